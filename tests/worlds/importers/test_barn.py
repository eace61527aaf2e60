"""Worlds of BARN and DynaBARN: cylinders where the source has them, keyframes to 1e-9, broken files in one line."""

import json
import math

import numpy as np
import pytest

from tests.shared_data import data_files
from vuca_nav.errors import BadWorld
from worlds import MoverField, load_scene, make_world, save_scene
from worlds.importers.barn import load_barn, load_dynabarn
from worlds.world import Box, Cylinder, Keyframes

CYLINDERS = [[-1.5, 5.0, 0.075, 1.0], [-3.0, 7.5, 0.25, 0.8]]


def sdf_of(models, extra=""):
    return f"<sdf version='1.6'><world name='default'>{models}{extra}</world></sdf>"


def model_of(x, y, radius, length, name="a", pose="0 0 0 0 0 0"):
    return (
        f"<model name='{name}'><static>1</static><pose frame=''>{x:f} {y:f} 0 0 0 0</pose><link name='l'><pose>{pose}"
        f"</pose><collision name='c'><geometry><cylinder><radius>{radius:f}</radius><length>{length:f}</length>"
        "</cylinder></geometry></collision></link></model>"
    )


FLOOR = (
    "<model name='floor'><link name='l'><collision name='c'><geometry><plane><normal>0 0 1</normal><size>9 9</size>"
    "</plane></geometry></collision></link></model>"
)
MODELS = FLOOR + "".join(model_of(*cylinder, name=str(k)) for k, cylinder in enumerate(CYLINDERS))
JSON = {
    "start": [-2.25, 3.0, 1.57],
    "goal": [-2.25, 13.0],
    "goal_tolerance_m": 1.0,
    "timeout_s": 100.0,
    "cylinders": CYLINDERS,
    "boxes": [],
    "moving": [],
}
MOVING = {
    **JSON,
    "boxes": [[0.0, 9.0, 0.3, 4.0, 0.5, 1.0]],
    "moving": [
        {
            "name": "one",
            "shape": "cylinder",
            "radius": 0.5,
            "height": 1.0,
            "period_s": 20.0,
            "loop": True,
            "keyframes": [[0.0, -9.0, 5.0], [8.0, -2.0, 6.0], [20.0, 4.0, 5.0]],
        },
        {
            "name": "two",
            "shape": "cylinder",
            "radius": 0.3,
            "height": 1.2,
            "period_s": 12.5,
            "loop": True,
            "keyframes": [[0.0, 3.0, 7.0], [12.5, -8.0, 10.0]],
        },
    ],
}


def written(tmp_path, content, name="world.json"):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_half_of_a_cylinder_stands_above_the_floor(tmp_path):
    world = load_barn(written(tmp_path, JSON))
    assert [o.shape for o in world.obstacles] == [Cylinder(-1.5, 5.0, 0.075, 0.5), Cylinder(-3.0, 7.5, 0.25, 0.4)]
    assert (world.start, world.goal) == ((-2.25, 3.0, 1.57), (-2.25, 13.0))
    assert (world.tolerance, world.time_limit, world.starts_on_motion) == (1.0, 100.0, True)
    assert world.open_borders


def test_sdf_and_json_give_the_same_scene(tmp_path):
    assert load_barn(written(tmp_path, sdf_of(MODELS), "world.world")) == load_barn(written(tmp_path, JSON))


def test_poses_of_model_link_and_collision_add_up(tmp_path):
    box = (
        "<model name='b'><pose>1 2 0.5 0 0 1.5707963267948966</pose><link name='l'><pose>1 0 0 0 0 0</pose>"
        "<collision name='c'><pose>0 1 0.25 0 0 0.1</pose><geometry><box><size>2 0.4 1</size></box></geometry>"
        "</collision></link></model>"
    )
    (shape,) = (o.shape for o in load_barn(written(tmp_path, sdf_of(box), "w.world")).obstacles)
    assert isinstance(shape, Box)
    assert (shape.x, shape.y, shape.yaw) == pytest.approx((0.0, 3.0, math.pi / 2 + 0.1))
    assert (shape.length, shape.width, shape.base, shape.height) == pytest.approx((2.0, 0.4, 0.25, 1.0))


