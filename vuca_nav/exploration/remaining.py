"""Length of the way from the edge of the known to the goal, around what is known to stand there."""

import math

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.planning.cells import ALL_HEADINGS, FREE, OCCUPIED, UNKNOWN, chamfer
from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import UNREACHED, cheapest_paths
from vuca_nav.types import FloatArray

COARSE = 2
"""Number of the costmap's cells to a cell here, each way: 0.2 m, for a quarter of the time."""
AROUND = 4.0
"""Width of the unknown that is added around the known and the goal, for ways that lead around the known [m]."""
LEAVING = 0.6
"""Distance from the goal within which a way may be narrower than the body [m]: a place nearby may stand for a goal on
which the body has no room."""
BESIDE = 3.0
"""Distance from what is known to stand within which the unknown is likely barred too [m]: a wall that has been seen
goes on beyond its last return, and what has one side seen has a depth."""
UNIT = 8
"""Weight of a free cell."""


class RemainingWay:
    """Lengths of the shortest ways to the goal through what is free or unknown.

    Args:
        costmap: The inflated grid.
        goal: Goal in the map [m].
        unknown: Length that a metre of the unknown counts for within ``BESIDE`` of an obstacle, where it is likely to
            be barred. Farther off a metre is a metre.
    """

    def __init__(self, costmap: Costmap, goal: tuple[float, float], unknown: float):
        fine, rows, columns = costmap.resolution, *costmap.state.shape
        step = self._step = fine * COARSE
        (x, y), (goal_x, goal_y) = costmap.origin, goal
        left, below = (math.ceil((max(low - end, 0.0) + AROUND) / step) for low, end in ((x, goal_x), (y, goal_y)))
        self._origin = x - left * step, y - below * step
        width = max(x + columns * fine, goal_x) + AROUND - self._origin[0]
        height = max(y + rows * fine, goal_y) + AROUND - self._origin[1]
        shape = math.ceil(height / step), math.ceil(width / step)
        i, j = self._cell(goal_x, goal_y)
        state = np.zeros(shape, np.int8)
        known = state[below:, left:]
        _coarsen(
            costmap.state,
            costmap.clearance,
            costmap.radius / costmap.unit,
            (i - below, j - left, LEAVING / step),
            known,
        )
        beside = chamfer(state, math.ceil(5.0 * BESIDE / step) + 1) <= 5.0 * BESIDE / step
        weight = np.full(shape, UNIT, np.int16)
        weight[(state == UNKNOWN) & beside] = round(UNIT * unknown)
        weight[state == OCCUPIED] = 0
        grids = weight, np.full(shape, ALL_HEADINGS, np.uint16), np.zeros(shape, np.int16)
        self._cost, _ = cheapest_paths(grids, (i, j))

    def lengths(self, points_in_map: FloatArray) -> FloatArray:
        """Length of the way from each point to the goal, (n,) [m]; ``inf`` where none is possible.

        Args:
            points_in_map: (n, 2) points of the costmap [m].
        """
        cells = np.array([self._cell(x, y) for x, y in points_in_map], np.int64).reshape(-1, 2)
        cost = self._cost[cells[:, 0], cells[:, 1]]
        return np.where(cost == UNREACHED, np.inf, cost * (self._step / (5.0 * UNIT)))

    def _cell(self, x: float, y: float) -> tuple[int, int]:
        return math.floor((y - self._origin[1]) / self._step), math.floor((x - self._origin[0]) / self._step)


@njit(cache=True)
def _coarsen(state, clearance, least, goal, coarse):
    """Coarsen the states: a cell is occupied where the body has no room, free if it has room in one that is known."""
    rows, columns = state.shape
    goal_i, goal_j, leaving = goal
    for i in range((rows + COARSE - 1) // COARSE):
        for j in range((columns + COARSE - 1) // COARSE):
            enough = 1 if (i - goal_i) ** 2 + (j - goal_j) ** 2 <= leaving * leaving else least
            coarse[i, j] = OCCUPIED
            for a in range(COARSE * i, min(COARSE * (i + 1), rows)):
                for b in range(COARSE * j, min(COARSE * (j + 1), columns)):
                    if clearance[a, b] < enough or coarse[i, j] == FREE:
                        continue
                    coarse[i, j] = UNKNOWN if state[a, b] == UNKNOWN else FREE
