"""Clearance of every place of a scene to the nearest static obstacle, exact at the centres of a grid's cells."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.arrays import ShapeArrays, pack_shapes
from worlds.world import Obstacle


@dataclass(frozen=True, slots=True)
class ClearanceField:
    """Distances on a grid over the bounds; row 0 is the lowest y, column 0 the lowest x."""

    distance: FloatArray
    """Distance of each cell's centre to the nearest obstacle or to the bounds, 0 inside, capped (rows, columns) [m]."""
    origin: tuple[float, float]
    """Lower-left corner of cell (0, 0) in the world [m]."""
    resolution: float
    """[m]"""

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell that holds a point of the world; a point outside gets the nearest cell."""
        row = int((y - self.origin[1]) / self.resolution)
        column = int((x - self.origin[0]) / self.resolution)
        rows, columns = self.distance.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def centres(self, cells: np.ndarray) -> FloatArray:
        """World positions (n, 2) [m] of the centres of cells (n, 2) row, column."""
        return (cells[:, ::-1] + 0.5) * self.resolution + self.origin


@njit(cache=True)
def _distance_to_shape(is_cylinder, cx, cy, half_x, half_y, cos, sin, x, y):
    """Distance of a point to an upright shape's outline in the plane, 0 inside [m]."""
    dx, dy = x - cx, y - cy
    if is_cylinder:
        return max(math.sqrt(dx * dx + dy * dy) - half_x, 0.0)
    out_x = max(abs(cos * dx + sin * dy) - half_x, 0.0)
    out_y = max(abs(cos * dy - sin * dx) - half_y, 0.0)
    return math.sqrt(out_x * out_x + out_y * out_y)


@njit(cache=True)
def _stamp_shapes(is_cylinder, centre, half, yaw, origin_x, origin_y, resolution, cap, distance):
    rows, columns = distance.shape
    for i in range(len(yaw)):
        cos, sin = math.cos(yaw[i]), math.sin(yaw[i])
        if is_cylinder[i]:
            reach_x = reach_y = half[i, 0] + cap
        else:
            reach_x = abs(cos) * half[i, 0] + abs(sin) * half[i, 1] + cap
            reach_y = abs(sin) * half[i, 0] + abs(cos) * half[i, 1] + cap
        first_column = max(int((centre[i, 0] - reach_x - origin_x) / resolution), 0)
        last_column = min(int((centre[i, 0] + reach_x - origin_x) / resolution) + 1, columns)
        first_row = max(int((centre[i, 1] - reach_y - origin_y) / resolution), 0)
        last_row = min(int((centre[i, 1] + reach_y - origin_y) / resolution) + 1, rows)
        for row in range(first_row, last_row):
            y = origin_y + (row + 0.5) * resolution
            for column in range(first_column, last_column):
                x = origin_x + (column + 0.5) * resolution
                d = _distance_to_shape(
                    is_cylinder[i], centre[i, 0], centre[i, 1], half[i, 0], half[i, 1], cos, sin, x, y
                )
                if d < distance[row, column]:
                    distance[row, column] = d


def clearance_field(
    obstacles: Sequence[Obstacle],
    bounds: tuple[float, float, float, float],
    resolution: float = 0.1,
    cap: float = 1.5,
    is_open: bool = False,
) -> ClearanceField:
    """Exact clearance at every cell's centre, whatever the obstacles' heights.

    Args:
        obstacles: The static obstacles.
        bounds: x_min, y_min, x_max, y_max; the space beyond them counts as solid, unless they are open [m].
        resolution: Side of a cell [m].
        cap: Distances above this are reported as this; the cost grows with it [m].
        is_open: Whether the bounds are open, with free space beyond.
    """
    x_min, y_min, x_max, y_max = bounds
    columns = max(math.ceil((x_max - x_min) / resolution - 1e-9), 1)
    rows = max(math.ceil((y_max - y_min) / resolution - 1e-9), 1)
    x = x_min + (np.arange(columns) + 0.5) * resolution
    y = y_min + (np.arange(rows) + 0.5) * resolution
    to_side = np.minimum(x - x_min, x_max - x).clip(0.0, cap)
    to_end = np.minimum(y - y_min, y_max - y).clip(0.0, cap)
    distance = np.full((rows, columns), cap) if is_open else np.minimum(to_side[None, :], to_end[:, None])
    shapes = pack_shapes([obstacle.shape for obstacle in obstacles])
    _stamp_shapes(shapes.is_cylinder, shapes.centre, shapes.half, shapes.yaw, x_min, y_min, resolution, cap, distance)
    return ClearanceField(distance, (x_min, y_min), resolution)


@njit(cache=True)
def _nearest(is_cylinder, centre, half, yaw, x, y):
    nearest, which = math.inf, -1
    for i in range(len(yaw)):
        d = _distance_to_shape(
            is_cylinder[i], centre[i, 0], centre[i, 1], half[i, 0], half[i, 1],
            math.cos(yaw[i]), math.sin(yaw[i]), x, y,
        )  # fmt: skip
        if d < nearest:
            nearest, which = d, i
    return nearest, which


def clearance_at(shapes: ShapeArrays, x: float, y: float) -> tuple[float, int]:
    """Distance of a point to the nearest shape, 0 inside [m], and its index; ``(inf, -1)`` if there is none."""
    return _nearest(shapes.is_cylinder, shapes.centre, shapes.half, shapes.yaw, x, y)


NECK_JUMP = 0.5
"""Neighbouring cells whose nearest wide places are farther apart than this lie on either side of a neck [m]."""


def distance_to_wide_ways(field: ClearanceField, width: float) -> FloatArray:
    """Distance of every cell to the nearest place where a disc of diameter ``width`` fits, (rows, columns) [m].

    Where this is at most ``width / 2 - r``, a disc of radius r lies inside the part of the free space that is
    at least ``width`` wide everywhere (its morphological opening). Discs from both sides of a short neck would
    meet in it; so the middle line of every neck, where the nearest wide place jumps from one side to the other,
    is set to infinity. So is everything if there is no wide place at all.
    """
    fits = field.distance >= width / 2.0
    if not fits.any():
        return np.full(field.distance.shape, np.inf)
    found = ndimage.distance_transform_edt(~fits, sampling=field.resolution, return_indices=True)
    distance, nearest = found  # type: ignore[misc]
    away: FloatArray = distance
    near = distance <= width / 2.0
    for axis in (0, 1):
        jump = np.hypot(*np.diff(nearest, axis=axis + 1)) * field.resolution > NECK_JUMP
        before, behind = [slice(None)] * 2, [slice(None)] * 2
        before[axis], behind[axis] = slice(None, -1), slice(1, None)
        jump &= near[tuple(before)] & near[tuple(behind)]
        away[tuple(before)][jump] = np.inf
        away[tuple(behind)][jump] = np.inf
    return away
