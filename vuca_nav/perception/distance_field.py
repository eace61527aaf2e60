"""Distance to the nearest return, everywhere around the robot: a square grid in base_link made from one scan."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit

_FAR = 32000
"""Distance where no return is near, in fifths of a cell."""
_DIAGONAL = math.sqrt(2.0)


class DistanceField(NamedTuple):
    """A square about base_link's origin; rows hold y, columns x, from ``-reach`` on."""

    fifths: NDArray[np.int16]
    """(n, n) distance to the nearest cell with a return by the 5-7 chamfer (Borgefors 1986), at most 8% too far, in
    fifths of a cell."""
    resolution: float
    """Side of a cell [m]."""
    reach: float
    """Half side of the square [m]."""
    scratch: NDArray[np.int16]
    """(n,) scratch of the chamfer's passes."""

    @classmethod
    def empty(cls, reach: float, resolution: float) -> "DistanceField":
        """A field to be filled by ``fill_field``; ``reach`` is rounded to whole cells."""
        n = 2 * round(reach / resolution)
        return cls(np.full((n, n), _FAR, np.int16), resolution, 0.5 * n * resolution, np.zeros(n, np.int16))

    @property
    def uncertainty(self) -> float:
        """Greatest distance by which a return may be nearer than the field says [m].

        A return counts for the middle of its cell, and a clearance is read between the middles of four cells.
        """
        return 1.5 * _DIAGONAL * self.resolution


@njit(cache=True, nogil=True)
def fill_field(ranges, beams, field):
    """Compute a field from a scan.

    Args:
        ranges: (num_beams,) [m]; ``inf`` or NaN where nothing came back.
        beams: (num_beams, 2) directions in base_link.
        field: The field, written to.
    """
    fifths, scratch = field.fifths, field.scratch
    n = fifths.shape[0]
    fifths[:] = _FAR
    for k in range(ranges.shape[0]):
        if ranges[k] < 1.5 * field.reach:
            j = int((ranges[k] * beams[k, 0] + field.reach) / field.resolution)
            i = int((ranges[k] * beams[k, 1] + field.reach) / field.resolution)
            if 0 <= i < n and 0 <= j < n:
                fifths[i, j] = 0
    # Each row takes first from the row before, which vectorises, then from its own neighbour.
    inner = n - 2
    for i in range(1, n):
        left, middle, right = fifths[i - 1, :inner], fifths[i - 1, 1 : n - 1], fifths[i - 1, 2:]
        here = fifths[i, 1 : n - 1]
        for j in range(inner):
            scratch[j] = min(min(min(left[j], right[j]) + 7, middle[j] + 5), here[j])
        least = fifths[i, 0]
        for j in range(inner):
            least = min(least + 5, scratch[j])
            here[j] = least
    for i in range(n - 2, -1, -1):
        left, middle, right = fifths[i + 1, :inner], fifths[i + 1, 1 : n - 1], fifths[i + 1, 2:]
        here = fifths[i, 1 : n - 1]
        for j in range(inner):
            scratch[j] = min(min(min(left[j], right[j]) + 7, middle[j] + 5), here[j])
        least = fifths[i, n - 1]
        for j in range(inner - 1, -1, -1):
            least = min(least + 5, scratch[j])
            here[j] = least


@njit(cache=True, nogil=True)
def clearance_at(field, discs, x, y, cos_yaw, sin_yaw):
    """Least distance between a disc's edge and a return, the body at a pose in base_link [m].

    Args:
        field: The scan's field.
        discs: (k, 3) discs that cover the footprint: x, y, radius [m].
        x: x of the pose [m].
        y: y of the pose [m].
        cos_yaw: Cosine of the pose's yaw.
        sin_yaw: Sine of the pose's yaw.

    Returns:
        The clearance; 1e9 outside of the field.
    """
    fifths, reach = field.fifths, field.reach
    n = fifths.shape[0]
    per_metre = 1.0 / field.resolution
    least = 1e9
    for k in range(discs.shape[0]):
        px = x + cos_yaw * discs[k, 0] - sin_yaw * discs[k, 1]
        py = y + sin_yaw * discs[k, 0] + cos_yaw * discs[k, 1]
        j = int((px + reach) * per_metre)
        i = int((py + reach) * per_metre)
        if 0 <= i < n and 0 <= j < n:
            least = min(least, fifths[i, j] * (0.2 * field.resolution) - discs[k, 2])
    return least


@njit(cache=True, nogil=True)
def smooth_clearance_at(field, discs, x, y, cos_yaw, sin_yaw):
    """``clearance_at``, interpolated between the cells' middles: it changes with every millimetre [m]."""
    fifths, reach = field.fifths, field.reach
    n = fifths.shape[0]
    per_metre = 1.0 / field.resolution
    least = 1e9
    for k in range(discs.shape[0]):
        column = (x + cos_yaw * discs[k, 0] - sin_yaw * discs[k, 1] + reach) * per_metre - 0.5
        row = (y + sin_yaw * discs[k, 0] + cos_yaw * discs[k, 1] + reach) * per_metre - 0.5
        j, i = math.floor(column), math.floor(row)
        if 0 <= i < n - 1 and 0 <= j < n - 1:
            right, up = column - j, row - i
            below = (1.0 - right) * fifths[i, j] + right * fifths[i, j + 1]
            above = (1.0 - right) * fifths[i + 1, j] + right * fifths[i + 1, j + 1]
            least = min(least, ((1.0 - up) * below + up * above) * (0.2 * field.resolution) - discs[k, 2])
    return least
