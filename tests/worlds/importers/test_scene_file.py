"""Scene files: exact round trips, and bad files answered with the path of the bad field."""

import copy
import json
import math
import os
from dataclasses import replace

import mujoco
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds import WORLDS, load_scene, make_world, save_scene
from worlds.importers.scene_file import SCHEMA_FILE
from worlds.mjcf import build_arena
from worlds.motion.movers import MoverField
from worlds.shortest_path import shortest_path_length
from worlds.world import (
    MOVER_KINDS,
    OBSTACLE_KINDS,
    Box,
    Cylinder,
    Mover,
    MoverPart,
    Obstacle,
    Patrol,
    RandomWalk,
    SocialForce,
    World,
)

SMALL = {
    "format": "vuca-scene-1",
    "name": "small",
    "seed": 0,
    "bounds": {"x_min": 0.0, "y_min": 0.0, "x_max": 10.0, "y_max": 8},
    "start": {"x": 1.0, "y": 1.0, "yaw": 0.0},
    "goal": {"x": 9, "y": 7.0},
    "obstacles": [
        {"kind": "wall", "shape": {"type": "box", "x": 5, "y": 0.1, "length": 10, "width": 0.2, "yaw": 0, "height": 2}},
        {"kind": "pillar", "shape": {"type": "cylinder", "x": 5, "y": 4, "radius": 0.5, "height": 2, "base": 0}},
    ],
    "movers": [
        {
            "kind": "cylinder",
            "radius": 0.3,
            "start": {"x": 3, "y": 4, "yaw": 0},
            "motion": {"type": "random_walk", "speed": 0.5, "seed": 7},
            "parts": [{"shape": {"type": "cylinder", "x": 0, "y": 0, "radius": 0.3, "height": 1}}],
        },
        {
            "kind": "legs",
            "radius": 0.4,
            "start": {"x": 2, "y": 6, "yaw": 0},
            "motion": {"type": "patrol", "speed": 0.5, "waypoints": [{"x": 2, "y": 6}, {"x": 8, "y": 6}]},
            "parts": [
                {"shape": {"type": "cylinder", "x": 0, "y": 0.1, "radius": 0.08, "height": 0.9}, "swing": 0.2},
                {"shape": {"type": "cylinder", "x": 0, "y": -0.1, "radius": 0.08, "height": 0.9}, "swing": -0.2},
            ],
        },
    ],
}


def write(tmp_path, document):
    path = tmp_path / "scene.yaml"
    path.write_text(document if isinstance(document, str) else yaml.safe_dump(document))
    return path


def changed(path, value):
    """The small scene with one field set (or deleted, if the value is ``...``)."""
    document = copy.deepcopy(SMALL)
    at = document
    for key in path[:-1]:
        at = at[key]
    if value is ...:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return document


def test_the_schema_is_a_schema():
    Draft202012Validator.check_schema(json.loads(SCHEMA_FILE.read_text()))


def test_a_small_scene(tmp_path):
    world = load_scene(write(tmp_path, SMALL))
    assert world.bounds == (0.0, 0.0, 10.0, 8.0)
    assert world.obstacles[1] == Obstacle("pillar", Cylinder(5.0, 4.0, 0.5, 2.0))
    assert world.movers[1].parts[1].swing == -0.2
    assert world.movers[0].motion == RandomWalk(0.5, 7)
    assert isinstance(world.goal[0], float)


@pytest.mark.parametrize("name", sorted(WORLDS))
def test_generated_worlds_come_back_equal(name, tmp_path):
    for seed in range(3):
        world = make_world(name, seed)
        save_scene(world, tmp_path / "scene.yaml")
        assert load_scene(tmp_path / "scene.yaml") == world


