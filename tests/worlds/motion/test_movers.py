"""Where movers go: known answers, and the promises of every world over a minute of motion."""

import math

import numpy as np
import pytest

from vuca_nav.types import Pose2
from worlds import WORLDS, MoverField, make_world
from worlds.arrays import pack_shapes
from worlds.clearance import clearance_at
from worlds.motion.movers import TICK_RATE
from worlds.motion.walk import PATIENCE
from worlds.scenes.parts.scatter import outline
from worlds.world import STRIDE, Box, Cylinder, Mover, MoverPart, Obstacle, Patrol, RandomWalk, SocialForce, World

DISC = (MoverPart(Cylinder(0.0, 0.0, 0.3, 1.0)),)


def room(*movers, obstacles=(), side=20.0):
    """An empty room, walled in by its bounds."""
    return World(
        "room", 0, (0.0, 0.0, side, side), tuple(obstacles), movers, Pose2(1.0, 1.0, 0.0), (side - 1, side - 1)
    )


def walker(x, y, speed=0.5, seed=1):
    return Mover("cylinder", DISC, 0.3, Pose2(x, y, 0.0), RandomWalk(speed, seed))


@pytest.mark.parametrize("name", [name for name in sorted(WORLDS) if name != "static"])
def test_no_part_ever_touches_a_wall(name):
    """60 s: the exact outline of every part stays out of every static obstacle."""
    for seed in (0, 1):
        world = make_world(name, seed)
        shapes, field = pack_shapes([o.shape for o in world.obstacles]), MoverField(world)
        parts = [part for mover in world.movers for part in mover.parts]
        local = []
        for part in parts:
            s = part.shape
            local.append(Cylinder(0, 0, s.radius, 1) if isinstance(s, Cylinder) else Box(0, 0, s.length, s.width, 0, 1))
        points = [np.array(outline(shape, 10.0)) for shape in local]
        for _ in range(200):
            field.step(0.3)
            for (x, y, yaw), around, shape in zip(field.part_poses, points, local):
                if isinstance(shape, Cylinder):
                    assert clearance_at(shapes, x, y)[0] >= shape.radius
                    continue
                c, s = math.cos(yaw), math.sin(yaw)
                for u, v in around:
                    assert clearance_at(shapes, x + c * u - s * v, y + s * u + c * v)[0] > 0.0


@pytest.mark.parametrize("name", ["factory", "square", "dynamic", "double_branch"])
def test_random_walkers_keep_their_speed_and_their_runs_are_long(name):
    world = make_world(name, 2)
    field = MoverField(world)
    speeds = np.array([m.motion.speed for m in world.movers])
    travelled, turns = np.zeros(len(speeds)), np.zeros(len(speeds))
    last = field.velocities.copy()
    for _ in range(60 * 30):
        before = field.poses[:, :2].copy()
        field.step(1.0 / TICK_RATE)
        travelled += np.hypot(*(field.poses[:, :2] - before).T)
        turns += np.abs(field.velocities - last).max(axis=1) > 1e-9
        last = field.velocities.copy()
        moving = np.hypot(*field.velocities.T)
        assert np.all((np.abs(moving - speeds) < 1e-9) | (moving == 0.0))
    assert np.all(travelled <= speeds * 60.0 + 1e-6)
    assert np.mean(travelled / (speeds * 60.0)) > 0.97  # hardly anyone is ever penned in
    runs = travelled / (turns + 1)
    assert np.median(runs) > 1.0
    assert np.all(turns <= 60.0 / PATIENCE + travelled / 0.1)


def test_motion_is_a_function_of_time_whatever_the_step():
    for name in ("factory", "building"):
        world = make_world(name, 4)
        fields = [MoverField(world) for _ in range(3)]
        for _ in range(3000):
            fields[0].step(1.0 / 300.0)
        for _ in range(300):
            fields[1].step(1.0 / 30.0)
        for k in range(100):
            fields[2].step(0.05 + 0.001 * k)  # 10.0 s less 0.05 s
        fields[2].step(10.0 - fields[2].time)
        for field in fields[1:]:
            assert np.abs(field.poses[:, :2] - fields[0].poses[:, :2]).max() < 1e-9
            assert np.abs(field.part_poses[:, :2] - fields[0].part_poses[:, :2]).max() < 1e-9


