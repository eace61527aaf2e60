"""Frontiers: free cells beside unknown ones (P_boundary; Zhang et al., Section III-C), gathered into candidates."""

from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import UNREACHED, PathField
from vuca_nav.types import FloatArray


class Frontiers(NamedTuple):
    """Candidate exploration points; n is their number."""

    points_in_map: FloatArray
    """(n, 2) the boundary cell nearest to the middle of each piece of frontier [m]."""
    approach_in_map: FloatArray
    """(n, 2) point near each at which the body can stand [m]."""
    path_lengths: FloatArray
    """(n,) length of the path from the robot to the approach [m]."""


APPROACH = 0.6
"""Distance from which a frontier counts as reachable [m]: beside a wall seen at a grazing angle the boundary
itself is at times too near to the wall to drive to, and a choice that comes and goes makes the robot turn back and
forth."""


def find_frontiers(
    costmap: Costmap, field: PathField, min_length: float, max_length: float, clearance: float
) -> Frontiers:
    """Find the candidate exploration points.

    Boundary cells too near to an occupied cell do not count: the body would not fit through, and a wall seen at a
    grazing angle is a dotted line with just such gaps. Connected ones form a frontier; one longer than ``max_length``
    gives a candidate for each piece of that length, so that a wide opening is not judged by its middle alone.

    Args:
        costmap: The inflated grid.
        field: Paths from the robot.
        min_length: Frontiers of fewer cells than this length holds are noise [m].
        max_length: Longest piece that one candidate stands for [m].
        clearance: Clearance that a boundary cell must have, as a rule the costmap's ``radius`` [m].

    Returns:
        The candidates that the body can come near to.
    """
    step = costmap.resolution
    cells = _candidates(
        costmap.state,
        costmap.clearance,
        clearance / costmap.unit,
        field.cost,
        UNREACHED,
        max(1, round(min_length / step)),
        max(1, round(max_length / step)),
        round(APPROACH / step),
    )
    points = (cells[:, [1, 0, 3, 2]].astype(np.float64) + 0.5) * step + np.tile(costmap.origin, 2)
    lengths = np.array([field.length_to_cell(int(i), int(j)) for i, j in cells[:, :2]])
    return Frontiers(points[:, 2:], points[:, :2], lengths)


@njit(cache=True)
def _boundary(state, clearance, least):
    """Mask of the free cells beside (4 neighbours) an unknown one that are not too near to an occupied one."""
    rows, columns = state.shape
    boundary = np.zeros((rows, columns), np.bool_)
    for i in range(rows):
        for j in range(columns):
            if state[i, j] != 1 or clearance[i, j] < least:
                continue
            boundary[i, j] = (
                (i > 0 and state[i - 1, j] == 0)
                or (i + 1 < rows and state[i + 1, j] == 0)
                or (j > 0 and state[i, j - 1] == 0)
                or (j + 1 < columns and state[i, j + 1] == 0)
            )
    return boundary


@njit(cache=True)
def _candidates(state, clearance, least, cost, unreached, min_cells, max_cells, reach):
    """Find the candidates, (n, 4): row and column of the approach, then of the boundary cell."""
    rows, columns = state.shape
    waiting = _boundary(state, clearance, least)
    stack = np.empty((rows * columns, 2), np.int32)
    piece = np.empty((rows * columns, 2), np.int32)
    result = np.empty((rows * columns // max(min_cells, 1) + 1, 4), np.int64)
    count = 0
    for i0 in range(rows):
        for j0 in range(columns):
            if not waiting[i0, j0]:
                continue
            # Flood the frontier; since the flood is a walk along it, runs of it are connected enough to cut it up.
            waiting[i0, j0] = False
            stack[0, 0], stack[0, 1] = i0, j0
            top = 1
            size = 0
            while top > 0:
                top -= 1
                i, j = stack[top, 0], stack[top, 1]
                piece[size, 0], piece[size, 1] = i, j
                size += 1
                for a in range(max(i - 1, 0), min(i + 2, rows)):
                    for b in range(max(j - 1, 0), min(j + 2, columns)):
                        if waiting[a, b]:
                            waiting[a, b] = False
                            stack[top, 0], stack[top, 1] = a, b
                            top += 1
            if size < min_cells:
                continue
            pieces = (size + max_cells - 1) // max_cells
            for p in range(pieces):
                first, last = p * size // pieces, (p + 1) * size // pieces
                mean_i = mean_j = 0.0
                for k in range(first, last):
                    mean_i += piece[k, 0]
                    mean_j += piece[k, 1]
                mean_i /= last - first
                mean_j /= last - first
                best, middle = 1e30, first
                for k in range(first, last):
                    d = (piece[k, 0] - mean_i) ** 2 + (piece[k, 1] - mean_j) ** 2
                    if d < best:
                        best, middle = d, k
                i, j = piece[middle, 0], piece[middle, 1]
                best, best_a, best_b = 1e30, -1, -1
                for a in range(max(i - reach, 0), min(i + reach + 1, rows)):
                    for b in range(max(j - reach, 0), min(j + reach + 1, columns)):
                        d = (a - i) ** 2 + (b - j) ** 2
                        if cost[a, b] != unreached and d < best and d <= reach * reach:
                            best, best_a, best_b = d, a, b
                if best_a >= 0:
                    result[count, 0], result[count, 1] = best_a, best_b
                    result[count, 2], result[count, 3] = i, j
                    count += 1
    return result[:count]