real = st.floats(-1e3, 1e3)
size = st.floats(1e-6, 1e2)
shape = st.one_of(
    st.builds(Box, real, real, size, size, real, size, st.floats(0.0, 10.0)),
    st.builds(Cylinder, real, real, size, size, st.floats(0.0, 10.0)),
)
point = st.tuples(real, real)
motion = st.one_of(
    st.builds(RandomWalk, st.floats(0.0, 5.0), st.integers(0, 2**64 - 1)),
    st.builds(Patrol, st.floats(0.0, 5.0), st.lists(point, min_size=1, max_size=3).map(tuple)),
    st.builds(SocialForce, st.floats(0.0, 5.0), st.lists(point, min_size=1, max_size=3).map(tuple)),
)
mover = st.builds(
    Mover,
    st.sampled_from(MOVER_KINDS),
    st.lists(st.builds(MoverPart, shape, real), min_size=1, max_size=3).map(tuple),
    size,
    st.builds(Pose2, real, real, real),
    motion,
)
any_world = st.builds(
    World,
    st.text("abc -:#'\"é", min_size=1),
    st.integers(0, 2**40),
    st.tuples(real, real, real, real),
    st.lists(st.builds(Obstacle, st.sampled_from(OBSTACLE_KINDS), shape, st.booleans()), max_size=4).map(tuple),
    st.lists(mover, max_size=3).map(tuple),
    st.builds(Pose2, real, real, real),
    point,
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(world=any_world)
def test_the_format_is_exact_for_any_numbers(world, tmp_path, monkeypatch):
    """Of the format alone, so the check of what makes sense is left out."""
    monkeypatch.setattr("worlds.importers.scene_file.check_world", lambda world, source: None)
    save_scene(world, tmp_path / "any.yaml")
    assert load_scene(tmp_path / "any.yaml") == world


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("obstacles", 1, "shape", "radius"), -1, "obstacles[1].shape.radius: -1 is less than or equal to the minimum"),
        (("obstacles", 1, "shape", "base"), -0.5, "obstacles[1].shape.base: -0.5 is less than the minimum of 0"),
        (("obstacles", 1, "shape", "radius"), "big", "obstacles[1].shape.radius: 'big' is not a number"),
        (("obstacles", 1, "shape", "radius"), ..., "obstacles[1].shape: radius missing"),
        (("obstacles", 1, "shape", "yaw"), 0.0, "obstacles[1].shape: unknown field yaw; its fields are type, x,"),
        (("obstacles", 1, "shape", "type"), "cone", "obstacles[1].shape.type: 'cone' is not one of box, cylinder"),
        (("obstacles", 0, "kind"), "fence", "obstacles[0].kind: 'fence' is not one of wall, block, shelf"),
        (("obstacles",), {}, "obstacles: {} is not a list"),
        (("movers", 0, "motion", "speed"), 9, "movers[0].motion.speed: 9 is greater than the maximum of 5"),
        (("movers", 0, "motion", "seed"), 1.5, "movers[0].motion.seed: 1.5 is not an integer"),
        (("movers", 0, "parts"), [], "movers[0].parts: "),
        (("movers", 1, "motion", "waypoints", 1, "x"), ..., "movers[1].motion.waypoints[1]: x missing"),
        (("start", "x"), math.nan, "start.x: nan is not a finite number"),
        (("bounds", "x_max"), math.inf, "bounds.x_max: inf is not a finite number"),
        (("bounds", "x_max"), -3.0, "bounds.x_max: -3 is not greater than x_min, which is 0"),
        (("bounds", "x_max"), 201, "bounds.x_max: 201 m from x_min; 200 m or less would be right"),
        (("bounds", "x_max"), 1e6, "bounds.x_max: 1000000.0 is greater than the maximum of 10000"),
        (("start", "x"), 1e6, "start.x: 1000000.0 is greater than the maximum of 10000"),
        (("obstacles", 1, "shape", "height"), 0.04, "obstacles[1]: its top is 0.04 m above the floor"),
        (("movers", 0, "parts", 0, "shape", "height"), 0.02, "movers[0]: its top is 0.02 m above the floor"),
        (("obstacles", 1, "outer"), 1, "obstacles[1].outer: 1 is not true or false"),
        (("movers", 0, "start", "x"), 9.8, "movers[0].start: (9.8, 4) is 0.20 m from the bounds; 0.3 m around it"),
        (("format",), "vuca-scene-9", "format: 'vuca-scene-9' should be 'vuca-scene-1'"),
        (("colour",), "red", "the file: unknown field colour; its fields are format, name"),
        (("goal",), {"x": 5.1, "y": 4.2}, "goal: (5.1, 4.2) is inside obstacles[1] (a pillar)"),
        (("start", "y"), 0.1, "start: (1, 0.1) is inside obstacles[0] (a wall)"),
        (("goal", "y"), 11.0, "goal: (9, 11) is out of bounds; x from 0 to 10 and y from 0 to 8"),
        (("movers", 0, "start", "x"), 5.0, "movers[0].start: (5, 4) is inside obstacles[1]"),
        (("movers", 0, "start", "x"), 4.3, "movers[0].start: (4.3, 4) is 0.20 m from obstacles[1] (a pillar)"),
        (("movers", 0, "start", "y"), 7.65, "movers[0].start: random walkers keep to ways of 2.2 m"),
        (("movers", 0, "radius"), 0.2, "movers[0].radius: 0.2 does not hold the parts; 0.300 or more"),
        (("movers", 1, "start", "x"), 2.5, "movers[1].motion.waypoints[0]: a patrol starts at its first waypoint"),
        (("movers", 1, "motion", "waypoints", 1), {"x": 8, "y": 2}, "movers[1].motion.waypoints[1]: on the straight"),
    ],
)  # fmt: skip
def test_a_bad_field_is_named(path, value, message, tmp_path):
    file = write(tmp_path, changed(path, value))
    with pytest.raises(BadWorld) as caught:
        load_scene(file)
    text = str(caught.value)
    assert text.startswith(f"{file}: {message}")
    assert "\n" not in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: [1, 2", "not YAML"),
        ("", "the file: None is not a mapping"),
        ("- 1\n- 2\n", "the file: [1, 2] is not a mapping"),
        ("name: !!python/object:os.system {}", "not YAML"),
        ("name: a\nseed: 0\nname: b\n", "line 3, column 1: not YAML: the key 'name' a second time"),
        ("goal: {x: 1, y: 2, x: 3}\n", "line 1, column 20: not YAML: the key 'x' a second time"),
    ],
)
def test_broken_files(text, message, tmp_path):
    with pytest.raises(BadWorld, match=r"scene.yaml: ") as caught:
        load_scene(write(tmp_path, text))
    assert message in str(caught.value)


