"""The shield's risk against the same by brute force."""

import math

import numpy as np
import pytest

from vuca_nav.shield.futures import Futures
from vuca_nav.shield.rollouts import _follow, _harm, _risk
from vuca_nav.shield.shield import ShieldConfig, ways_out

CONFIG = ShieldConfig()
DISCS, LIMITS, ACCELERATIONS = np.array([[0.0, 0.0, 0.28]]), np.array([1.0, -0.4, 0.0, 1.0]), np.array([1.0, 0.0, 2.0])
FREE = np.full((160, 160), 32000, np.int16)
ROOM = 1e9


def scene(rng):
    """One to three things that come at the robot more or less, (k, 6)."""
    k = rng.integers(1, 4)
    angle, away = rng.uniform(-math.pi, math.pi, k), rng.uniform(1.0, 2.5, k)
    heading, speed = angle + math.pi + rng.normal(0.0, 0.5, k), rng.uniform(0.4, 1.5, k)
    return np.column_stack(
        [
            away * np.cos(angle), away * np.sin(angle), speed * np.cos(heading), speed * np.sin(heading),
            np.full(k, 0.3), np.ones(k),
        ]
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(100))
def test_in_every_future_the_best_of_all_ways_out_is_taken(seed):
    rng = np.random.default_rng(seed)
    things, ways, c = scene(rng), ways_out(CONFIG.num_ways_out), CONFIG
    dt, resolution, reach = c.futures.time_step, c.resolution, c.reach
    futures = Futures(16, c.futures).draw(things, FREE, c.far_resolution, c.far_reach)
    near, steps, first = np.arange(len(things)), futures.shape[2], round(c.segment / dt)
    u, last = np.array([rng.uniform(-0.4, 1.0), 0.0, rng.uniform(-1.0, 1.0)]), np.array([rng.uniform(0, 1), 0.0, 0.0])
    risk = _risk(
        FREE, resolution, reach, DISCS, futures, things, near, ways, np.zeros((len(ways), steps, 4)), u, last,
        np.zeros(3), LIMITS, ACCELERATIONS, dt, c.segment, c.margin, c.mover_margin, c.mover_growth, ROOM, math.inf,
    )  # fmt: skip

    def follow(way, begin, trajectory, since, end):
        return _follow(
            FREE, resolution, reach, DISCS, way, u, begin, LIMITS, ACCELERATIONS, dt, c.margin, ROOM, trajectory, since,
            end,
        )  # fmt: skip

    trajectories = np.zeros((len(ways) + 1, steps, 4))
    turned = follow(np.array([3.0, 0.0]), np.array([0.0, 0.0, 0.0, *last]), trajectories[-1], 0, first)
    for m, way in enumerate(ways):
        follow(way, turned, trajectories[m], first, steps)
    harms = []
    for future in futures:
        at_first = _harm(future, things, near, DISCS, trajectories[-1], 0, first, dt, c.mover_margin, c.mover_growth)
        then = [
            _harm(future, things, near, DISCS, trajectory, first, steps, dt, c.mover_margin, c.mover_growth)
            for trajectory in trajectories[:-1]
        ]
        harms.append(max(at_first, min(then)))
    assert risk == pytest.approx(np.mean(harms), abs=1e-12)
