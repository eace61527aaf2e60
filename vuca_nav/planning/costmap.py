"""The inflated grid: cells that a body of a given size may enter."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.types import FloatArray

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
NOTHING_MOVES: FloatArray = np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class CostmapConfig:
    """Settings of the costmap: clearances that a path needs and prefers."""

    downsample: int = 2
    """Number of map cells to a costmap cell, each way: 0.05 m to 0.1 m."""
    margin: float = 0.07
    """Clearance of the footprint's circumscribed circle from an obstacle's cell that a path needs [m]."""
    comfort: float = 0.75
    """Clearance beyond which obstacles cost nothing [m]."""
    comfort_weight: float = 3.0
    """Extra cost of a path that touches the margin, per length; it falls linearly to 0 at ``comfort``."""
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
        radius: Radius of the body [m].
        robot: Position of the robot in the map [m].
        config: Settings.
        moving: (m, 3) x, y in the map and radius of the tracks that surely move [m].
        doubting: Paths also lead through small obstacles that may have moved away. Cells behind them are no frontier.

    Attributes:
        state: (rows, columns) int8 of UNKNOWN, FREE, OCCUPIED.
        clearance: (rows, columns) int16, distance to the nearest occupied cell in fifths of a cell, capped.
        weight: (rows, columns) int16, cost of entering a cell relative to ``UNIT``; 0 where a path must not go;
            ``escape_weight`` where it may only leave.
        origin: Lower-left corner in the map [m].
    """

    UNIT = 4
    """Weight of a cell with a clearance of ``comfort`` or more."""

    def __init__(
        self,
        grid: OccupancyGrid,
        radius: float,
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
        self.radius = radius
        level = np.ascontiguousarray(grid.level[i0:i1, j0:j1])
        self.state: NDArray[np.int8] = coarsen(level, config.downsample)
        _leave_out(self.state, self.origin, step, moving, config.own_cells)
        passable = self.state
        if doubting:
            passable = self.state.copy()
            certain = (level > 0) & ~grid.not_updated_for(config.memory)[i0:i1, j0:j1]
            _forget(passable, certain, config.downsample, max(1, round(config.small / step)))
        cap = math.ceil(config.comfort / step * 5.0) + 5
        self.clearance: NDArray[np.int16] = chamfer(passable, cap)
        # An occupied cell's surface is half a cell nearer than its centre.
        lethal = (radius + config.margin + 0.5 * step) / step * 5.0
        comfort = max(config.comfort / step * 5.0, lethal + 1.0)
        self.lethal = lethal
        robot_i, robot_j = self.cell(*robot)
        self.escape_weight = int(self.UNIT * 2.0 * (1.0 + config.comfort_weight))
        self.weight: NDArray[np.int16] = _weigh(
            passable,
            self.clearance,
            lethal,
            comfort,
            config.comfort_weight,
            self.UNIT,
            self.escape_weight,
            robot_i,
            robot_j,
            config.escape_radius / step,
        )

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a point of the map; may lie outside."""
        return (
            math.floor((y - self.origin[1]) / self.resolution),
            math.floor((x - self.origin[0]) / self.resolution),
        )

    def contains(self, i: int, j: int) -> bool:
        """Whether the cell lies inside the array."""
        return 0 <= i < self.state.shape[0] and 0 <= j < self.state.shape[1]

    def point(self, i: int, j: int) -> tuple[float, float]:
        """Centre of a cell in the map [m]."""
        return (self.origin[0] + (j + 0.5) * self.resolution, self.origin[1] + (i + 0.5) * self.resolution)


@njit(cache=True)
def coarsen(level, factor):
    """Coarsen a grid: a coarse cell is occupied if any of its cells is, free if half of them are."""
    rows, columns = level.shape[0] // factor, level.shape[1] // factor
    state = np.empty((rows, columns), np.int8)
    free, occupied = np.empty(columns * factor, np.int32), np.empty(columns * factor, np.int32)
    for i in range(rows):
        free[:], occupied[:] = 0, 0
        for a in range(factor * i, factor * (i + 1)):
            line = level[a]
            for j in range(columns * factor):
                free[j] += line[j] < 0
                occupied[j] += line[j] > 0
        for j in range(columns):
            num_free = num_occupied = 0
            for b in range(factor * j, factor * (j + 1)):
                num_free += free[b]
                num_occupied += occupied[b]
            state[i, j] = 2 if num_occupied > 0 else (1 if 2 * num_free >= factor * factor else 0)
    return state


@njit(cache=True)
def _forget(state, certain, factor, most):
    """Free the connected occupied cells that extend over at most ``most`` cells each way, none of them certain."""
    rows, columns = state.shape
    visited = np.zeros((rows, columns), np.bool_)
    stack = np.empty((rows * columns, 2), np.int32)
    for i0 in range(rows):
        for j0 in range(columns):
            if state[i0, j0] != 2 or visited[i0, j0]:
                continue
            visited[i0, j0] = True
            stack[0, 0], stack[0, 1] = i0, j0
            done, size = 0, 1
            low_i, high_i, low_j, high_j, gone = i0, i0, j0, j0, True
            while done < size:
                i, j = stack[done, 0], stack[done, 1]
                done += 1
                low_i, high_i, low_j, high_j = min(low_i, i), max(high_i, i), min(low_j, j), max(high_j, j)
                for a in range(factor * i, factor * (i + 1)):
                    for b in range(factor * j, factor * (j + 1)):
                        gone = gone and not certain[a, b]
                for a in range(max(i - 1, 0), min(i + 2, rows)):
                    for b in range(max(j - 1, 0), min(j + 2, columns)):
                        if state[a, b] == 2 and not visited[a, b]:
                            visited[a, b] = True
                            stack[size, 0], stack[size, 1] = a, b
                            size += 1
            if gone and high_i - low_i < most and high_j - low_j < most:
                for k in range(size):
                    state[stack[k, 0], stack[k, 1]] = 1


@njit(cache=True)
def _leave_out(state, origin, resolution, moving, margin):
    """Free the cells that moving tracks occupy."""
    for track in moving:
        reach = (track[2] + margin) / resolution
        middle_j, middle_i = (track[0] - origin[0]) / resolution - 0.5, (track[1] - origin[1]) / resolution - 0.5
        for i in range(max(int(middle_i - reach), 0), min(int(middle_i + reach) + 2, state.shape[0])):
            for j in range(max(int(middle_j - reach), 0), min(int(middle_j + reach) + 2, state.shape[1])):
                if state[i, j] == 2 and (i - middle_i) ** 2 + (j - middle_j) ** 2 <= reach * reach:
                    state[i, j] = 1


@njit(cache=True)
def chamfer(state, cap):
    """Distance to the nearest occupied cell by the 5-7 chamfer (Borgefors 1986), at most 8% too far, capped."""
    rows, columns = state.shape
    d = np.empty((rows, columns), np.int16)
    # Each row takes first from the row before, which vectorises, then from its own neighbour.
    before = np.full(columns + 2, cap, np.int16)
    for i in range(rows):
        here = d[i]
        left, middle, right = before[:columns], before[1 : columns + 1], before[2:]
        for j in range(columns):
            least = min(min(min(left[j], right[j]) + 7, middle[j] + 5), cap)
            here[j] = 0 if state[i, j] == 2 else least
        least = cap
        for j in range(columns):
            least = min(least + 5, here[j])
            here[j] = least
        before[1 : columns + 1] = here
    before[:] = cap
    for i in range(rows - 1, -1, -1):
        here = d[i]
        left, middle, right = before[:columns], before[1 : columns + 1], before[2:]
        for j in range(columns):
            here[j] = min(min(min(left[j], right[j]) + 7, middle[j] + 5), here[j])
        least = cap
        for j in range(columns - 1, -1, -1):
            least = min(least + 5, here[j])
            here[j] = least
        before[1 : columns + 1] = here
    return d


@njit(cache=True)
def _weigh(state, clearance, lethal, comfort, comfort_weight, unit, escape_weight, robot_i, robot_j, escape):
    """Weigh each cell by its clearance: the cost of entering it, 0 where a path must not go."""
    rows, columns = state.shape
    weight = np.zeros((rows, columns), np.int16)
    for i in range(rows):
        for j in range(columns):
            if state[i, j] != 1:
                continue
            c = clearance[i, j]
            if c >= comfort:
                weight[i, j] = unit
            elif c >= lethal:
                weight[i, j] = int(unit * (1.0 + comfort_weight * (comfort - c) / (comfort - lethal)))
            elif (i - robot_i) ** 2 + (j - robot_j) ** 2 <= escape * escape:
                weight[i, j] = escape_weight
    # Under the robot it is free by definition, whatever the map says.
    for i in range(max(robot_i - 2, 0), min(robot_i + 3, rows)):
        for j in range(max(robot_j - 2, 0), min(robot_j + 3, columns)):
            if weight[i, j] == 0:
                weight[i, j] = escape_weight
    return weight
