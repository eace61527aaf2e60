"""Observations with tracks in analytic scenes, as training sees them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.rooms import disc_body, ranges_to_discs, room
from vuca_nav.geometry import compose
from vuca_nav.policy.observation import BODY_SIZE, TWIST_SIZE, ObservationConfig, Observer
from vuca_nav.policy.track_features import SLOT_SIZE, SLOTS
from vuca_nav.types import FloatArray, LidarSpec, Pose2

TRACKED = ObservationConfig(kind="tracked")
BODY = disc_body(0.3)
HALL = room(10.0, 8.0)


def look(pose: Pose2, discs, beams: int = 180) -> FloatArray:
    """(beams,) ranges from a place in the hall to its walls and discs (x, y, radius)."""
    return ranges_to_discs(discs, HALL, pose, LidarSpec(num_beams=beams))


def drive(observer, scene, seconds, rate=10.0, motion=(0.8, 0.0, 0.6), beams=180):
    """Observe a scene (time to discs) while driving at a velocity; returns the last observation."""
    pose, step = Pose2(2.0, 3.0, 0.2), Pose2(*(v / rate for v in motion))
    out = np.zeros((1, observer.size), np.float32)
    for tick in range(round(seconds * rate) + 1):
        ranges = look(pose, scene(tick / rate), beams=beams)
        observer.observe(ranges[None], np.array([[2.0, 1.0]]), np.array([motion]), np.array([step]), out)
        if tick < round(seconds * rate):
            pose = compose(pose, step)
    return out[0]


def rest_of(observation):
    """Urgency of standing still, and the slots (SLOTS, SLOT_SIZE)."""
    at = TRACKED.goal_slice.stop + TWIST_SIZE + BODY_SIZE
    return observation[at], observation[at + 1 :].reshape(SLOTS, SLOT_SIZE)


def test_a_mirrored_world_gives_the_mirrored_observation():
    def world(t):
        return [(4.0 + 0.5 * t, 4.5 - 1.0 * t, 0.3), (3.3, 1.7, 0.2), (5.0 - t, 2.0, 0.25)]

    def image(t):
        return [(x, 8.0 - y, radius) for x, y, radius in world(t)]

    order, signs = TRACKED.mirror()
    left, right = (Observer(TRACKED, [BODY], 180, 10.0) for _ in range(2))
    goal, sign = np.array([[2.0, 1.0]]), np.array([1.0, -1.0, -1.0])
    pose, step, velocity = Pose2(2.0, 3.0, 0.2), Pose2(0.08, 0.02, 0.06), np.array([[0.8, 0.2, 0.6]])
    here, there = (np.zeros((1, TRACKED.size), np.float32) for _ in range(2))
    for tick in range(15):
        motion = np.array([step])
        left.observe(look(pose, world(0.1 * tick))[None], goal, velocity, motion, here)
        mirrored = look(Pose2(pose.x, 8.0 - pose.y, -pose.yaw), image(0.1 * tick))
        right.observe(mirrored[None], goal * sign[:2], velocity * sign, motion * sign, there)
        assert there[0] == pytest.approx(here[0][order] * signs, abs=1e-5)
        pose = compose(pose, step)
    assert not np.allclose(here, there, atol=0.1)
    assert np.array_equal(here[0][order][order], here[0])
    assert (rest_of(here[0])[1][:, 5] > 0.0).sum() == 3


def test_rows_equal_robots_alone():
    bodies = [replace(disc_body(radius), max_v_x=1.0 + radius) for radius in (0.2, 0.3, 0.5)]
    together, alone = Observer(TRACKED, bodies, 180, 10.0), [Observer(TRACKED, [body], 180, 10.0) for body in bodies]
    rng = np.random.default_rng(4)
    out = np.zeros((3, TRACKED.size), np.float32)
    for tick in range(16):
        discs = [(4.0 + 0.05 * tick, 4.5 - 0.1 * tick, 0.3), (6.0 - 0.1 * tick, 2.0, 0.2)]
        ranges = np.stack([look(Pose2(2.0 + k, 3.0, 0.02 * tick * k), discs) for k in range(3)])
        ranges += rng.normal(0.0, 0.02, ranges.shape)
        motions = np.array([[0.0, 0.0, 0.02 * k] for k in range(3)])
        goals, twists = rng.normal(size=(3, 2)), rng.normal(size=(3, 3))
        if tick == 8:
            together.reset(np.array([1]))
            alone[1].reset()
        together.observe(ranges, goals, twists, motions, out)
        for k in range(3):
            row, one = slice(k, k + 1), np.zeros((1, TRACKED.size), np.float32)
            alone[k].observe(ranges[row], goals[row], twists[row], motions[row], one)
            assert np.array_equal(out[row], one)


def test_a_fast_observer_sees_what_a_slow_one_sees():
    def scene(t):
        return [(5.0 - 1.0 * t, 3.6, 0.3), (3.0, 2.0, 0.2)]

    slow, fast = (drive(Observer(TRACKED, [BODY], 180, rate), scene, 1.5, rate) for rate in (10.0, 30.0))
    # Straight steps of other lengths along a curve end a little apart: an edge may be in the next sector of O_L.
    assert fast[TRACKED.sectors :] == pytest.approx(slow[TRACKED.sectors :], abs=0.08)
    still, slots = rest_of(fast)
    assert still > 0.5
    assert (slots[:, 5] > 0.0).sum() == 2
    # Between two scans that are looked at, tracks go on and so does the body.
    between = drive(Observer(TRACKED, [BODY], 180, 30.0), scene, 1.5 + 2 / 30, 30.0)
    later = drive(Observer(TRACKED, [BODY], 180, 10.0), scene, 1.6, 10.0)
    x_then, x_between, x_later = (rest_of(o)[1][0, 0] for o in (slow, between, later))
    assert x_then > x_between > x_later


@pytest.mark.parametrize("empty", [math.inf, math.nan, 0.0, -math.inf])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_scans_with_nothing_in_them_are_finite(empty, share):
    observer, rng = Observer(TRACKED, [BODY], 180, 10.0), np.random.default_rng(0)
    out = np.full((1, TRACKED.size), np.nan, np.float32)
    for _ in range(30):
        ranges = look(Pose2(2.0, 3.0, 0.0), [(4.0, 3.0, 0.3), (3.0, 4.0, 0.2)])
        ranges[rng.random(180) < share] = empty
        observer.observe(ranges[None], np.zeros((1, 2)), np.zeros((1, 3)), np.zeros((1, 3)), out)
        assert np.isfinite(out).all()
        if share == 1.0:
            assert (rest_of(out[0])[1] == 0.0).all()
