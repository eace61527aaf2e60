"""The ring: what any planar lidar sees, as a full circle of beams about base_link, nearest obstacle per direction.

Policies, tracks and the shield are made for scans that begin behind the robot and go once round base_link. A lidar that
is mounted elsewhere, sees a part of the circle, turns the other way or slower than the loop gives such a scan by way of
its returns' places. Directions in which it sees nothing are unknown, not free: ``vuca_nav.perception.seen_space`` knows
what was seen there lately.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, LidarSpec, Pose2

RING_BEAMS = 360
"""Number of a ring's beams: that of the scans which everything is tuned on."""
RING_STEP = 60
"""A scan whose number of beams this divides can be a ring as it is: the shipped policies' number of sectors."""
MOST_LOST = 5
"""Number of neighbouring beams of a ring that may be missing without a gap in it: at 1 m they span 0.1 m."""


def ring_of(lidar: LidarSpec, rate: float | None = None) -> LidarSpec:
    """The lidar that a ring is the scan of.

    Args:
        lidar: The real lidar.
        rate: Rate of the loop [Hz]; by default the lidar's.

    Returns:
        ``lidar`` itself if its scans are rings and it is as fast as the loop.
    """
    rate = lidar.rate if rate is None else rate
    if lidar.is_centred_ring and lidar.num_beams % RING_STEP == 0:
        return lidar if lidar.rate == rate else replace(lidar, rate=rate)
    return LidarSpec(num_beams=RING_BEAMS, max_range=lidar.max_range, min_range=0.0, rate=rate, height=lidar.height)


class BeamGeometry(NamedTuple):
    """The beams of a lidar in base_link."""

    directions: FloatArray
    """(num_beams, 2)"""
    origin: FloatArray
    """(2,) where the lidar stands [m]."""
    half_pitch: float
    """Half the angle between two beams [rad]."""
    max_range: float
    """[m]"""

    @classmethod
    def of(cls, lidar: LidarSpec) -> "BeamGeometry":
        """The beams of this lidar."""
        angles = lidar.angles_in_base()
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        origin = np.array([float(lidar.mount.x), float(lidar.mount.y)])
        return cls(directions, origin, 0.5 * abs(lidar.pitch), float(lidar.max_range))


def write_ring(ranges: FloatArray, beams: BeamGeometry, base_from_then: Pose2, ring: FloatArray) -> None:
    """Write a scan as a ring.

    Each beam stands for the arc halfway to its neighbours; where several end in one direction the nearest counts.

    Args:
        ranges: (num_beams,) ranges, ``inf`` or NaN [m].
        beams: The beams that they were measured by.
        base_from_then: Pose of the base at the time of the scan, in the base frame of now.
        ring: (ring beams,) [m], written to; NaN in directions that no beam went to, or only a faulty one.
    """
    _write_ring(ranges, beams, base_from_then, ring)


def find_gaps(ring: FloatArray, gaps: NDArray[np.bool_]) -> bool:
    """Mark the directions of a ring that are unknown: those in a run of more than ``MOST_LOST`` missing beams.

    Args:
        ring: (n,) with NaN where a beam is missing.
        gaps: (n,), written to.

    Returns:
        Whether there are any.
    """
    return bool(_find_gaps(ring, gaps))


@njit(cache=True)
def _write_ring(ranges, beams, base_from_then, ring):
    x0, y0, yaw = base_from_then
    c, s = math.cos(yaw), math.sin(yaw)
    lidar_x = x0 + c * beams.origin[0] - s * beams.origin[1]
    lidar_y = y0 + s * beams.origin[0] + c * beams.origin[1]
    half_cos, half_sin = math.cos(beams.half_pitch), math.sin(beams.half_pitch)
    n = len(ring)
    per_radian = n / (2.0 * math.pi)
    ring[:] = np.nan
    for k in range(len(ranges)):
        r = ranges[k]
        if r != r:
            continue
        far = min(r, beams.max_range)
        bx = far * (c * beams.directions[k, 0] - s * beams.directions[k, 1])
        by = far * (s * beams.directions[k, 0] + c * beams.directions[k, 1])
        x, y = lidar_x + bx, lidar_y + by
        value = math.hypot(x, y) if r < np.inf else np.inf
        middle = (math.atan2(y, x) + math.pi) * per_radian
        right = math.atan2(lidar_y + half_cos * by - half_sin * bx, lidar_x + half_cos * bx + half_sin * by)
        left = math.atan2(lidar_y + half_cos * by + half_sin * bx, lidar_x + half_cos * bx - half_sin * by)
        # Both sides from the middle on, so that the border behind the robot does not matter.
        to_right = _wrap((right + math.pi) * per_radian - middle, n)
        to_left = _wrap((left + math.pi) * per_radian - middle, n)
        nearest = int(math.floor(middle + 0.5))
        first = min(int(math.ceil(middle + min(to_right, to_left) - 1e-9)), nearest)
        last = max(int(math.floor(middle + max(to_right, to_left) + 1e-9)), nearest)
        if last - first > n // 4:  # an end next to base_link
            first = last = nearest
        for m in range(first, last + 1):
            b = m % n
            if not ring[b] <= value:
                ring[b] = value


@njit(cache=True, inline="always")
def _wrap(beams, n):
    """A difference of directions, in beams of a ring of n, the short way round."""
    return beams - n * math.floor(beams / n + 0.5)


@njit(cache=True)
def _find_gaps(ring, gaps):
    n = len(ring)
    gaps[:] = False
    start = 0  # at a beam that is there, so that no run is cut in two
    while start < n and ring[start] != ring[start]:
        start += 1
    if start == n:
        gaps[:] = True
        return True
    found, run = False, 0
    for k in range(1, n + 1):
        b = (start + k) % n
        if ring[b] != ring[b]:
            run += 1
            continue
        if run > MOST_LOST:
            found = True
            for m in range(1, run + 1):
                gaps[(start + k - m) % n] = True
        run = 0
    return found
