"""The shortest way from start to goal around the static obstacles."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.clearance import clearance_field
from worlds.heap import pop, push
from worlds.widest_way import WIDTH_ERROR, widest_way
from worlds.world import TALLEST, World


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Grid of the cells that the centre of a disc must keep out of."""

    blocked: NDArray[np.bool_]
    """(rows, columns); row 0 is the lowest y, column 0 the lowest x."""
    origin: tuple[float, float]
    """Lower-left corner of cell (0, 0) in the world [m]."""
    resolution: float
    """[m]"""

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell that holds a point; a point outside gets the nearest cell."""
        rows, columns = self.blocked.shape
        row, column = (y - self.origin[1]) / self.resolution, (x - self.origin[0]) / self.resolution
        return min(max(int(row), 0), rows - 1), min(max(int(column), 0), columns - 1)

    def centre(self, row: int, column: int) -> tuple[float, float]:
        """Centre of a cell in the world [m]."""
        x = self.origin[0] + (column + 0.5) * self.resolution
        return x, self.origin[1] + (row + 0.5) * self.resolution


def occupancy(world: World, resolution: float = 0.1, inflation: float = 0.0, height: float = TALLEST) -> Occupancy:
    """Occupancy of the static obstacles and of all beyond bounds that are not open, inflated; movers are left out.

    Args:
        world: Any world.
        resolution: Side of a cell [m].
        inflation: A cell is blocked if its centre is inside a solid, or less than this away from one [m].
        height: Obstacles that hang higher than this are left out [m].
    """
    cap = max(inflation, resolution) + resolution
    field = clearance_field(world.below(height), world.bounds, resolution, cap, world.open_borders)
    return Occupancy(field.distance < max(inflation, 1e-9), field.origin, resolution)


RESOLUTIONS = (0.1, 0.05)
"""Resolutions of the grids that ways are searched on, the finer one only where the coarser has none [m]."""
STEPS = np.array(
    [(i, j) for i in range(-2, 3) for j in range(-2, 3) if abs(i) + abs(j) in (1, 3) or abs(i) == abs(j) == 1]
)
"""Steps to a cell's 16 neighbours: those of a king and of a knight in chess."""


@njit(cache=True)
def _grid_path(blocked, steps, start, goal):
    """Cells (n, 2) of the shortest way over the 16 neighbours (A*), from goal to start; empty if there is none."""
    rows, columns = blocked.shape
    best = np.full(rows * columns, np.inf)
    before = np.full(rows * columns, -1, np.int64)
    closed = np.zeros(rows * columns, np.bool_)
    heap_cost, heap_cell = np.empty(len(steps) * rows * columns), np.empty(len(steps) * rows * columns, np.int64)
    first, last = start[0] * columns + start[1], goal[0] * columns + goal[1]
    best[first] = 0.0
    size = push(heap_cost, heap_cell, 0, 0.0, first)
    while size > 0:
        cell = heap_cell[0]
        size = pop(heap_cost, heap_cell, size)
        if closed[cell]:
            continue
        closed[cell] = True
        if cell == last:
            break
        row, column = cell // columns, cell % columns
        for k in range(len(steps)):
            r, c = row + steps[k, 0], column + steps[k, 1]
            if r < 0 or c < 0 or r >= rows or c >= columns or blocked[r, c]:
                continue
            cost = best[cell] + math.sqrt(steps[k, 0] ** 2 + steps[k, 1] ** 2)
            if cost < best[r * columns + c] - 1e-12:
                best[r * columns + c], before[r * columns + c] = cost, cell
                ahead = math.sqrt((r - goal[0]) ** 2 + (c - goal[1]) ** 2)
                size = push(heap_cost, heap_cell, size, cost + ahead, r * columns + c)
    if not closed[last]:
        return np.empty((0, 2), np.int64)
    count, cell = 1, last
    while cell != first:
        cell, count = before[cell], count + 1
    path = np.empty((count, 2), np.int64)
    cell = last
    for k in range(count):
        path[k, 0], path[k, 1] = cell // columns, cell % columns
        cell = before[cell]
    return path


@njit(cache=True)
def _line_is_free(blocked, r0, c0, r1, c1):
    """Whether the straight line between two cells' centres stays in free cells, in steps of a third of a cell."""
    count = int(3.0 * max(abs(r1 - r0), abs(c1 - c0))) + 1
    for k in range(count + 1):
        share = k / count
        if blocked[int(r0 + share * (r1 - r0) + 0.5), int(c0 + share * (c1 - c0) + 0.5)]:
            return False
    return True


