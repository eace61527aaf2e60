"""The matching map: an occupancy grid whose cells remember where in them the returns lay.

A cell's mean return is an estimate of the surface far finer than the cell; the mean and scatter of a neighbourhood
give the line through it (as in the normal distributions transform, Biber and Strasser 2003).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid, grown
from vuca_nav.types import FloatArray, Pose2

MAX_COUNT = 60
"""Returns that a cell's mean remembers: enough to average 2 cm of noise to 3 mm, and new ones still count."""
PRIOR_COUNT = 3
"""Returns that a cell of a map known beforehand is worth: its surface may lie anywhere in the cell."""


class Surface(NamedTuple):
    """Arrays of a surface grid for the scan matcher."""

    level: np.ndarray
    """(rows, columns) int8 levels, see ``OccupancyGrid``."""
    mean: np.ndarray
    """(rows, columns, 2) float32 mean returns, see ``SurfaceGrid``."""
    count: np.ndarray
    """(rows, columns) uint8 numbers of returns, see ``SurfaceGrid``."""
    origin_x: float
    """x of the lower-left corner in the map [m]."""
    origin_y: float
    """y of the lower-left corner in the map [m]."""
    resolution: float
    """[m]"""
    limit: int
    """The highest level there is."""


class PackedSurfaces(NamedTuple):
    """A surface grid that nothing more is written to, in a fraction of its memory."""

    level: NDArray[np.int8]
    """(rows, columns) levels of the known part."""
    cells: NDArray[np.int32]
    """(n,) flat indices of the occupied cells."""
    mean: NDArray[np.float32]
    """(n, 2) their mean returns."""
    count: NDArray[np.uint8]
    """(n,) numbers of returns."""
    origin: tuple[float, float]
    """Lower-left corner [m]."""
    resolution: float
    """[m]"""
    limit: int
    """The highest level there is."""

    def surface(self) -> Surface:
        """Unpack it for the scan matcher."""
        rows, columns = self.level.shape
        mean, count = np.zeros((rows * columns, 2), np.float32), np.zeros(rows * columns, np.uint8)
        mean[self.cells], count[self.cells] = self.mean, self.count
        means, counts = mean.reshape(rows, columns, 2), count.reshape(rows, columns)
        return Surface(self.level, means, counts, *self.origin, self.resolution, self.limit)


class SurfaceGrid(OccupancyGrid):
    """An occupancy grid with a mean return per cell.

    Attributes:
        mean: (rows, columns, 2) x and y of the mean return, from the cell's lower-left corner, in cells.
        count: (rows, columns) number of returns in the mean.
    """

    def __init__(self, config: GridConfig, centre: tuple[float, float] = (0.0, 0.0)):
        super().__init__(config, centre)
        self.mean: NDArray[np.float32] = np.zeros((*self.level.shape, 2), np.float32)
        self.count: NDArray[np.uint8] = np.zeros(self.level.shape, np.uint8)
        self._surface: Surface | None = None

    @property
    def surface(self) -> Surface:
        """The grid as the scan matcher takes it; until it grows it is the same object."""
        if self._surface is None:
            self._surface = Surface(
                self.level,
                self.mean,
                self.count,
                self.origin[0],
                self.origin[1],
                self.resolution,
                self.config.limit,
            )
        return self._surface

    def insert(
        self, map_from_sensor: Pose2, points_in_map: FloatArray, num_hits: int, grazed: FloatArray, box: FloatArray
    ) -> bool:
        """Insert a scan as ``OccupancyGrid.insert`` does, and move the means of the returns' cells."""
        is_mapped = super().insert(map_from_sensor, points_in_map, num_hits, grazed, box)
        if is_mapped:
            _average(self.surface, self.config.hit, points_in_map, num_hits)
        return is_mapped

    def fill(self, level: NDArray[np.int8], origin: tuple[float, float]) -> None:
        """Take over a map known beforehand; only occupied cells beside a free one are surfaces.

        A surface goes through the middle of its cell and weighs little, so that the first returns correct it.
        """
        outline = level.copy()
        free = np.pad(level < 0, 1)
        beside_free = free[2:, 1:-1] | free[:-2, 1:-1] | free[1:-1, 2:] | free[1:-1, :-2]
        outline[(level > 0) & ~beside_free] = 0
        super().fill(outline, origin)
        self.mean[self.level > 0] = 0.5
        self.count[self.level > 0] = PRIOR_COUNT

    def unpack(self, packed: "PackedSurfaces") -> None:
        """Take over what another grid of this resolution has held; this one is empty.

        Raises:
            BadArgument: If it does not fit into the greatest size of a grid.
        """
        super().fill(np.sign(packed.level), packed.origin)
        window = self._window_of(packed.level.shape, packed.origin)
        self.level[window] = packed.level
        surface = packed.surface()
        self.mean[window], self.count[window] = surface.mean, surface.count
        self._surface = None

    def _window_of(self, shape: tuple[int, ...], origin: tuple[float, float]) -> tuple[slice, slice]:
        """Rows and columns of a rectangle of cells that begins at a point [m]."""
        i, j = self.cell(origin[0] + 0.5 * self.resolution, origin[1] + 0.5 * self.resolution)
        return slice(i, i + shape[0]), slice(j, j + shape[1])

    def clear(self, centre: tuple[float, float]) -> None:
        """Forget everything, as ``OccupancyGrid.clear`` does."""
        super().clear(centre)
        self._surface = None

    def _arrays(self) -> tuple[np.ndarray, ...]:
        return (*super()._arrays(), self.mean, self.count)

    def pack(self) -> "PackedSurfaces":
        """The known part of the grid, packed."""
        window = self._known_window()
        level = self.level[window].copy()
        cells = np.flatnonzero(level > 0).astype(np.int32)
        i0, j0 = window[0].start, window[1].start
        return PackedSurfaces(
            level,
            cells,
            self.mean[window].reshape(-1, 2)[cells],
            self.count[window].ravel()[cells],
            (self.origin[0] + j0 * self.resolution, self.origin[1] + i0 * self.resolution),
            self.resolution,
            self.config.limit,
        )

    def _grow(self, pad: tuple[tuple[int, int], tuple[int, int]]) -> None:
        super()._grow(pad)
        self.mean = grown(self.mean, pad)
        self.count = grown(self.count, pad)
        self._surface = None


@njit(cache=True)
def _average(surface, hit, points, num_hits):
    """Move the means of the cells that the returns fall in; a cell that was free until now begins anew."""
    level, mean, count = surface.level, surface.mean, surface.count
    origin_x, origin_y, per_metre = surface.origin_x, surface.origin_y, 1.0 / surface.resolution
    for k in range(num_hits):
        fx = (points[k, 0] - origin_x) * per_metre
        fy = (points[k, 1] - origin_y) * per_metre
        i, j = int(fy), int(fx)
        if level[i, j] <= hit:
            count[i, j] = min(count[i, j], 1)  # the former surface had moved away
        n = min(count[i, j] + 1, MAX_COUNT)
        count[i, j] = n
        mean[i, j, 0] += (fx - j - mean[i, j, 0]) / n
        mean[i, j, 1] += (fy - i - mean[i, j, 1]) / n
