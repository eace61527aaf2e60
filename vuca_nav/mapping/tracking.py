"""Quality of tracking: whether the robot still knows where it is, from scans alone.

Three things tell that it does not. A scan that has little in common with the one before, though odometry says that the
robot has hardly moved: somebody has carried it off. Scans that contradict the map, again and again. Scans without any
return where surfaces were near a moment ago: the lidar is dead, or covered.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.alignment import Alignment
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import LidarSpec, Pose2

Tracking = Literal["tracked", "weak", "lost"]
"""What SLAM makes of its own estimate. While it is weak, or lost, nothing is mapped."""

_NEIGHBOURS = 2
"""Beams to either side among which a range may be found again: edges move from beam to beam."""


@dataclass(frozen=True, slots=True)
class TrackingConfig:
    """Settings of the monitor of tracking.

    In missions without faults the median quality is 0.99, and 0.9 and less in one scan of a hundred.
    """

    usual: float = 0.75
    """Quality that a scan is measured by: what falls short of it adds up, what exceeds it makes good again."""
    enough: float = 2.5
    """Sum of the shortcomings from which on the robot is lost: ten scans that half contradict the map."""
    maps: float = 0.6
    """Quality below which a scan is not drawn into the map."""
    weak: float = 0.5
    """Sum of the shortcomings from which on tracking is weak."""
    changed: float = 0.3
    """A range that is found nowhere near within this has changed, beside twice the robot's way [m]."""
    comparable: float = 0.3
    """Way between two scans up to which they can be compared [m]: after more, other things are hidden ..."""
    comparable_turn: float = 0.3
    """... or turning [rad] ..."""
    comparable_time: float = 1.0
    """... or time [s]: after more, people have gone elsewhere."""
    jump: float = 0.5
    """Share of changed ranges from which on a scan was taken elsewhere. Missions without faults have at most 0.05 on
    wheels and 0.3 on legs, which lean; being carried by 3 m and half a turn gives 0.6 and more in most places ..."""
    suspect: float = 0.08
    """... but 0.1 along a corridor. From this share on ..."""
    unusual: float = 2.0
    """... and this many times the greatest share of late, a scan was taken elsewhere ..."""
    drop: float = 0.06
    """... if its share of matched returns is less than usual by so much, and not for new ground alone."""
    late: float = 0.98
    """Factor on the greatest share of changed ranges from scan to scan: half of it is forgotten in a second."""
    forgetting: float = 0.1
    """Share of a scan in the usual share of matched returns."""
    recovered: int = 3
    """Scans that have to match as usual where the robot is by odometry for it not to be lost after all: something has
    stood in its light."""
    looks: int = 15
    """Scans in which it may recover before it is looked for in the whole map, which takes thirty times as long."""
    least_beams: int = 30
    """Fewest beams that can tell."""


