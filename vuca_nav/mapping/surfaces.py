"""The matching map: an occupancy grid whose cells remember where in them the returns lay.

A cell's mean return is an estimate of the surface far finer than the cell; the mean and scatter of a neighbourhood
give the line through it (as in the normal distributions transform, Biber and Strasser 2003).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.types import FloatArray, Pose2

MAX_COUNT = 60
"""Returns that a cell's mean remembers: enough to average 2 cm of noise to 3 mm, and new ones still count."""
PRIOR_COUNT = 3
"""Returns that a cell of a map known beforehand is worth: its surface may lie anywhere in the cell."""


class SurfaceGrid(OccupancyGrid):
    """An occupancy grid with a mean return per cell.

    Attributes:
        mean: (rows, columns, 2) x and y of the mean return, from the cell's lower-left corner, in cells.
        count: (rows, columns) how many returns are in the mean.
    """

    def __init__(self, config: GridConfig, centre: tuple[float, float] = (0.0, 0.0)):
        super().__init__(config, centre)
        self.mean: NDArray[np.float32] = np.zeros((*self.level.shape, 2), np.float32)
        self.count: NDArray[np.uint8] = np.zeros(self.level.shape, np.uint8)

    def insert(
        self, map_from_sensor: Pose2, points_in_map: FloatArray, num_hits: int, grazed: FloatArray, box: FloatArray
    ) -> None:
        """As for the occupancy grid; the returns also move their cells' means."""
        super().insert(map_from_sensor, points_in_map, num_hits, grazed, box)
        _average(
            self.level,
            self.mean,
            self.count,
            points_in_map,
            num_hits,
            self.origin[0],
            self.origin[1],
            1.0 / self.resolution,
            self.config.hit,
        )

    def fill(self, level: NDArray[np.int8], origin: tuple[float, float]) -> None:
        """As for the occupancy grid, but only what has a free cell beside it is a surface.

        It goes through the middle of its cell and weighs little, so that the first returns put it right.
        """
        outline = level.copy()
        free = np.pad(level < 0, 1)
        beside_free = free[2:, 1:-1] | free[:-2, 1:-1] | free[1:-1, 2:] | free[1:-1, :-2]
        outline[(level > 0) & ~beside_free] = 0
        super().fill(outline, origin)
        self.mean[self.level > 0] = 0.5
        self.count[self.level > 0] = PRIOR_COUNT

    def _grow(self, pad: tuple[tuple[int, int], tuple[int, int]]) -> None:
        super()._grow(pad)
        self.mean = np.pad(self.mean, (*pad, (0, 0)))
        self.count = np.pad(self.count, pad)


@njit(cache=True)
def _average(level, mean, count, points, num_hits, origin_x, origin_y, per_metre, hit):
    for k in range(num_hits):
        fx = (points[k, 0] - origin_x) * per_metre
        fy = (points[k, 1] - origin_y) * per_metre
        i, j = int(fy), int(fx)
        if level[i, j] <= hit:
            count[i, j] = min(count[i, j], 1)  # what was here before had moved away
        n = min(count[i, j] + 1, MAX_COUNT)
        count[i, j] = n
        mean[i, j, 0] += (fx - j - mean[i, j, 0]) / n
        mean[i, j, 1] += (fy - i - mean[i, j, 1]) / n
