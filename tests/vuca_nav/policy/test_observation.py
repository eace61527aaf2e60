import math
from dataclasses import replace

import numpy as np
import pytest

from vuca_nav.errors import BadArgument
from vuca_nav.footprint import outline_ranges
from vuca_nav.policy.observation import (
    ObservationConfig,
    Observer,
    command_from_action,
    goal_features,
    limits_of,
)
from vuca_nav.types import BodySpec

RECTANGLE = np.array([[-0.3, -0.2], [0.5, -0.2], [0.5, 0.2], [-0.3, 0.2]])
BODY = BodySpec("box", RECTANGLE, 1.5, -0.5, 0.4, 2.0, 2.0, 2.0, 4.0)
PAPER = ObservationConfig(sectors=4, max_range=6.0)
STILL = np.zeros((1, 3))
AHEAD = np.array([[2.0, 0.0]])


def sees(observer: Observer, ranges, goal=AHEAD, twist=STILL, motion=STILL) -> np.ndarray:
    out = np.full((len(ranges), observer.size), np.nan, np.float32)
    observer.observe(np.asarray(ranges, np.float64), goal, twist, motion, out)
    return out


def metres(pooled):
    return (pooled + 1.0) * 3.0


def test_ranges_are_beyond_the_footprint():
    # Beams of 8: -180, -135, -90, -45, 0, 45, 90, 135 degrees.
    out = sees(Observer(PAPER, [BODY], 8, 30.0), [[1.3, 2.0, 5.2, 2.0, 3.5, 4.0, 0.1, math.inf]])[0]
    # The nearest of three beams, those on the borders included; inside the footprint is 0, far the greatest range.
    assert metres(out[:4]) == pytest.approx([1.0, 2.0 - 0.2 * math.sqrt(2.0), 0.0, 0.0], abs=1e-6)


def test_a_mirrored_world_gives_the_mirrored_observation():
    rng = np.random.default_rng(5)
    config = ObservationConfig()
    left, right = (Observer(config, [BODY], 360, 10.0) for _ in range(2))
    order, signs = config.mirror()
    sign = np.array([1.0, -1.0, -1.0])
    for _ in range(8):
        scan, goal, twist = rng.uniform(0.3, 9.0, (1, 360)), rng.normal(size=(1, 2)), rng.normal(size=(1, 3))
        a = sees(left, scan, goal, twist)[0]
        b = sees(right, np.roll(scan[:, ::-1], 1, axis=1), goal * sign[:2], twist * sign)[0]
        assert b == pytest.approx(a[order] * signs, abs=1e-6)
        assert not np.allclose(a, b)


def test_the_motion_term_is_the_papers_sum():
    observer = Observer(PAPER, [BODY], 4, 10.0)
    clearances = np.array([3.0, 2.9, 2.6, 2.5, 2.45])
    outs = [sees(observer, [outline_ranges(RECTANGLE, 4) + c])[0] for c in clearances]
    # Full scale: CLOSING_SPEED over the three lags, 0.6 m.
    assert outs[0][4:8] == pytest.approx(np.zeros(4), abs=1e-6)
    assert outs[1][4:8] == pytest.approx(np.full(4, (-0.1 - 0.1 / 2 - 0.1 / 3) / 0.6), abs=1e-5)
    assert outs[4][4:8] == pytest.approx(np.full(4, (-0.05 - 0.15 / 2 - 0.45 / 3) / 0.6), abs=1e-5)


def test_at_a_faster_rate_the_history_keeps_its_spacing():
    slow, fast = Observer(PAPER, [BODY], 4, 10.0), Observer(PAPER, [BODY], 4, 30.0)
    a = b = np.empty(0)
    for tick in range(31):
        scan = [outline_ranges(RECTANGLE, 4) + 4.0 - 0.02 * tick]
        b = sees(fast, scan)
        if tick % 3 == 0:
            a = sees(slow, scan)
    assert np.array_equal(a, b)


