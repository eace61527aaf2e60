"""Scan to map: correlative search for the basin, point-to-line Gauss-Newton for the rest.

In two steps like Cartographer's local SLAM (Hess et al. 2016, Section IV): a small real-time correlative search (Olson
2009) around the prediction, then a refinement. Cartographer refines on the smoothed probability grid; on our logs that
left 7 mm and 1.5 mrad of error a match (standard deviation), the lines through the cells' mean returns leave 2.5 mm
and 0.45 mrad, and drift follows (docs/findings.md).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from vuca_nav.geometry import wrap_angle
from vuca_nav.mapping.surfaces import SurfaceGrid
from vuca_nav.types import FloatArray, Pose2

LINE_RATIO = 0.1
"""Variance across over variance along up to which neighbouring returns are a line; 0.25 doubled the yaw's drift."""


@dataclass(frozen=True, slots=True)
class ScanMatcherConfig:
    """Windows and weights."""

    linear_window: float = 0.05
    """Half width of the search [m]: between two scans at 30 Hz odometry errs by millimetres."""
    angular_window: float = math.radians(1.0)
    """[rad]"""
    linear_step: float = 0.025
    """[m]"""
    angular_step: float = math.radians(0.5)
    """[rad]"""
    search_stride: int = 3
    """The search looks at every so many returns."""
    recovery_factor: float = 4.0
    """Both windows grow by this when the score says that the match was lost."""
    recovery_score: float = 0.5
    """Share of matched returns under which it may be lost. In corridors a good match has 0.6 to 0.9 and one that is 3
    degrees off 0.4; in a crowd good ones have 0.4, too, so that what the wider search finds must be better."""
    residual_scale: float = 0.03
    """Distance to the line at which a return's weight has fallen to a half (Cauchy) [m]: 1.5 sigma of range noise."""
    gate: float = 0.12
    """A return farther than this from every known surface has no part in the match [m]."""
    translation_weight: float = 10.0
    """Pull to the prediction, in returns: along a bare corridor odometry decides, elsewhere 360 returns do."""
    rotation_weight: float = 100.0
    """As above, in returns at 1 m."""
    associations: int = 3
    """Times that returns are assigned to lines."""
    iterations: int = 2
    """Gauss-Newton steps for each assignment."""


class Match(NamedTuple):
    """Where the scan fits, and how well."""

    map_from_base: Pose2
    score: float
    """Share of the returns that lie on a known surface."""


class ScanMatcher:
    """Fits returns to the surfaces of a map."""

    def __init__(self, config: ScanMatcherConfig, num_beams: int):
        self.config = config
        self._lines = np.empty((num_beams, 5))

    def match(self, grid: SurfaceGrid, predicted: Pose2, points_in_base: FloatArray) -> Match:
        """Fit.

        Args:
            grid: What to match against.
            predicted: ``map_from_base`` by odometry.
            points_in_base: (n, 2) returns [m].
        """
        c = self.config
        match = self._fit(grid, predicted, points_in_base, 1.0)
        if match.score < c.recovery_score:
            wide = self._fit(grid, predicted, points_in_base, c.recovery_factor)
            if wide.score > match.score + 0.05:
                return wide
        return match

    def _fit(self, grid: SurfaceGrid, predicted: Pose2, points_in_base: FloatArray, window: float) -> Match:
        c = self.config
        found = _search(
            grid.level,
            grid.config.limit,
            grid.origin[0],
            grid.origin[1],
            1.0 / grid.resolution,
            points_in_base,
            c.search_stride,
            predicted.x,
            predicted.y,
            predicted.yaw,
            round(window * c.linear_window / c.linear_step),
            c.linear_step,
            round(window * c.angular_window / c.angular_step),
            c.angular_step,
        )
        x, y, yaw, score = _refine(
            grid.level,
            grid.mean,
            grid.count,
            grid.origin[0],
            grid.origin[1],
            grid.resolution,
            points_in_base,
            found,
            (predicted.x, predicted.y, predicted.yaw),
            c.translation_weight,
            c.rotation_weight,
            c.residual_scale,
            c.gate,
            c.associations,
            c.iterations,
            self._lines,
        )
        return Match(Pose2(x, y, wrap_angle(yaw)), score)


@njit(cache=True)
def _search(
    level, limit, origin_x, origin_y, per_metre, points, stride, x0, y0, yaw0, n_linear, linear_step,
    n_angular, angular_step,
):  # fmt: skip
    """Best of the window by the mean level of the occupied cells that returns fall in; x, y and yaw.

    A little in favour of the prediction.
    """
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
                        total += max(level[i, j], 0)
                away = (u * u + v * v) * linear_step**2 * 4.0 + (a * angular_step) ** 2 * 20.0
                score = total / (limit * max(count, 1)) * math.exp(-away)
                # A tie goes to the prediction: strictly better, or nearer.
                if score > best + 1e-12 or (score > best - 1e-12 and u == 0 and v == 0 and a == 0):
                    best, best_x, best_y, best_yaw = score, x, y, yaw
    return best_x, best_y, best_yaw


