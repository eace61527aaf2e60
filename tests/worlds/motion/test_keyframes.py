"""Movers by keyframes: exact at any time, loops with and without a jump, and gone while they are not there."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from vuca_nav.types import Pose2
from worlds.motion.keyframes import place_of
from worlds.motion.movers import MoverField
from worlds.reachability import reachable
from worlds.world import Cylinder, Keyframes, Mover, MoverPart, Patrol, World, at_speed

DISC = (MoverPart(Cylinder(0.0, 0.0, 0.3, 1.0)),)
TIMES, POINTS = (0.0, 0.7, 1.9, 4.0), ((2.0, 2.0), (2.5, 3.1), (1.0, 4.0), (6.0, 4.0))


def world_of(*movers):
    return World("room", 0, (0.0, 0.0, 10.0, 10.0), (), movers, Pose2(1.0, 9.0, 0.0), (9.0, 9.0))


def mover_of(motion):
    return Mover("cylinder", DISC, 0.3, place_of(motion)[0], motion)


def place_at(motion, time, dt=1 / 60):
    """Pose after so many steps of the simulation's length."""
    field = MoverField(world_of(mover_of(motion)))
    for _ in range(round(time / dt)):
        field.step(dt)
    return field


def linear(times, points, t):
    xs, ys = zip(*points)
    return np.interp(t, times, xs), np.interp(t, times, ys)


@pytest.mark.parametrize("dt", [1 / 300, 1 / 60, 1 / 7, 0.4])
def test_a_mover_is_where_its_keyframes_say_at_any_time(dt):
    field = MoverField(world_of(mover_of(Keyframes(TIMES, POINTS))))
    for _ in range(round(5.0 / dt)):
        field.step(dt)
        np.testing.assert_allclose(field.poses[0, :2], linear(TIMES, POINTS, field.time), rtol=0, atol=1e-9)
        np.testing.assert_allclose(field.part_poses[0, :2], field.poses[0, :2], rtol=0, atol=1e-9)


def test_a_loop_jumps_back_or_goes_back_straight_on():
    jumping = Keyframes(TIMES, POINTS, period=4.0, jumps=True)
    np.testing.assert_allclose(place_at(jumping, 9.5).poses[0, :2], linear(TIMES, POINTS, 1.5), atol=1e-9)
    resting = Keyframes(TIMES, POINTS, period=6.0, jumps=True)  # it rests at the end of its way, then jumps
    np.testing.assert_allclose(place_at(resting, 5.0).poses[0, :2], POINTS[-1], atol=1e-9)
    np.testing.assert_allclose(place_at(resting, 6.5).poses[0, :2], linear(TIMES, POINTS, 0.5), atol=1e-9)
    returning = Keyframes(TIMES, POINTS, period=6.0)
    np.testing.assert_allclose(place_at(returning, 5.0).poses[0, :2], (4.0, 3.0), atol=1e-9)  # half the way back
    np.testing.assert_allclose(place_at(returning, 6.5).poses[0, :2], linear(TIMES, POINTS, 0.5), atol=1e-9)


def test_phase_and_pace_shift_and_stretch_its_clock():
    motion = Keyframes(TIMES, POINTS, period=4.0, jumps=True, phase=3.0)
    np.testing.assert_allclose(place_of(motion)[0][:2], linear(TIMES, POINTS, 3.0), atol=1e-12)
    np.testing.assert_allclose(place_at(motion, 1.5).poses[0, :2], linear(TIMES, POINTS, 0.5), atol=1e-9)
    fast = at_speed(Keyframes(TIMES, POINTS), 2.0)
    np.testing.assert_allclose(place_at(fast, 1.5).poses[0, :2], linear(TIMES, POINTS, 3.0), atol=1e-9)
    assert fast.speed == pytest.approx(2.0 * Keyframes(TIMES, POINTS).speed)
    assert Keyframes(TIMES, POINTS).speed == pytest.approx(5.0 / 2.1)


def test_its_velocity_is_that_of_its_leg_and_it_faces_where_it_goes():
    field = place_at(Keyframes(TIMES, POINTS), 3.0)
    np.testing.assert_allclose(field.velocities[0], (5.0 / 2.1, 0.0), atol=1e-9)
    assert field.poses[0, 2] == pytest.approx(0.0, abs=1e-6)
    assert np.all(place_at(Keyframes(TIMES, POINTS), 4.5).velocities == 0.0)


