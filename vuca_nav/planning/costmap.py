"""The inflated grid: cells that a body of a given size may enter."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.footprint import size_of
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.planning.cells import (
    HEADINGS,
    Limits,
    best_places,
    chamfer,
    coarsen,
    fine_obstacles,
    forget,
    leave_out,
    to_best_places,
    weigh,
)
from vuca_nav.types import FloatArray

NOTHING_MOVES: FloatArray = np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class CostmapConfig:
    """Settings of the costmap: clearances that a path needs and prefers."""

    downsample: int = 2
    """Number of map cells to a costmap cell, each way: 0.05 m to 0.1 m."""
    margin: float = 0.02
    """Distance of the footprint from the centre of an obstacle's cell that a path needs [m]. The wall is within that
    cell, on either side of its centre, and a noisy range puts it one cell too near at most: a way that leaves 0.05 m at
    either side of the body stays open."""
    turning: float = 0.12
    """Distance beyond which the body may turn about: of its circumscribed circle from the centre of an obstacle's cell
    [m]. What is nearer is tight."""
    tight_weight: float = 15.0
    """Extra cost of a path that touches the margin, per length, beyond that of one in which the body may just turn."""
    comfort: float = 0.75
    """Clearance beyond which obstacles cost nothing [m]."""
    comfort_weight: float = 3.0
    """Extra cost of a path in which the body may just turn, per length; it falls linearly to 0 at ``comfort``."""
    escape_radius: float = 0.6
    """Radius about the robot in which cells within the margin may be crossed, to leave a tight spot [m]."""
    own_cells: float = 0.25
    """Distance from a moving track's circle within which occupied cells are its own [m]."""
    memory: int = 60
    """Scans after which a small obstacle, neither confirmed nor changed, may have moved away: 2 s at 30 Hz."""
    small: float = 1.5
    """Greatest extent of a small obstacle, each way [m]."""


