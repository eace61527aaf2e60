"""Which returns are of things that stand: in the open the rest is neither matched nor kept.

Among walls whatever walks is outvoted. In an open field it may be all that a scan shows, and a robot that follows it
leaves the map with it. There a surface wider than anything that moves stands; what is slighter has to be seen in its
place for a while first. Its place is by odometry alone: by the match it would seem to stand because the pose has
followed it.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import LidarSpec, Pose2

OPEN = 0.7
"""Share of the beams that meet something, tracks left out, below which the robot is in the open. In rooms, corridors
and halls full of things 0.9 and more do; on a square 0.5, among people in a field 0.1."""
WIDE = 1.2
"""Width from which on a surface stands [m]: the widest moving obstacle is 0.9 m."""
PROOF = 3.0
"""Time for which something slight has to be seen in its place [s]: a mover of 0.9 m at 0.4 m/s is gone by then."""
GAP = 0.5
"""Longest time for which it may be hidden meanwhile [s], or two and a half scans if these are rarer."""
_CELL = 0.15
"""Side of a place [m]: a return is of the thing that was seen there or in one of the eight places about it."""
_SIZE = 512
"""Places each way, a power of two: those 77 m apart share one, and forget each other's by the gap."""
_NEAR, _STEEP = 0.1, 3.0
"""Neighbouring returns are of one surface within this [m], or so many times as far as the beams are apart: an angle of
incidence of 70 degrees ..."""
_EVEN = 3.0
"""... or where the next one lies on their line, each of the two distances at most so many times the other ..."""
_LONGEST = 3.0
"""... and no longer than this [m] ..."""
_NOISE, _BEND = 0.02, 0.03
"""... within this [m], and this share of the line's length."""
_MISSED = 2
"""Beams that may be missing within a surface, and one more."""


class _Rule(NamedTuple):
    """Settings of the kernels."""

    min_range: float
    max_range: float
    pitch: float
    wraps: bool


class Standing:
    """Tells what stands from what may walk: ``mark(level, odom_from_base, stamp)`` once a scan.

    Args:
        lidar: The lidar.
        reach: Returns from farther away do not count [m].
    """

    def __init__(self, lidar: LidarSpec, reach: float):
        n = lidar.num_beams
        self._rule = _Rule(lidar.min_range, min(lidar.max_range, reach), abs(lidar.pitch), lidar.sees_all_round)
        self._points, self._beam, self._starts = np.zeros((n, 2)), np.zeros(n, np.int64), np.zeros(n + 1, np.int64)
        self._walks = np.zeros(n, np.bool_)
        self._first, self._last = np.zeros((2, _SIZE, _SIZE))
        self.reset()

    def reset(self) -> None:
        """Forget what has been seen."""
        self._first[:], self._last[:] = math.inf, -math.inf
        self._stamp, self._period = -math.inf, 0.0

    def mark(self, level: LevelScan, odom_from_base: Pose2, stamp: float) -> LevelScan:
        """The scan with everything marked as a mover that does not surely stand; valid until the next one.

        Args:
            level: The scan; movers that are known beforehand stay marked.
            odom_from_base: Odometry at its time.
            stamp: Its time [s].
        """
        if math.isfinite(self._stamp) and stamp > self._stamp:
            self._period = stamp - self._stamp
        self._stamp = stamp
        scratch = self._points, self._beam, self._starts
        is_open, count = _slight(level, self._rule, scratch)
        self._walks[:] = level.is_mover
        if count:
            times = stamp, max(GAP, 2.5 * self._period)
            points, beam = self._points[:count], self._beam[:count]
            _prove(points, beam, odom_from_base, times, (self._first, self._last), self._walks)
        return level._replace(is_mover=self._walks) if is_open else level


@njit(cache=True)
def _is_one_surface(points, a, reach):
    """Whether a return and the next one are of one surface."""
    dx, dy = points[a + 1, 0] - points[a, 0], points[a + 1, 1] - points[a, 1]
    apart = math.hypot(dx, dy)
    if apart < reach:
        return True
    if apart > _LONGEST:
        return False
    for before in (a - 1, a + 1):
        if not 0 <= before < len(points) - 1:
            continue
        ex, ey = points[before + 1, 0] - points[before, 0], points[before + 1, 1] - points[before, 1]
        length = math.hypot(ex, ey)
        whole = apart + length
        if (
            length * _EVEN > apart
            and length < _EVEN * apart
            and dx * ex + dy * ey > 0.0
            and abs(dx * ey - dy * ex) < (_NOISE + _BEND * whole) * whole
        ):
            return True
    return False


@njit(cache=True)
def _slight(level, rule, scratch):
    """Move the returns of slight things to the front of the scratch; whether the robot is in the open, their number."""
    points, beam, starts = scratch
    ranges, beams = level.ranges, level.beams
    n = seen = 0
    for k in range(ranges.shape[0]):
        if rule.min_range <= ranges[k] < rule.max_range:
            points[n, 0] = level.origin[0] + ranges[k] * beams[k, 0]
            points[n, 1] = level.origin[1] + ranges[k] * beams[k, 1]
            beam[n] = k
            n += 1
            seen += not level.is_mover[k]
    num = 0
    for k in range(n):
        pitch = 1 if k == 0 else beam[k] - beam[k - 1]
        reach = max(_NEAR, _STEEP * rule.pitch * pitch * ranges[beam[k]])
        if k == 0 or pitch > _MISSED or not _is_one_surface(points[:n], k - 1, reach):
            starts[num] = k
            num += 1
    starts[num] = n
    closes = rule.wraps and num > 1 and beam[0] + ranges.shape[0] <= beam[n - 1] + _MISSED
    closes = closes and math.hypot(points[0, 0] - points[n - 1, 0], points[0, 1] - points[n - 1, 1]) < _NEAR
    count = 0
    for s in range(num):
        first = points[starts[s]]
        x, y = first[0], first[1]
        is_wide = closes and (s == 0 or s == num - 1)
        for k in range(starts[s], starts[s + 1]):
            is_wide |= (points[k, 0] - x) ** 2 + (points[k, 1] - y) ** 2 > WIDE * WIDE
        if not is_wide:
            for k in range(starts[s], starts[s + 1]):
                points[count] = points[k]
                beam[count] = beam[k]
                count += 1
    return seen < OPEN * ranges.shape[0], count


@njit(cache=True)
def _prove(points, beam, pose, times, places, walks):
    """Write down where slight things are seen, and mark those that have not been there for long."""
    first, last = places
    now, gap = times
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(points.shape[0]):
        x, y = points[k]
        points[k, 0] = (pose[0] + c * x - s * y) / _CELL
        points[k, 1] = (pose[1] + s * x + c * y) / _CELL
        i, j = int(math.floor(points[k, 1])) & (_SIZE - 1), int(math.floor(points[k, 0])) & (_SIZE - 1)
        if now - last[i, j] > gap:
            first[i, j] = now
        last[i, j] = now
    for k in range(points.shape[0]):
        i, j = int(math.floor(points[k, 1])), int(math.floor(points[k, 0]))
        since = now
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                u, v = a & (_SIZE - 1), b & (_SIZE - 1)
                if now - last[u, v] <= gap:
                    since = min(since, first[u, v])
        walks[beam[k]] |= now - since < PROOF