def test_reset_gives_the_same_bits_again_and_the_robot_is_not_seen():
    world = make_world("factory", 1, region=2)
    field = MoverField(world)
    start = field.part_poses.copy()
    for _ in range(500):
        field.step(1.0 / 30.0)
    first = field.part_poses.copy()
    field.reset()
    assert field.time == 0.0
    assert np.array_equal(field.part_poses, start)
    for _ in range(500):
        field.step(1.0 / 30.0, robot=(*field.poses[0, :2], 0.3))
    assert np.array_equal(field.part_poses, first)
    assert np.abs(first - start).max() > 1.0


def test_walkers_do_not_pass_a_neck_narrower_than_2_2_metres():
    def two_rooms(gap):
        walls = (
            Obstacle("wall", Box(6.0, (6 - gap / 2) / 2, 0.1, 6 - gap / 2, 0.0, 2.0)),
            Obstacle("wall", Box(6.0, 12 - (6 - gap / 2) / 2, 0.1, 6 - gap / 2, 0.0, 2.0)),
        )
        return MoverField(room(*(walker(3.0, 2.0 + k, 1.0, k) for k in range(8)), obstacles=walls, side=12.0))

    for gap, passed in ((2.0, False), (2.6, True)):
        field = two_rooms(gap)
        right = 0
        for _ in range(3000):
            field.step(0.1)
            right = max(right, int((field.poses[:, 0] > 6.0).sum()))
        assert (right > 0) == passed


