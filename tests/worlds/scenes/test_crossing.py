"""The crossing's promises, verified on its geometry and on the ways of its movers."""

import math

import numpy as np

from worlds import make_world
from worlds.motion.movers import MoverField
from worlds.scenes.crossing import SIDE
from worlds.world import SocialForce

MIDDLE = SIDE / 2.0


def test_the_task_and_the_movers_are_those_of_crowdnav():
    radii, speeds, offsets = [], [], []
    for seed in range(20):
        world = make_world("crossing", seed)
        for x, y in (world.start[:2], world.goal):
            assert max(abs(x - MIDDLE), abs(y - MIDDLE)) <= 6.0
        assert math.dist(world.start[:2], world.goal) >= 8.0
        assert len(world.movers) == 20
        for mover in world.movers:
            assert isinstance(mover.motion, SocialForce)
            assert not mover.sees_robot
            across = mover.motion.waypoints[1]
            assert np.allclose(np.add(mover.start[:2], across), 2.0 * MIDDLE)
            radii.append(mover.radius)
            speeds.append(mover.motion.speed)
            offsets.append(math.dist(mover.start[:2], (MIDDLE, MIDDLE)) - 6.0 * math.sqrt(2.0))
    assert 0.3 <= min(radii) < 0.32
    assert 0.48 < max(radii) <= 0.5
    assert 0.5 <= min(speeds) < 0.55
    assert 1.45 < max(speeds) <= 1.5
    assert -2.0 * math.sqrt(2.0) <= min(offsets)
    assert max(offsets) <= 2.0 * math.sqrt(2.0)


def test_movers_start_clear_of_each_other_the_robot_and_its_goal():
    for seed in range(20):
        world = make_world("crossing", seed, movers=40)
        for i, mover in enumerate(world.movers):
            for x, y in (world.start[:2], world.goal):
                assert math.dist(mover.start[:2], (x, y)) >= mover.radius + 0.5 + 0.25
            for other in world.movers[:i]:
                assert math.dist(mover.start[:2], other.start[:2]) >= mover.radius + other.radius + 0.25


def test_movers_cross_the_ground_and_keep_off_each_other_and_the_walls():
    world = make_world("crossing", 1)
    field = MoverField(world)
    radii = np.array([mover.radius for mover in world.movers])
    starts = field.poses[:, :2].copy()
    crossed, pressed, pairs = np.zeros(len(radii), bool), 0, 0
    for _ in range(50 * 10):
        field.step(0.1)
        places = field.poses[:, :2]
        assert np.all(places > 0.2 + radii[:, None])
        assert np.all(places < SIDE - 0.2 - radii[:, None])
        crossed |= np.linalg.norm(places - (2.0 * MIDDLE - starts), axis=1) < 0.6
        gaps = np.linalg.norm(places[:, None] - places, axis=2) - radii[:, None] - radii
        pressed += int((gaps[np.triu_indices(len(radii), 1)] < -0.1).sum())
        pairs += len(radii) * (len(radii) - 1) // 2
    assert crossed.sum() >= 12  # the slowest take 50 s, and in the press some turn back
    assert pressed / pairs < 0.002
