"""Shortest paths from the robot to everywhere: one Dijkstra field answers the explorer and the planner."""

import math

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.planning.cells import HEADINGS
from vuca_nav.planning.costmap import Costmap
from vuca_nav.types import FloatArray

UNREACHED = np.int32(2**31 - 1)
EASY_ROOM = 0.15
"""Room beyond that of a turn on the spot which makes a place easy to stand on [m]."""
ROOM_WEIGHT = 4.0
"""Weight of the square of the room that a place lacks, beside that of its distance."""
CELL_NOISE = 5
"""Loss of clearance, in the costmap's unit, that says nothing: a cell of the map."""

# Eight neighbours, straight ones first; the length of a step in fifths of a cell (5-7 chamfer).
_DI = np.array([0, 0, 1, -1, 1, 1, -1, -1], np.int64)
_DJ = np.array([1, -1, 0, 0, 1, -1, 1, -1], np.int64)
_LENGTH = np.array([5, 5, 5, 5, 7, 7, 7, 7], np.int64)


def _headings_along(di: NDArray[np.int64], dj: NDArray[np.int64]) -> NDArray[np.int64]:
    """Bits of the headings of the body along each step: the step's own and its two neighbours, 22.5 degrees to it."""
    own = np.round(np.arctan2(di, dj) / (2.0 * np.pi / HEADINGS)).astype(np.int64)
    return np.bitwise_or.reduce([1 << ((own + off) % HEADINGS) for off in (-1, 0, 1)])


_ALONG = _headings_along(_DI, _DJ)