def test_files_that_cannot_be_read_or_written(tmp_path):
    with pytest.raises(BadWorld, match="No such file"):
        load_scene(tmp_path / "none.yaml")
    with pytest.raises(BadWorld, match="Is a directory"):
        load_scene(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(BadWorld, match="not a text in UTF-8"):
        load_scene(tmp_path / "binary.yaml")
    with pytest.raises(BadWorld, match="cannot be written"):
        save_scene(make_world("static", 0), tmp_path / "no" / "such" / "folder.yaml")


def leaves(value, path=()):
    if isinstance(value, dict):
        for key, item in value.items():
            yield from leaves(item, (*path, key))
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from leaves(item, (*path, i))
    else:
        yield path


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(path=st.sampled_from(list(leaves(SMALL))), value=st.sampled_from([None, [], {}, ..., math.nan, "?"]))
def test_any_spoilt_leaf_is_refused_in_one_line(path, value, tmp_path):
    if path == ("name",) and value == "?":
        return
    optional = path[-1] in ("base", "swing") and value is ...
    file = write(tmp_path, changed(path, value))
    if optional:
        load_scene(file)
        return
    with pytest.raises(BadWorld) as caught:
        load_scene(file)
    text = str(caught.value)
    assert str(path[0]) in text
    assert "\n" not in text


def test_the_documented_example_is_a_scene(tmp_path):
    world = load_scene(documented_example(tmp_path))
    assert world.name == "two rooms"
    assert shortest_path_length(world, 0.35) < 14.0


def documented_example(tmp_path):
    text = (SCHEMA_FILE.parents[2] / "docs" / "scene-format.md").read_text()
    return write(tmp_path, text.split("```yaml\n")[1].split("```")[0])


def test_the_documented_example_without_corridors_is_one_room(tmp_path):
    opened = make_world(str(documented_example(tmp_path)), 0, without="C")
    assert sum(o.kind == "wall" for o in opened.obstacles) == 4


def test_something_low_is_counted_from_the_floor(tmp_path):
    """A slab of 0.02 m that hangs at 0.5 m is seen and hit."""
    shape = {"type": "box", "x": 5, "y": 7.5, "length": 1, "width": 0.4, "yaw": 0, "height": 0.02, "base": 0.5}
    document = changed(("obstacles", 1, "shape"), shape)
    assert load_scene(write(tmp_path, document)).obstacles[1].shape.base == 0.5


def refusal(tmp_path, document) -> str:
    """The line that a scene is refused with, after the file's name."""
    file = write(tmp_path, document)
    with pytest.raises(BadWorld) as caught:
        load_scene(file)
    text = str(caught.value)
    assert text.startswith(f"{file}: ")
    assert "\n" not in text
    return text.removeprefix(f"{file}: ")


def test_a_bad_field_has_its_line(tmp_path):
    text = yaml.safe_dump(SMALL).replace("radius: 0.5", "radius: -1")
    number = 1 + text[: text.index("radius: -1")].count("\n")
    assert refusal(tmp_path, text).endswith(f"(line {number})")
    inside = yaml.safe_dump(changed(("goal",), {"x": 5.1, "y": 4.2}))
    number = 1 + inside[: inside.index("  x: 5.1")].count("\n")
    assert refusal(tmp_path, inside).endswith(f"(line {number})")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- " * 4000, "line 1, column 65: "),
        ("&a [*a]", "*a refers to itself"),
        ("seed: !!int abc", "line 1, column 7: seed: a tag"),
        (
            "format: vuca-scene-1\nstart: {x: " + "9" * 5000 + "}",
            "line 2, column 12: start.x: an integer of 5000 digits",
        ),
    ],
)
def test_yaml_that_is_more_than_data_is_refused(tmp_path, text, message):
    assert message in refusal(tmp_path, text)


