"""Branch and bound over poses: the best match of returns to a submap in a wide window, as if all were tried.

Hess et al. 2016, Section V-B. A level of the pyramid holds, for each cell, the greatest value in the square of 2^h
cells from there on, so that one look-up bounds the returns' values over 2^h by 2^h poses.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, Pose2

DEPTH = 6
"""Levels of the pyramid above the cells: the top one bounds squares of 64 cells, 3.2 m."""


class Pyramid(NamedTuple):
    """A submap to search in."""

    levels: NDArray[np.uint8]
    """(DEPTH + 1, rows, columns) greatest values of squares that begin 2^DEPTH - 1 cells before the submap's."""
    origin_x: float
    """x of the lower-left corner of the padded grid [m]."""
    origin_y: float
    """y of it [m]."""
    resolution: float
    """[m]"""


class Window(NamedTuple):
    """Poses that are tried: those about ``centre``."""

    centre: Pose2
    position: float
    """Half width along x and y [m]."""
    yaw: float
    """Half width [rad]."""
    angular_step: float
    """[rad]"""


class Found(NamedTuple):
    """The best pose of a window."""

    pose: Pose2
    score: float
    """Mean value of the returns' cells, 0 to 1."""


def build_pyramid(occupied: NDArray[np.bool_], origin: tuple[float, float], resolution: float) -> Pyramid:
    """Prepare a submap.

    A return next to an occupied cell counts half: surfaces lie anywhere in their cells.

    Args:
        occupied: (rows, columns) mask of the occupied cells.
        origin: Lower-left corner [m].
        resolution: Side of a cell [m].
    """
    pad = (1 << DEPTH) - 1
    rows, columns = occupied.shape
    levels = np.zeros((DEPTH + 1, rows + pad + 2, columns + pad + 2), np.uint8)
    _build(occupied, pad + 1, levels)
    return Pyramid(levels, origin[0] - (pad + 1) * resolution, origin[1] - (pad + 1) * resolution, resolution)


def search(pyramid: Pyramid, points: FloatArray, window: Window, least_score: float) -> Found | None:
    """Find the pose of the window whose returns have the greatest score; None if none has ``least_score``.

    Positions are whole cells apart.

    Args:
        pyramid: The submap.
        points: (n, 2) returns in base_link [m].
        window: The poses.
        least_score: Score that the pose must exceed.
    """
    n_linear = int(window.position / pyramid.resolution + 1e-6)
    n_angular = int(window.yaw / window.angular_step + 1e-6)
    x, y, yaw, score = _search(
        pyramid, points, tuple(window.centre), n_linear, n_angular, window.angular_step, least_score
    )
    return Found(Pose2(x, y, yaw), score) if score > least_score else None


def score_along(
    pyramid: Pyramid, points: FloatArray, pose: Pose2, direction: tuple[float, float], distances: FloatArray
) -> float:
    """Greatest score at poses that lie along a line through a pose, or a cell beside it.

    Args:
        pyramid: The submap.
        points: (n, 2) returns in base_link [m].
        pose: The pose.
        direction: Unit vector of the line.
        distances: (m,) distances from the pose along it [m].
    """
    return float(_score_along(pyramid, points, tuple(pose), direction, distances))


@njit(cache=True)
def _score_along(pyramid, points, pose, direction, distances):
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    per_metre = 1.0 / pyramid.resolution
    n = points.shape[0]
    cells = np.empty((n, 2), np.int32)
    best = 0
    for d in distances:
        for aside in range(-1, 2):
            away = aside * pyramid.resolution
            px = x + d * direction[0] - away * direction[1] - pyramid.origin_x
            py = y + d * direction[1] + away * direction[0] - pyramid.origin_y
            for k in range(n):
                cells[k, 0] = int(math.floor((py + s * points[k, 0] + c * points[k, 1]) * per_metre))
                cells[k, 1] = int(math.floor((px + c * points[k, 0] - s * points[k, 1]) * per_metre))
            best = max(best, _sum(pyramid.levels[0], cells, 0, 0))
    return best / (2.0 * max(n, 1))


