"""A task for a map that comes without one: the longest of the shortest ways between two free places."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

ROOM = (0.45, 0.35)
"""Free distance about start and goal, and along the way, the widest that the map has [m]: TIAGo's circle has 0.28 m,
Go2's 0.41 m."""
CELL = 0.2
"""Side of the cells that ways are searched on [m]."""
LEAST = 2.0
"""Least length of the way [m]."""


def longest_way(solid: NDArray[np.bool_], resolution: float) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Row and column of two free cells that are as far apart as can be, by the way between them.

    The same for every robot: found by two searches, each to the farthest place, which is exact but for loops.

    Args:
        solid: Solid cells (rows, columns); all beyond them is solid.
        resolution: Side of a cell [m].
    """
    free_rows, free_columns = np.flatnonzero(~solid.all(axis=1)), np.flatnonzero(~solid.all(axis=0))
    if not len(free_rows):
        return None
    # Maps are often much larger than what is known of them.
    top, left = int(free_rows[0]), int(free_columns[0])
    solid = solid[top : int(free_rows[-1]) + 1, left : int(free_columns[-1]) + 1]
    space = ndimage.distance_transform_edt(~np.pad(solid, 1, constant_values=True))[1:-1, 1:-1] * resolution  # type: ignore[index]
    step = max(1, round(CELL / resolution))
    rows = np.arange(step // 2, solid.shape[0], step)
    columns = np.arange(step // 2, solid.shape[1], step)
    space = space[np.ix_(rows, columns)]
    for room in ROOM:
        free = space > room
        labels, count = ndimage.label(free)  # type: ignore[misc]
        if not count:
            continue
        largest = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
        cells: NDArray[np.int64] = np.argwhere(largest)
        graph = _graph(largest)
        ends, length = [0], 0.0
        for _ in range(2):
            ways = csgraph.dijkstra(graph, indices=ends[-1])
            ends.append(int(np.argmax(ways)))
            length = float(ways[ends[-1]]) * step * resolution
        if length >= LEAST:
            (a, b), (c, d) = cells[ends[1]].tolist(), cells[ends[2]].tolist()
            return (top + int(rows[a]), left + int(columns[b])), (top + int(rows[c]), left + int(columns[d]))
    return None


def _graph(free: NDArray[np.bool_]) -> sparse.csr_array:
    """Steps between the free cells, to their eight neighbours."""
    index: NDArray[np.int64] = np.full(free.shape, -1, np.int64)
    index[free] = np.arange(free.sum())
    rows, columns = free.shape
    edges = []
    for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = index[: rows - di, max(-dj, 0) : columns - max(dj, 0)]
        b = index[di:, max(dj, 0) : columns + min(dj, 0)]
        joined = (a >= 0) & (b >= 0)
        edges.append((a[joined], b[joined], np.full(int(joined.sum()), math.hypot(di, dj))))
    a, b, length = (np.concatenate(each) for each in zip(*edges))
    n = int(free.sum())
    half = sparse.coo_array((length, (a, b)), shape=(n, n))
    return sparse.csr_array(half + half.T)
