"""The occupancy grid: quantised log-odds, one update per cell and scan, free rays erase obstacles that moved away."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument
from vuca_nav.mapping.grid_kernels import GridCells, count_unsettled, insert_beams
from vuca_nav.types import FloatArray, Pose2

OCCUPIED_ABOVE = 0.52
FREE_BELOW = 0.48
"""Probabilities between which a cell is unknown (Zhang et al., Section III-C)."""
MOST_CELLS = 1 << 25
"""Greatest number of a grid's cells: at 0.05 m a square of 290 m, or a map of 5,000 by 6,400 cells, which the largest
public logs of buildings take. A navigation grid of this size holds 170 MB, a matching grid 470 MB."""
GROWTH = 1 / 4
"""A grid grows by this share of its side, or by a block if that is more: so that a large one is copied seldom."""


@dataclass(frozen=True, slots=True)
class GridConfig:
    """Settings of an occupancy grid. Levels are log-odds in units of ``unit``; 0 is unknown."""

    resolution: float = 0.05
    """Side of a cell [m]; Cartographer 2D's default."""
    unit: float = 0.1
    """Log-odds of one level. One level off zero is already outside [0.48, 0.52]."""
    hit: int = 9
    """Levels a return adds: p(hit) = 0.71."""
    miss: int = 4
    """Levels a passing beam takes: p(miss) = 0.40."""
    limit: int = 20
    """Levels are clamped here, p in [0.12, 0.88]: six passing beams, 0.2 s, free a cell that was surely occupied."""
    block: float = 8.0
    """The grid grows by multiples of this length [m]."""
    most_cells: int = MOST_CELLS
    """The grid grows no larger than this; scans that reach beyond are not inserted."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            BadArgument: If the levels cannot hold them.
        """
        if not 0 < self.limit <= 127 or self.hit <= 0 or self.miss <= 0:
            raise BadArgument("grid: hit and miss must be positive, limit within 1..127")
        if 1.0 / (1.0 + math.exp(-self.unit)) <= OCCUPIED_ABOVE:
            raise BadArgument(f"grid: one level of {self.unit} log-odds must leave [{FREE_BELOW}, {OCCUPIED_ABOVE}]")


