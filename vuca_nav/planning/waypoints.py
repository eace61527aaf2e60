"""Sparse waypoints: the farthest point of the path that the body can reach in a straight line.

Source: Zhang et al., Section III-C.
"""

import math

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.planning.cells import HEADINGS
from vuca_nav.planning.costmap import Costmap
from vuca_nav.types import FloatArray

NEAREST = 0.4
"""Least length of path to a waypoint [m]: one nearer says nothing about where to go."""
TIGHTER = 0.03
"""Clearance by which the straight line to a waypoint may be tighter than the path, where the path is tight [m]: half a
cell. So the body enters a narrow way from its middle."""


def farthest_free_waypoint(
    costmap: Costmap, path_in_map: FloatArray, robot: tuple[float, float], nearest: float = NEAREST
) -> tuple[float, float]:
    """The farthest point of the path with no static obstacle on the straight line to it.

    Args:
        costmap: The inflated grid.
        path_in_map: (n, 2), n >= 1, from the robot to its target [m].
        robot: Position of the robot in the map [m].
        nearest: Least length of path to the waypoint, where the path is as long [m].

    Returns:
        The point in the map [m]. In a spot too tight for any straight line it is the first point of the path that is so
        far ahead and out of that spot.
    """
    cells = (path_in_map - costmap.origin) / costmap.resolution
    k = _farthest(
        (costmap.weight, costmap.headings, costmap.clearance),
        (costmap.escape_weight, costmap.turning, TIGHTER / costmap.unit),
        cells,
        (robot[1] - costmap.origin[1]) / costmap.resolution,
        (robot[0] - costmap.origin[0]) / costmap.resolution,
        nearest / costmap.resolution,
    )
    return (float(path_in_map[k, 0]), float(path_in_map[k, 1]))


@njit(cache=True)
def _farthest(grids, limits, cells, robot_i, robot_j, nearest):
    """Index of the farthest point of the path that a free straight line leads to."""
    weight, _, clearance = grids
    escape_weight, turning, tighter = limits
    n = len(cells)
    # Least clearance of the path up to each of its points, once it has left the robot's tight spot.
    least = np.full(n, turning)
    first, ahead = n - 1, n - 1
    way = 0.0
    for k in range(1, n):
        i, j = int(cells[k, 1]), int(cells[k, 0])
        here = float(clearance[i, j]) if weight[i, j] != escape_weight else turning
        least[k] = min(least[k - 1], here)
        way += math.hypot(cells[k, 0] - cells[k - 1, 0], cells[k, 1] - cells[k - 1, 1])
        if way >= nearest:
            first = min(first, k)
            if weight[i, j] != escape_weight:
                ahead = min(ahead, k)
    for k in range(n - 1, first - 1, -1):
        if _line_clearance(grids, escape_weight, robot_i, robot_j, cells[k, 1], cells[k, 0]) >= least[k] - tighter:
            return k
    return ahead


@njit(cache=True)
def _line_clearance(grids, escape_weight, i0, j0, i1, j1):
    """Least clearance of the straight line from one point to another, both in fractional rows and columns.

    Cells too near an obstacle are allowed only at the beginning, and only while they lead away from it; they do not
    count.

    Returns:
        The clearance in the costmap's unit; -inf where the body, facing along the line, cannot go.
    """
    weight, headings, clearance = grids
    rows, columns = weight.shape
    n = int(2.0 * max(abs(i1 - i0), abs(j1 - j0))) + 1
    heading = int(round(math.atan2(i1 - i0, j1 - j0) / (2.0 * math.pi / HEADINGS)))
    along = 0
    for off in range(-1, 2):
        along |= 1 << ((heading + off) % HEADINGS)
    leaving = True
    before = -1
    least = np.inf
    for k in range(n + 1):
        i = int(math.floor(i0 + (i1 - i0) * k / n))
        j = int(math.floor(j0 + (j1 - j0) * k / n))
        if not (0 <= i < rows and 0 <= j < columns) or weight[i, j] == 0 or headings[i, j] & along == 0:
            return -np.inf
        if weight[i, j] != escape_weight:
            leaving = False
            least = min(least, float(clearance[i, j]))
        elif not leaving or clearance[i, j] < before:
            return -np.inf
        before = clearance[i, j]
    return least