def test_numbers_are_read_as_they_are_written(tmp_path):
    document = yaml.safe_dump(changed(("goal",), {"x": 9, "y": 7.0}))
    world = load_scene(write(tmp_path, document.replace("x: 9\n", "x: 010\n").replace("x_max: 10.0", "x_max: 1.1e1")))
    assert world.goal == (10.0, 7.0)
    assert world.bounds[2] == 11.0
    assert "seed: '1_0' is not an integer" in refusal(tmp_path, document.replace("seed: 0", "seed: 1_0"))
    assert "outer: 'yes' is not true or false" in refusal(tmp_path, changed(("obstacles", 0, "outer"), "yes"))


@pytest.mark.parametrize(
    "name",
    ["a\x01b", "a\nb", "tab\t", "a/b", "del\x7f", "nel\x85", "\u2028", "\ufffe", "x" * 101, ""],
)
def test_names_that_are_no_line_of_xml_are_refused(tmp_path, name):
    assert refusal(tmp_path, changed(("name",), name)).startswith("name: ")
    ways = [{"name": name, "box": SMALL["bounds"]}]
    assert refusal(tmp_path, {**SMALL, "ways": ways}).startswith("ways[0].name: ")


@pytest.mark.parametrize("name", ["tiago", "world", '<a href="&amp;">', " ", "räum 中 😀", "1e1", "0o7", "yes", "~"])
def test_other_names_are_kept_and_compiled(tmp_path, name):
    world = replace(load_scene(write(tmp_path, SMALL)), name=name)
    save_scene(world, tmp_path / "again.yaml")
    assert load_scene(tmp_path / "again.yaml") == world
    mujoco.MjModel.from_xml_string(build_arena(world).to_xml_string())  # type: ignore[attr-defined]


def test_numbers_that_are_nearly_zero_compile(tmp_path):
    """MuJoCo takes a subnormal number in XML for one that is too large."""
    document = changed(("obstacles", 0, "shape", "yaw"), 1e-320)
    document["movers"][0]["start"]["yaw"] = document["obstacles"][1]["shape"]["base"] = 5e-324
    document["movers"][1]["parts"][0]["shape"]["y"] = 1e-310
    world = load_scene(write(tmp_path, document))
    mujoco.MjModel.from_xml_string(build_arena(world).to_xml_string())  # type: ignore[attr-defined]


def test_an_unknown_field_gets_a_guess_and_a_short_line(tmp_path):
    document = changed(("obstacles", 1, "shape", "radius"), ...)
    document["obstacles"][1]["shape"]["radios"] = 0.5
    text = refusal(tmp_path, document)
    assert "obstacles[1].shape: unknown field radios; its fields are type, x, y, radius, " in text
    assert "did you mean 'radius'?" in text
    for document in ({**SMALL, "\x1b[2J" + "y" * 1000: 1}, {**SMALL, "start": {"\x1b[2J": math.inf}}):
        text = refusal(tmp_path, document)
        assert "\x1b" not in text
        assert len(text) < 300


def test_a_list_that_is_too_long_is_refused_without_being_shown(tmp_path):
    entry = "- {kind: wall, shape: {type: box, x: 5, y: 0.1, length: 10, width: 0.2, yaw: 0, height: 2}}\n"
    empty = yaml.safe_dump({**SMALL, "obstacles": []})
    text = refusal(tmp_path, empty.replace("obstacles: []\n", "obstacles:\n" + entry * 10_001))
    assert text.startswith("obstacles: it has 10001 entries; at most 10000")
    text = refusal(tmp_path, empty.replace("obstacles: []\n", "obstacles:\n" + "- {}\n" * 10_001))
    assert text.startswith("obstacles[0]: kind, shape missing (line ")
    assert len(text) < 300