class Costmap:
    """A snapshot of the navigation grid, coarser, with clearances, and without moving tracks.

    Args:
        grid: The navigation grid.
        discs: (k, 3) discs that cover the body: x, y in base_link and radius [m].
        robot: Position of the robot in the map [m].
        config: Settings.
        moving: (m, 3) x, y in the map and radius of the tracks that surely move [m].
        doubting: Paths also lead through small obstacles that may have moved away. Cells behind them are no frontier.

    Attributes:
        state: (rows, columns) int8 of UNKNOWN, FREE, OCCUPIED.
        clearance: (rows, columns) int16, distance of the best place in a cell to the nearest occupied cell of the map,
            in fifths of the map's cells, capped.
        weight: (rows, columns) int16, cost of entering a cell relative to ``UNIT``; 0 where a path must not go;
            ``escape_weight`` where it may only leave.
        headings: (rows, columns) uint16, a bit for each of the ``HEADINGS`` in which the body fits into the cell.
        fine: Clearances of the map's cells, a whole number of them to a cell each way, like ``clearance``.
        unit: Unit of the clearances [m].
        turning: Clearance from which the body may turn about, in that unit; cells with less are tight.
        radius: Clearance that a cell at the edge of the known needs for the body to go on there [m].
        origin: Lower-left corner in the map [m].
    """

    UNIT = 4
    """Weight of a cell with a clearance of ``comfort`` or more."""

    leaves_only = True
    """Whether paths may use cells of ``escape_weight`` only to leave a tight spot, away from obstacles."""

    def __init__(
        self,
        grid: OccupancyGrid,
        discs: FloatArray,
        robot: tuple[float, float],
        config: CostmapConfig,
        moving: FloatArray = NOTHING_MOVES,
        doubting: bool = False,
    ):
        step = grid.resolution * config.downsample
        self.resolution = step
        x_min, y_min, x_max, y_max = grid.known_box
        margin = config.downsample
        rows, columns = grid.level.shape
        i0, j0 = grid.cell(x_min, y_min)
        i1, j1 = grid.cell(x_max, y_max)
        i0, j0 = max(i0 - margin, 0), max(j0 - margin, 0)
        i1, j1 = min(i1 + margin + 1, rows), min(j1 + margin + 1, columns)
        self.origin = (grid.origin[0] + j0 * grid.resolution, grid.origin[1] + i0 * grid.resolution)
        self.radius = float(discs[:, 2].max())
        level = np.ascontiguousarray(grid.level[i0:i1, j0:j1])
        self.state: NDArray[np.int8] = coarsen(level, config.downsample)
        leave_out(self.state, self.origin, step, moving, config.own_cells)
        passable = self.state
        if doubting:
            passable = self.state.copy()
            certain = (level > 0) & ~grid.not_updated_for(config.memory)[i0:i1, j0:j1]
            forget(passable, certain, config.downsample, max(1, round(config.small / step)))
        unit = self.unit = grid.resolution / 5.0
        self.turning = (size_of(discs) + config.turning) / unit
        comfort = max(config.comfort / unit, self.turning + 1.0)
        obstacles = fine_obstacles(passable, level, config.downsample)
        self.fine: NDArray[np.int16] = chamfer(obstacles, math.ceil(comfort) + 5)
        self.clearance: NDArray[np.int16] = best_places(self.fine, config.downsample)
        limits = Limits(
            (self.radius + config.margin) / unit,
            self.turning,
            comfort,
            config.tight_weight,
            config.comfort_weight,
            self.UNIT,
            int(self.UNIT * 2.0 * (1.0 + config.comfort_weight + config.tight_weight)),
            config.downsample,
        )
        self.escape_weight = limits.escape_weight
        self.weight: NDArray[np.int16]
        self.headings: NDArray[np.uint16]
        self.weight, self.headings = weigh(
            passable,
            self.clearance,
            self.fine,
            _along_headings(discs) / grid.resolution,
            limits,
            (*self.cell(*robot), config.escape_radius / step),
        )

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a point of the map; may lie outside."""
        return (
            math.floor((y - self.origin[1]) / self.resolution),
            math.floor((x - self.origin[0]) / self.resolution),
        )

    def bar(self, places: FloatArray) -> None:
        """Let no path lead through places.

        Args:
            places: (k, 3) x, y in the map and radius [m].
        """
        for x, y, radius in places:
            rows = self.origin[1] + (np.arange(self.weight.shape[0]) + 0.5) * self.resolution - y
            columns = self.origin[0] + (np.arange(self.weight.shape[1]) + 0.5) * self.resolution - x
            self.weight[rows[:, None] ** 2 + columns**2 <= radius**2] = 0

    def refine(self, points: FloatArray) -> None:
        """Move points (n, 2) of a path, in place, to the best places of their cells where these are tight [m]."""
        to_best_places(points, self.clearance, self.fine, self.turning, np.array(self.origin), self.resolution)

    def clearances_at(self, points: FloatArray) -> FloatArray:
        """Distance of the best place of each point's cell to the nearest obstacle, capped, (n,) [m].

        Args:
            points: (n, 2) in the map [m].
        """
        rows = np.floor((points[:, 1] - self.origin[1]) / self.resolution).astype(np.int64)
        columns = np.floor((points[:, 0] - self.origin[0]) / self.resolution).astype(np.int64)
        clearances: FloatArray = self.clearance[rows, columns].astype(np.float64) * self.unit
        return clearances

    def parts_of(self, i: int, j: int) -> list[tuple[tuple[float, float], float]]:
        """The map's cells that make up a cell: the centre of each in the map and its clearance [m]."""
        parts = self.fine.shape[0] // self.state.shape[0]
        size = self.resolution / parts
        return [
            (
                (self.origin[0] + (b + 0.5) * size, self.origin[1] + (a + 0.5) * size),
                float(self.fine[a, b]) * self.unit,
            )
            for a in range(parts * i, parts * (i + 1))
            for b in range(parts * j, parts * (j + 1))
        ]

    def clearance_about(self, x: float, y: float) -> float:
        """Clearance of the map's cell of a point within the array [m]."""
        size = self.resolution * self.state.shape[0] / self.fine.shape[0]
        a, b = math.floor((y - self.origin[1]) / size), math.floor((x - self.origin[0]) / size)
        return float(self.fine[a, b]) * self.unit

    def contains(self, i: int, j: int) -> bool:
        """Whether the cell lies inside the array."""
        return 0 <= i < self.state.shape[0] and 0 <= j < self.state.shape[1]

    def point(self, i: int, j: int) -> tuple[float, float]:
        """Centre of a cell in the map [m]."""
        return (self.origin[0] + (j + 0.5) * self.resolution, self.origin[1] + (i + 0.5) * self.resolution)


def _along_headings(discs: FloatArray) -> FloatArray:
    """Centres of the discs for each of the headings, (HEADINGS, k, 2) [m]."""
    angles = np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS)
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return np.stack([c * discs[:, 0] - s * discs[:, 1], s * discs[:, 0] + c * discs[:, 1]], axis=-1)
