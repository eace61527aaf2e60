"""A body as discs, and how far everything about it is from what the scan shows."""

import math

import numpy as np
from numba import njit

from vuca_nav.types import FloatArray


def cover_by_discs(footprint: FloatArray) -> FloatArray:
    """Equal discs along base_link's x axis that cover a convex outline.

    Args:
        footprint: (n, 2) [m].

    Returns:
        (k, 3) x, y and radius [m]; one disc about the origin for a body that is about as long as wide.
    """
    x_min, y_min = footprint.min(axis=0)
    x_max, y_max = footprint.max(axis=0)
    length, width = x_max - x_min, y_max - y_min
    circumscribed = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
    if length < 1.4 * width:
        return np.array([[0.0, 0.0, circumscribed]])
    count = math.ceil(length / width)
    piece = length / count
    radius = math.hypot(0.5 * piece, 0.5 * width)
    xs = x_min + piece * (np.arange(count) + 0.5)
    return np.column_stack([xs, np.full(count, 0.5 * (y_min + y_max)), np.full(count, radius)])


@njit(cache=True)
def distance_field(ranges, beams, resolution, reach, field):
    """Distance to the nearest return in fifths of a cell (5-7 chamfer), rows y and columns x from -reach on."""
    n = field.shape[0]
    field[:] = 32000
    for k in range(ranges.shape[0]):
        if ranges[k] < 1.5 * reach:
            j = int((ranges[k] * beams[k, 0] + reach) / resolution)
            i = int((ranges[k] * beams[k, 1] + reach) / resolution)
            if 0 <= i < n and 0 <= j < n:
                field[i, j] = 0
    for i in range(1, n):
        for j in range(1, n - 1):
            field[i, j] = min(
                field[i, j],
                field[i - 1, j] + 5,
                field[i, j - 1] + 5,
                field[i - 1, j - 1] + 7,
                field[i - 1, j + 1] + 7,
            )
    for i in range(n - 2, -1, -1):
        for j in range(n - 2, 0, -1):
            field[i, j] = min(
                field[i, j],
                field[i + 1, j] + 5,
                field[i, j + 1] + 5,
                field[i + 1, j + 1] + 7,
                field[i + 1, j - 1] + 7,
            )


@njit(cache=True)
def room_around(field, resolution, reach, discs, x, y, cos_yaw, sin_yaw):
    """Least distance between a disc's edge and a return, the body at a pose [m]."""
    n = field.shape[0]
    per_metre = 1.0 / resolution
    least = 1e9
    for k in range(discs.shape[0]):
        px = x + cos_yaw * discs[k, 0] - sin_yaw * discs[k, 1]
        py = y + sin_yaw * discs[k, 0] + cos_yaw * discs[k, 1]
        j = int((px + reach) * per_metre)
        i = int((py + reach) * per_metre)
        if 0 <= i < n and 0 <= j < n:
            least = min(least, field[i, j] * (0.2 * resolution) - discs[k, 2])
    return least


@njit(cache=True)
def smooth_room_around(field, resolution, reach, discs, x, y, cos_yaw, sin_yaw):
    """As ``room_around``, between the cells' middles interpolated: it changes with every millimetre [m]."""
    n = field.shape[0]
    per_metre = 1.0 / resolution
    least = 1e9
    for k in range(discs.shape[0]):
        column = (x + cos_yaw * discs[k, 0] - sin_yaw * discs[k, 1] + reach) * per_metre - 0.5
        row = (y + sin_yaw * discs[k, 0] + cos_yaw * discs[k, 1] + reach) * per_metre - 0.5
        j, i = math.floor(column), math.floor(row)
        if 0 <= i < n - 1 and 0 <= j < n - 1:
            right, up = column - j, row - i
            below = (1.0 - right) * field[i, j] + right * field[i, j + 1]
            above = (1.0 - right) * field[i + 1, j] + right * field[i + 1, j + 1]
            least = min(least, ((1.0 - up) * below + up * above) * (0.2 * resolution) - discs[k, 2])
    return least
