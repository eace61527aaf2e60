"""The occupancy grid: quantised log-odds, one update per cell and scan, free rays erase what moved away."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument
from vuca_nav.types import FloatArray, Pose2

OCCUPIED_ABOVE = 0.52
FREE_BELOW = 0.48
"""A cell between the two is unknown (Section III-C)."""


@dataclass(frozen=True, slots=True)
class GridConfig:
    """Levels are log-odds in units of ``unit``; 0 is "not known"."""

    resolution: float = 0.05
    """[m]; Cartographer 2D's default."""
    unit: float = 0.1
    """Log-odds of one level. One level off zero is already outside [0.48, 0.52]."""
    hit: int = 9
    """Levels a return adds: p(hit) = 0.71."""
    miss: int = 4
    """Levels a passing beam takes: p(miss) = 0.40."""
    limit: int = 20
    """Levels are clamped here, p in [0.12, 0.88]: six passing beams, 0.2 s, free a cell that was surely occupied."""
    block: float = 8.0
    """The grid grows by multiples of this [m]."""

    def __post_init__(self) -> None:
        """Reject what the levels cannot hold."""
        if not 0 < self.limit <= 127 or self.hit <= 0 or self.miss <= 0:
            raise BadArgument("grid: hit and miss must be positive, limit within 1..127")
        if 1.0 / (1.0 + math.exp(-self.unit)) <= OCCUPIED_ABOVE:
            raise BadArgument(f"grid: one level of {self.unit} log-odds must leave [{FREE_BELOW}, {OCCUPIED_ABOVE}]")


