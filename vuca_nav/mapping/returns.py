"""What a scan says to the scan matcher: where its returns lie, and which way the surfaces about them face."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import FloatArray, LidarSpec

_SIDE, _MOST_SIDE = 2, 10
"""Fewest and most returns to either side up to those whose line is the surface about a return ..."""
_LINE = 0.3
"""... which is about so long where it faces the lidar: noise of 2 cm turns it by 5 degrees [m]."""
_LONGEST = 3.0
"""Greatest length of that line: farther apart they need not be of one surface [m]."""
_NOISE, _BEND = 0.02, 0.03
"""Greatest distance of the return from that line: this [m], and this share of the line's length."""
_LONGEST_GAP = 1.5
"""Greatest distance of two neighbouring returns of one surface between which the surface is drawn [m]."""
_SPACING = 0.05
"""Distance of what is drawn there: a cell [m]."""
_PARALLEL = 0.97
"""Least cosine of the angle between the normals of two returns of one surface."""
_LEAST_SINE = 0.04
"""Least sine of the angle between beam and surface: at 2.3 degrees a beam grazes at most 2.5 m of a wall."""


class ReturnRule(NamedTuple):
    """Settings of the reading of returns."""

    min_range: float
    max_range: float
    reach: float
    """Returns from farther away are not matched: their beams only free what lies on their way up to here [m]."""
    thickness: float
    """A beam does not empty occupied cells while it is this near to the surface it ends on [m]."""
    wraps: bool
    """Whether the last beam is the first one's neighbour."""
    pitch: float
    """Angle from each beam to the next [rad]."""


class Returns(NamedTuple):
    """Returns of one scan in base_link; views into buffers that the next scan overwrites."""

    points: FloatArray
    """(n, 2) returns that may be matched [m]."""
    normals: FloatArray
    """(n, 2) unit normals of the surfaces about them as the scan itself shows them; zeros where it shows none."""
    ends: FloatArray
    """(m, 2) what is drawn: the returns; points of the surfaces between neighbouring returns that lie farther apart
    than the cells of a map; then ends of beams that free what is on their way and end farther away."""
    num_hits: int
    """Number of the first two kinds of these."""
    grazed: FloatArray
    """(m,) length of the last part of each beam, over which it skims the surface that it ends on [m]."""
    origin: tuple[float, float]
    """Place of the lidar [m]."""


class ReturnReader:
    """Reads the returns of one lidar's scans.

    Args:
        lidar: The lidar.
        reach: Returns from farther away are not matched [m].
        thickness: A beam does not empty occupied cells while it is this near to the surface it ends on [m].
    """

    def __init__(self, lidar: LidarSpec, reach: float, thickness: float):
        n = lidar.num_beams
        self._rule = ReturnRule(
            lidar.min_range, lidar.max_range, reach, thickness, lidar.sees_all_round, abs(lidar.pitch)
        )
        self._ends, self._normals, self._grazed = np.zeros((4 * n, 2)), np.zeros((n, 2)), np.zeros(4 * n)
        self._beams = np.zeros(n, np.int64)

    def read(self, level: LevelScan) -> Returns:
        """The scan's returns; those of moving tracks are left out, and their beams free what is before them."""
        n, num_hits, m = _read(level, self._rule, (self._ends, self._normals, self._grazed, self._beams))
        origin = float(level.origin[0]), float(level.origin[1])
        return Returns(self._ends[:n], self._normals[:n], self._ends[:m], num_hits, self._grazed[:m], origin)


@njit(cache=True)
def _read(level, rule, out):
    """Write what is drawn; returns the number of returns, of these and the points between them, and of all."""
    ends, normals, grazed, beam_of = out
    ranges, beams, origin = level.ranges, level.beams, level.origin
    n = ranges.shape[0]
    pitch = rule.pitch
    count = 0
    for k in range(n):
        r = ranges[k]
        if not rule.min_range <= r < min(rule.max_range, rule.reach) or level.is_mover[k]:
            continue
        x, y = r * beams[k, 0], r * beams[k, 1]
        ends[count, 0], ends[count, 1] = origin[0] + x, origin[1] + y
        normals[count, 0] = normals[count, 1] = 0.0
        sine = 1.0
        side = int(0.5 * _LINE / (r * pitch) + 0.5)
        side = min(max(side, _SIDE), _MOST_SIDE)
        right, left = k - side, k + side
        if (right >= 0 and left < n) or rule.wraps:
            right, left = right % n, left % n
            if rule.min_range <= ranges[right] < rule.max_range and rule.min_range <= ranges[left] < rule.max_range:
                rx, ry = ranges[right] * beams[right, 0] - x, ranges[right] * beams[right, 1] - y
                lx, ly = ranges[left] * beams[left, 0] - x, ranges[left] * beams[left, 1] - y
                tx, ty = lx - rx, ly - ry
                length = math.hypot(tx, ty)
                if length > 1e-6:
                    nx, ny = -ty / length, tx / length
                    sine = abs(nx * beams[k, 0] + ny * beams[k, 1])
                    off = abs(nx * rx + ny * ry)  # of the return, from the line of its neighbours
                    if length < _LONGEST and off < _NOISE + _BEND * length:
                        normals[count, 0], normals[count, 1] = nx, ny
        grazed[count] = rule.thickness / max(sine, _LEAST_SINE)
        beam_of[count] = k
        count += 1
    num_points = count
    room = ends.shape[0] - n
    for k in range(num_points - 1):
        if beam_of[k + 1] != beam_of[k] + 1:
            continue
        dx, dy = ends[k + 1, 0] - ends[k, 0], ends[k + 1, 1] - ends[k, 1]
        length = math.hypot(dx, dy)
        pieces = int(length / _SPACING)
        if pieces < 2 or length > _LONGEST_GAP or count + pieces > room:
            continue
        nx, ny = normals[k, 0], normals[k, 1]
        mx, my = normals[k + 1, 0], normals[k + 1, 1]
        slack = _NOISE + _BEND * length
        if abs(nx * mx + ny * my) < _PARALLEL or abs(nx * dx + ny * dy) > slack or abs(mx * dx + my * dy) > slack:
            continue
        for m in range(1, pieces):
            ends[count, 0] = ends[k, 0] + dx * m / pieces
            ends[count, 1] = ends[k, 1] + dy * m / pieces
            grazed[count] = max(grazed[k], grazed[k + 1])
            count += 1
    num_hits = count
    for k in range(n):
        r = ranges[k]
        if rule.min_range <= r < rule.max_range and (level.is_mover[k] or r >= rule.reach):
            free = min(r, rule.reach)
            ends[count, 0] = origin[0] + free * beams[k, 0]
            ends[count, 1] = origin[1] + free * beams[k, 1]
            grazed[count] = 0.0
            count += 1
    return num_points, num_hits, count
