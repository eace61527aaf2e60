"""Several robots in a world: they start apart, see each other and collide with each other, by their own footprints."""

import math
from dataclasses import replace

import numpy as np
import pytest

from train.arena.arena import Arena
from train.arena.config import CROWDED_KINDS, KINDS, ArenaConfig, Imperfections
from train.arena.shared_worlds import START_GAP
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig

PAPER = ObservationConfig()
NO_OTHERS = dict.fromkeys(KINDS, 0.0)
CIRCLE = ArenaConfig(
    circle=1.0, **NO_OTHERS, robots=8, lengths=(8.0, 10.0), layouts=1, pairs=256, num_bodies=6,
    imperfections=Imperfections.none(),
)  # fmt: skip
HALL = replace(CIRCLE, circle=0.0, hall=1.0, lengths=(3.0, 12.0), layouts=2)


def actions(n, steps, seed=0):
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, n, 3)).astype(np.float32)
    drawn[:, :, 0] = np.abs(drawn[:, :, 0])
    return drawn


def rollout(arena, drawn):
    seen = [arena.reset().copy()]
    for action in drawn:
        seen += [array.copy() for array in arena.step(action)]
    return seen


def corners_in_world(arena, i, pose=None):
    """Corners of the footprint of row i where it is, or at a pose."""
    (shard,) = arena.shards
    x, y, yaw = shard.rows.pose[i] if pose is None else pose
    local = shard.bodies.bodies[shard.rows.body[i]].spec.footprint
    c, s = math.cos(yaw), math.sin(yaw)
    return np.column_stack([x + c * local[:, 0] - s * local[:, 1], y + s * local[:, 0] + c * local[:, 1]])


def inside(point, polygon):
    ahead = np.roll(polygon, -1, 0) - polygon
    to = point - polygon
    return (ahead[:, 0] * to[:, 1] - ahead[:, 1] * to[:, 0] >= 0.0).all()


def overlap(a, b):
    """Whether two convex polygons overlap: a corner in the other one, or edges that cross, found by sampling."""
    dense = [p + t * (q - p) for t in np.linspace(0.0, 1.0, 60) for p, q in zip(a, np.roll(a, -1, 0))]
    return any(inside(point, b) for point in dense) or any(inside(point, a) for point in b)


def put(arena, poses):
    """Put the robots somewhere, at rest, with a goal far away, and look again."""
    (shard,) = arena.shards
    shard.rows.pose[: len(poses)] = poses
    shard.rows.task[:, 2:4] = 1000.0
    shard._look(np.arange(arena.n))
    return shard


def test_same_bits_for_the_same_seed_on_any_number_of_threads():
    drawn = actions(48, 60)
    one, two, six = (rollout(Arena(CIRCLE, PAPER, 48, 5, threads), drawn) for threads in (1, 2, 6))
    assert all(np.array_equal(a, b) and np.array_equal(a, c) for a, b, c in zip(one, two, six))
    assert any(step.any() for step in one[5::8])  # somebody collided
    other = rollout(Arena(CIRCLE, PAPER, 48, 6), drawn)
    assert not np.array_equal(one[-8], other[-8])


@pytest.mark.parametrize("config", [CIRCLE, replace(HALL, robots=24)], ids=CROWDED_KINDS)
def test_robots_of_a_world_share_its_layout_and_start_apart(config):
    arena = Arena(config, PAPER, 4 * config.robots, 2)
    arena.reset()
    (shard,) = arena.shards
    for world in range(4):
        rows = slice(world * config.robots, (world + 1) * config.robots)
        assert len(set(shard.rows.layout[rows].tolist())) == 1
        at, radius = shard.rows.pose[rows, :2], shard.bodies.shape[shard.rows.body[rows], 0]
        gaps = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1)) - radius[:, None] - radius[None]
        gaps[np.arange(len(at)), np.arange(len(at))] = np.inf
        assert gaps.min() >= START_GAP
    assert (shard.outputs.clearance > 0.0).all()
    assert (shard.rows.counts == 0).all()
    assert np.allclose(shard.rows.pose[:, :2], shard.rows.task[:, :2])


def test_the_circle_holds_its_starts_and_goals():
    arena = Arena(CIRCLE, PAPER, 160, 2)
    arena.reset()
    task = arena.gather("task")
    assert np.hypot(*(task[:, :2] - 10.0).T).max() <= 9.0
    assert np.hypot(*(task[:, 2:4] - 10.0).T).max() <= 9.0
    straight = np.hypot(*(task[:, :2] - task[:, 2:4]).T)
    assert straight.min() > 7.3
    assert straight.max() < 10.4


