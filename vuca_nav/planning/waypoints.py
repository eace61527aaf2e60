"""Sparse waypoints: the farthest point of the path that the body can reach in a straight line.

Source: Zhang et al., Section III-C.
"""

import math

from vuca_nav.kernel_cache import njit
from vuca_nav.planning.costmap import Costmap
from vuca_nav.types import FloatArray


def farthest_free_waypoint(
    costmap: Costmap, path_in_map: FloatArray, robot: tuple[float, float]
) -> tuple[float, float]:
    """The farthest point of the path with no static obstacle on the straight line to it.

    Args:
        costmap: The inflated grid.
        path_in_map: (n, 2), n >= 1, from the robot to its target [m].
        robot: Position of the robot in the map [m].

    Returns:
        The point in the map [m]. In a spot too tight for any straight line it is where the path leaves that spot.
    """
    cells = (path_in_map - costmap.origin) / costmap.resolution
    k = _farthest(
        costmap.weight,
        costmap.clearance,
        costmap.escape_weight,
        cells,
        (robot[1] - costmap.origin[1]) / costmap.resolution,
        (robot[0] - costmap.origin[0]) / costmap.resolution,
    )
    return (float(path_in_map[k, 0]), float(path_in_map[k, 1]))


@njit(cache=True)
def _farthest(weight, clearance, escape_weight, cells, robot_i, robot_j):
    """Index of the farthest point of the path that a free straight line leads to."""
    n = len(cells)
    for k in range(n - 1, 0, -1):
        if line_is_free(weight, clearance, escape_weight, robot_i, robot_j, cells[k, 1], cells[k, 0]):
            return k
    for k in range(1, n):
        i, j = int(cells[k, 1]), int(cells[k, 0])
        if weight[i, j] != escape_weight:
            return k
    return n - 1


@njit(cache=True)
def line_is_free(weight, clearance, escape_weight, i0, j0, i1, j1):
    """Whether the body can go straight from one point to another, both in fractional rows and columns.

    Cells too near an obstacle are allowed only at the beginning, and only while they lead away from it.
    """
    rows, columns = weight.shape
    n = int(2.0 * max(abs(i1 - i0), abs(j1 - j0))) + 1
    leaving = True
    before = -1
    for k in range(n + 1):
        i = int(math.floor(i0 + (i1 - i0) * k / n))
        j = int(math.floor(j0 + (j1 - j0) * k / n))
        if not (0 <= i < rows and 0 <= j < columns) or weight[i, j] == 0:
            return False
        if weight[i, j] != escape_weight:
            leaving = False
        elif not leaving or clearance[i, j] < before:
            return False
        before = clearance[i, j]
    return True
