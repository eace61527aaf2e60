import math
from dataclasses import replace

import numpy as np
import pytest

from robots.clearance import FootprintClearance
from train.analysis.episodes import Evaluation
from train.arena.arena import Arena
from train.arena.bank import make_bank
from train.arena.config import BODY_KINDS, KINDS, ArenaConfig, Imperfections
from train.arena.kernels import Driven, Wheels, drive
from train.arena.rows import Robots, Streams
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig
from worlds.motion.movers import TICK

SMALL = ArenaConfig(layouts=2, pairs=16, num_bodies=6)
EXACT = replace(SMALL, imperfections=Imperfections.none())
PAPER = ObservationConfig()


def random_actions(n, steps, seed=0):
    actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, n, 3)).astype(np.float32)
    actions[:, :, 0] = np.abs(actions[:, :, 0])
    return actions


def rollout(arena, actions):
    """Everything that came of it, as one list of arrays."""
    seen = [arena.reset().copy()]
    for action in actions:
        seen += [array.copy() for array in arena.step(action)]
    return seen


def test_same_bits_on_one_thread_and_on_two():
    actions = random_actions(37, 60)
    one, two = (rollout(Arena(SMALL, PAPER, 37, 5, threads), actions) for threads in (1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(one, two))
    other = rollout(Arena(SMALL, PAPER, 37, 6), actions)
    assert not np.array_equal(one[-7], other[-7])


@pytest.mark.parametrize("kind", KINDS)
def test_an_episode_starts_free_and_away_from_movers(kind):
    config = replace(EXACT.of(kind), movers=(15, 15))
    arena = Arena(config, PAPER, 200, 0)
    arena.reset()
    assert (arena.outputs.clearance > 0.0).all()
    rows, (shard,) = arena.shards[0].rows, arena.shards
    gap = np.hypot(rows.movers[:, :, 0] - rows.pose[:, None, 0], rows.movers[:, :, 1] - rows.pose[:, None, 1])
    gap -= rows.constants[:, :, 2]
    there = np.arange(15) < rows.counts[:, None]
    radius = shard.bodies.shape[rows.body, 0]
    assert ((gap >= 1.5 + radius[:, None] - 1e-9) | ~there).all()
    assert (rows.counts == 0).all() if kind == "static" else rows.counts.mean() > 5
    length, (low, high) = rows.task[:, 4], config.lengths
    straight = np.hypot(*(rows.task[:, 0:2] - rows.task[:, 2:4]).T)
    assert ((length > low - 0.31) & (length < high + 0.31) & (straight <= length * 1.001)).all()
    assert length.max() > 8.0
    assert length.min() < 4.0


def test_new_episodes_begin_where_old_ones_ended():
    arena = Arena(SMALL, PAPER, 64, 1)
    arena.reset()
    ended = 0
    for action in random_actions(64, 150):
        step = arena.step(action)
        over = step.collided | step.reached | step.timed_out
        assert (step.collided.astype(int) + step.reached + step.timed_out <= 1).all()
        assert (arena.gather("ticks")[over] == 0).all()
        assert (arena.gather("ticks")[~over] > 0).all()
        assert np.isfinite(step.observation).all()
        assert np.isfinite(step.progress).all()
        ended += int(over.sum())
    assert ended > 64


def test_collisions_are_those_of_the_clearance_at_the_same_places():
    """A row that collided is where its footprint overlaps something; one that goes on is nowhere near."""
    config = replace(EXACT.of("mixed"), movers=(15, 15))
    evaluation = Evaluation(config, PAPER, 60, 3)
    for action in random_actions(60, 200, 1):
        evaluation.step(action)
    records, arena = evaluation.records(), evaluation.arena
    assert records.collision.sum() > 20
    (shard,) = arena.shards
    for i in range(60):
        a, b = shard.bank.first[shard.rows.layout[i] :][:2]
        static, body = shard.bank.static[a:b], shard.bodies.bodies[shard.rows.body[i]]
        parts = shard.rows.parts[i, : shard.rows.num_parts[i]]
        clearance = FootprintClearance(as_shapes(static), as_shapes(parts), body.spec.footprint, body.height)
        hit = False
        for tick in range(3):
            (x, y, yaw), places = shard._poses[i, tick], shard._part_poses[i, tick, : len(parts)]
            parts_at = np.column_stack([places[:, :2], np.arctan2(places[:, 3], places[:, 2])])
            hit |= clearance.distance(x, y, yaw, parts_at) == 0.0
        assert hit == records.collision[i]


def as_shapes(columns):
    from worlds.arrays import ShapeArrays

    yaw = np.arctan2(columns[:, 3], columns[:, 2])
    return ShapeArrays(columns[:, 6] != 0.0, columns[:, :2], columns[:, 4:6], yaw, columns[:, 8:10])


def test_a_body_answers_late_slowly_and_within_its_acceleration():
    gain, lag, delay, acceleration = 0.9, 0.2, 2, 1.5
    commands = np.concatenate([np.full(20, 1.0), np.full(20, -0.5), np.linspace(0, 1, 20)])
    # As train.analysis.response has it, but the limit comes after the lag: wheels and legs both have theirs at the end.
    expected, v = np.empty(60), 0.0
    for k in range(60):
        wanted = gain * commands[k - delay] if k >= delay else 0.0
        v += np.clip((1.0 - math.exp(-TICK / lag)) * (wanted - v), -acceleration * TICK, acceleration * TICK)
        expected[k] = v
    response = np.zeros((1, 3, 5))
    response[0, :] = gain, math.exp(-TICK / lag), delay, 0.0, acceleration
    pose, velocity, ring, ticks = np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 16, 3)), np.zeros(1, np.int64)
    words, poses, way = np.zeros(1, np.uint64), np.zeros((1, 1, 3)), np.zeros(1)
    nothing = np.zeros(1, np.int64)
    robots = Robots(nothing, pose, velocity, response, nothing, ring, np.zeros((1, 3)), np.zeros((1, 2)))
    driven = Driven(poses, np.zeros((1, 3)), np.zeros((1, 3)), way)
    got = []
    for command in commands:
        wanted = np.array([[command, 0.0, 0.0]])
        drive(
            np.zeros(1, np.int64), TICK, wanted, Wheels(np.zeros(1), 1.0), Streams(words, words), ticks, robots, driven,
        )  # fmt: skip
        got.append(velocity[0, 0])
    np.testing.assert_allclose(got, expected, atol=1e-12)
    assert pose[0, 0] == pytest.approx(expected.sum() * TICK)