def test_a_robot_sees_the_footprints_of_the_others_and_not_its_own():
    """Every beam against the edges of all other footprints, crossed one by one."""
    arena = Arena(replace(CIRCLE, num_beams=360), PAPER, 8, 1)
    arena.reset()
    rng = np.random.default_rng(0)
    met = 0
    for _ in range(6):
        angles = 2.0 * math.pi * np.arange(8) / 8
        at = 10.0 + rng.uniform(1.0, 2.0, 8)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        shard = put(arena, np.column_stack([at, rng.uniform(-math.pi, math.pi, 8)]))
        for i in range(8):
            x, y, yaw = shard.rows.pose[i]
            expected = np.full(360, np.inf)
            for j in range(8):
                lower = shard.bodies.bodies[shard.rows.body[i]].lidar_height
                if j == i or lower > shard.bodies.bodies[shard.rows.body[j]].height:
                    continue
                polygon = corners_in_world(arena, j)
                for a, b in zip(polygon, np.roll(polygon, -1, 0)):
                    for k in range(360):
                        bearing = yaw - math.pi + k * 2.0 * math.pi / 360
                        d, e = np.array([math.cos(bearing), math.sin(bearing)]), b - a
                        area = d[0] * e[1] - d[1] * e[0]
                        if abs(area) < 1e-12:
                            continue
                        to = a - (x, y)
                        length = (to[0] * e[1] - to[1] * e[0]) / area
                        along = (to[0] * d[1] - to[1] * d[0]) / area
                        if 0.0 < length < expected[k] and 0.0 <= along <= 1.0:
                            expected[k] = length
            seen = np.isfinite(expected) & (expected < 3.5)
            assert shard.ranges[i][seen] == pytest.approx(expected[seen], abs=1e-6)
            assert (shard.ranges[i][~np.isfinite(expected)] > 6.0).all()  # nothing but the walls of the square
            met += int(seen.sum())
    assert met > 1000


def test_alone_in_the_circle_a_robot_sees_only_the_walls():
    arena = Arena(replace(CIRCLE, robots=2, num_beams=360), PAPER, 2, 1)
    arena.reset()
    shard = put(arena, np.array([[10.0, 10.0, 0.3], [1.0, 1.0, 0.0]]))
    assert not np.isfinite(shard.ranges[0]).any()


def test_collisions_are_overlaps_of_footprints_and_both_robots_have_them():
    arena = Arena(replace(CIRCLE, num_beams=36), ObservationConfig(sectors=36), 64, 3)
    arena.reset()
    (shard,) = arena.shards
    pairs = 0
    for action in actions(64, 200, 1):
        body, ticks = shard.rows.body.copy(), shard._poses
        footprints = [shard.bodies.bodies[b].spec for b in body]
        step = arena.step(action)
        for world in range(8):
            rows = range(world * 8, (world + 1) * 8)
            for i in rows:
                met = False
                for j in rows:
                    away = np.hypot(*(ticks[i, :, :2] - ticks[j, :, :2]).T).min()
                    if j == i or away > footprints[i].radius + footprints[j].radius:
                        continue
                    for t in range(ticks.shape[1]):
                        a, b = (_at(footprints[k].footprint, ticks[k, t]) for k in (i, j))
                        met |= overlap(a, b)
                near_wall = np.abs(ticks[i, :, :2] - 10.0).max() > 9.3
                if met:
                    assert step.collided[i] or step.reached[i]
                    pairs += 1
                elif step.collided[i]:
                    assert near_wall
    assert pairs >= 10


def _at(local, pose):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.column_stack([pose[0] + c * local[:, 0] - s * local[:, 1], pose[1] + s * local[:, 0] + c * local[:, 1]])


def test_a_robot_that_ends_starts_anew_and_the_others_go_on():
    arena = Arena(CIRCLE, PAPER, 16, 4)
    arena.reset()
    (shard,) = arena.shards
    layouts, ended = shard.rows.layout.copy(), 0
    for action in actions(16, 500, 2):
        step = arena.step(action)
        over = step.collided | step.reached | step.timed_out
        assert (shard.rows.ticks[over] == 0).all()
        assert (shard.rows.ticks[~over] > 0).all()
        assert np.array_equal(shard.rows.layout, layouts)
        ended += int(over.sum())
    assert ended > 16


def test_a_robot_that_has_ended_stays_in_the_way_where_each_runs_once():
    arena = Arena(replace(CIRCLE, robots=2), PAPER, 2, 0, once=True)
    arena.reset()
    shard = put(arena, np.array([[10.0, 10.0, 0.0], [12.0, 10.0, math.pi]]))
    arena.end(np.array([False, True]))
    shard._encounters.park(np.array([1]))
    stay = shard.rows.pose[1].copy()
    forward = np.tile(np.array([1.0, 0.0, 0.0], np.float32), (2, 1))
    for _ in range(60):
        step = arena.step(forward)
        if step.collided[0]:
            break
    assert step.collided[0]
    assert np.array_equal(shard.rows.pose[1], stay)
    assert 11.0 < shard.rows.pose[0, 0] < 12.0


def test_what_does_not_go_together_is_refused():
    with pytest.raises(BadArgument, match="8 in each world: a multiple of 8"):
        Arena(CIRCLE, PAPER, 12, 0)
    with pytest.raises(BadArgument, match="go with circle, hall only"):
        ArenaConfig(robots=2)
    with pytest.raises(BadArgument, match="robots must be 1 or more"):
        replace(CIRCLE, robots=0)