def test_goal_and_velocity_are_relative():
    observer = Observer(PAPER, [BODY], 4, 30.0)
    out = sees(observer, [[9.0] * 4], np.array([[0.0, -3.0]]), np.array([[-0.25, 0.2, 1.0]]))[0]
    assert out[8:11] == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)
    assert out[11:] == pytest.approx([-0.5, 0.5, 0.5])
    assert out[PAPER.goal_slice] == pytest.approx(goal_features(np.array([[0.0, -3.0]]))[0])
    assert goal_features(np.zeros((1, 2)))[0] == pytest.approx([-1.0, 1.0, 0.0])
    # A differential base that does not back up: what it cannot do reads as nothing.
    other = Observer(PAPER, [BODY, replace(BODY, max_v_y=0.0, min_v_x=0.0)], 4, 30.0)
    observer.take_bodies(np.array([0]), other, np.array([1]))
    out = sees(observer, [[9.0] * 4], twist=np.array([[-0.75, 0.2, 90.0]]))[0]
    assert out[11:] == pytest.approx([-0.5, 0.0, 2.0])


def test_actions_are_shares_of_the_limits():
    limits = limits_of(BODY)
    assert command_from_action(np.array([0.5, -1.0, 2.0]), limits) == pytest.approx([0.75, -0.4, 2.0])
    batch = command_from_action(np.array([[-1.0, 0.0, -0.5], [1.0, 0.5, 0.0]], np.float32), np.tile(limits, (2, 1)))
    assert batch == pytest.approx(np.array([[-0.5, 0.0, -1.0], [1.5, 0.2, 0.0]]))


@pytest.mark.parametrize("kind", ["paper", "tracked"])
@pytest.mark.parametrize("nothing", [math.inf, math.nan])
def test_an_empty_scan_reads_as_free(kind, nothing):
    observer = Observer(ObservationConfig(kind=kind), [BODY], 360, 30.0)
    for _ in range(15):
        out = sees(observer, np.full((1, 360), nothing), motion=np.array([[0.05, 0.0, 0.05]]))
    assert (out[0, :60] == 1.0).all()
    assert (out[0, 60 : observer.config.goal_slice.start] == 0.0).all()


@pytest.mark.parametrize("kind", ["paper", "tracked"])
def test_a_row_is_what_it_is_alone(kind):
    rng = np.random.default_rng(3)
    n, config = 5, ObservationConfig(kind=kind)
    bodies = [replace(BODY, footprint=RECTANGLE * k, max_v_x=0.5 * k) for k in range(1, n + 1)]
    together = Observer(config, bodies, 120, 10.0)
    alone = [Observer(config, [body], 120, 10.0) for body in bodies]
    for tick in range(12):
        ranges = rng.uniform(0.2, 9.0, (n, 120))
        goals, twists = rng.normal(size=(n, 2)), rng.normal(size=(n, 3))
        motions = 0.1 * rng.normal(size=(n, 3))
        if tick == 6:
            together.reset(np.array([False, True, False, False, True]))
            alone[1].reset()
            alone[4].reset()
        out = sees(together, ranges, goals, twists, motions)
        for i in range(n):
            row = slice(i, i + 1)
            assert np.array_equal(out[row], sees(alone[i], ranges[row], goals[row], twists[row], motions[row]))


def test_a_reset_forgets():
    for kind in ("paper", "tracked"):
        config = ObservationConfig(kind=kind)
        used, new = (Observer(config, [BODY], 360, 10.0) for _ in range(2))
        rng = np.random.default_rng(0)
        for _ in range(7):
            sees(used, rng.uniform(0.5, 5.0, (1, 360)), motion=rng.normal(size=(1, 3)))
        used.reset(np.array([0]))
        for _ in range(7):
            scan, motion = rng.uniform(0.5, 5.0, (1, 360)), rng.normal(size=(1, 3))
            assert np.array_equal(sees(used, scan, motion=motion), sees(new, scan, motion=motion))


@pytest.mark.parametrize(
    ("config", "beams", "rate", "message"),
    [
        (ObservationConfig(sectors=7), 360, 30.0, "do not divide"),
        (ObservationConfig(spacing=0.05), 360, 30.0, "spaced by"),
        (ObservationConfig(spacing=0.1), 360, 4.0, "spaced by"),
    ],
)
def test_what_does_not_fit_is_refused(config, beams, rate, message):
    with pytest.raises(BadArgument, match=message):
        Observer(config, [BODY], beams, rate)


@pytest.mark.parametrize(
    "bad", [{"sectors": 0}, {"sectors": 60.0}, {"history": 0}, {"max_range": math.nan}, {"spacing": 0.0}]
)
def test_a_bad_configuration_is_refused(bad):
    with pytest.raises(BadArgument):
        ObservationConfig(**bad)
