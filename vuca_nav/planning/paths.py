"""Shortest paths from the robot to everywhere: one Dijkstra field answers the explorer and the planner."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.planning.costmap import Costmap
from vuca_nav.types import FloatArray

UNREACHED = np.int32(2**31 - 1)

# Eight neighbours, straight ones first; the length of a step in fifths of a cell (5-7 chamfer).
_DI = np.array([0, 0, 1, -1, 1, 1, -1, -1], np.int64)
_DJ = np.array([1, -1, 0, 0, 1, -1, 1, -1], np.int64)
_LENGTH = np.array([5, 5, 5, 5, 7, 7, 7, 7], np.int64)


class PathField:
    """All cheapest paths from one point of a costmap.

    Attributes:
        cost: (rows, columns) int32 cost from the start; UNREACHED where no path leads.
    """

    def __init__(self, costmap: Costmap, start: tuple[float, float]):
        self.costmap = costmap
        self.start = start
        i, j = costmap.cell(*start)
        if costmap.contains(i, j):
            self.cost, self._came_by = _dijkstra(costmap.weight, i, j, _DI, _DJ, _LENGTH)
        else:
            self.cost: NDArray[np.int32] = np.full(costmap.weight.shape, UNREACHED, np.int32)
            self._came_by = np.full(costmap.weight.shape, -1, np.int8)

    def reaches(self, x: float, y: float) -> bool:
        """Whether a path leads to this point of the map."""
        i, j = self.costmap.cell(x, y)
        return self.costmap.contains(i, j) and bool(self.cost[i, j] != UNREACHED)

    def path_to(self, x: float, y: float) -> FloatArray:
        """The cheapest path, (n, 2) [m] from the start to the point itself; (0, 2) if there is none."""
        if not self.reaches(x, y):
            return np.empty((0, 2))
        i, j = self.costmap.cell(x, y)
        cells = _trace(self._came_by, i, j, _DI, _DJ)
        points = (cells[::-1, ::-1].astype(np.float64) + 0.5) * self.costmap.resolution + np.array(self.costmap.origin)
        if len(points) == 1:
            return np.array([self.start, (x, y)])
        points[0], points[-1] = self.start, (x, y)
        return points

    def on_the_way(self, points_in_map: FloatArray, length: float) -> FloatArray:
        """Where the cheapest paths to points lead first.

        Args:
            points_in_map: (n, 2) that are reached [m].
            length: [m]

        Returns:
            (n, 2) the points so far along the paths; of a shorter path its end [m].
        """
        cells = np.array([self.costmap.cell(x, y) for x, y in points_in_map], np.int64).reshape(-1, 2)
        steps = 5.0 * length / self.costmap.resolution
        found = _cells_on_the_way(self._came_by, cells, steps, _DI, _DJ, _LENGTH)
        points = (found[:, ::-1] + 0.5) * self.costmap.resolution + np.array(self.costmap.origin)
        return np.where((found == cells).all(axis=1)[:, None], points_in_map, points)

    def length_to_cell(self, i: int, j: int) -> float:
        """Length of the cheapest path to a cell that is reached [m]."""
        return _trace_length(self._came_by, i, j, _DI, _DJ, _LENGTH) * self.costmap.resolution / 5.0


@njit(cache=True)
def _dijkstra(weight, start_i, start_j, di, dj, length):
    """Dial's algorithm: integer costs, a ring of buckets, each a linked list of entries."""
    rows, columns = weight.shape
    cost = np.full((rows, columns), 2**31 - 1, np.int32)
    came_by = np.full((rows, columns), -1, np.int8)
    max_weight = 1
    for i in range(rows):
        for j in range(columns):
            max_weight = max(max_weight, weight[i, j])
    num_buckets = 7 * max_weight + 1
    head = np.full(num_buckets, -1, np.int32)
    entry_cell = np.empty(4 * rows * columns + 8, np.int32)
    entry_next = np.empty(4 * rows * columns + 8, np.int32)
    free_entry = -1  # entries that were taken out are used again
    used = 0
    cost[start_i, start_j] = 0
    entry_cell[0], entry_next[0] = start_i * columns + start_j, -1
    head[0] = 0
    used = 1
    waiting = 1
    current = 0
    while waiting > 0:
        bucket = current % num_buckets
        while head[bucket] != -1:
            entry = head[bucket]
            head[bucket] = entry_next[entry]
            cell = entry_cell[entry]
            entry_next[entry] = free_entry
            free_entry = entry
            waiting -= 1
            i, j = cell // columns, cell % columns
            if cost[i, j] != current:
                continue  # was reached more cheaply meanwhile
            for k in range(8):
                a, b = i + di[k], j + dj[k]
                if a < 0 or b < 0 or a >= rows or b >= columns or weight[a, b] == 0:
                    continue
                if k >= 4 and (weight[i, b] == 0 or weight[a, j] == 0):
                    continue  # no cutting of corners
                new = current + length[k] * weight[a, b]
                if new < cost[a, b]:
                    cost[a, b] = new
                    came_by[a, b] = k
                    if free_entry != -1:
                        entry = free_entry
                        free_entry = entry_next[entry]
                    else:
                        entry = used
                        used += 1
                    entry_cell[entry] = a * columns + b
                    entry_next[entry] = head[new % num_buckets]
                    head[new % num_buckets] = entry
                    waiting += 1
        current += 1
    return cost, came_by


@njit(cache=True)
def _trace(came_by, i, j, di, dj):
    """Cells from (i, j) back to the start, (n, 2) rows and columns."""
    n = 1
    a, b = i, j
    while came_by[a, b] >= 0:
        k = came_by[a, b]
        a, b = a - di[k], b - dj[k]
        n += 1
    cells = np.empty((n, 2), np.int64)
    for m in range(n):
        cells[m, 0], cells[m, 1] = i, j
        k = came_by[i, j]
        if k >= 0:
            i, j = i - di[k], j - dj[k]
    return cells


@njit(cache=True)
def _cells_on_the_way(came_by, cells, most, di, dj, length):
    """The cells at most so many fifths of a cell from the start, on the paths to cells, (n, 2)."""
    found = cells.copy()
    for n in range(len(cells)):
        i, j = cells[n]
        left = _trace_length(came_by, i, j, di, dj, length)
        while left > most:
            k = came_by[i, j]
            i, j = i - di[k], j - dj[k]
            left -= length[k]
        found[n, 0], found[n, 1] = i, j
    return found


@njit(cache=True)
def _trace_length(came_by, i, j, di, dj, length):
    total = 0
    while came_by[i, j] >= 0:
        k = came_by[i, j]
        i, j = i - di[k], j - dj[k]
        total += length[k]
    return total