class OccupancyGrid:
    """Grows as it is written to.

    Attributes:
        level: (rows, columns) int8, row i holds y, column j holds x. Above 0 is occupied, below 0 free.
        origin: x and y of the lower-left corner of cell [0, 0] in the map [m].
    """

    def __init__(self, config: GridConfig, centre: tuple[float, float] = (0.0, 0.0)):
        self.config = config
        self.resolution = config.resolution
        cells = 4 * round(config.block / config.resolution)
        self.level: NDArray[np.int8] = np.zeros((cells, cells), np.int8)
        self._scan_of_last_update = np.zeros((cells, cells), np.int32)
        self._scan_index = 0
        half = 0.5 * cells * config.resolution
        step = config.resolution
        self.origin = (
            math.floor((centre[0] - half) / step) * step,
            math.floor((centre[1] - half) / step) * step,
        )
        levels = np.arange(-128, 128) * config.unit
        self.probability_of_level = 1.0 / (1.0 + np.exp(-levels))
        """(256,) indexed by level + 128."""
        p = self.probability_of_level
        self._entropy_of_level = -p * np.log(p) - (1.0 - p) * np.log(1.0 - p)
        self._entropy_change = np.zeros(1)
        self.known_box = (centre[0], centre[1], centre[0], centre[1])
        """x_min, y_min, x_max, y_max of all that was ever written to [m]."""

    @property
    def entropy(self) -> float:
        """Of the map less that of an unseen one, summed over all cells [nat]; 0 at first, and falling.

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
        """-1 free, 0 unknown, 1 occupied, at a point of the map."""
        i, j = self.cell(x, y)
        if not (0 <= i < self.level.shape[0] and 0 <= j < self.level.shape[1]):
            return 0
        return int(np.sign(self.level[i, j]))

    def not_updated_for(self, scans: int) -> NDArray[np.bool_]:
        """Cells that a scan has hit or changed, but none of the last so many, (rows, columns)."""
        return (self._scan_of_last_update > 0) & (self._scan_of_last_update < self._scan_index - scans)

    def cover(self, x_min: float, y_min: float, x_max: float, y_max: float) -> None:
        """Grow, if need be, so that the rectangle lies inside."""
        rows, columns = self.level.shape
        step = self.resolution
        block = round(self.config.block / step)
        margin = 2 * step
        before = [
            max(0, math.ceil((edge - (low - margin)) / step / block)) * block
            for edge, low in zip(self.origin, (x_min, y_min))
        ]
        after = [
            max(0, math.ceil(((high + margin) - (edge + cells * step)) / step / block)) * block
            for edge, cells, high in zip(self.origin, (columns, rows), (x_max, y_max))
        ]
        if not any(before) and not any(after):
            return
        self._grow(((before[1], after[1]), (before[0], after[0])))
        self.origin = (self.origin[0] - before[0] * step, self.origin[1] - before[1] * step)

    def _grow(self, pad: tuple[tuple[int, int], tuple[int, int]]) -> None:
        self.level = np.pad(self.level, pad)
        self._scan_of_last_update = np.pad(self._scan_of_last_update, pad)

    def _include(self, x_min: float, y_min: float, x_max: float, y_max: float) -> None:
        known = self.known_box
        if x_min < known[0] or y_min < known[1] or x_max > known[2] or y_max > known[3]:
            self.known_box = (
                min(x_min, known[0]),
                min(y_min, known[1]),
                max(x_max, known[2]),
                max(y_max, known[3]),
            )
            self.cover(*self.known_box)

    def insert(
        self, map_from_sensor: Pose2, points_in_map: FloatArray, num_hits: int, grazed: FloatArray, box: FloatArray
    ) -> None:
        """Update every cell that the scan saw, once: a return's cell up, the cells on the way to it down.

        Args:
            map_from_sensor: Where the scan was taken.
            points_in_map: (n, 2) where beams ended [m].
            num_hits: The first so many of them are returns; the others are ends of beams that met nothing.
            grazed: (n,) over this last part of its way a beam skims the surface it ends on, and empties no cell that
                is held for occupied [m].
            box: (4,) x_min, y_min, x_max, y_max of all of them and the sensor [m].
        """
        self._include(float(box[0]), float(box[1]), float(box[2]), float(box[3]))
        self._scan_index += 1
        _insert(
            self.level,
            self._scan_of_last_update,
            self._scan_index,
            (map_from_sensor.x - self.origin[0]) / self.resolution,
            (map_from_sensor.y - self.origin[1]) / self.resolution,
            points_in_map,
            num_hits,
            grazed,
            self.origin[0],
            self.origin[1],
            1.0 / self.resolution,
            self.config.hit,
            self.config.miss,
            self.config.limit,
            self._entropy_of_level,
            self._entropy_change,
        )

    def fill(self, level: NDArray[np.int8], origin: tuple[float, float]) -> None:
        """Take over a map known beforehand; it must have this grid's resolution.

        Args:
            level: (rows, columns) -1 free, 0 unknown, 1 occupied; becomes as sure as a level can be.
            origin: Lower-left corner in the map [m].
        """
        step = self.resolution
        rows, columns = level.shape
        self._include(origin[0], origin[1], origin[0] + columns * step, origin[1] + rows * step)
        i, j = self.cell(origin[0] + 0.5 * step, origin[1] + 0.5 * step)
        self.level[i : i + rows, j : j + columns] = np.sign(level) * self.config.limit
        entropy = self._entropy_of_level[self.level.astype(np.int16) + 128]
        self._entropy_change[0] = float((entropy - self._entropy_of_level[128]).sum())


@njit(cache=True)
def _insert(
    level, last_update, scan_index, sensor_j, sensor_i, points, num_hits, grazed, origin_x, origin_y, per_metre,
    hit, miss, limit, entropy_of_level, entropy_change,
):  # fmt: skip
    gain = 0.0
    for k in range(num_hits):
        i = int((points[k, 1] - origin_y) * per_metre)
        j = int((points[k, 0] - origin_x) * per_metre)
        if last_update[i, j] != scan_index:
            last_update[i, j] = scan_index
            old = level[i, j]
            new = min(old + hit, limit)
            level[i, j] = new
            gain += entropy_of_level[new + 128] - entropy_of_level[old + 128]
    for k in range(points.shape[0]):
        # Walk the cells of the beam (Amanatides and Woo 1987), short of the one it ends in.
        end_j = (points[k, 0] - origin_x) * per_metre
        end_i = (points[k, 1] - origin_y) * per_metre
        dj = end_j - sensor_j
        di = end_i - sensor_i
        i, j = int(sensor_i), int(sensor_j)
        last_i, last_j = int(end_i), int(end_j)
        step_i = 1 if di > 0 else -1
        step_j = 1 if dj > 0 else -1
        t_per_i = abs(1.0 / di) if di != 0.0 else 1e30
        t_per_j = abs(1.0 / dj) if dj != 0.0 else 1e30
        t_i = ((i + 1 - sensor_i) if di > 0 else (sensor_i - i)) * t_per_i
        t_j = ((j + 1 - sensor_j) if dj > 0 else (sensor_j - j)) * t_per_j
        skims_from = 1.0 - grazed[k] * per_metre / max(math.hypot(di, dj), 1e-9)
        for _ in range(abs(last_i - i) + abs(last_j - j)):
            old = level[i, j]
            skims = old > 0 and min(t_i, t_j) > skims_from
            if old > -limit and last_update[i, j] != scan_index and not skims:
                last_update[i, j] = scan_index
                new = max(old - miss, -limit)
                level[i, j] = new
                gain += entropy_of_level[new + 128] - entropy_of_level[old + 128]
            if t_i < t_j:
                t_i += t_per_i
                i += step_i
            else:
                t_j += t_per_j
                j += step_j
    entropy_change[0] += gain
