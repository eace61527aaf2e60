"""Other people's files, damaged at random: refused in one line, or a world that moves and can be saved."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from tests.fuzz import FAST, SLOW
from vuca_nav.errors import VucaError
from worlds import MoverField, load_scene, save_scene
from worlds.importers.sources import load_world
from worlds.motion.phases import drawn

MAP = b"image: room.png\nresolution: 0.1\norigin: [-1.0, 2.0, 0.3]\nnegate: 0\nfree_thresh: 0.196\nmode: scale\n"
BARN = json.dumps(
    {
        "start": [0.0, 0.0, 1.57],
        "goal": [3.0, 3.0],
        "cylinders": [[1.0, 1.0, 0.1, 1.0]],
        "boxes": [[2.0, -1.0, 0.3, 1.0, 0.5, 1.0]],
        "moving": [
            {
                "shape": "cylinder",
                "radius": 0.3,
                "height": 1.0,
                "period_s": 9.0,
                "loop": True,
                "keyframes": [[0.0, -3.0, 2.0], [4.0, -1.0, 2.0], [9.0, -3.0, 4.0]],
            }
        ],
    }
).encode()
SDF = (
    b"<sdf version='1.6'><world name='w'><model name='m'><pose frame=''>-1 6 0 0 0 0.2</pose><link name='l'>"
    b"<collision name='c'><geometry><cylinder><radius>0.1</radius><length>1</length></cylinder></geometry></collision>"
    b"</link></model></world></sdf>"
)
PEOPLE = (
    b"t_s,ped_id,x_m,y_m\n0.0,1,0.0,0.0\n0.0,2,9.0,4.0\n0.4,1,0.4,0.1\n0.4,2,8.6,4.0\n0.8,1,0.9,0.1\n0.8,2,8.1,4.2\n"
)
FILES = {
    "map:room.yaml": MAP,
    "barn:world.world": SDF,
    "dynabarn:world.json": BARN,
    "tracks:people.csv": PEOPLE,
    "map:image": b"",
}

edits = st.lists(
    st.tuples(
        st.integers(0, 700),
        st.integers(0, 12),
        st.one_of(
            st.binary(max_size=4),
            st.sampled_from(
                [b"1e9", b"-", b"nan", b"0", b"[", b"]", b"{", b",", b"\n", b"<", b"/>", b"&a;", b'"', b"1e-9"]
            ),
        ),
    ),
    min_size=1,
    max_size=4,
)


def spoilt(content, edits):
    damaged = bytearray(content)
    for at, removed, added in edits:
        at %= len(damaged) + 1
        damaged[at : at + removed] = added
    return bytes(damaged)


def loaded(name):
    try:
        return load_world(name), ""
    except VucaError as error:
        return None, str(error)


def check(tmp_path, name, edits):
    image = tmp_path / "room.png"
    pixels = np.full((30, 40), 254, np.uint8)
    pixels[5:8, 10:30] = 0
    Image.fromarray(pixels).save(image)
    kind, _, file = name.partition(":")
    if file == "image":
        (tmp_path / "room.yaml").write_bytes(MAP)
        image.write_bytes(spoilt(image.read_bytes(), edits))
        file = "room.yaml"
    else:
        (tmp_path / file).write_bytes(spoilt(FILES[name], edits))
    world, message = loaded(f"{kind}:{tmp_path / file}")
    if world is None:
        assert message.isprintable()  # in one line
        return
    save_scene(world, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == world
    try:
        world = drawn(world, 0)
    except VucaError:  # a mover stands where the robot starts
        return
    field = MoverField(world)
    for _ in range(30):
        field.step(0.1)
    assert np.isfinite(field.poses[field.present]).all()


@pytest.mark.parametrize("name", FILES)
def test_undamaged_files_load(name, tmp_path):
    check(tmp_path, name, [])


@pytest.mark.parametrize("name", FILES)
@FAST
@given(edits=edits)
def test_damaged_files(name, tmp_path, edits):
    check(tmp_path, name, edits)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
@SLOW
@given(edits=edits)
def test_many_damaged_files(name, tmp_path, edits):
    check(tmp_path, name, edits)
