"""Keyframes, a map's walls, open borders, tolerance and time limit in scene files: exact round trips, refusals."""

import copy
import math

import numpy as np
import pytest
import yaml

from vuca_nav.errors import BadWorld
from worlds import MoverField, load_scene, save_scene
from worlds.clearance import clearance_field
from worlds.shortest_path import shortest_path_length
from worlds.world import Box, Keyframes, UserMotion

SCENE = {
    "format": "vuca-scene-1",
    "name": "a hall with a map",
    "seed": 0,
    "bounds": {"x_min": 0.0, "y_min": 0.0, "x_max": 10.0, "y_max": 8.0},
    "start": {"x": 1.0, "y": 1.0, "yaw": 0.0},
    "goal": {"x": 9.0, "y": 7.0},
    "tolerance": 1.0,
    "time_limit": 100,
    "clock": "motion",
    "open_borders": True,
    "map": {
        "origin": {"x": 4.0, "y": 3.0, "yaw": math.pi / 2.0},
        "resolution": 0.05,
        "columns": 40,
        "rows": 20,
        "height": 2.0,
        "walls": [[0, 0, 40, 2], [10, 5, 3, 7]],
        "unknown": [[20, 10, 5, 5]],
    },
    "obstacles": [{"kind": "pillar", "shape": {"type": "cylinder", "x": 7, "y": 2, "radius": 0.5, "height": 2}}],
    "movers": [
        {
            "kind": "cylinder",
            "radius": 0.5,
            "motion": {
                "type": "keyframes",
                "keyframes": [[0.0, -1.0, 4.0], [4.1, 5.0, 4], [9, 12.0, 6.5]],
                "period": 11.5,
                "jumps": True,
                "vanishes": True,
                "phase": "random",
            },
            "parts": [{"shape": {"type": "cylinder", "x": 0, "y": 0, "radius": 0.5, "height": 1}}],
        }
    ],
}


def written(tmp_path, change=lambda scene: None):
    scene = copy.deepcopy(SCENE)
    change(scene)
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(scene))
    return path


def test_what_the_fields_mean(tmp_path):
    world = load_scene(written(tmp_path))
    assert (world.tolerance, world.time_limit, world.starts_on_motion, world.open_borders) == (1.0, 100.0, True, True)
    wall = world.obstacles[1].shape
    assert isinstance(wall, Box)
    # 40 x 2 cells from the origin; rows run up, and the map is turned by 90 degrees: 2 m up, 0.1 m to the left.
    assert (wall.x, wall.y) == pytest.approx((3.95, 4.0))
    assert (wall.length, wall.width, wall.yaw, wall.height) == pytest.approx((2.0, 0.1, math.pi / 2.0, 2.0))
    motion = world.movers[0].motion
    assert isinstance(motion, Keyframes)
    assert (motion.times, motion.period, motion.phase) == ((0.0, 4.1, 9.0), 11.5, None)
    np.testing.assert_allclose(MoverField(world).poses[0, :2], (-1.0, 4.0))  # beyond the open borders


def test_it_comes_back_equal(tmp_path):
    world = load_scene(written(tmp_path))
    save_scene(world, tmp_path / "again.yaml")
    assert load_scene(tmp_path / "again.yaml") == world
    assert "walls" in (tmp_path / "again.yaml").read_text()  # as a map, not as boxes


def test_a_plain_scene_has_no_such_fields(tmp_path):
    def plain(scene):
        for field in ("tolerance", "time_limit", "clock", "open_borders", "map"):
            del scene[field]
        scene["movers"] = []

    world = load_scene(written(tmp_path, plain))
    assert (world.tolerance, world.time_limit, world.starts_on_motion, world.open_borders) == (0.3, None, False, False)
    save_scene(world, tmp_path / "again.yaml")
    text = (tmp_path / "again.yaml").read_text()
    assert not any(field in text for field in ("tolerance", "time_limit", "clock", "open_borders", "map:"))


