"""Walls that come from an occupancy map: rectangles of whole cells, kept as such beside the boxes they stand for."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.types import FloatArray

Rectangle = tuple[int, int, int, int]
"""Column and row of the lower-left cell, number of columns and of rows."""


@dataclass(frozen=True, slots=True)
class WallGrid:
    """Solid and unknown cells of an occupancy map; column 0 and row 0 are at the origin, rows go up."""

    origin: tuple[float, float, float]
    """x, y of the lower-left corner of cell (0, 0), and the direction of its rows [m, m, rad]."""
    resolution: float
    """Side of a cell [m]."""
    size: tuple[int, int]
    """Numbers of columns and rows."""
    walls: tuple[Rectangle, ...]
    """Rectangles that cover the solid cells and no other."""
    unknown: tuple[Rectangle, ...] = ()
    """Rectangles of cells of which the map says nothing: nothing stands there, and a map given to the robot leaves them
    unknown."""
    height: float = 2.0
    """Height of the walls [m]."""

    def centre(self, rectangle: Rectangle) -> tuple[float, float]:
        """Centre of a rectangle in the world [m]."""
        x0, y0, yaw = self.origin
        column, row, columns, rows = rectangle
        u, v = (column + 0.5 * columns) * self.resolution, (row + 0.5 * rows) * self.resolution
        c, s = math.cos(yaw), math.sin(yaw)
        return x0 + c * u - s * v, y0 + s * u + c * v

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Upright rectangle about the map: x_min, y_min, x_max, y_max [m]."""
        x0, y0, yaw = self.origin
        width, height = self.size[0] * self.resolution, self.size[1] * self.resolution
        c, s = math.cos(yaw), math.sin(yaw)
        corners = [(x0 + c * u - s * v, y0 + s * u + c * v) for u in (0.0, width) for v in (0.0, height)]
        xs, ys = zip(*corners)
        return min(xs), min(ys), max(xs), max(ys)

    def cells(self, rectangles: tuple[Rectangle, ...]) -> NDArray[np.bool_]:
        """Mask (rows, columns) of the cells in some rectangles; row 0 is the lowest."""
        mask = np.zeros((self.size[1], self.size[0]), np.bool_)
        for column, row, columns, rows in rectangles:
            mask[row : row + rows, column : column + columns] = True
        return mask

    def is_in(self, rectangles: tuple[Rectangle, ...], xs: FloatArray, ys: FloatArray) -> NDArray[np.bool_]:
        """Whether points of the world [m] lie in some of the rectangles; all arrays have one shape."""
        x0, y0, yaw = self.origin
        c, s = math.cos(yaw), math.sin(yaw)
        columns = np.floor((c * (xs - x0) + s * (ys - y0)) / self.resolution).astype(int)
        rows = np.floor((c * (ys - y0) - s * (xs - x0)) / self.resolution).astype(int)
        within = (columns >= 0) & (rows >= 0) & (columns < self.size[0]) & (rows < self.size[1])
        found = np.zeros(within.shape, np.bool_)
        found[within] = self.cells(rectangles)[rows[within], columns[within]]
        return found


def rectangles_of(mask: NDArray[np.bool_]) -> tuple[Rectangle, ...]:
    """Cut the cells of a mask (rows, columns) into rectangles that do not overlap.

    Runs of equal extent in neighbouring rows become one rectangle; rows or columns are taken first, whichever gives
    fewer.
    """
    by_rows, by_columns = _runs(mask), _runs(mask.T)
    if len(by_rows) <= len(by_columns):
        return tuple(by_rows)
    return tuple((row, column, rows, columns) for column, row, columns, rows in by_columns)


def _runs(mask: NDArray[np.bool_]) -> list[Rectangle]:
    """Rectangles of a mask, by runs along its rows."""
    rows, columns = mask.shape
    padded = np.zeros((rows, columns + 2), np.int8)
    padded[:, 1:-1] = mask
    steps = np.diff(padded, axis=1)
    row_of, begins = np.nonzero(steps == 1)
    ends = np.nonzero(steps == -1)[1]
    done: list[Rectangle] = []
    growing: dict[tuple[int, int], int] = {}  # first row of the rectangle that each run of the last row belongs to
    first = np.searchsorted(row_of, np.arange(rows + 1))
    for row in range(rows):
        runs = list(zip(begins[first[row] : first[row + 1]].tolist(), ends[first[row] : first[row + 1]].tolist()))
        now = {run: growing.get(run, row) for run in runs}
        done += [(a, since, b - a, row - since) for (a, b), since in growing.items() if (a, b) not in now]
        growing = now
    done += [(a, since, b - a, rows - since) for (a, b), since in growing.items()]
    return done