def pedestrian(x, y, *waypoints, radius=0.3):
    return {
        "kind": "person",
        "radius": radius,
        "start": {"x": x, "y": y, "yaw": 0},
        "motion": {"type": "social_force", "speed": 1.0, "waypoints": [{"x": x, "y": y} for x, y in waypoints]},
        "parts": [{"shape": {"type": "cylinder", "x": 0, "y": 0, "radius": radius, "height": 1.7}}],
    }


def patrol(*waypoints, radius=0.3):
    (x, y), *_ = waypoints
    mover = pedestrian(x, y, *waypoints, radius=radius)
    return {**mover, "motion": {**mover["motion"], "type": "patrol"}}


def walker(x, y):
    return {**pedestrian(x, y), "motion": {"type": "random_walk", "speed": 1.0, "seed": 3}}


A, B = (2.0, 6.0), (8.0, 6.0)


@pytest.mark.parametrize("kind", [walker, lambda x, y: pedestrian(x, y, A, B), lambda x, y: patrol((x, y), A, B)])
def test_movers_that_overlap_at_the_start_are_refused(tmp_path, kind):
    for gap in (0.0, 0.3, 0.59):
        text = refusal(tmp_path, {**SMALL, "movers": [kind(*A), kind(8.0, 6.5), kind(A[0] + gap, A[1])]})
        assert "movers[2].start: it overlaps movers[0] (a person), which starts at (2, 6); 0.6 m or more" in text
    assert len(load_scene(write(tmp_path, {**SMALL, "movers": [kind(*A), kind(A[0] + 0.6, A[1])]})).movers) == 2


@pytest.mark.parametrize(
    ("mover", "message"),
    [
        (pedestrian(2, 6, (12.0, 6.0)), "movers[0].motion.waypoints[0]: (12, 6) is out of bounds"),
        (pedestrian(2, 6, (2.0, 6.0), (8.0, 9.0)), "movers[0].motion.waypoints[1]: (8, 9) is out of bounds"),
        (patrol(A, (11.0, 6.0), radius=0.05), "movers[0].motion.waypoints[1]: (11, 6) is out of bounds"),
        (patrol(A, B, (5.0, 4.2)), "movers[0].motion.waypoints[2]: (5, 4.2) is inside obstacles[1] (a pillar)"),
        (pedestrian(2, 4, (8.0, 4.0)), "movers[0].motion.waypoints[0]: on the straight way"),
        (pedestrian(2, 4, (2.0, 4.0), A, B, (8.0, 4.0)), "movers[0].motion.waypoints[0]: on the straight way"),
        (pedestrian(2, 4, B, (8.0, 4.0), A), "movers[0].motion.waypoints[1]: on the straight way"),
        (patrol(A), "movers[0].motion.waypoints: a patrol of 0 m; two waypoints or more"),
        (patrol(A, A, A), "movers[0].motion.waypoints: a patrol of 0 m"),
        (patrol(A, (2.0, 6.01)), "movers[0].motion.waypoints: a patrol of 0.01 m"),
    ],
)  # fmt: skip
def test_waypoints_that_cannot_be_walked_are_refused(tmp_path, mover, message):
    assert refusal(tmp_path, {**SMALL, "movers": [mover]}).startswith(message)


def test_a_pedestrian_may_have_one_place_to_stand_at(tmp_path):
    world = load_scene(write(tmp_path, {**SMALL, "movers": [pedestrian(2, 6, (3.0, 6.0))]}))
    field = MoverField(world)
    for _ in range(300):
        field.step(1 / 30)
    assert field.poses[0, :2] == pytest.approx((3.0, 6.0), abs=0.5)


def test_obstacles_many_layers_deep_are_refused(tmp_path):
    """Each would be stamped all over the grids."""
    slab = {"kind": "wall", "shape": {"type": "box", "x": 5, "y": 4, "length": 50, "width": 50, "yaw": 1, "height": 1,
                                      "base": 9}}  # fmt: skip
    assert "obstacles: together they cover the bounds 30 times" in refusal(
        tmp_path, {**SMALL, "obstacles": [slab] * 30}
    )
    assert load_scene(write(tmp_path, {**SMALL, "obstacles": [slab] * 5})).obstacles


def test_a_scene_is_read_from_a_regular_file_only(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(BadWorld, match=r"pipe.yaml is a pipe; the path of a regular file"):
        load_scene(tmp_path / "pipe.yaml")
    (tmp_path / "mark.yaml").write_bytes(b"\xef\xbb\xbf" + yaml.safe_dump(SMALL).encode())
    assert load_scene(tmp_path / "mark.yaml").name == "small"
