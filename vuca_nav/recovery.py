"""What the stack does when it makes no progress, in this order: back out, clear, another way, wait."""

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from vuca_nav.geometry import transform_points
from vuca_nav.planning.planner import Plan
from vuca_nav.types import FloatArray, Pose2

Point = tuple[float, float]


class Rung(IntEnum):
    """What is tried, one after the other."""

    DRIVE = 0
    """Nothing: there is progress."""
    BACK_OUT = 1
    """Go back along the robot's own trail."""
    CLEAR = 2
    """Plan also through small obstacles that have not been seen lately."""
    ANOTHER_WAY = 3
    """Bar the narrowest place ahead for a while, if the target can be reached without it."""
    WAIT = 4
    """Stand for a while, and begin anew."""


SAID = {
    Rung.BACK_OUT: "no progress: backing out",
    Rung.CLEAR: "no progress: doubting small obstacles that have not been seen lately",
    Rung.ANOTHER_WAY: "no progress: looking for another way",
    Rung.WAIT: "no progress: waiting",
}
"""Events of the rungs."""


@dataclass(frozen=True, slots=True)
class RecoveryConfig:
    """Settings of the recovery. Its times count only while nothing moves near the robot: movers are waited for."""

    patience: float = 5.0
    """Time without progress after which the next rung is tried [s]."""
    progress: float = 0.5
    """Length that the robot must get on along its path [m]."""
    step: float = 0.3
    """Distance between two places by which that is measured: the path's length is known to a cell or so [m]."""
    back: float = 0.8
    """Distance to back out [m]."""
    back_time: float = 3.0
    """Longest time to back out, and time to wait [s]."""
    bar_near: float = 0.4
    """Least distance ahead of a place that is barred [m]."""
    bar_far: float = 2.0
    """Greatest distance ahead of it [m]."""
    bar_radius: float = 0.3
    """Radius about it in which no path leads [m]."""
    bar_time: float = 30.0
    """Time for which it is barred [s]."""


NO_RECOVERY = RecoveryConfig(patience=math.inf)
"""Settings with which nothing is ever tried."""


class Recovery:
    """Watches the progress along the path and climbs the rungs while there is none.

    Args:
        config: Settings.
        period: Time between two updates [s].

    Attributes:
        rung: What is tried now.
        barred: Places in the map that no path may lead through, and until when: x, y [m], time [s].
    """

    def __init__(self, config: RecoveryConfig, period: float):
        self.config, self._period = config, period
        self._trail: deque[Point] = deque(maxlen=100)
        self.reset()

    def reset(self) -> None:
        """Begin with another goal."""
        self.rung = Rung.DRIVE
        self.barred: list[tuple[float, float, float]] = []
        self._trail.clear()
        self._advance = self._most = self._idle = 0.0
        self._last: tuple[Point, FloatArray] | None = None

    def update(self, now: float, place: Point, plan: Plan, waits_for_mover: bool = False) -> Rung | None:
        """Take in where the robot is on its path.

        Args:
            now: Time [s].
            place: Position of the robot in the map [m].
            plan: The plan.
            waits_for_mover: Whether something moves near the robot.

        Returns:
            The rung that begins now; None if there is none.
        """
        c = self.config
        self.barred = [bar for bar in self.barred if bar[2] > now]
        if not self._trail or math.dist(self._trail[-1], place) > 0.1:
            self._trail.append(place)
        if not len(plan.path_in_map):
            return None
        last_place, last_path = self._last or (place, plan.path_in_map)
        moved = math.dist(last_place, place)
        if self._last is None or moved >= c.step:
            # Along the path that led it here: the next one may go elsewhere.
            shorter = _rest(last_path, last_place) - _rest(last_path, place)
            self._advance += max(-moved, min(shorter, moved))
            self._last = place, plan.path_in_map
        if self._advance > self._most + c.progress:
            self._most, self._idle, self.rung = self._advance, 0.0, Rung.DRIVE
            return None
        if waits_for_mover:
            return None
        self._idle += self._period
        if self._idle < c.patience:
            return None
        self._idle = 0.0
        self.rung = Rung.BACK_OUT if self.rung == Rung.WAIT else Rung(self.rung + 1)
        return self.rung

    def waypoint(self, place: Point) -> Point | None:
        """Where to back out to, in the map [m]; None if that is not tried, or done.

        Args:
            place: Position of the robot in the map [m].
        """
        c = self.config
        if self.rung != Rung.BACK_OUT or self._idle > c.back_time:
            return None
        behind = [point for point in self._trail if math.dist(point, place) >= c.back]
        return behind[-1] if behind else None

    @property
    def hovers(self) -> bool:
        """Whether there has been no progress for a while, of half the patience."""
        return self._idle > 0.5 * self.config.patience or self.rung != Rung.DRIVE

    def try_again(self) -> None:
        """Begin to wait for progress anew: something else drives from now on."""
        self._idle, self.rung = 0.0, Rung.DRIVE

    @property
    def tries_other_driver(self) -> bool:
        """Whether the robot has backed out, and it is the other local policy's turn."""
        return self.rung in (Rung.BACK_OUT, Rung.CLEAR)

    @property
    def waits(self) -> bool:
        """Whether the robot stands to wait."""
        return self.rung == Rung.WAIT and self._idle <= self.config.back_time

    def bar(self, now: float, place: Point, plan: Plan) -> bool:
        """Bar the narrowest place ahead on the path; returns whether there is one.

        Args:
            now: Time [s].
            place: Position of the robot in the map [m].
            plan: The plan.
        """
        c, path, clearances = self.config, plan.path_in_map, plan.clearances
        if not len(clearances):
            return False
        away = np.hypot(path[:, 0] - place[0], path[:, 1] - place[1])
        ahead = np.flatnonzero((away >= c.bar_near) & (away <= c.bar_far) & (np.arange(len(path)) >= np.argmin(away)))
        if not len(ahead):
            return False
        x, y = path[ahead[np.argmin(clearances[ahead])]].tolist()
        self.barred.append((x, y, now + c.bar_time))
        return True

    def barred_in_map(self) -> FloatArray:
        """The barred places, (k, 3) x, y and radius [m]."""
        return np.array([(x, y, self.config.bar_radius) for x, y, _ in self.barred]).reshape(-1, 3)

    def follow(self, map_correction: Pose2) -> None:
        """Move everything that is remembered in the map along with it."""

        def moved(points: list[Point]) -> list[Point]:
            new = transform_points(map_correction, np.array(points).reshape(-1, 2))
            return [(float(x), float(y)) for x, y in new]

        places = moved([(x, y) for x, y, _ in self.barred])
        self.barred = [(x, y, until) for (x, y), (_, _, until) in zip(places, self.barred)]
        trail = moved(list(self._trail))
        self._trail.clear()
        self._trail.extend(trail)
        if self._last is not None:
            (place,) = moved([self._last[0]])
            self._last = place, transform_points(map_correction, self._last[1])


def _rest(path: FloatArray, place: Point) -> float:
    """Length of the rest of a path from the point nearest to a place [m]."""
    away = np.hypot(path[:, 0] - place[0], path[:, 1] - place[1])
    nearest = int(np.argmin(away))
    return float(away[nearest] + np.hypot(*np.diff(path[nearest:], axis=0).T).sum())