def test_driving_straight_at_the_goal_arrives_in_time():
    config = replace(EXACT.of("dynamic").driven_by("go2"), movers=(0, 0))
    evaluation = Evaluation(config, PAPER, 40, 0)
    goal = PAPER.goal_slice

    def policy(observation):
        _, cos, sin = observation[:, goal].T
        bearing = np.arctan2(sin, cos)
        forward = np.where(np.abs(bearing) < 0.3, 1.0, 0.0)
        return np.column_stack([forward, np.zeros_like(forward), np.clip(3.0 * bearing, -1, 1)]).astype(np.float32)

    records = evaluation.run(policy)
    assert records.success.all()
    assert (records.time < 12.0 / 1.2 + 8.0).all()
    assert (records.path_length > records.shortest - 0.6).all()
    assert (records.ansps > 0.0).all()
    assert (records.arsps == 0.0).mean() > 0.5


def test_who_waits_times_out():
    config = replace(EXACT.of("static"), time_factor=1e-6, time_slack=0.95)
    evaluation = Evaluation(config, PAPER, 8, 0)
    records = evaluation.run(lambda observation: np.zeros((8, 3), np.float32))
    assert records.timeout.all()
    np.testing.assert_allclose(records.time, 1.0)
    assert np.allclose(records.path_length, 0.0)


def test_every_policy_meets_the_same_episodes():
    config = replace(SMALL, movers=(12, 12))
    first, second = (Evaluation(config, PAPER, 30, 9) for _ in range(2))
    for action in random_actions(30, 40):
        first.step(action)
        second.step(0.0 * action)
    both = first.active & second.active
    assert both.any()
    for name in ("task", "body", "layout", "kind", "response", "latency"):
        np.testing.assert_array_equal(first.arena.gather(name), second.arena.gather(name))
    np.testing.assert_array_equal(first.arena.gather("movers")[both], second.arena.gather("movers")[both])
    more = Evaluation(config, PAPER, 35, 9)
    np.testing.assert_array_equal(more.arena.gather("task")[:30], first.arena.gather("task"))


@pytest.mark.parametrize("seen", [PAPER, ObservationConfig(kind="tracked")])
def test_the_same_episodes_again_all_or_some_of_them(seen):
    evaluation = Evaluation(replace(SMALL, time_factor=0.5, time_slack=3.0).of("dynamic"), seen, 12, 3, threads=2)

    def drive(observation):
        return np.tanh(observation[:, :3] + 0.5).astype(np.float32)

    first = evaluation.run(drive)
    evaluation.again()
    second = evaluation.run(drive)
    for name in first.__slots__:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    only = np.arange(12) % 3 == 0
    evaluation.again(only)
    np.testing.assert_array_equal(evaluation.active, only)
    some = evaluation.run(drive)
    for name in ("time", "collision", "path_length", "arsps"):
        np.testing.assert_array_equal(getattr(some, name)[only], getattr(first, name)[only])
    assert (some.time[~only] == 0.0).all()


