"""Frontiers: free cells beside unknown ones (P_boundary, Section III-C), gathered into candidates."""

import numpy as np
from numba import njit

from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import UNREACHED, PathField
from vuca_nav.types import FloatArray


def find_frontiers(
    costmap: Costmap, field: PathField, min_length: float, max_length: float
) -> tuple[FloatArray, FloatArray]:
    """Candidate exploration points.

    Connected boundary cells form a frontier; one longer than ``max_length`` gives a candidate for each piece of
    that length, so that a wide opening is not judged by its middle alone. A candidate is the reachable cell nearest
    to its piece's centre.

    Args:
        costmap: The map, coarse.
        field: Paths from the robot.
        min_length: Frontiers of fewer cells than this length holds are noise [m].
        max_length: [m]

    Returns:
        points_in_map (n, 2) [m] and path_lengths (n,) [m] from the robot.
    """
    step = costmap.resolution
    cells = _candidates(
        costmap.state,
        field.cost,
        UNREACHED,
        max(1, round(min_length / step)),
        max(1, round(max_length / step)),
    )
    points = (cells[:, ::-1].astype(np.float64) + 0.5) * step + np.array(costmap.origin)
    lengths = np.array([field.length_to_cell(int(i), int(j)) for i, j in cells])
    return points, lengths


@njit(cache=True)
def _is_boundary(state, i, j):
    """Free and beside (4 neighbours) an unknown cell."""
    if state[i, j] != 1:
        return False
    rows, columns = state.shape
    return (
        (i > 0 and state[i - 1, j] == 0)
        or (i + 1 < rows and state[i + 1, j] == 0)
        or (j > 0 and state[i, j - 1] == 0)
        or (j + 1 < columns and state[i, j + 1] == 0)
    )


@njit(cache=True)
def _candidates(state, cost, unreached, min_cells, max_cells):
    rows, columns = state.shape
    seen = np.zeros((rows, columns), np.bool_)
    stack = np.empty((rows * columns, 2), np.int32)
    piece = np.empty((rows * columns, 2), np.int32)
    result = np.empty((rows * columns // max(min_cells, 1) + 1, 2), np.int64)
    count = 0
    for i0 in range(rows):
        for j0 in range(columns):
            if seen[i0, j0] or not _is_boundary(state, i0, j0):
                continue
            # Flood the frontier; since the flood is a walk along it, runs of it are connected enough to cut it up.
            seen[i0, j0] = True
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
                        if not seen[a, b] and _is_boundary(state, a, b):
                            seen[a, b] = True
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
                best, best_k = 1e30, -1
                for k in range(first, last):
                    if cost[piece[k, 0], piece[k, 1]] != unreached:
                        d = (piece[k, 0] - mean_i) ** 2 + (piece[k, 1] - mean_j) ** 2
                        if d < best:
                            best, best_k = d, k
                if best_k >= 0:
                    result[count, 0], result[count, 1] = piece[best_k, 0], piece[best_k, 1]
                    count += 1
    return result[:count]
