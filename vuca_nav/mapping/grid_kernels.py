"""The insertion of a scan into an occupancy grid: returns raise their cells, beams lower those on their way."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit

_TILE = 3
"""A tile is a square of 2^3 cells each way. Most tiles on a beam's way are wholly free, and the beam skips them."""


class GridCells(NamedTuple):
    """Arrays of an occupancy grid for the kernels, valid until the grid grows."""

    level: np.ndarray
    """(rows, columns) int8, see ``OccupancyGrid``."""
    last_update: np.ndarray
    """(rows, columns) int32, number of the last scan that hit or changed the cell; 0 for none."""
    unsettled: np.ndarray
    """(tile rows, tile columns) int32, cells of each tile that a passing beam could still lower."""
    entropy_of_level: np.ndarray
    """(256,) entropy of a cell, indexed by level + 128 [nat]."""
    entropy_change: np.ndarray
    """(1,) entropy of all cells less that of an unseen map [nat]."""
    origin_x: float
    """x of the lower-left corner in the map [m]."""
    origin_y: float
    """y of the lower-left corner in the map [m]."""
    resolution: float
    """[m]"""
    hit: int
    """Levels a return adds; see ``GridConfig`` for this and the next two."""
    miss: int
    limit: int


@njit(cache=True)
def count_unsettled(level, lowest):
    """Count the cells of each tile that lie above the lowest level."""
    rows, columns = level.shape
    side = 1 << _TILE
    unsettled = np.zeros(((rows + side - 1) // side, (columns + side - 1) // side), np.int32)
    for i in range(rows):
        for j in range(columns):
            unsettled[i >> _TILE, j >> _TILE] += level[i, j] > lowest
    return unsettled


@njit(cache=True, error_model="numpy")
def insert_beams(cells, scan_index, sensor_x, sensor_y, points, num_hits, grazed):
    """Raise the cells of the returns, then lower the cells on the way to them, each cell once."""
    entropy_of_level = cells.entropy_of_level
    origin_x, origin_y, per_metre = cells.origin_x, cells.origin_y, 1.0 / cells.resolution
    level, last_update, unsettled = cells.level.ravel(), cells.last_update.ravel(), cells.unsettled.ravel()
    columns, tile_columns = cells.level.shape[1], cells.unsettled.shape[1]
    highest, lowest, miss = cells.limit, -cells.limit, cells.miss
    gain = 0.0
    for k in range(num_hits):
        i = int((points[k, 1] - origin_y) * per_metre)
        j = int((points[k, 0] - origin_x) * per_metre)
        cell = i * columns + j
        if last_update[cell] != scan_index:
            last_update[cell] = scan_index
            old = level[cell]
            new = min(old + cells.hit, highest)
            level[cell] = new
            gain += entropy_of_level[new + 128] - entropy_of_level[old + 128]
            if old == lowest:
                unsettled[(i >> _TILE) * tile_columns + (j >> _TILE)] += 1
    sensor_j = (sensor_x - origin_x) / cells.resolution
    sensor_i = (sensor_y - origin_y) / cells.resolution
    for k in range(points.shape[0]):
        # Follow the beam, short of the cell it ends in, along the axis p that it advances faster on; q is the other.
        # Where it leaves its n-th line of cells across p is computed from the start, not added up as by Amanatides and
        # Woo (1987): so it can be followed from any line on.
        end_j = (points[k, 0] - origin_x) * per_metre
        end_i = (points[k, 1] - origin_y) * per_metre
        if abs(end_j - sensor_j) >= abs(end_i - sensor_i):
            p0, q0, p1, q1, stride_p, stride_q, tile_p, tile_q = (
                sensor_j, sensor_i, end_j, end_i, 1, columns, 1, tile_columns,
            )  # fmt: skip
        else:
            p0, q0, p1, q1, stride_p, stride_q, tile_p, tile_q = (
                sensor_i, sensor_j, end_i, end_j, columns, 1, tile_columns, 1,
            )  # fmt: skip
        dp, dq = p1 - p0, q1 - q0
        first_p, q, last_p, last_q = int(p0), int(q0), int(p1), int(q1)
        if first_p == last_p and q == last_q:
            continue
        step_p = 1 if dp > 0.0 else -1
        per_line = dq / abs(dp)
        to_edge = first_p + 1 - p0 if dp > 0.0 else p0 - first_p
        # Edges that are met exactly have been crossed.
        leaves_at = q0 + to_edge * per_line - (1e-9 if dq <= 0.0 else 0.0)
        lines = abs(last_p - first_p)
        if dq == 0.0 and q0 == q:  # along an edge: on its lower side, and short of the cell before the end's
            lines, last_q = lines - 1, last_q - 1
        n = 0
        while n <= lines:
            p = first_p + n * step_p
            in_tile = p & ((1 << _TILE) - 1)
            stop = n + ((1 << _TILE) - in_tile if dp > 0.0 else in_tile + 1)
            if stop <= lines:
                next_q = int(leaves_at + (stop - 1) * per_line)
                tile = (p >> _TILE) * tile_p
                here, there = np.uint64(tile + (q >> _TILE) * tile_q), np.uint64(tile + (next_q >> _TILE) * tile_q)
                if (unsettled[here] == 0) & (unsettled[there] == 0):
                    n, q = stop, next_q
                    continue
            for m in range(n, min(stop, lines + 1)):
                p = first_p + m * step_p
                next_q = int(leaves_at + m * per_line) if m < lines else last_q
                line = p * stride_p
                cell, there = np.uint64(line + q * stride_q), np.uint64(line + next_q * stride_q)
                if (level[cell] == lowest) & (level[there] == lowest):
                    q = next_q
                    continue
                while m < lines or q != last_q:
                    old = level[cell]
                    if old > lowest and last_update[cell] != scan_index:
                        skims = False
                        if old > 0:
                            left_at = (to_edge + m) / abs(dp)
                            if q != next_q:
                                left_at = min(left_at, ((q + 1 if dq > 0.0 else q) - q0) / dq)
                            skims = left_at > 1.0 - grazed[k] * per_metre / max(math.hypot(dp, dq), 1e-9)
                        if not skims:
                            last_update[cell] = scan_index
                            new = max(old - miss, lowest)
                            level[cell] = new
                            gain += entropy_of_level[new + 128] - entropy_of_level[old + 128]
                            if new == lowest:
                                unsettled[(p >> _TILE) * tile_p + (q >> _TILE) * tile_q] -= 1
                    if q == next_q:
                        break
                    q = next_q
                    cell = there
            n = stop
    cells.entropy_change[0] += gain