@njit(cache=True)
def _pull_tight(blocked, path):
    """Indices of the path's cells that remain when every corner that can be cut is cut, seen from its start."""
    kept = np.empty(len(path), np.int64)
    kept[0] = 0
    count, at = 1, 0
    while at < len(path) - 1:
        reach = at + 1
        # The farthest cell in sight may lie behind hidden ones; beyond 2 m of hidden path none is looked for.
        hidden = 0
        for k in range(at + 2, len(path)):
            if _line_is_free(blocked, path[at, 0], path[at, 1], path[k, 0], path[k, 1]):
                reach, hidden = k, 0
            else:
                hidden += 1
                if hidden > 20:
                    break
        kept[count] = at = reach
        count += 1
    return kept[:count]


def shortest_path(world: World, radius: float, height: float = TALLEST, tolerance: float = 0.0) -> FloatArray:
    """The shortest way of a disc from start to goal around the static obstacles, (n, 2) [m]; empty if there is none.

    A* over 16 neighbours, pulled tight by lines of sight: an any-angle path, within about 1% of the true shortest.
    It also defines "can be reached": by a way as wide as the disc, within 0.01 m, wherever the grid's cells lie.

    Args:
        world: Any world.
        radius: Radius of the disc [m]. Where it does not fit at the start, the way begins at the nearest place within
            the radius where it does: the body may stand beside a wall.
        height: Height of the body [m]; obstacles that hang above it are not in its way.
        tolerance: Where the disc does not fit at the goal, the way ends at the nearest place within this that it gets
            to [m].
    """
    for resolution in RESOLUTIONS:
        path = _path_on_grid(world, occupancy(world, resolution, radius, height), radius, tolerance)
        if len(path):
            return path
    # A way just wide enough may lie between the centres of the cells; they are at most half a diagonal from it.
    neck = widest_way(world, radius, tolerance, height)
    if neck is not None and neck.width > 2.0 * radius - WIDTH_ERROR:
        finest = RESOLUTIONS[-1]
        grid = occupancy(world, finest, radius - 0.5 * (WIDTH_ERROR + math.sqrt(2.0) * finest), height)
        path = _path_on_grid(world, grid, radius, tolerance)
    return path


def shortest_path_length(world: World, radius: float, height: float = TALLEST, tolerance: float = 0.0) -> float:
    """Length of :func:`shortest_path` [m]; ``inf`` if there is none."""
    points = shortest_path(world, radius, height, tolerance)
    return float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) else math.inf


def _path_on_grid(world: World, grid: Occupancy, radius: float, tolerance: float) -> FloatArray:
    found = ndimage.label(~grid.blocked, np.ones((3, 3)))
    free: NDArray[np.int32] = found[0]  # type: ignore[index]
    start = _free_cell(grid, world.start[:2], ~grid.blocked, radius)
    if start is None:
        return np.empty((0, 2))
    goal = _free_cell(grid, world.goal, free == free[start], tolerance)
    if goal is None:
        return np.empty((0, 2))
    cells = _grid_path(grid.blocked, STEPS, start, goal)
    if len(cells) == 0:
        return np.empty((0, 2))
    cells = cells[::-1]
    cells = cells[_pull_tight(grid.blocked, np.ascontiguousarray(cells))]
    points: FloatArray = np.empty((max(len(cells), 2), 2))
    points[: len(cells)] = (cells[:, ::-1] + 0.5) * grid.resolution + grid.origin
    points[0] = world.start[:2]
    if goal == grid.cell(*world.goal) or len(cells) < 2:
        points[-1] = world.goal
    return points


def _free_cell(
    grid: Occupancy, point: tuple[float, float], free: NDArray[np.bool_], reach: float
) -> tuple[int, int] | None:
    """The free cell nearest to a point: its own, else one beside it or within reach."""
    own = grid.cell(*point)
    if free[own]:
        return own
    rows, columns = free.shape
    cells = max(1, math.ceil(reach / grid.resolution))
    around = [
        (row, column)
        for row in range(max(own[0] - cells, 0), min(own[0] + cells + 1, rows))
        for column in range(max(own[1] - cells, 0), min(own[1] + cells + 1, columns))
        if free[row, column]
        and (max(abs(row - own[0]), abs(column - own[1])) == 1 or math.dist(grid.centre(row, column), point) <= reach)
    ]
    return min(around, key=lambda cell: math.dist(grid.centre(*cell), point), default=None)