def test_an_empty_scan_is_observed():
    always = replace(SMALL, imperfections=Imperfections(empty_scan=1.0))
    for kind in ("paper", "tracked"):
        arena = Arena(always, ObservationConfig(kind=kind), 6, 0)
        observation = arena.reset()
        for action in random_actions(6, 10):
            assert np.isfinite(observation).all()
            assert np.isinf(arena.outputs.nearest).all()
            observation = arena.step(action).observation


def test_decisions_at_the_lidars_rate():
    arena = Arena(replace(SMALL, decision_rate=30), PAPER, 8, 0)
    arena.reset()
    arena.step(random_actions(8, 1)[0])
    assert (arena.gather("ticks") == 1).all()


def test_shares_are_drawn():
    arena = Arena(replace(SMALL, layouts=1), PAPER, 600, 0)
    arena.reset()
    kinds = np.bincount(arena.gather("kind"), minlength=len(SMALL.shares)) / 600
    np.testing.assert_allclose(kinds, SMALL.shares, atol=0.07)
    bodies = np.bincount(np.minimum(arena.gather("body"), 2), minlength=3) / 600
    np.testing.assert_allclose(bodies, SMALL.body_shares, atol=0.07)


def test_movers_stop_and_go_and_patrols_turn_back():
    config = replace(EXACT.of("dynamic"), movers=(12, 12), pausing=0.5, patrols=0.5)
    arena = Arena(config, PAPER, 20, 0)
    arena.reset()
    standing = []
    for _ in range(60):
        arena.shards[0].move(np.arange(20), 3)
        rows = arena.shards[0].rows
        there = np.arange(12) < rows.counts[:, None]
        standing.append((np.hypot(rows.movers[:, :, 3], rows.movers[:, :, 4]) == 0.0) & there)
        assert (rows.movers[:, :, :2][there] > 0.2).all()
        assert (rows.movers[:, :, :2][there] < 15.8).all()
    pausing = rows.pauses[:, :, 0] > 0.0
    share = np.mean(standing, axis=0)
    assert (share[~pausing & there] == 0.0).mean() > 0.95
    assert 0.2 < share[pausing & there].mean() < 0.5  # 1.5 s of every 4.5 s
    assert (rows.constants[:, :, 0] == 1).mean() > 0.2


def test_training_and_evaluation_have_different_layouts():
    arena = Arena(SMALL, PAPER, 4, 0)
    evaluation = Evaluation(SMALL, PAPER, 4, 0)
    assert not np.array_equal(arena.bank.static, evaluation.arena.bank.static)
    assert np.array_equal(make_bank(SMALL).pairs, arena.bank.pairs)


@pytest.mark.parametrize(
    "wrong",
    [
        {"movers": (5, 3)}, {"movers": (5, 121)}, {"mover_speeds": (0.2, math.inf)}, {"decision_rate": 7},
        {"decision_rate": 0}, {"static": -1.0}, {"layouts": 0}, dict.fromkeys(BODY_KINDS, 0.0), {"num_beams": 0},
        {"patrols": -0.1}, {"pausing": 2.0}, {"pausing": math.nan}, {"time_factor": 0.0}, {"time_slack": -1.0},
        {"lengths": (0.0, 0.0)}, {"lengths": (1.5, math.inf)}, {"world_seed": -1},
    ],
)  # fmt: skip
def test_bad_configurations_are_refused(wrong):
    with pytest.raises(BadArgument, match=next(iter(wrong))) as caught:
        ArenaConfig(**wrong)
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    "wrong",
    [
        {"latency": (0, 99)}, {"latency": (2, 1)}, {"dropout": 1.5}, {"pose_time": 0.0}, {"range_sigma": -1.0},
        {"yaw_sigma": math.inf}, {"velocity_noise": math.nan}, {"response_spread": 1.0}, {"odometry_turn": -0.1},
    ],
)  # fmt: skip
def test_bad_imperfections_are_refused(wrong):
    with pytest.raises(BadArgument, match=next(iter(wrong))) as caught:
        Imperfections(**wrong)
    assert len(str(caught.value)) < 120


def test_bad_actions_are_refused():
    arena = Arena(SMALL, PAPER, 3, 0)
    arena.reset()
    with pytest.raises(BadArgument, match="shape"):
        arena.step(np.zeros((2, 3), np.float32))
    with pytest.raises(BadArgument, match="row 1 is not finite"):
        arena.step(np.array([[0, 0, 0], [0, np.nan, 0], [0, 0, 0]], np.float32))
