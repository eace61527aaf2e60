"""Scan to map: correlative search for the basin, Gauss-Newton on the smoothed grid for the rest.

After Cartographer's local SLAM (Hess et al. 2016, Section IV): a small real-time correlative search (Olson 2009)
around the prediction, then a refinement whose cost is the occupied-space term plus a pull towards the prediction.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from vuca_nav.geometry import wrap_angle
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.types import FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class ScanMatcherConfig:
    """Weights after Cartographer (occupied space 1, translation 10, rotation 40), which they multiply unsquared."""

    linear_window: float = 0.05
    """Half width of the search [m]: between two scans at 30 Hz odometry errs by millimetres."""
    angular_window: float = math.radians(1.0)
    """[rad]"""
    linear_step: float = 0.025
    """[m]"""
    angular_step: float = math.radians(0.5)
    """[rad]"""
    recovery_factor: float = 4.0
    """Both windows grow by this when the score says that the match was lost."""
    recovery_score: float = 0.4
    """Mean map value at the matched returns under which it was lost; a good match has 0.6 to 0.9."""
    search_stride: int = 3
    """The search looks at every so many returns."""
    translation_weight: float = 10.0
    rotation_weight: float = 40.0
    iterations: int = 8


class Match(NamedTuple):
    """Where the scan fits, and how well."""

    map_from_base: Pose2
    score: float
    """Mean map value at the returns, 0 to 1."""


class ScanMatcher:
    """Fits returns to the occupied cells of a grid."""

    def __init__(self, config: ScanMatcherConfig, grid: OccupancyGrid):
        self.config = config
        p = grid.probability_of_level
        peak = p[128 + grid.config.limit]
        self._value_of_level = np.clip((p - 0.5) / (peak - 0.5), 0.0, 1.0)
        """(256,) what the matcher climbs: 0 in free and unknown cells, so that the unknown does not attract."""

    def match(self, grid: OccupancyGrid, predicted: Pose2, points_in_base: FloatArray) -> Match:
        """Fit.

        Args:
            grid: What to match against.
            predicted: ``map_from_base`` by odometry.
            points_in_base: (n, 2) returns [m].
        """
        c = self.config
        match = self._fit(grid, predicted, points_in_base, c.linear_window, c.angular_window)
        if match.score < c.recovery_score:
            wide = self._fit(
                grid,
                predicted,
                points_in_base,
                c.recovery_factor * c.linear_window,
                c.recovery_factor * c.angular_window,
            )
            if wide.score > match.score + 0.05:
                return wide
        return match

    def _fit(
        self, grid: OccupancyGrid, predicted: Pose2, points_in_base: FloatArray, linear: float, angular: float
    ) -> Match:
        c = self.config
        x, y, yaw = _search(
            grid.level,
            self._value_of_level,
            grid.origin[0],
            grid.origin[1],
            1.0 / grid.resolution,
            points_in_base,
            c.search_stride,
            predicted.x,
            predicted.y,
            predicted.yaw,
            round(linear / c.linear_step),
            c.linear_step,
            round(angular / c.angular_step),
            c.angular_step,
        )
        x, y, yaw, score = _refine(
            grid.level,
            self._value_of_level,
            grid.origin[0],
            grid.origin[1],
            1.0 / grid.resolution,
            points_in_base,
            x,
            y,
            yaw,
            predicted.x,
            predicted.y,
            predicted.yaw,
            c.translation_weight,
            c.rotation_weight,
            c.iterations,
        )
        return Match(Pose2(x, y, wrap_angle(yaw)), score)


@njit(cache=True)
def _search(
    level, value_of_level, origin_x, origin_y, per_metre, points, stride, x0, y0, yaw0, n_linear, linear_step,
    n_angular, angular_step,
):  # fmt: skip
    """Best of the window by the mean value at the nearest cells, a little in favour of the prediction."""
    rows, columns = level.shape
    best, best_x, best_y, best_yaw = -1.0, x0, y0, yaw0
    count = (points.shape[0] + stride - 1) // stride
    for a in range(-n_angular, n_angular + 1):
        yaw = yaw0 + a * angular_step
        c, s = math.cos(yaw), math.sin(yaw)
        for u in range(-n_linear, n_linear + 1):
            for v in range(-n_linear, n_linear + 1):
                x, y = x0 + u * linear_step, y0 + v * linear_step
                total = 0.0
                for k in range(0, points.shape[0], stride):
                    j = int((x + c * points[k, 0] - s * points[k, 1] - origin_x) * per_metre)
                    i = int((y + s * points[k, 0] + c * points[k, 1] - origin_y) * per_metre)
                    if 0 <= i < rows and 0 <= j < columns:
                        total += value_of_level[level[i, j] + 128]
                away = (u * u + v * v) * linear_step**2 * 4.0 + (a * angular_step) ** 2 * 20.0
                score = total / max(count, 1) * math.exp(-away)
                # A tie goes to the prediction: strictly better, or nearer.
                if score > best + 1e-12 or (score > best - 1e-12 and u == 0 and v == 0 and a == 0):
                    best, best_x, best_y, best_yaw = score, x, y, yaw
    return best_x, best_y, best_yaw


@njit(cache=True)
def _evaluate(level, value_of_level, origin_x, origin_y, per_metre, points, x, y, yaw, hessian, gradient):
    """Cost 0.5 mean (1 - M)^2, and its Gauss-Newton system, M the grid smoothed by a cubic B-spline."""
    rows, columns = level.shape
    c, s = math.cos(yaw), math.sin(yaw)
    hessian[:] = 0.0
    gradient[:] = 0.0
    cost = 0.0
    score = 0.0
    n = points.shape[0]
    wx = np.empty(4)
    wy = np.empty(4)
    dx = np.empty(4)
    dy = np.empty(4)
    for k in range(n):
        px = c * points[k, 0] - s * points[k, 1]
        py = s * points[k, 0] + c * points[k, 1]
        # Values sit at cell centres.
        fx = (x + px - origin_x) * per_metre - 0.5
        fy = (y + py - origin_y) * per_metre - 0.5
        j, i = int(math.floor(fx)), int(math.floor(fy))
        if i < 1 or j < 1 or i + 2 >= rows or j + 2 >= columns:
            cost += 0.5
            continue
        occupied = False
        for a in range(i - 1, i + 3):
            for b in range(j - 1, j + 3):
                occupied = occupied or level[a, b] > 0
        if not occupied:
            cost += 0.5
            continue
        _cubic(fx - j, wx, dx)
        _cubic(fy - i, wy, dy)
        m = gx = gy = 0.0
        for a in range(4):
            row = row_dx = 0.0
            for b in range(4):
                value = value_of_level[level[i - 1 + a, j - 1 + b] + 128]
                row += wx[b] * value
                row_dx += dx[b] * value
            m += wy[a] * row
            gx += wy[a] * row_dx
            gy += dy[a] * row
        gx *= per_metre
        gy *= per_metre
        r = 1.0 - m
        g_yaw = -gx * py + gy * px
        cost += 0.5 * r * r
        score += min(max(m, 0.0), 1.0)
        gradient[0] -= gx * r
        gradient[1] -= gy * r
        gradient[2] -= g_yaw * r
        hessian[0, 0] += gx * gx
        hessian[0, 1] += gx * gy
        hessian[0, 2] += gx * g_yaw
        hessian[1, 1] += gy * gy
        hessian[1, 2] += gy * g_yaw
        hessian[2, 2] += g_yaw * g_yaw
    scale = 1.0 / max(n, 1)
    hessian *= scale
    gradient *= scale
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
    return cost * scale, score * scale


@njit(cache=True)
def _cubic(t, weight, slope):
    """Weights of four neighbours at fraction t, and their derivatives: the uniform cubic B-spline."""
    u = 1.0 - t
    weight[0] = u * u * u / 6.0
    weight[1] = (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0
    weight[2] = (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0
    weight[3] = t * t * t / 6.0
    slope[0] = -0.5 * u * u
    slope[1] = 1.5 * t * t - 2.0 * t
    slope[2] = -1.5 * u * u + 2.0 * u
    slope[3] = 0.5 * t * t


@njit(cache=True)
def _refine(
    level, value_of_level, origin_x, origin_y, per_metre, points, x, y, yaw, x0, y0, yaw0, translation_weight,
    rotation_weight, iterations,
):  # fmt: skip
    """Levenberg-Marquardt from (x, y, yaw), pulled towards the prediction (x0, y0, yaw0)."""
    hessian = np.empty((3, 3))
    gradient = np.empty(3)
    new_hessian = np.empty((3, 3))
    new_gradient = np.empty(3)
    pull_t, pull_r = translation_weight, rotation_weight
    data, score = _evaluate(level, value_of_level, origin_x, origin_y, per_metre, points, x, y, yaw, hessian, gradient)
    cost = data + 0.5 * (pull_t * ((x - x0) ** 2 + (y - y0) ** 2) + pull_r * (yaw - yaw0) ** 2)
    damping = 1e-3
    for _ in range(iterations):
        a = hessian.copy()
        b = gradient.copy()
        a[0, 0] += pull_t
        a[1, 1] += pull_t
        a[2, 2] += pull_r
        b[0] += pull_t * (x - x0)
        b[1] += pull_t * (y - y0)
        b[2] += pull_r * (yaw - yaw0)
        for d in range(3):
            a[d, d] *= 1.0 + damping
        step = -np.linalg.solve(a, b)
        nx, ny, nyaw = x + step[0], y + step[1], yaw + step[2]
        new_data, new_score = _evaluate(
            level,
            value_of_level,
            origin_x,
            origin_y,
            per_metre,
            points,
            nx,
            ny,
            nyaw,
            new_hessian,
            new_gradient,
        )
        new_cost = new_data + 0.5 * (pull_t * ((nx - x0) ** 2 + (ny - y0) ** 2) + pull_r * (nyaw - yaw0) ** 2)
        if new_cost < cost:
            moved = abs(step[0]) + abs(step[1]) + abs(step[2])
            x, y, yaw, cost, score = nx, ny, nyaw, new_cost, new_score
            hessian[:] = new_hessian
            gradient[:] = new_gradient
            damping = max(damping * 0.2, 1e-6)
            if moved < 2e-4:
                break
        else:
            damping *= 10.0
            if damping > 1e3:
                break
    return x, y, yaw, score