def test_a_state_moves_a_model(tmp_path):
    state = "<state world_name='default'><model name='0'><pose frame=''>-1.0 6.0 0 0 0 0</pose></model></state>"
    world = load_barn(written(tmp_path, sdf_of(MODELS, state), "w.world"))
    assert (world.obstacles[0].shape.x, world.obstacles[0].shape.y) == (-1.0, 6.0)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (sdf_of(MODELS, "<include><uri>model://sun</uri></include>"), "<include>: it names another file"),
        (sdf_of(MODELS.replace("cylinder>", "sphere>")), "a collision is a <sphere>"),
        (sdf_of(MODELS.replace("<length>1.000000", "<length>tall")), "<length> is 'tall'"),
        (sdf_of(MODELS.replace("<length>1.000000", "<length>nan")), "<length> is 'nan'"),
        (sdf_of(MODELS.replace("<radius>0.075000", "<radius>-1")), "radius -1"),
        (sdf_of(model_of(0, 5, 1, 1, pose="0 0 0 0.2 0 0")), "it leans (roll 0.2"),
        (sdf_of(model_of(0, 5, 1, 1, pose="0 0 0")), "6 finite numbers"),
        (sdf_of(MODELS.replace("frame=''", "relative_to='0'")), "relative to another frame"),
        (sdf_of(MODELS.replace("<static>1</static>", "<plugin name='p' filename='libobs.so'/>")), "has a plugin"),
        (sdf_of("<model name='m'><link name='l'><visual name='v'/></link></model>"), "seen but has no collision"),
        (sdf_of(MODELS.replace("frame=''", "degrees='true'")), "a pose in degrees"),
        (sdf_of(MODELS.replace("frame=''", "rotation_format='quat_xyzw'")), "a pose in degrees or of a quaternion"),
        (sdf_of(MODELS + MODELS), "a second model of this name"),
        (sdf_of(MODELS, "<state><model name='0'><scale>1 2 1</scale></model></state>"), "its state scales it"),
        (sdf_of(MODELS, "<state><insertions/></state>"), "<insertions>"),
        (sdf_of(MODELS, "<population name='p'/>"), "<population>"),
        (sdf_of(FLOOR), "no obstacles"),
        ("<sdf/>", "<sdf> with a <world> would be right"),
        ("<robot/>", "the root element is <robot>"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><sdf/>', "declares a document type"),
        ("<sdf><world>", "is not XML"),
        ("", "is not XML"),
    ],
)
def test_a_broken_sdf_is_refused_in_one_line(tmp_path, content, text):
    with pytest.raises(BadWorld) as told:
        load_barn(written(tmp_path, content, "w.world"))
    assert text in str(told.value)
    assert "\n" not in str(told.value)


def changed(**fields):
    return {**MOVING, **fields}


def moving_with(**fields):
    return changed(moving=[{**MOVING["moving"][0], **fields}])


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("[]", "the file: '[]' is not a mapping"),
        ("{", "not JSON"),
        ("", "not JSON"),
        (changed(start=[1, 2]), "start: '[1, 2]' is not a list of 3 numbers"),
        (changed(goal=None), "goal: it is missing"),
        (changed(cylinders=[[0, 0, 1]]), "cylinders[0]: '[0, 0, 1]' is not a list of 4 numbers"),
        (changed(cylinders=[[0, 0, -1, 1]]), "cylinders[0]: radius and height above 0"),
        (changed(cylinders=[[0, 0, 1, True]]), "cylinders[0][3]: True is not a number"),
        (changed(cylinders=[[0, 1e99, 1, 1]]), "cylinders[0][1]: 1e+99 is out of range"),
        (changed(boxes={}), "boxes: {} is not a list"),
        (changed(boxes=[[0, 0, 0, 0, 1, 1]]), "boxes[0]: sizes above 0"),
        (changed(moving=[]), "nothing moves"),
        (moving_with(shape="box"), "moving[0].shape: box is not a cylinder"),
        (moving_with(keyframes=[]), "moving[0].keyframes: none"),
        (moving_with(keyframes=[[0, 1, 1], [0, 2, 2]]), "keyframes[1]: its time"),
        (moving_with(keyframes=[[0, 0, 0], [20, "a", 0]]), "moving[0].keyframes[1][1]: 'a' is not a number"),
        (moving_with(period_s=3.0), "period: 3 s is shorter than the keyframes"),
        (moving_with(radius=0.0), "moving[0].radius: 0 is out of range"),
        (changed(goal_tolerance_m=-1), "goal_tolerance_m: -1 is out of range"),
        (changed(optimal_path_length_m=-1), "optimal_path_length_m: -1 is out of range"),
        (changed(cylinders=[[0, 0, 1, 10**400]]), "cylinders[0][3]: 1000"),
    ],
)
def test_broken_json_is_refused_in_one_line(tmp_path, content, text):
    with pytest.raises(BadWorld) as told:
        load_dynabarn(written(tmp_path, content))
    assert text.replace("'[", "[").replace("]'", "]") in str(told.value).replace("'[", "[").replace("]'", "]")
    assert "\n" not in str(told.value)


