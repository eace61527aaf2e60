"""Futures: possible positions of all moving tracks in the next seconds, several possibilities at once.

A moving obstacle goes straight on until an obstacle is in its way, now and then turns earlier, and then goes on in any
free direction; the moment of a turn cannot be foreseen. So each future draws the moment and the direction of each
track's turn from a table made once: the same scene always has the same futures.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.distance_field import DistanceField
from vuca_nav.perception.tracks import RADIUS, V_X, V_Y, X, Y
from vuca_nav.types import FloatArray


@dataclass(frozen=True, slots=True)
class FuturesConfig:
    """Settings of the futures: number, length, and turns of moving obstacles."""

    scenarios: int = 12
    """Number of futures of all tracks; in the first a track turns only before an obstacle."""
    horizon: float = 3.0
    """Length of a future [s]."""
    time_step: float = 0.1
    """[s]"""
    turn_rate: float = 0.1
    """Rate of a moving obstacle's turns without a visible cause [1/s]."""
    free_run: float = 0.6
    """Length that must be free along the heading after a turn [m]."""
    clearance: tuple[float, float] = (0.05, 0.6)
    """Least and greatest clearance at which a moving obstacle turns away from an obstacle [m]."""


class _Turning(NamedTuple):
    """Settings and draws of the turns, for the kernel."""

    rate: float
    free_run: float
    nearest: float
    farthest: float
    time_step: float


_DRAWS = 12
"""Numbers for each track in each future: time of the first turn, clearance at a turn, then headings to try."""


class Futures:
    """Draws futures of tracks.

    Args:
        most: Greatest number of tracks.
        config: Settings.

    Attributes:
        positions: (scenarios, most, steps, 2) in the base_link of now [m].
    """

    def __init__(self, most: int, config: FuturesConfig = FuturesConfig()):
        s = config.scenarios
        rng = np.random.default_rng(0)
        # Stratified: of all scenarios the first turns of each track are spread over all times, headings over all.
        strata = np.array([[rng.permutation(s) for _ in range(_DRAWS)] for _ in range(most)])  # (most, _DRAWS, s)
        self._draws: FloatArray = (strata.transpose(2, 0, 1) + rng.random((s, most, _DRAWS))) / s
        steps = round(config.horizon / config.time_step)
        self.positions: FloatArray = np.zeros((s, most, steps, 2))
        self._turning = _Turning(config.turn_rate, config.free_run, *config.clearance, config.time_step)

    def draw(self, tracks: FloatArray, static: DistanceField) -> FloatArray:
        """Draw the futures of these tracks.

        Args:
            tracks: (k, TRACK_SIZE) in base_link.
            static: Distance field of the static returns.

        Returns:
            (scenarios, k, steps, 2) a view of ``positions``: where they are after 1, 2, ... time steps.
        """
        _draw(tracks, static, self._draws, self._turning, self.positions)
        return self.positions[:, : len(tracks)]


@njit(cache=True)
def _clearance_at(field, x, y):
    """Distance of a point to the static returns [m]; 1e9 outside of the field."""
    n, reach = field.fifths.shape[0], field.reach
    j, i = int((x + reach) / field.resolution), int((y + reach) / field.resolution)
    inside = x > -reach and y > -reach and i < n and j < n
    return field.fifths[i, j] * (0.2 * field.resolution) if inside else 1e9


@njit(cache=True)
def _draw(tracks, static, draws, turning, out):
    dt = turning.time_step
    for k in range(len(tracks)):
        radius, speed = tracks[k, RADIUS], math.hypot(tracks[k, V_X], tracks[k, V_Y])
        for s in range(len(draws)):
            least = radius + turning.nearest + (turning.farthest - turning.nearest) * draws[s, k, 1]
            x, y, v_x, v_y = tracks[k, X], tracks[k, Y], tracks[k, V_X], tracks[k, V_Y]
            turns_at = math.inf
            if s > 0 and turning.rate > 0.0:
                turns_at = -math.log(1.0 - draws[s, k, 0]) / turning.rate
            here = _clearance_at(static, x, y)
            turned, next_try = False, 0
            for step in range(out.shape[2]):
                there = _clearance_at(static, x + v_x * dt, y + v_y * dt)
                blocked = there < least and there < here
                if blocked or (not turned and (step + 1) * dt > turns_at):
                    turned = True
                    limit = min(least, here + 1e-3)
                    v_x, v_y, next_try = _turn(x, y, speed, static, draws[s, k, 2:], next_try, limit, turning.free_run)
                    there = _clearance_at(static, x + v_x * dt, y + v_y * dt)
                x += v_x * dt
                y += v_y * dt
                here = there
                out[s, k, step, 0], out[s, k, step, 1] = x, y


@njit(cache=True)
def _turn(x, y, speed, static, headings, next_try, least, free_run):
    """Velocity in the first drawn heading that is free for ``free_run``, 0 if none is; and the heading to try next."""
    share = free_run / max(speed, 1e-6)
    for _ in range(len(headings)):
        angle = 2.0 * math.pi * headings[next_try]
        next_try = (next_try + 1) % len(headings)
        v_x, v_y = speed * math.cos(angle), speed * math.sin(angle)
        ahead = _clearance_at(static, x + share * v_x, y + share * v_y)
        half = _clearance_at(static, x + 0.5 * share * v_x, y + 0.5 * share * v_y)
        if min(ahead, half) >= least:
            return v_x, v_y, next_try
    return 0.0, 0.0, next_try