def test_walkers_turn_away_from_each_other():
    """Of a crowd of 20 on 64 m^2 hardly any overlap at a time; blind walkers would, on 12% of the pairs' time."""
    field = MoverField(room(*(walker(1.5 + k % 5, 1.5 + k // 5 * 1.5, 0.6, k) for k in range(20)), side=8.0))
    overlaps = 0
    for _ in range(600):
        field.step(0.1)
        gaps = np.hypot(*(field.poses[:, None, :2] - field.poses[None, :, :2]).transpose(2, 0, 1))
        overlaps += int((gaps[np.triu_indices(20, 1)] < 0.6).sum())
    blind = 600 * 190 * math.pi * 0.6**2 / 6.6**2
    assert overlaps < 0.35 * blind


def test_patrol_goes_to_and_fro():
    line = ((2.0, 2.0), (6.0, 2.0), (6.0, 5.0))
    field = MoverField(room(Mover("cylinder", DISC, 0.3, Pose2(2.0, 2.0, 0.0), Patrol(1.0, line))))
    expected = {0.5: (2.5, 2.0), 4.0: (6.0, 2.0), 5.5: (6.0, 3.5), 8.0: (6.0, 4.0), 12.0: (4.0, 2.0), 14.5: (2.5, 2.0)}
    for until, position in expected.items():
        while field.time < until - 1e-9:
            field.step(0.05)
        assert field.poses[0, :2] == pytest.approx(position, abs=1e-6)


def test_parts_follow_their_mover_and_legs_swing_against_each_other():
    parts = (
        MoverPart(Cylinder(0.0, 0.1, 0.08, 0.9), 0.2),
        MoverPart(Cylinder(0.0, -0.1, 0.08, 0.9), -0.2),
        MoverPart(Box(0.1, 0.0, 0.2, 0.1, math.pi / 2, 0.5, base=0.9)),
    )
    mover = Mover("legs", parts, 0.35, Pose2(5.0, 5.0, math.pi / 2), Patrol(1.0, ((5.0, 5.0), (5.0, 15.0))))
    field = MoverField(room(mover))
    assert list(field.part_mover) == [0, 0, 0]
    assert field.part_poses[0, :2] == pytest.approx((4.9, 5.0))
    field.step(STRIDE / 4.0)  # a quarter of a gait cycle at 1 m/s
    assert field.part_poses[0, :2] == pytest.approx((4.9, 5.0 + STRIDE / 4 + 0.2), abs=1e-9)
    assert field.part_poses[1, :2] == pytest.approx((5.1, 5.0 + STRIDE / 4 - 0.2), abs=1e-9)
    assert field.part_poses[2] == pytest.approx((5.0, 5.1 + STRIDE / 4, math.pi), abs=1e-9)
    assert np.allclose(field.part_shapes.z[2], (0.9, 1.4))


def test_a_world_without_movers():
    field = MoverField(room())
    field.step(0.1)
    assert field.poses.shape == (0, 3)
    assert field.part_poses.shape == (0, 3)
    assert field.time == pytest.approx(0.1)


def person(x, y, waypoints, speed=1.0):
    return Mover("person", DISC, 0.3, Pose2(x, y, 0.0), SocialForce(speed, waypoints))


def run(field, seconds, robot=None):
    """Positions (n, m, 2) at every tick."""
    track = []
    for _ in range(int(seconds * TICK_RATE)):
        field.step(1.0 / TICK_RATE, robot)
        track.append(field.poses[:, :2].copy())
    return np.array(track)


def test_a_person_alone_walks_straight_at_the_desired_speed():
    track = run(MoverField(room(person(3.0, 10.0, ((17.0, 10.0),)))), 8.0)
    assert np.abs(track[:, 0, 1] - 10.0).max() < 1e-6
    speed = np.diff(track[60:, 0, 0]) * TICK_RATE
    assert speed == pytest.approx(1.0, abs=0.02)


def test_two_who_meet_pass_on_the_right_without_touching():
    field = MoverField(room(person(5.0, 10.0, ((15.0, 10.0),)), person(15.0, 10.0, ((5.0, 10.0),))))
    track = run(field, 15.0)
    assert np.hypot(*(track[:, 0] - track[:, 1]).T).min() > 0.6
    meeting = np.argmin(np.abs(track[:, 0, 0] - track[:, 1, 0]))
    assert track[meeting, 0, 1] < track[meeting, 1, 1]  # the one who walks towards +x is on its right, at lower y
    assert track[-1, 0, 0] > 14.0
    assert track[-1, 1, 0] < 6.0


def test_a_person_walks_round_the_robot():
    robot = (10.0, 10.0, 0.3)
    world = room(person(5.0, 10.05, ((15.0, 10.0),)))
    track = run(MoverField(world), 14.0, robot)
    assert np.hypot(*(track[:, 0] - robot[:2]).T).min() > 0.6
    assert track[-1, 0, 0] > 14.0
    unseen = run(MoverField(world), 14.0)
    assert np.hypot(*(unseen[:, 0] - robot[:2]).T).min() < 0.3


def test_people_pass_a_door_of_one_metre_and_turn_back_at_a_blocked_one():
    def wall(gap):
        return (
            Obstacle("wall", Box(10.0, (10 - gap / 2) / 2, 0.15, 10 - gap / 2, 0.0, 2.0)),
            Obstacle("wall", Box(10.0, 20 - (10 - gap / 2) / 2, 0.15, 10 - gap / 2, 0.0, 2.0)),
        )

    route = ((6.0, 10.0), (14.0, 10.0))
    through = run(MoverField(room(person(6.0, 10.0, route), obstacles=wall(1.0))), 15.0)
    assert through[:, 0, 0].max() > 13.0
    blocked = run(MoverField(room(person(6.0, 10.0, route), obstacles=wall(0.5))), 15.0)
    assert 9.0 < blocked[:, 0, 0].max() < 10.0
    assert blocked[blocked[:, 0, 0].argmax() :, 0, 0].min() < 7.0


def test_the_crowd_of_the_building_keeps_walking():
    for seed in range(3):
        track = run(MoverField(make_world("building", seed, movers=30)), 120.0)
        walked = np.hypot(*np.diff(track[::30], axis=0).transpose(2, 0, 1)).sum(axis=0)
        assert np.median(walked) > 40.0
        assert walked.min() > 5.0


def test_a_ceiling_is_in_no_movers_way_and_a_low_canopy_is():
    def path(*overhead):
        walker = Mover(
            "person", (MoverPart(Cylinder(0.0, 0.0, 0.3, 1.7)),), 0.3, Pose2(4.0, 4.0, 0.0), RandomWalk(1.0, 5)
        )
        field = MoverField(
            World("hall", 0, (0.0, 0.0, 8.0, 8.0), overhead, (walker,), Pose2(0.5, 0.5, 0.0), (7.0, 7.0))
        )
        positions = []
        for _ in range(900):
            field.step(1 / 30)
            positions.append(field.poses[0, :2].copy())
        return np.array(positions)

    bare = path()
    np.testing.assert_array_equal(path(Obstacle("wall", Box(4.0, 4.0, 8.0, 8.0, 0.0, 0.1, base=3.0))), bare)
    assert bare[:, 0].max() > 5.5
    canopy = Obstacle("wall", Box(7.0, 4.0, 2.0, 8.0, 0.0, 0.1, base=1.5))
    assert path(canopy)[:, 0].max() < 5.75