def interpolated(source, time):
    """Where the source has a mover at a time of its own clock: linear, and back to the first place at the end."""
    times, xs, ys = zip(*source["keyframes"])
    time %= source["period_s"]
    return np.interp(time, times, xs), np.interp(time, times, ys)


def assert_movers_follow(path, source, seed):
    world = make_world(f"dynabarn:{path}", seed, footprint_radius=0.3)
    field = MoverField(world)
    phases = {m.motion.phase for m in world.movers if isinstance(m.motion, Keyframes)}
    assert len(phases) == 1  # one clock for all
    (phase,) = phases
    assert phase is not None
    for _ in range(120):
        for mover, pose in zip(source["moving"], field.poses, strict=True):
            left = (phase + field.time) % mover["period_s"]
            if min(left, mover["period_s"] - left) > 1e-6:  # at a jump it is at one of two places
                np.testing.assert_allclose(pose[:2], interpolated(mover, phase + field.time), rtol=0, atol=1e-9)
        field.step(0.37)
    return phase


def test_movers_are_where_the_keyframes_say_and_the_phase_follows_from_the_seed(tmp_path):
    path = written(tmp_path, MOVING)
    phases = [assert_movers_follow(path, MOVING, seed) for seed in (0, 1, 0)]
    assert phases[0] == phases[2] != phases[1]


def test_no_mover_begins_where_the_robot_does(tmp_path):
    hiding = moving_with(keyframes=[[0.0, -2.25, 3.0], [19.0, -2.25, 3.0], [20.0, -2.25, 6.0]], period_s=40.0)
    path = written(tmp_path, hiding)
    for seed in range(5):
        world = make_world(f"dynabarn:{path}", seed, footprint_radius=0.3)
        assert math.dist(world.movers[0].start[:2], world.start[:2]) > 0.5 + 0.5
    always = moving_with(keyframes=[[0.0, -2.25, 3.0]])
    with pytest.raises(BadWorld, match="a mover is there at any time"):
        make_world(f"dynabarn:{written(tmp_path, always)}", 0, footprint_radius=0.3)


@pytest.mark.parametrize("path", data_files("barn/*.world"))
def test_public_worlds_have_their_cylinders_in_both_forms(path, tmp_path):
    world = load_barn(path)
    source = json.loads(path.with_suffix(".json").read_text())
    assert load_barn(path.with_suffix(".json")) == world
    shapes = [(s.x, s.y, s.radius, s.height) for s in (o.shape for o in world.obstacles) if isinstance(s, Cylinder)]
    assert shapes == [(x, y, radius, height / 2.0) for x, y, radius, height in source["cylinders"]]
    save_scene(world, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == world


@pytest.mark.parametrize("path", data_files("dynabarn/*.json"))
def test_public_moving_worlds_follow_their_keyframes(path, tmp_path):
    assert_movers_follow(path, json.loads(path.read_text()), 3)
    world = load_dynabarn(path)
    save_scene(world, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == world