@njit(cache=True)
def _build(occupied, pad, levels):
    rows, columns = levels.shape[1:]
    for i in range(occupied.shape[0]):
        for j in range(occupied.shape[1]):
            if not occupied[i, j]:
                continue
            for a in range(-1, 2):
                for b in range(-1, 2):
                    value = 2 if a == 0 and b == 0 else 1
                    if levels[0, i + pad + a, j + pad + b] < value:
                        levels[0, i + pad + a, j + pad + b] = value
    for h in range(1, levels.shape[0]):
        half = 1 << (h - 1)
        below, here = levels[h - 1], levels[h]
        for i in range(rows):
            i2 = min(i + half, rows - 1)
            for j in range(columns):
                j2 = min(j + half, columns - 1)
                here[i, j] = max(max(below[i, j], below[i, j2]), max(below[i2, j], below[i2, j2]))


@njit(cache=True)
def _sum(level, cells, di, dj):
    rows, columns = level.shape
    total = 0
    for k in range(cells.shape[0]):
        i, j = cells[k, 0] + di, cells[k, 1] + dj
        if 0 <= i < rows and 0 <= j < columns:
            total += level[i, j]
    return total


@njit(cache=True)
def _search(pyramid, points, centre, n_linear, n_angular, angular_step, least_score):
    """Depth first, the most promising pose first: x, y, yaw and score."""
    x0, y0, yaw0 = centre
    levels = pyramid.levels
    per_metre = 1.0 / pyramid.resolution
    n = points.shape[0]
    num_yaws = 2 * n_angular + 1
    cells = np.empty((num_yaws, n, 2), np.int32)
    for a in range(num_yaws):
        yaw = yaw0 + (a - n_angular) * angular_step
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(n):
            cells[a, k, 0] = int(math.floor((y0 + s * points[k, 0] + c * points[k, 1] - pyramid.origin_y) * per_metre))
            cells[a, k, 1] = int(math.floor((x0 + c * points[k, 0] - s * points[k, 1] - pyramid.origin_x) * per_metre))
    top = 0
    while top < levels.shape[0] - 1 and (1 << top) < 2 * n_linear + 1:
        top += 1
    stride = 1 << top
    per_side = (2 * n_linear + 1 + stride - 1) // stride
    count = num_yaws * per_side * per_side
    scores, roots = np.empty(count, np.int64), np.empty((count, 3), np.int32)
    m = 0
    for a in range(num_yaws):
        for u in range(per_side):
            for v in range(per_side):
                di, dj = u * stride - n_linear, v * stride - n_linear
                scores[m] = _sum(levels[top], cells[a], di, dj)
                roots[m, 0], roots[m, 1], roots[m, 2] = a, di, dj
                m += 1
    order = np.argsort(-scores, kind="mergesort")
    best = int(least_score * 2.0 * n)
    best_a, best_i, best_j, is_found = n_angular, 0, 0, False
    stack = np.empty((4 * (top + 1) + 4, 5), np.int64)
    for r in order:
        if scores[r] <= best:
            break
        stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3], stack[0, 4] = (
            roots[r, 0],
            roots[r, 1],
            roots[r, 2],
            top,
            scores[r],
        )
        depth = 1
        while depth > 0:
            depth -= 1
            a, di, dj, h, score = stack[depth]
            if score <= best:
                continue
            if h == 0:
                best, best_a, best_i, best_j, is_found = score, a, di, dj, True
                continue
            half = 1 << (h - 1)
            first = depth
            for u in range(2):
                for v in range(2):
                    ci, cj = di + u * half, dj + v * half
                    if ci > n_linear or cj > n_linear:
                        continue
                    value = _sum(levels[h - 1], cells[a], ci, cj)
                    if value <= best:
                        continue
                    # Keep the four sorted, the best one on top of the stack.
                    place = depth
                    while place > first and stack[place - 1, 4] > value:
                        stack[place] = stack[place - 1]
                        place -= 1
                    stack[place, 0], stack[place, 1], stack[place, 2], stack[place, 3], stack[place, 4] = (
                        a,
                        ci,
                        cj,
                        h - 1,
                        value,
                    )
                    depth += 1
    if not is_found:
        return x0, y0, yaw0, 0.0
    step = pyramid.resolution
    return x0 + best_j * step, y0 + best_i * step, yaw0 + (best_a - n_angular) * angular_step, best / (2.0 * n)