@njit(cache=True)
def _assign(level, mean, count, origin_x, origin_y, resolution, points, x, y, yaw, gate, lines):
    """The line through the surface about each return; how many have one.

    Writes rows of ``lines``: a point of the line, its normal, and 1 or 0 for whether there is one.
    """
    rows, columns = level.shape
    per_metre = 1.0 / resolution
    c, s = math.cos(yaw), math.sin(yaw)
    assigned = 0
    for k in range(points.shape[0]):
        lines[k, 4] = 0.0
        # Everything below in cells, from the return.
        fx = (x + c * points[k, 0] - s * points[k, 1] - origin_x) * per_metre
        fy = (y + s * points[k, 0] + c * points[k, 1] - origin_y) * per_metre
        i, j = int(fy), int(fx)
        if i < 2 or j < 2 or i >= rows - 2 or j >= columns - 2:
            continue
        n = mx = my = xx = xy = yy = 0.0
        for a in range(i - 2, i + 3):
            for b in range(j - 2, j + 3):
                if level[a, b] > 0 and count[a, b] > 0:
                    w = min(float(count[a, b]), 10.0)
                    u = b + mean[a, b, 0] - fx
                    v = a + mean[a, b, 1] - fy
                    n += w
                    mx += w * u
                    my += w * v
                    xx += w * u * u
                    xy += w * u * v
                    yy += w * v * v
        if n < 6.0:
            continue
        mx /= n
        my /= n
        xx = xx / n - mx * mx
        xy = xy / n - mx * my
        yy = yy / n - my * my
        root = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        along, across = 0.5 * (xx + yy) + root, 0.5 * (xx + yy) - root
        if across > LINE_RATIO * along:
            continue  # a corner, a blob, or both faces of a thin wall: no line
        direction = 0.5 * math.atan2(2.0 * xy, xx - yy)
        nx, ny = -math.sin(direction), math.cos(direction)
        if abs(nx * mx + ny * my) * resolution > gate:
            continue
        lines[k, 0] = (fx + mx) * resolution + origin_x
        lines[k, 1] = (fy + my) * resolution + origin_y
        lines[k, 2] = nx
        lines[k, 3] = ny
        lines[k, 4] = 1.0
        assigned += 1
    return assigned


@njit(cache=True)
def _refine(
    level, mean, count, origin_x, origin_y, resolution, points, start, predicted, translation_weight, rotation_weight,
    residual_scale, gate, associations, iterations, lines,
):  # fmt: skip
    """Gauss-Newton on Cauchy-weighted distances to lines, pulled to the prediction; pose and share of returns used."""
    x, y, yaw = start
    x0, y0, yaw0 = predicted
    n = points.shape[0]
    assigned = 0
    for _ in range(associations):
        assigned = _assign(level, mean, count, origin_x, origin_y, resolution, points, x, y, yaw, gate, lines)
        for _ in range(iterations):
            h00, h11, h22 = translation_weight, translation_weight, rotation_weight
            h01 = h02 = h12 = 0.0
            g0, g1, g2 = translation_weight * (x0 - x), translation_weight * (y0 - y), rotation_weight * (yaw0 - yaw)
            c, s = math.cos(yaw), math.sin(yaw)
            for k in range(n):
                if lines[k, 4] == 0.0:
                    continue
                px = c * points[k, 0] - s * points[k, 1]
                py = s * points[k, 0] + c * points[k, 1]
                nx, ny = lines[k, 2], lines[k, 3]
                r = nx * (lines[k, 0] - x - px) + ny * (lines[k, 1] - y - py)
                w = 1.0 / (1.0 + (r / residual_scale) ** 2)
                j2 = ny * px - nx * py
                h00 += w * nx * nx
                h01 += w * nx * ny
                h02 += w * nx * j2
                h11 += w * ny * ny
                h12 += w * ny * j2
                h22 += w * j2 * j2
                g0 += w * nx * r
                g1 += w * ny * r
                g2 += w * j2 * r
            # Solve the symmetric 3 x 3 system by cofactors.
            c00 = h11 * h22 - h12 * h12
            c01 = h02 * h12 - h01 * h22
            c02 = h01 * h12 - h02 * h11
            c11 = h00 * h22 - h02 * h02
            c12 = h01 * h02 - h00 * h12
            c22 = h00 * h11 - h01 * h01
            det = h00 * c00 + h01 * c01 + h02 * c02
            x += (c00 * g0 + c01 * g1 + c02 * g2) / det
            y += (c01 * g0 + c11 * g1 + c12 * g2) / det
            yaw += (c02 * g0 + c12 * g1 + c22 * g2) / det
    return x, y, yaw, assigned / max(n, 1)
