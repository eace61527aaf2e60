"""``vuca import``: what it writes, what it says, and that the world comes back."""

import json
import os

import numpy as np
import pytest
from PIL import Image

from vuca_nav.errors import BadArgument, BadWorld
from worlds import load_scene, make_world
from worlds.importers.commands import import_
from worlds.importers.sources import Bringing, kind_of, load_world

TABLE = "time,id,x,y\n0,1,0,0\n1,1,1,0\n"


@pytest.fixture
def room(tmp_path):
    Image.fromarray(np.full((30, 40), 254, np.uint8)).save(tmp_path / "room.png")
    path = tmp_path / "room.yaml"
    path.write_text("image: room.png\nresolution: 0.1\norigin: [0, 0, 0.3]\nnegate: 0\n")
    return path


def test_a_map_becomes_a_scene(room, tmp_path, capsys):
    out = tmp_path / "scene.yaml"
    task = ["--start", "1", "2", "0", "--goal", "2", "2", "--tolerance", "0.5", "--time-limit", "40"]
    picture = tmp_path / "room-drawn.png"
    assert import_([str(room), "--out", str(out), *task, "--picture", str(picture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (told["shapes"], told["movers"], told["start"], told["goal"]) == (4, 0, [1.0, 2.0, 0.0], [2.0, 2.0])
    world = load_scene(out)
    assert (world.tolerance, world.time_limit) == (0.5, 40.0)
    bringing = Bringing((1, 2, 0), (2, 2), 0.5, 40)
    assert make_world(f"map:{room}", 3, footprint_radius=0.3, bringing=bringing) == world
    assert Image.open(picture).width > 200
    again = tmp_path / "again.yaml"
    assert import_([str(out), "--out", str(again)]) == 0
    assert again.read_text() == out.read_text()


def test_people_go_into_a_map_with_their_radius(room, tmp_path):
    table = tmp_path / "people.csv"
    table.write_text(TABLE)
    out = tmp_path / "scene.yaml"
    assert import_([str(room), "--obstacles", f"tracks:{table}", "--radius", "0.2", "--out", str(out)]) == 0
    assert [mover.radius for mover in load_scene(out).movers] == [0.2]


def test_a_name_that_no_scene_has_is_written_as_one(room, tmp_path):
    odd = tmp_path / "ro\x01om\u2028.yaml"
    odd.write_text(room.read_text())
    assert import_([f"map:{odd}", "--out", str(tmp_path / "scene.yaml")]) == 0
    assert load_scene(tmp_path / "scene.yaml").name == "ro_om_"


def test_what_is_read_is_not_written_over(room, tmp_path):
    table = tmp_path / "people.csv"
    table.write_text(TABLE)
    people = ["--obstacles", f"tracks:{table}"]
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments in (
        ["--out", str(room)],
        ["--out", "-", "--picture", str(tmp_path / "room.png")],
        ["--out", str(table), *people],
    ):
        with pytest.raises(BadArgument, match="it is the file that is read"):
            import_([f"map:{room}", *arguments])
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("option", ["--tolerance", "--time-limit", "--radius"])
@pytest.mark.parametrize("value", ["nan", "inf", "0", "-1"])
def test_numbers_that_no_task_has_are_refused(room, option, value):
    with pytest.raises(BadArgument, match=f"{option} {value}: above 0, up to"):
        import_([f"map:{room}", "--out", "-", option, value])


def test_a_dry_run_writes_nothing(room, tmp_path):
    before = sorted(os.listdir(tmp_path))
    assert import_([f"map:{room}", "--out", "-"]) == 0
    assert sorted(os.listdir(tmp_path)) == before


def test_the_name_tells_what_a_file_is(room, tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text("format: vuca-scene-1\n")
    marked = tmp_path / "marked.yaml"
    marked.write_text("\ufeff" + room.read_text(), encoding="utf-8")
    assert kind_of(marked) == "map"
    names = {"a.world": "barn", "a.sdf": "barn", "a.json": "barn", "dynabarn_1.json": "dynabarn", "a.csv": "tracks"}
    assert {name: kind_of(tmp_path / name) for name in names} == names
    assert (kind_of(room), kind_of(scene)) == ("map", "scene")
    with pytest.raises(BadArgument, match=r"a.txt: its name does not tell what it is; map:FILE"):
        kind_of(tmp_path / "a.txt")


def test_a_map_that_is_taken_for_a_scene_is_told(room):
    with pytest.raises(BadWorld, match="it names an image, as an occupancy map does; map:"):
        load_world(str(room))


def test_a_pipe_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "scene.yaml")
    with pytest.raises(BadWorld, match="is a pipe"):
        import_([str(tmp_path / "scene.yaml"), "--out", "-"])
