"""Damaged scene files: each is refused in one line, or makes a world that compiles and moves."""

import copy
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz import FAST, SLOW
from vuca_nav.errors import VucaError
from worlds.importers.scene_file import save_scene
from worlds.mjcf import build_arena
from worlds.motion.movers import MoverField
from worlds.registry import make_world

EXAMPLE = Path(__file__).parents[3] / "docs" / "scene-format.md"
TEXT = EXAMPLE.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
SCENE = yaml.safe_load(TEXT)
PERSON = {
    "kind": "person",
    "radius": 0.3,
    "start": {"x": 8.0, "y": 2.0, "yaw": 0.0},
    "motion": {"type": "social_force", "speed": 1.0, "waypoints": [{"x": 8.0, "y": 2.0}, {"x": 8.0, "y": 6.0}]},
    "parts": [{"shape": {"type": "cylinder", "x": 0.0, "y": 0.0, "radius": 0.3, "height": 1.7}}],
}
BODIES = ((0.2843, 1.262), (0.4, 0.42))
"""Radius and height of bodies [m]."""


def places(value, path=()):
    """Paths of all values of a tree."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


FULL = {**SCENE, "movers": [*SCENE["movers"], PERSON], "ways": [{"name": "left", "box": SCENE["bounds"]}]}
PLACES = [path for path in places(FULL) if path]
numbers = st.one_of(
    st.floats(-20.0, 20.0),
    st.floats(),
    st.integers(-3, 12),
    st.integers(),
    st.sampled_from([0, -0.0, 1e-9, 1e-320, 5e-7, 1e5, 1e300, 2**64, 10**39, math.inf, -math.inf, math.nan]),
)
scalars = st.one_of(numbers, st.text(max_size=12), st.booleans(), st.none(), st.sampled_from(["box", "patrol", "low"]))
trees = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=6), inner, max_size=4)),
    max_leaves=8,
)


@st.composite
def damaged(draw):
    """A scene with some of its values replaced, left out, repeated, moved to another place or put beside others."""
    scene = copy.deepcopy(FULL)
    for _ in range(draw(st.integers(1, 4))):
        path = draw(st.sampled_from(PLACES))
        try:
            at = scene
            for key in path[:-1]:
                at = at[key]
            value = at[path[-1]]
        except (KeyError, IndexError, TypeError):  # it was taken away before
            continue
        how = draw(st.sampled_from(["number", "number", "nudge", "tree", "drop", "repeat", "other", "key"]))
        if how == "drop":
            del at[path[-1]]
        elif how == "nudge" and isinstance(value, int | float):
            at[path[-1]] = value + draw(st.floats(-1.0, 1.0))
        elif how == "repeat" and isinstance(at, list):
            at.insert(path[-1], copy.deepcopy(value))
        elif how == "key" and isinstance(at, dict):
            at[draw(st.text(max_size=8))] = value
        elif how == "other":
            source = draw(st.sampled_from(PLACES))
            other = FULL
            for key in source:
                other = other[key]
            at[path[-1]] = copy.deepcopy(other)
        else:
            at[path[-1]] = draw(numbers if how == "number" else trees)
    return scene


def refused_or_usable(path: Path) -> bool:
    """Whether a scene file is accepted; it then makes a model and moves, and is otherwise refused in one line."""
    worlds = []
    for radius, height in BODIES:
        try:
            worlds.append(make_world(str(path), 0, footprint_radius=radius, height=height))
        except VucaError as error:
            text = str(error)
            assert str(path) in text
            assert len(text.splitlines()) == 1
            assert len(text) < 500 + len(str(path))
            assert text.isprintable()
    if not worlds:
        return False
    world = worlds[0]
    mujoco.MjModel.from_xml_string(build_arena(world).to_xml_string())  # type: ignore[attr-defined]
    field = MoverField(world)
    (x0, y0, x1, y1), places = world.bounds, []
    for _ in range(30):
        field.step(1 / 30, (world.start.x, world.start.y, 0.3))
        places.append(field.poses[:, :2].copy())
    if world.movers:
        x, y = np.concatenate(places).T
        assert ((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)).all()
    save_scene(world, path)
    assert make_world(str(path), 0, footprint_radius=BODIES[0][0], height=1.0) is not None
    return True


def check_tree(tmp_path, scene):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.dump(scene, allow_unicode=True), encoding="utf-8", errors="surrogatepass")
    refused_or_usable(path)


def check_bytes(tmp_path, content, edits):
    path, damaged = tmp_path / "scene.yaml", bytearray(content)
    for at, removed, added in edits:
        damaged[at : at + removed] = added
    path.write_bytes(bytes(damaged))
    refused_or_usable(path)


edits = st.lists(
    st.tuples(
        st.integers(0, len(TEXT)),
        st.integers(0, 20),
        st.one_of(
            st.binary(max_size=4),
            st.sampled_from(
                [b"&a ", b"*a", b"!!int ", b"<<: ", b"- ", b"[", b"{", b"}", b"\n", b"---\n", b"1e1", b"'"]
            ),
        ),
    ),
    min_size=1,
    max_size=5,
)


def test_the_undamaged_scene_is_usable(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(FULL))
    assert refused_or_usable(path)


@FAST
@given(scene=damaged())
def test_damaged_trees(tmp_path, scene):
    check_tree(tmp_path, scene)


@FAST
@given(edits=edits)
def test_damaged_bytes(tmp_path, edits):
    check_bytes(tmp_path, TEXT.encode(), edits)


@pytest.mark.slow
@SLOW
@given(scene=damaged())
def test_many_damaged_trees(tmp_path, scene):
    check_tree(tmp_path, scene)


@pytest.mark.slow
@SLOW
@given(edits=edits)
def test_many_damaged_bytes(tmp_path, edits):
    check_bytes(tmp_path, TEXT.encode(), edits)
