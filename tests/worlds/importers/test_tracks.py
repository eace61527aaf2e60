"""Recorded people: where the table has them, when it has them; broken tables are refused in one line."""

import csv
from collections import defaultdict

import numpy as np
import pytest

from tests.shared_data import data_files
from vuca_nav.errors import BadArgument, BadWorld
from worlds import MoverField, load_scene, make_world, save_scene
from worlds.importers.sources import Bringing
from worlds.importers.tracks import load_people, load_tracks
from worlds.world import Cylinder

TABLE = """t_s,ped_id,x_m,y_m
0.0,1,0.0,0.0
0.0,2,10.0,4.0
0.4,1,0.4,0.1
0.4,2,9.6,4.0
0.8,1,0.9,0.1
0.8,2,9.1,4.2
0.8,guest,5.0,5.0
1.2,guest,5.0,5.5
"""


def written(tmp_path, text=TABLE):
    path = tmp_path / "people.csv"
    path.write_text(text)
    return path


def test_people_come_walk_and_go_in_real_time(tmp_path):
    field = MoverField(load_tracks(written(tmp_path)))
    assert field.present.tolist() == [True, True, False]
    for _ in range(6):
        field.step(0.1)
    np.testing.assert_allclose(field.poses[:2, :2], [[0.65, 0.1], [9.35, 4.1]], atol=1e-9)
    for _ in range(4):
        field.step(0.1)
    assert field.present.tolist() == [False, False, True]
    np.testing.assert_allclose(field.poses[2, :2], (5.0, 5.25), atol=1e-9)


def test_other_headers_and_orders(tmp_path):
    _, *rows = TABLE.splitlines()
    by_person = sorted(rows, key=lambda row: row.split(",")[1])
    swapped = [",".join(["9", *row.split(",")[::-1]]) for row in by_person]
    text = "\n".join(["frame,y,x,id,time", *swapped]) + "\n\n"
    assert {m.motion for m in load_people(written(tmp_path, text))} == {
        m.motion for m in load_people(written(tmp_path, TABLE))
    }


def test_the_radius_is_as_stated(tmp_path):
    people = load_people(written(tmp_path), radius=0.4)
    assert all(p.radius == 0.4 and p.parts[0].shape == Cylinder(0.0, 0.0, 0.4, 1.7) for p in people)


def test_people_walk_in_any_world_besides_its_own_movers(tmp_path):
    bringing = Bringing(obstacles=f"tracks:{written(tmp_path)}")
    world = make_world("square", 1, movers=3, bringing=bringing)
    assert [m.kind for m in world.movers[3:]] == ["person"] * 3
    assert world.movers[:3] == make_world("square", 1, movers=3).movers
    with pytest.raises(BadArgument, match=r"--obstacles people\.csv: tracks:FILE"):
        make_world("square", 1, bringing=Bringing(obstacles="people.csv"))
    with pytest.raises(BadArgument, match="--without V"):
        make_world("square", 1, without="V", bringing=bringing)


def test_a_ground_of_their_own_is_crossed_along_its_longer_side(tmp_path):
    world = load_tracks(written(tmp_path))
    assert world.open_borders
    assert world.bounds == pytest.approx((-1.25, -1.25, 11.25, 6.75))
    assert abs(world.goal[0] - world.start.x) > 10.0
    save_scene(world, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == world


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (("0.8,2,9.1,4.2\n", "0.8,2,9.1,4.2\n0.8,2,9.0,4.2\n"), "line 8: person 2 is there twice at 0.8 s"),
        (("0.4,1,0.4,0.1\n0.4", "0.8,1,0.4,0.1\n0.4"), "person 1 is there twice"),
        (("0.0,1,0.0,0.0\n", "0.5,1,0.0,0.0\n"), "person 1 at 0.4 s comes after 0.5 s"),
        (("1.2,guest", "2.4,guest"), "line 9: person guest is missing from 0.8 s to 2.4 s"),
        (("9.6,4.0", "19.6,4.0"), "person 2 comes at 24.0 m/s"),
        (("0.9,0.1", "nan,0.1"), "line 6: x is 'nan'"),
        (("0.9,0.1", ",0.1"), "line 6: x is ''"),
        (("0.8,1,0.9,0.1", "0.8,1,0.9"), "line 6: 3 columns; 4 would be right"),
        (("0.0,2", "1e9,2"), "the time is '1e9'"),
        (("ped_id", "who"), "no column of the person in its first line"),
        ((TABLE, ""), "it is empty"),
        (("t_s", "frame"), "no column of the time"),
        ((TABLE, "t_s,ped_id,x_m,y_m\n"), "no rows"),
        ((TABLE, "t_s,ped_id,x_m,y_m\n\n,,,\n"), "no rows"),
        (("0.8,1,0.9", "0.8,,0.9"), "line 6: the person is missing"),
        ((TABLE, TABLE.replace("0.0,1,0.0,0.0\n0.0,2,10.0,4.0\n", "") + "0.0,3,1.0,1.0\n"), "comes after a later time"),
        (("guest", "\0"), "not a text"),
    ],
)
def test_a_broken_table_is_refused_in_one_line(tmp_path, change, text):
    with pytest.raises(BadWorld) as told:
        load_tracks(written(tmp_path, TABLE.replace(*change)))
    assert text in str(told.value)
    assert "\n" not in str(told.value)


def test_something_else_than_a_table_is_refused(tmp_path):
    path = tmp_path / "people.csv"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(BadWorld, match="not a text"):
        load_tracks(path)
    with pytest.raises(BadWorld, match="cannot be read"):
        load_tracks(tmp_path / "none.csv")


@pytest.mark.parametrize("path", data_files("pedestrians/*.csv"))
def test_public_recordings_are_exact(path, tmp_path):
    rows = defaultdict(list)
    with open(path, encoding="utf-8") as file:
        for row in csv.DictReader(file):
            rows[row["ped_id"]].append(tuple(float(row[name]) for name in ("t_s", "x_m", "y_m")))
    world = load_tracks(path)
    field = MoverField(world)
    for _ in range(200):
        for k, own in enumerate(rows.values()):
            times, xs, ys = zip(*own)
            if times[0] - 1e-7 > field.time or field.time > times[-1] + 1e-7:
                assert not field.present[k] or min(abs(field.time - times[0]), abs(field.time - times[-1])) < 1e-5
                continue
            wanted = np.interp(field.time, times, xs), np.interp(field.time, times, ys)
            np.testing.assert_allclose(field.poses[k, :2], wanted, rtol=0, atol=1e-9)
        field.step(0.31)
    save_scene(world, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == world


def test_nobody_comes_where_the_robot_starts_while_the_episode_begins(tmp_path):
    default = load_tracks(written(tmp_path)).start
    visitor = f"1.0,late,{default.x},{default.y}\n1.4,late,{default.x},{default.y}\n"
    rows = sorted((TABLE + visitor).splitlines()[1:], key=lambda row: float(row.split(",")[0]))
    start = load_tracks(written(tmp_path, "\n".join([TABLE.splitlines()[0], *rows]))).start
    assert np.hypot(start.x - default.x, start.y - default.y) > 1.0