def cheapest_paths(
    grids: tuple[NDArray[np.int16], NDArray[np.uint16], NDArray[np.int16]], start: tuple[int, int], escape: int = 0
) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Find the cheapest paths from a cell to all others, in steps to the eight neighbours.

    Args:
        grids: The cost of entering each cell, 0 where a path must not go; the bits of the headings in which the body
            fits into it; and its clearance. Each of (rows, columns).
        start: Row and column.
        escape: Cost of the cells that a path may use only to leave them; 0 if there are none.

    Returns:
        (rows, columns) costs, 5 times the weight of a cell for a straight step and 7 times for a diagonal one,
        ``UNREACHED`` where no path leads; and the step by which each cell was reached, -1 where there is none.
    """
    return _dijkstra(grids, start, (_DI, _DJ, _LENGTH, _ALONG), escape)


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
            grids = costmap.weight, costmap.headings, costmap.clearance
            escape = costmap.escape_weight if costmap.leaves_only else 0
            self.cost, self._came_by = cheapest_paths(grids, (i, j), escape)
        else:
            self.cost: NDArray[np.int32] = np.full(costmap.weight.shape, UNREACHED, np.int32)
            self._came_by = np.full(costmap.weight.shape, -1, np.int8)

    def reaches(self, x: float, y: float) -> bool:
        """Whether a path leads to this point of the map."""
        i, j = self.costmap.cell(x, y)
        return self.costmap.contains(i, j) and bool(self.cost[i, j] != UNREACHED)

    def standing_place(self, x: float, y: float, reach: float) -> tuple[float, float] | None:
        """The place to stand for a point: the point itself if it is reached and has room, else the best within reach.

        The best one is neither far from the point nor without the ``EASY_ROOM`` that the body has to turn about in: it
        has the least sum of squares of what either is off. None if no path leads to any place within reach.

        Args:
            x: Of the point in the map [m].
            y: Of the point in the map [m].
            reach: Greatest distance of the place [m].
        """
        costmap = self.costmap
        easy = costmap.turning * costmap.unit + EASY_ROOM
        middle = costmap.cell(x, y)
        best: tuple[float, tuple[float, float] | None] = math.inf, None
        cells = math.ceil(reach / costmap.resolution)
        for i in range(max(middle[0] - cells, 0), min(middle[0] + cells + 1, costmap.state.shape[0])):
            for j in range(max(middle[1] - cells, 0), min(middle[1] + cells + 1, costmap.state.shape[1])):
                if self.cost[i, j] == UNREACHED:
                    continue
                places = costmap.parts_of(i, j)
                if (i, j) == middle:
                    places.append(((x, y), costmap.clearance_about(x, y)))
                for place, clearance in places:
                    away = math.dist(place, (x, y))
                    if away <= reach:
                        best = min(best, (away**2 + ROOM_WEIGHT * max(easy - clearance, 0.0) ** 2, place))
        return best[1]

    def path_to(self, x: float, y: float) -> FloatArray:
        """The cheapest path from the start to the point itself, (n, 2) [m]; (0, 2) if there is none."""
        if not self.reaches(x, y):
            return np.empty((0, 2))
        i, j = self.costmap.cell(x, y)
        cells = _trace(self._came_by, i, j, _DI, _DJ)
        points = (cells[::-1, ::-1].astype(np.float64) + 0.5) * self.costmap.resolution + np.array(self.costmap.origin)
        if len(points) == 1:
            return np.array([self.start, (x, y)])
        self.costmap.refine(points)
        points[0], points[-1] = self.start, (x, y)
        return points

    def on_the_way(self, points_in_map: FloatArray, length: float) -> FloatArray:
        """Find the points at a given length along the cheapest paths.

        Args:
            points_in_map: (n, 2) points that are reached [m].
            length: Length along the paths [m].

        Returns:
            (n, 2) the point of each path at that length, or its end if it is shorter [m].
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
def _dijkstra(grids, start, steps_of, escape):
    """Find all cheapest paths by Dial's algorithm: integer costs, a ring of buckets, each a linked list of entries.

    A step leads on where the body fits into both cells along one heading that is the step's own, nearly. Cells of the
    weight ``escape`` are entered from such cells alone, and not to get nearer to an obstacle.

    Returns:
        (rows, columns) int32 costs, and (rows, columns) int8 index of the step by which each cell was reached, -1 where
        there is none. Of equally cheap paths the one found first stays.
    """
    weight, headings, clearance = grids
    (start_i, start_j), (di, dj, length, along) = start, steps_of
    rows, columns = weight.shape
    # A border that no path enters saves asking for the array's ends; cells are numbered row by row.
    width = columns + 2
    size = (rows + 2) * width
    weights = np.zeros(size, np.int32)
    fits = np.zeros(size, np.uint16)
    clear = np.zeros(size, np.int16)
    max_weight = 1
    for i in range(rows):
        row = (i + 1) * width + 1
        for j in range(columns):
            w = weight[i, j]
            weights[row + j] = w
            fits[row + j] = headings[i, j]
            clear[row + j] = clearance[i, j]
            max_weight = max(max_weight, w)
    offsets, turns, aside = np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8, np.int64)
    for k in range(8):
        offsets[k] = di[k] * width + dj[k]
        turns[k], aside[k] = di[k] * width, dj[k]
    costs = np.full(size, 2**31 - 1, np.int32)
    steps = np.full(size, -1, np.int8)
    num_buckets = 7 * max_weight + 1
    head = np.full(num_buckets, -1, np.int32)
    entry_cell = np.empty(4 * rows * columns + 8, np.int32)
    entry_next = np.empty(4 * rows * columns + 8, np.int32)
    free_entry = -1  # entries that were taken out are used again
    first = (start_i + 1) * width + start_j + 1
    costs[first] = 0
    entry_cell[0], entry_next[0] = first, -1
    head[0] = 0
    used = 1
    waiting = 1
    current = bucket = 0
    while waiting > 0:
        while head[bucket] != -1:
            entry = head[bucket]
            head[bucket] = entry_next[entry]
            cell = entry_cell[entry]
            entry_next[entry] = free_entry
            free_entry = entry
            waiting -= 1
            if costs[cell] != current:
                continue  # was reached more cheaply meanwhile
            for k in range(8):
                other = cell + offsets[k]
                w = weights[other]
                if w == 0:
                    continue
                new = current + length[k] * w
                if new >= costs[other]:
                    continue
                if fits[cell] & fits[other] & along[k] == 0:
                    continue
                if w == escape and (weights[cell] != escape or clear[other] < clear[cell] - CELL_NOISE):
                    continue
                if k >= 4 and (weights[cell + aside[k]] == 0 or weights[cell + turns[k]] == 0):
                    continue  # no cutting of corners
                costs[other] = new
                steps[other] = k
                if free_entry != -1:
                    entry = free_entry
                    free_entry = entry_next[entry]
                else:
                    entry = used
                    used += 1
                ahead = bucket + new - current
                if ahead >= num_buckets:
                    ahead -= num_buckets
                entry_cell[entry] = other
                entry_next[entry] = head[ahead]
                head[ahead] = entry
                waiting += 1
        current += 1
        bucket += 1
        if bucket == num_buckets:
            bucket = 0
    cost = np.empty((rows, columns), np.int32)
    came_by = np.empty((rows, columns), np.int8)
    for i in range(rows):
        row = (i + 1) * width + 1
        cost[i] = costs[row : row + columns]
        came_by[i] = steps[row : row + columns]
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
    """Cells on the paths to cells, at most ``most`` fifths of a cell from the start, (n, 2)."""
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
    """Length of the path to a cell, in fifths of a cell."""
    total = 0
    while came_by[i, j] >= 0:
        k = came_by[i, j]
        i, j = i - di[k], j - dj[k]
        total += length[k]
    return total