def test_one_that_vanishes_is_there_from_its_first_time_to_its_last():
    times = (1.0, 2.0, 3.0)
    motion = Keyframes(times, POINTS[:3], vanishes=True)
    field = MoverField(world_of(mover_of(motion)))
    for _ in range(240):
        there = times[0] - 1e-9 <= field.time <= times[-1] + 1e-9
        assert bool(field.present[0]) == there or min(abs(field.time - 1.0), abs(field.time - 3.0)) < 1e-6
        assert np.isfinite(field.poses[0, :2]).all() == np.isfinite(field.part_poses[0, :2]).all() == field.present[0]
        if field.present[0]:
            np.testing.assert_allclose(field.poses[0, :2], linear(times, POINTS[:3], field.time), atol=1e-9)
        else:
            assert np.all(field.velocities == 0.0)
        field.step(1 / 60)


@pytest.mark.parametrize("jumps", [False, True])
def test_one_that_vanishes_is_gone_for_the_rest_of_its_period(jumps):
    motion = Keyframes((0.0, 2.0), ((0.0, 0.0), (2.0, 0.0)), period=5.0, jumps=jumps, vanishes=True)
    assert [place_of(motion, time)[1] for time in (1.0, 2.5, 4.5, 5.5)] == [True, False, False, True]
    assert place_of(motion, 5.5)[0] == Pose2(0.5, 0.0, 0.0)
    assert motion.speed == 1.0


def test_it_appears_facing_where_it_goes():
    motion = Keyframes((0.5, 2.5), ((5.0, 5.0), (3.0, 5.0)), vanishes=True)
    field = MoverField(world_of(replace(mover_of(motion), start=Pose2(5.0, 5.0, 0.0))))
    for _ in range(16):
        field.step(1 / 30)
    assert abs(field.poses[0, 2]) == pytest.approx(math.pi, abs=1e-6)


def test_reset_and_copies_go_the_same_way():
    motion = Keyframes((0.2, 1.0, 2.0), POINTS[:3], vanishes=True)
    field = MoverField(world_of(mover_of(motion), mover_of(beside())))
    first = course(field)
    field.reset()
    for _ in range(20):
        field.step(1 / 60)
    ahead = copy.deepcopy(field)
    np.testing.assert_array_equal(course(field), course(ahead))
    field.reset()
    np.testing.assert_array_equal(first, course(field))


def beside():
    return Keyframes((0.0, 5.0), ((8.0, 1.0), (8.0, 6.0)), period=10.0)


def course(field):
    poses = []
    for _ in range(150):
        field.step(1 / 60)
        poses.append(field.poses.copy())
    return np.array(poses)


def test_a_disc_may_pass_where_a_mover_is_not_there_any_more():
    """A door of 1 m, in which somebody stands: for ever, or for 5 s."""
    from worlds.world import Box, Obstacle

    walls = (Obstacle("wall", Box(2.25, 5.0, 4.5, 0.2, 0.0, 2.0)), Obstacle("wall", Box(7.75, 5.0, 4.5, 0.2, 0.0, 2.0)))
    standing = Keyframes((0.0, 5.0), ((5.0, 5.0), (5.0, 5.0)))
    scene = replace(world_of(mover_of(standing)), obstacles=walls, start=Pose2(5.0, 2.0, 0.0), goal=(5.0, 8.0))
    assert not reachable(scene, 0.25, 1.0, 30.0).reached
    leaving = replace(scene, movers=(mover_of(replace(standing, vanishes=True)),))
    result = reachable(leaving, 0.25, 1.0, 30.0)
    assert result.reached
    assert result.time > 5.0


def test_patrols_keep_their_way_beside_keyframes():
    patrol = Mover("cylinder", DISC, 0.3, Pose2(8.0, 1.0, 0.0), Patrol(1.0, ((8.0, 1.0), (8.0, 6.0))))
    field = MoverField(world_of(mover_of(Keyframes(TIMES, POINTS)), patrol))
    for _ in range(120):
        field.step(1 / 60)
    np.testing.assert_allclose(field.poses[1, :2], (8.0, 3.0), atol=1e-6)
