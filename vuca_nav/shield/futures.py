"""What moves, a few seconds ahead: several possible futures of everything at once.

Nobody can tell when somebody turns. What can be told: things go straight on until something stands in their way, now
and then turn earlier, and then go on in any direction that is free. So each future draws, for each thing, when it
turns and where to, from a table made once: the same scene always has the same futures.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.types import FloatArray


@dataclass(frozen=True, slots=True)
class FuturesConfig:
    """How far, how many, how wayward."""

    scenarios: int = 12
    """Futures of everything; in the first nothing turns but before what stands."""
    horizon: float = 3.0
    """[s]"""
    time_step: float = 0.1
    """[s]"""
    turn_rate: float = 0.1
    """How often things turn for no reason that is seen [1/s]."""
    free_run: float = 0.6
    """Things that turn pick a heading that is free for so far [m]."""
    clearance: tuple[float, float] = (0.05, 0.6)
    """At which a thing turns away from what stands, least and greatest [m]: nobody knows how near it will go."""


_DRAWS = 12
"""Numbers for each thing in each future: when it turns first, how near it goes, then headings to try."""


class Futures:
    """Draws futures of tracked things.

    Args:
        most: Greatest number of things.
        config: Settings.

    Attributes:
        positions: (scenarios, most, steps, 2) in the base_link of now [m].
    """

    def __init__(self, most: int, config: FuturesConfig = FuturesConfig()):
        self._config = config
        s = config.scenarios
        rng = np.random.default_rng(0)
        # Stratified: of all scenarios the first turns of each thing are spread over all times, headings over all.
        strata = np.array([[rng.permutation(s) for _ in range(_DRAWS)] for _ in range(most)])  # (most, _DRAWS, s)
        self._draws: FloatArray = (strata.transpose(2, 0, 1) + rng.random((s, most, _DRAWS))) / s
        steps = round(config.horizon / config.time_step)
        self.positions: FloatArray = np.zeros((s, most, steps, 2))

    def draw(self, things: FloatArray, field: NDArray[np.int16], resolution: float, reach: float) -> FloatArray:
        """The futures of these things.

        Args:
            things: (k, 6) as ``Tracker.things`` gives them.
            field: Of ``distance_field``, without what moves.
            resolution: Of its cells [m].
            reach: Half of its side [m].

        Returns:
            (scenarios, k, steps, 2) a view of ``positions``: where they are after 1, 2, ... time steps.
        """
        c = self._config
        _draw(
            things, field, resolution, reach, self._draws, c.turn_rate, c.free_run, *c.clearance,
            c.time_step, self.positions,
        )  # fmt: skip
        return self.positions[:, : len(things)]


@njit(cache=True)
def _room(field, resolution, reach, x, y):
    n = field.shape[0]
    j, i = int((x + reach) / resolution), int((y + reach) / resolution)
    return field[i, j] * (0.2 * resolution) if x > -reach and y > -reach and i < n and j < n else 1e9


@njit(cache=True)
def _draw(things, field, resolution, reach, draws, turn_rate, free_run, nearest, farthest, dt, out):
    tries = draws.shape[2] - 2
    for k in range(len(things)):
        radius, speed = things[k, 4], math.hypot(things[k, 2], things[k, 3])
        for s in range(len(draws)):
            least = radius + nearest + (farthest - nearest) * draws[s, k, 1]
            x, y, v_x, v_y = things[k, 0], things[k, 1], things[k, 2], things[k, 3]
            turns_at = -math.log(1.0 - draws[s, k, 0]) / turn_rate if s > 0 and turn_rate > 0.0 else math.inf
            here = _room(field, resolution, reach, x, y)
            turned, next_try = False, 0
            for step in range(out.shape[2]):
                there = _room(field, resolution, reach, x + v_x * dt, y + v_y * dt)
                blocked = there < least and there < here
                if blocked or (not turned and (step + 1) * dt > turns_at):
                    turned = True
                    found = False
                    for _ in range(tries):
                        angle = 2.0 * math.pi * draws[s, k, 2 + next_try]
                        next_try = (next_try + 1) % tries
                        u_x, u_y = speed * math.cos(angle), speed * math.sin(angle)
                        share = free_run / max(speed, 1e-6)
                        ahead = _room(field, resolution, reach, x + share * u_x, y + share * u_y)
                        half = _room(field, resolution, reach, x + 0.5 * share * u_x, y + 0.5 * share * u_y)
                        if min(ahead, half) >= min(least, here + 1e-3):
                            v_x, v_y, found = u_x, u_y, True
                            break
                    if not found:
                        v_x = v_y = 0.0
                    there = _room(field, resolution, reach, x + v_x * dt, y + v_y * dt)
                x += v_x * dt
                y += v_y * dt
                here = there
                out[s, k, step, 0], out[s, k, step, 1] = x, y