class OccupancyGrid:
    """An occupancy grid that grows as it is written to.

    Attributes:
        level: (rows, columns) int8, row i holds y, column j holds x. Above 0 is occupied, below 0 free. Only ``insert``
            and ``fill`` may write to it.
        scan_index: Number of the last scan that was inserted; whoever draws scans of the past may set it.
        origin: x and y of the lower-left corner of cell [0, 0] in the map [m].
    """

    def __init__(self, config: GridConfig, centre: tuple[float, float] = (0.0, 0.0)):
        self.config = config
        self.resolution = config.resolution
        cells = 4 * round(config.block / config.resolution)
        self.level: NDArray[np.int8] = np.zeros((cells, cells), np.int8)
        self._scan_of_last_update = np.zeros((cells, cells), np.int32)
        self.scan_index = 0
        self.origin = self._origin_about(centre)
        # By the C library: NumPy's own functions round in the way of the processor's type.
        self.probability_of_level = np.array([_probability(k * config.unit) for k in range(-128, 128)])
        """(256,) probability of each level, indexed by level + 128."""
        self._entropy_of_level = np.array([_entropy(p) for p in self.probability_of_level.tolist()])
        self._entropy_change = np.zeros(1)
        self._cells: GridCells | None = None
        self.known_box = (centre[0], centre[1], centre[0], centre[1])
        """x_min, y_min, x_max, y_max of the rectangle that holds all cells ever written to [m]."""

    def _origin_about(self, centre: tuple[float, float]) -> tuple[float, float]:
        """Lower-left corner of the grid with a point in its middle [m]."""
        step = self.resolution
        rows, columns = self.level.shape
        return (
            math.floor((centre[0] - 0.5 * columns * step) / step) * step,
            math.floor((centre[1] - 0.5 * rows * step) / step) * step,
        )

    def clear(self, centre: tuple[float, float]) -> None:
        """Forget everything and begin anew about another point; the arrays are kept, and their memory."""
        window = self._known_window()
        for array in self._arrays():
            array[window] = 0
        self.scan_index = 0
        self.origin = self._origin_about(centre)
        self._entropy_change[0] = 0.0
        self._cells = None
        self.known_box = (centre[0], centre[1], centre[0], centre[1])

    def _arrays(self) -> tuple[np.ndarray, ...]:
        """The arrays with an entry for each cell."""
        return (self.level, self._scan_of_last_update)

    def _known_window(self) -> tuple[slice, slice]:
        """Rows and columns of the cells that were ever written to, and some about them."""
        x_min, y_min, x_max, y_max = self.known_box
        (i0, j0), (i1, j1) = self.cell(x_min, y_min), self.cell(x_max, y_max)
        margin = 3
        return slice(max(i0 - margin, 0), i1 + margin + 1), slice(max(j0 - margin, 0), j1 + margin + 1)

    @property
    def entropy(self) -> float:
        """Entropy of the map less that of an unseen one, summed over all cells [nat]; 0 at first, and falling.

        Section III-C prints ``-sum p log p`` with p the occupancy alone, which is largest at p = 1/e, so that the
        first look at a free cell would raise it. This is the entropy of the cell's two outcomes, largest at 1/2; and
        against an unseen map, so that it does not jump when the grid grows.
        """
        return float(self._entropy_change[0])

    def probability(self) -> NDArray[np.uint8]:
        """Occupancy probability times 255, (rows, columns)."""
        return (self.probability_of_level * 255.0).astype(np.uint8)[self.level.astype(np.int16) + 128]

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a point in the map; may lie outside the array."""
        return (
            math.floor((y - self.origin[1]) / self.resolution),
            math.floor((x - self.origin[0]) / self.resolution),
        )

    def state(self, x: float, y: float) -> int:
        """State of the cell at a point of the map: -1 free, 0 unknown, 1 occupied."""
        i, j = self.cell(x, y)
        if not (0 <= i < self.level.shape[0] and 0 <= j < self.level.shape[1]):
            return 0
        return int(np.sign(self.level[i, j]))

    def not_updated_for(self, scans: int) -> NDArray[np.bool_]:
        """Mask of the cells that some scan has hit or changed, but none of the last ``scans``, (rows, columns)."""
        return (self._scan_of_last_update > 0) & (self._scan_of_last_update < self.scan_index - scans)

    def cover(self, x_min: float, y_min: float, x_max: float, y_max: float) -> bool:
        """Grow, if need be, so that the rectangle lies inside; returns whether it does: a grid has a greatest size."""
        if not math.isfinite(x_min + y_min + x_max + y_max):
            return False
        low, high = (x_min, y_min), (x_max, y_max)
        before, after = self._pad(low, high, GROWTH)
        if not any(before) and not any(after):
            return True
        if not self._may_grow(before, after):
            before, after = self._pad(low, high, 0.0)  # nearly full: no more than it takes
            if not self._may_grow(before, after):
                return False
        self._grow(((before[1], after[1]), (before[0], after[0])))
        step = self.resolution
        self.origin = (self.origin[0] - before[0] * step, self.origin[1] - before[1] * step)
        return True

    def _may_grow(self, before: list[int], after: list[int]) -> bool:
        """Whether the grid with so many more columns and rows before and after has at most its greatest size."""
        rows, columns = self.level.shape
        return (rows + before[1] + after[1]) * (columns + before[0] + after[0]) <= self.config.most_cells

    def _pad(self, low: tuple[float, float], high: tuple[float, float], share: float) -> tuple[list[int], list[int]]:
        """Columns and rows to add before and after, so that a rectangle is covered.

        Args:
            low: Its lower-left corner [m].
            high: Its upper-right corner [m].
            share: A side that grows, grows by at least this share of it.
        """
        rows, columns = self.level.shape
        step, margin = self.resolution, 2 * self.resolution
        sides = list(zip(self.origin, low, high, (columns, rows)))
        before = [self._growth(edge - (near - margin), cells, share) for edge, near, _, cells in sides]
        after = [self._growth((far + margin) - (edge + cells * step), cells, share) for edge, _, far, cells in sides]
        return before, after

    def _growth(self, missing: float, cells: int, share: float) -> int:
        """Number of cells to add at one end of a side, a whole number of blocks.

        Args:
            missing: Length that is missing there [m].
            cells: Length of the side, in cells.
            share: Least share of the side, if it grows.
        """
        block = round(self.config.block / self.resolution)
        blocks = max(0, math.ceil(missing / self.resolution / block))
        return block * max(blocks, math.floor(share * cells / block)) if blocks else 0

    def _grow(self, pad: tuple[tuple[int, int], tuple[int, int]]) -> None:
        self.level = grown(self.level, pad)
        self._scan_of_last_update = grown(self._scan_of_last_update, pad)
        self._cells = None

    @property
    def cells(self) -> GridCells:
        """The grid as the kernels take it; until it grows it is the same object."""
        if self._cells is None:
            self._cells = GridCells(
                self.level,
                self._scan_of_last_update,
                count_unsettled(self.level, -self.config.limit),
                self._entropy_of_level,
                self._entropy_change,
                self.origin[0],
                self.origin[1],
                self.resolution,
                self.config.hit,
                self.config.miss,
                self.config.limit,
            )
        return self._cells

    def _include(self, x_min: float, y_min: float, x_max: float, y_max: float) -> bool:
        """Take a rectangle into the known box; returns whether the grid can hold it."""
        known = self.known_box
        if x_min < known[0] or y_min < known[1] or x_max > known[2] or y_max > known[3]:
            box = (min(x_min, known[0]), min(y_min, known[1]), max(x_max, known[2]), max(y_max, known[3]))
            if not self.cover(*box):
                return False
            self.known_box = box
        return True

    def insert(
        self, map_from_sensor: Pose2, points_in_map: FloatArray, num_hits: int, grazed: FloatArray, box: FloatArray
    ) -> bool:
        """Update every cell that the scan saw, once: raise the returns' cells, lower those on the way to them.

        Args:
            map_from_sensor: Pose at which the scan was taken.
            points_in_map: (n, 2) ends of the beams [m].
            num_hits: The first ``num_hits`` of them are returns; the others are ends of beams that met nothing.
            grazed: (n,) length of the last part of each beam, over which it skims the surface it ends on and empties no
                occupied cell [m].
            box: (4,) x_min, y_min, x_max, y_max of all ends and the sensor [m].

        Returns:
            Whether the scan is in the map now: not if the grid would have to grow beyond its greatest size.
        """
        if not self._include(float(box[0]), float(box[1]), float(box[2]), float(box[3])):
            return False
        self.scan_index += 1
        insert_beams(self.cells, self.scan_index, map_from_sensor.x, map_from_sensor.y, points_in_map, num_hits, grazed)
        return True

    def fill(self, level: NDArray[np.int8], origin: tuple[float, float]) -> None:
        """Take over a map known beforehand; it must have this grid's resolution.

        Args:
            level: (rows, columns) -1 free, 0 unknown, 1 occupied; free and occupied become the extreme levels.
            origin: Lower-left corner in the map [m].

        Raises:
            BadArgument: If it does not fit into the greatest size of a grid.
        """
        step = self.resolution
        rows, columns = level.shape
        if not self._include(origin[0], origin[1], origin[0] + columns * step, origin[1] + rows * step):
            raise BadArgument(
                f"a map of {columns} x {rows} cells from {tuple(origin)} on does not fit into a grid, which has at "
                f"most {self.config.most_cells} cells: cut it, or start inside it"
            )
        i, j = self.cell(origin[0] + 0.5 * step, origin[1] + 0.5 * step)
        self.level[i : i + rows, j : j + columns] = np.sign(level) * self.config.limit
        self._cells = None
        entropy = self._entropy_of_level[self.level.astype(np.int16) + 128]
        self._entropy_change[0] = float((entropy - self._entropy_of_level[128]).sum())


def _probability(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))  # less than overflows


def _entropy(p: float) -> float:
    """Entropy of a cell that is occupied with probability p [nat]."""
    return -p * math.log(p) - (1.0 - p) * math.log(1.0 - p) if 0.0 < p < 1.0 else 0.0


def grown(array: np.ndarray, pad: tuple[tuple[int, int], tuple[int, int]]) -> np.ndarray:
    """An array with rows and columns of zeros added before and after; these take no memory until they are written to.

    Args:
        array: (rows, columns, ...).
        pad: Rows before and after, columns before and after.
    """
    (above, below), (left, right) = pad
    rows, columns = array.shape[:2]
    larger = np.zeros((above + rows + below, left + columns + right, *array.shape[2:]), array.dtype)
    larger[above : above + rows, left : left + columns] = array
    return larger
