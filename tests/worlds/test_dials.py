"""Dials of the moving obstacles: how many, how fast, and how many of them see the robot."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from vuca_nav.errors import BadArgument
from vuca_nav.types import Pose2
from worlds import WORLDS, MoverField, load_scene, make_world, save_scene
from worlds.motion.movers import TICK_RATE
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol, RandomWalk, World

MOVING = [name for name in sorted(WORLDS) if name != "static"]
DISC = (MoverPart(Cylinder(0.0, 0.0, 0.3, 1.0)),)
ROBOT = (10.0, 10.05, 0.3)
"""x, y, radius of a robot that stands [m]."""


def room(*movers, obstacles=(), side=20.0):
    start, goal = Pose2(1.0, 1.0, 0.0), (side - 1, side - 1)
    return World("room", 0, (0.0, 0.0, side, side), tuple(obstacles), movers, start, goal)


def patrol(sighted, *waypoints, speed=1.0):
    start = Pose2(waypoints[0][0], waypoints[0][1], 0.0)
    return Mover("cylinder", DISC, 0.3, start, Patrol(speed, waypoints), sighted)


def track(world, seconds, robot=None):
    """Positions (n, m, 2) at every tick."""
    field, places = MoverField(world), []
    for _ in range(round(seconds * TICK_RATE)):
        field.step(1.0 / TICK_RATE, robot)
        places.append(field.poses[:, :2].copy())
    return np.array(places)


def gap_to_robot(places):
    return np.hypot(places[..., 0] - ROBOT[0], places[..., 1] - ROBOT[1]) - 0.3 - ROBOT[2]


@pytest.mark.parametrize("name", MOVING)
def test_dials_at_rest_leave_the_world_as_it_is(name):
    own = 1.0 if name == "building" else 0.0
    world, turned = make_world(name, 3), make_world(name, 3, speed=1.0, sighted=own)
    assert replace(turned, movers=()) == replace(world, movers=())
    assert [m.sees_robot for m in turned.movers] == [m.sees_robot for m in world.movers]
    np.testing.assert_array_equal(track(world, 10.0, ROBOT), track(turned, 10.0, ROBOT))


@pytest.mark.parametrize("name", MOVING)
def test_speeds_scale_exactly_and_nothing_else_changes(name):
    world, fast = make_world(name, 3), make_world(name, 3, speed=1.5)
    assert [m.motion.speed for m in fast.movers] == [1.5 * m.motion.speed for m in world.movers]
    slowed = tuple(replace(m, motion=w.motion) for m, w in zip(fast.movers, world.movers, strict=True))
    assert replace(fast, movers=slowed) == world


def test_a_patrol_at_twice_its_speed_is_where_it_is_at_twice_the_time():
    line = ((4.0, 10.0), (9.0, 10.0), (9.0, 15.0))
    slow, fast = track(room(patrol(None, *line, speed=0.5)), 20.0), track(room(patrol(None, *line)), 10.0)
    np.testing.assert_allclose(fast[:-1:3], slow[1:-1:6], atol=1e-9)


def test_at_no_speed_all_stand():
    places = track(make_world("square", 1, speed=0.0), 5.0)
    np.testing.assert_array_equal(places[0], places[-1])


@pytest.mark.parametrize("name", MOVING)
def test_shares_of_the_sighted_nest_and_are_exact(name):
    count = len(make_world(name, 5).movers)
    seeing = []
    for share in (0.0, 0.2, 0.5, 0.8, 1.0):
        movers = make_world(name, 5, sighted=share).movers
        seeing.append({i for i, mover in enumerate(movers) if mover.sees_robot})
        assert len(seeing[-1]) == round(share * count)
    assert all(few < more for few, more in pairwise(seeing))
    other = {i for i, mover in enumerate(make_world(name, 6, sighted=0.5).movers) if mover.sees_robot}
    assert other != seeing[2]


def test_a_sighted_walker_goes_round_a_standing_robot_and_a_blind_one_through_it():
    for seed in range(6):
        walker = Mover("cylinder", DISC, 0.3, Pose2(6.0, 10.0, 0.0), RandomWalk(0.8, seed))
        blind = gap_to_robot(track(room(walker, side=14.0), 180.0, ROBOT))
        sighted = gap_to_robot(track(room(replace(walker, sighted=True), side=14.0), 180.0, ROBOT))
        assert blind.min() < 0.0
        assert 0.1 < sighted.min() < 1.5  # it came by


def test_a_sighted_patrol_goes_round_the_robot_and_returns_to_its_line():
    line = (4.0, 10.0), (16.0, 10.0)
    blind, sighted = (track(room(patrol(s, *line)), 18.0, ROBOT)[:, 0] for s in (False, True))
    assert gap_to_robot(blind).min() < 0.0
    assert gap_to_robot(sighted).min() > 0.1
    reached = np.flatnonzero(sighted[:, 0] > 15.0)
    assert len(reached)
    assert abs(sighted[reached[0], 1] - 10.0) < 0.1


def test_without_a_robot_in_reach_the_sighted_walk_as_the_blind():
    movers = make_world("square", 2).movers
    world = replace(make_world("square", 2), movers=tuple(replace(m, sighted=True) for m in movers))
    np.testing.assert_array_equal(track(world, 20.0, (-50.0, 0.0, 0.3)), track(make_world("square", 2), 20.0))


def test_a_sighted_patrol_turns_back_where_the_robot_bars_its_way():
    walls = tuple(Obstacle("wall", Box(10.0, y, 12.0, 0.2, 0.0, 2.0)) for y in (9.3, 10.7))
    places = track(room(patrol(True, (5.0, 10.0), (15.0, 10.0)), obstacles=walls), 30.0, ROBOT)[:, 0]
    assert gap_to_robot(places).min() > 0.0
    assert places[:, 0].max() < 10.0
    assert places[places[:, 0].argmax() :, 0].min() < 6.0
    assert np.abs(places[:, 1] - 10.0).max() < 0.31  # never in a wall


def test_a_blind_crowd_walks_through_the_robot():
    world = make_world("building", 1)
    sighted = gap_to_robot(track(world, 60.0, ROBOT))
    blind = gap_to_robot(track(make_world("building", 1, sighted=0.0), 60.0, ROBOT))
    assert blind.min() < sighted.min()
    np.testing.assert_array_equal(track(make_world("building", 1, sighted=0.0), 20.0, ROBOT), track(world, 20.0))


@pytest.mark.parametrize("name", ["square", "factory"])
def test_sighted_random_walks_stay_in_their_ways(name):
    """60 s of a robot that chases a mover: no mover is ever pushed into a wall."""
    world = make_world(name, 4, sighted=1.0)
    field = MoverField(world)
    shapes = [o.shape for o in world.obstacles]
    for _ in range(1800):
        x, y = field.poses[0, :2]
        field.step(1.0 / TICK_RATE, (x + 0.6, y + 0.2, 0.3))
        assert all(_distance(shape, *field.poses[0, :2]) > 0.15 for shape in shapes)


def _distance(shape, x, y):
    if isinstance(shape, Cylinder):
        return np.hypot(x - shape.x, y - shape.y) - shape.radius
    c, s = np.cos(shape.yaw), np.sin(shape.yaw)
    u, v = c * (x - shape.x) + s * (y - shape.y), c * (y - shape.y) - s * (x - shape.x)
    return np.hypot(max(abs(u) - shape.length / 2, 0.0), max(abs(v) - shape.width / 2, 0.0))


@pytest.mark.parametrize(("region", "movers"), [(1, 0), (1, 20), (2, 7), (4, 40), (4, 80)])
def test_the_factory_takes_a_number_of_movers(region, movers):
    world = make_world("factory", 2, region=region, movers=movers)
    assert len(world.movers) == movers
    if movers == 10 * region:
        assert world == make_world("factory", 2, region=region)


def test_a_scene_file_takes_the_dials_and_keeps_who_is_sighted(tmp_path):
    path = tmp_path / "scene.yaml"
    movers = patrol(None, (4.0, 10.0), (9.0, 10.0)), patrol(True, (4.0, 5.0), (9.0, 5.0))
    save_scene(room(*movers), path)
    assert load_scene(path) == room(*movers)
    few = make_world(str(path), 0, movers=1, speed=2.0, sighted=1.0)
    assert [(m.motion.speed, m.sees_robot) for m in few.movers] == [(2.0, True)]
    with pytest.raises(BadArgument, match=r"--movers 3: .* has 2; that or fewer"):
        make_world(str(path), 0, movers=3)
    save_scene(room(patrol(None, (4.0, 10.0), (9.0, 10.0), speed=4.0)), path)
    with pytest.raises(BadArgument, match=r"would move at 8\.0 m/s; 1\.25 or less"):
        make_world(str(path), 0, speed=2.0)