def test_open_borders_are_no_walls(tmp_path):
    world = load_scene(written(tmp_path, lambda scene: scene.update(obstacles=[])))
    space = clearance_field((), world.bounds, is_open=True)
    assert space.distance.min() == space.distance.max() == 1.5
    near = written(tmp_path, lambda scene: scene.update(start={"x": 0.05, "y": 4.0, "yaw": 0.0}))
    assert math.isfinite(shortest_path_length(load_scene(near), 0.3))


def test_movers_come_in_through_open_borders_alone(tmp_path):
    def patrolling(scene):
        motion = {"type": "patrol", "speed": 1.0, "waypoints": [{"x": -3, "y": 6}, {"x": 5, "y": 6}]}
        scene["movers"][0].update(motion=motion, start={"x": -3, "y": 6, "yaw": 0})
        del scene["map"]

    field = MoverField(load_scene(written(tmp_path, patrolling)))
    for _ in range(150):
        field.step(1 / 30)
    np.testing.assert_allclose(field.poses[0, :2], (2.0, 6.0), atol=1e-6)

    def closed(scene):
        patrolling(scene)
        scene["open_borders"] = False

    with pytest.raises(BadWorld, match=r"movers\[0\].start: \(-3, 6\) is out of bounds"):
        load_scene(written(tmp_path, closed))


def change_motion(**fields):
    return lambda scene: scene["movers"][0]["motion"].update(fields)


@pytest.mark.parametrize(
    ("change", "field", "text"),
    [
        (change_motion(keyframes=[[0, 0, 0], [0, 1, 1]]), "movers[0].motion.keyframes[1]", "not after 0 s"),
        (change_motion(keyframes=[[0, 0, 0], [1, 9, 9]]), "movers[0].motion.keyframes", "12.7 m/s"),
        (change_motion(keyframes=[]), "movers[0].motion.keyframes", "at least 1"),
        (change_motion(keyframes=[[0, 0]]), "movers[0].motion.keyframes[0]", "at least 3"),
        (change_motion(keyframes=[[0, 0, "a"]]), "movers[0].motion.keyframes[0][2]", "not a number"),
        (change_motion(period=5.0), "movers[0].motion.period", "shorter than the keyframes"),
        (change_motion(period=9.0, jumps=False, vanishes=False), "movers[0].motion.period", "no time is left"),
        (change_motion(speed=1.0), "movers[0].motion", "unknown field speed"),
        (lambda scene: scene["movers"][0].update(sighted=True), "movers[0].sighted", "give way to nobody"),
        (lambda scene: scene["movers"][0].update(radius=0.4), "movers[0].radius", "does not hold the parts"),
        (lambda scene: scene.update(tolerance=0.0), "tolerance", "0.0"),
        (lambda scene: scene.update(time_limit=-1), "time_limit", "-1"),
        (lambda scene: scene.update(clock="sun"), "clock", "one of start, motion"),
        (lambda scene: scene["map"]["walls"].append([39, 0, 2, 1]), "map.walls[2]", "none of a map of 40 x 20"),
        (lambda scene: scene["map"]["unknown"].append([0, 0, 0, 1]), "map.unknown[1]", "none of a map"),
        (lambda scene: scene["map"].pop("rows"), "map", "rows missing"),
    ],
)
def test_what_is_refused_is_named(tmp_path, change, field, text):
    with pytest.raises(BadWorld) as told:
        load_scene(written(tmp_path, change))
    message = str(told.value)
    assert f"{field}: " in message
    assert text in message
    assert "(line " in message
    assert "\n" not in message


def test_a_motion_of_ones_own_is_loaded_only_if_trusted(tmp_path):
    def own(scene):
        scene["movers"][0].update(
            motion={"type": "user", "class": "os:system", "speed": 1.5, "options": {"command": "true", "n": 2}},
            start={"x": 5, "y": 6, "yaw": 0},
        )

    path = written(tmp_path, own)
    with pytest.raises(BadWorld, match=r"movers\[0\].motion.class: os:system .*--trust"):
        load_scene(path)
    world = load_scene(path, trust=True)
    assert world.movers[0].motion == UserMotion("os:system", (("command", "true"), ("n", 2.0)), 1.5)
    save_scene(world, tmp_path / "again.yaml")
    assert load_scene(tmp_path / "again.yaml", trust=True) == world