class TrackingMonitor:
    """``has_jumped`` before each match, ``update`` after it.

    Args:
        lidar: The lidar.
        config: Settings.

    Attributes:
        shortcoming: How much the last scans have fallen short of the usual quality, summed up.
        is_sparse: Whether the last scan was taken too far from the one before, or too late, to be compared with it.
    """

    def __init__(self, lidar: LidarSpec, config: TrackingConfig = TrackingConfig()):
        self.config = config
        self._pitch, self._wraps, self._max_range = lidar.pitch, lidar.sees_all_round, lidar.max_range
        self._last = np.full(lidar.num_beams, math.nan)
        self.reset()

    def reset(self) -> None:
        """Begin anew, from a pose that is known."""
        self.shortcoming = 0.0
        self._recovered = self._looked = 0
        self._changed_away, self._has_changed_back, self._must_change_back = 0.0, False, False
        self._last[:] = math.nan
        self._stamp, self.is_sparse = -math.inf, False
        self._greatest, self._matched, self._is_suspect = self.config.jump, 0.0, False
        self._share = 0.0

    @property
    def state(self) -> Tracking:
        """What the last scans have shown."""
        if self.shortcoming > self.config.enough:
            return "lost"
        return "weak" if self.shortcoming > self.config.weak else "tracked"

    def has_jumped(self, level: LevelScan, motion: Pose2, stamp: float) -> bool:
        """Whether a scan was taken elsewhere than the last one and odometry tell.

        Args:
            level: The scan.
            motion: Motion since the last scan by odometry.
            stamp: Time of the scan [s].
        """
        c = self.config
        elapsed, self._stamp = stamp - self._stamp, stamp
        slack = c.changed + 2.0 * math.hypot(motion.x, motion.y)
        shift = round(motion.yaw / self._pitch)
        changed, valid = _changed(level.ranges, self._last, shift, (self._wraps, self._max_range, slack))
        self._last[:] = level.ranges
        is_near = math.hypot(motion.x, motion.y) <= c.comparable and abs(motion.yaw) <= c.comparable_turn
        self.is_sparse = not (is_near and 0.0 < elapsed <= c.comparable_time)
        share = changed / valid if not self.is_sparse and valid >= c.least_beams else 0.0
        self._is_suspect = share > max(c.suspect, c.unusual * self._greatest)
        self._greatest = max(share, c.late * self._greatest)
        self._has_changed_back |= 0.0 < self._changed_away < 2.0 * share
        if share > c.jump:
            self._changed_away, self._must_change_back = share, True
        self._share = share
        return share > c.jump

    def update(self, alignment: Alignment | None) -> Tracking:
        """Take in how a scan has matched.

        Args:
            alignment: The match; None if the scan contradicts the map wherever odometry may have brought the robot.
        """
        c = self.config
        quality, matched = (0.0, 0.0) if alignment is None else (alignment.quality, alignment.matched)
        self.shortcoming = max(self.shortcoming + c.usual - quality, 0.0)
        if self._is_suspect and quality < 1.0 - c.drop and matched < self._matched - c.drop:
            self.shortcoming = max(self.shortcoming, 1.5 * c.enough)
            self._changed_away = self._share
        self._matched += c.forgetting * (matched - self._matched)
        return self.state

    def refutes(self, alignment: Alignment) -> bool:
        """Whether a scan that seems to be taken elsewhere fits the map here as scans usually do: people have passed.

        Args:
            alignment: Match of the scan where the robot is by odometry.
        """
        if not self._is_usual(alignment):
            return False
        self._changed_away, self._must_change_back, self._is_suspect = 0.0, False, False
        return True

    def _is_usual(self, alignment: Alignment) -> bool:
        c = self.config
        return alignment.quality > 1.0 - c.drop and alignment.matched > self._matched - c.drop

    @property
    def is_done_looking(self) -> bool:
        """Whether it is time to look for the lost robot in the whole map."""
        return self._looked >= self.config.looks

    def recovers(self, alignment: Alignment) -> bool:
        """Whether a lost robot is not lost after all. After a jump the view has to change back first.

        Args:
            alignment: Match of the latest scan where the robot is by odometry.
        """
        c = self.config
        self._looked += 1
        self._recovered = self._recovered + 1 if self._is_usual(alignment) else 0
        return self._recovered >= c.recovered and (self._has_changed_back or not self._must_change_back)


@njit(cache=True)
def _changed(ranges, last, shift, rule):
    """Number of ranges that the last scan had nowhere near their direction, and of all that can be compared."""
    wraps, max_range, slack = rule
    n = ranges.shape[0]
    valid = changed = 0
    for k in range(n):
        r = min(ranges[k], max_range)
        if r != r:
            continue
        nearest, is_known = math.inf, False
        for d in range(-_NEIGHBOURS, _NEIGHBOURS + 1):
            j = k + shift + d
            if wraps:
                j %= n
            elif not 0 <= j < n:
                continue
            before = min(last[j], max_range)
            if before == before:
                is_known = True
                nearest = min(nearest, abs(before - r))
        if is_known:
            valid += 1
            changed += nearest > slack
    return changed, valid
