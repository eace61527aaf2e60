"""Where a robot goes that does not know where it is: to open space in sight, to see more than it does."""

import math

import numpy as np

from vuca_nav.geometry import between, compose
from vuca_nav.perception.percept import Percept
from vuca_nav.policy.base import LocalGoal
from vuca_nav.types import LidarSpec, Pose2

NEAREST, FARTHEST = 0.8, 2.5
"""Least and greatest distance of a place to look from [m]."""
KEPT = 0.8
"""Distance that is kept from what is behind it [m]."""
REACHED = 0.4
"""Distance at which it has been reached [m]."""
PATIENCE = 5.0
"""Time after which another place is chosen [s]."""
_HALF_WIDTH = math.radians(12.0)
"""Half the angle that must be open about a direction [rad]."""
VISITED = 1.2
"""Places nearer than this to one that it has been at, or tried, count less [m]."""
_AHEAD = 1.0
"""How much farther a direction ahead counts than one behind [m]: a robot that turns round sees nothing new."""


class Looking:
    """``goal(percept)`` once a tick.

    Args:
        ring: The ring of the percepts.
        rate: Rate of the ticks [Hz].
    """

    def __init__(self, ring: LidarSpec, rate: float):
        self._angles = ring.angles_in_base()
        self._max_range, self._patience = ring.max_range, round(PATIENCE * rate)
        self._half_width = max(1, round(_HALF_WIDTH / abs(ring.pitch)))
        self.reset()

    def reset(self) -> None:
        """Forget all places."""
        self._visited: list[tuple[float, float]] = []
        self._leave()

    def _leave(self) -> None:
        self._place_in_odom: tuple[float, float] | None = None
        self._ticks = 0

    def goal(self, percept: Percept) -> LocalGoal | None:
        """The place to look from, None if there is none in sight."""
        here = percept.odom_from_base
        if self._place_in_odom is not None:
            place = between(here, Pose2(*self._place_in_odom, 0.0))
            self._ticks += 1
            if math.hypot(place.x, place.y) > REACHED and self._ticks < self._patience:
                return LocalGoal((place.x, place.y), False)
        if self._place_in_odom is not None:
            self._visited.append(self._place_in_odom)
        self._leave()
        chosen = self._choose(percept)
        if chosen is not None:
            place = compose(here, Pose2(*chosen, 0.0))
            self._place_in_odom = (place.x, place.y)
            return LocalGoal(chosen, False)
        return None

    def _choose(self, percept: Percept) -> tuple[float, float] | None:
        """The most open place in sight, in base_link."""
        ranges = np.nan_to_num(np.minimum(percept.ring, self._max_range), nan=0.0)
        n = len(ranges)
        around = (np.arange(n)[:, None] + np.arange(-self._half_width, self._half_width + 1)) % n
        open_to = ranges[around].min(axis=1) - KEPT
        worth = np.minimum(open_to, FARTHEST) + _AHEAD * np.cos(self._angles)
        away = np.minimum(open_to, FARTHEST)
        for place in self._visited:
            x, y, _ = between(percept.odom_from_base, Pose2(*place, 0.0))
            apart = np.hypot(away * np.cos(self._angles) - x, away * np.sin(self._angles) - y)
            worth -= np.maximum(VISITED - apart, 0.0)
        worth[open_to < NEAREST] = -math.inf
        best = int(np.argmax(worth))
        if not math.isfinite(worth[best]):
            return None
        angle = float(self._angles[best])
        return float(away[best]) * math.cos(angle), float(away[best]) * math.sin(angle)
