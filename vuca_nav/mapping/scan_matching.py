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

from vuca_nav.geometry import wrap_angle
from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.surfaces import SurfaceGrid
from vuca_nav.types import FloatArray, Pose2

LINE_RATIO = 0.1
"""Variance across over variance along up to which neighbouring returns are a line; 0.25 doubled the yaw's drift."""
REACH = 2
"""Rows and columns each way of the return's cell from which a line is made."""
WIDTH = 2 * REACH + 1
WINDOW_CELLS = WIDTH * WIDTH
MAX_WEIGHT = 10.0
"""A cell's mean weighs as many returns as it holds, but no more than this in the line of its neighbourhood."""
MIN_WEIGHT = 6.0
"""Least number of returns in a neighbourhood that shows a line."""
TRANSLATION_PENALTY, ROTATION_PENALTY = 4.0, 20.0
"""A candidate of the search loses this share of its score per squared metre and per squared radian from the prediction:
1% at 0.05 m and 0.6% at 1 degree, so that among equals the nearest wins."""
TIE = 1e-12
"""Scores nearer to each other than this are equal, and the prediction wins."""


@dataclass(frozen=True, slots=True)
class ScanMatcherConfig:
    """Settings of the scan matcher: windows of the search, weights of the refinement."""

    linear_window: float = 0.05
    """Half width of the search [m]: between two scans at 30 Hz odometry errs by millimetres."""
    angular_window: float = math.radians(1.0)
    """Half width of the search in yaw [rad]."""
    linear_step: float = 0.025
    """Step of the search along x and y [m]."""
    angular_step: float = math.radians(0.5)
    """Step of the search in yaw [rad]."""
    search_stride: int = 3
    """Stride of the search over the returns."""
    recovery_factor: float = 4.0
    """Both windows grow by this when the score says that the match was lost."""
    recovery_score: float = 0.5
    """Share of matched returns below which the match may be lost. In corridors a good match has 0.6 to 0.9 and one 3
    degrees off 0.4; in a crowd good ones have 0.4, too, so that the wider search must find a better one."""
    residual_scale: float = 0.03
    """Distance to the line at which a return's weight has fallen to a half (Cauchy) [m]: 1.5 sigma of range noise."""
    gate: float = 0.12
    """A return farther than this from every known surface has no part in the match [m]."""
    translation_weight: float = 10.0
    """Pull to the prediction, in returns: along a bare corridor odometry decides, elsewhere 360 returns do."""
    rotation_weight: float = 100.0
    """Pull to the predicted yaw, in returns at 1 m."""
    associations: int = 3
    """Number of times that returns are assigned to lines."""
    iterations: int = 2
    """Gauss-Newton steps for each assignment."""


class Match(NamedTuple):
    """The pose at which a scan fits, and the quality of the fit."""

    map_from_base: Pose2
    score: float
    """Share of the returns that lie on a known surface."""


class SearchWindow(NamedTuple):
    """The candidates of the correlative search, in steps about the prediction."""

    stride: int
    """Stride of the search over the returns."""
    n_linear: int
    """Steps each way along x and along y."""
    linear_step: float
    """[m]"""
    n_angular: int
    """Steps each way of the yaw."""
    angular_step: float
    """[rad]"""
    preference: np.ndarray
    """(2 n_angular + 1, 2 n_linear + 1, 2 n_linear + 1) factor of each candidate's score, 1 for the prediction."""


class RefinementSettings(NamedTuple):
    """The settings of the Gauss-Newton refinement; see ``ScanMatcherConfig``."""

    translation_weight: float
    rotation_weight: float
    residual_scale: float
    """[m]"""
    gate: float
    """[m]"""
    associations: int
    iterations: int


class Workspace(NamedTuple):
    """Scratch arrays of the kernels, allocated once."""

    candidate_cells: np.ndarray
    """(2, 2 n + 1, num_beams) int32, n of the widest window: the first element of the row of ``level`` that a return
    falls in by the candidate's y, and the column by its x; -1 where that is outside the grid."""
    cells: np.ndarray
    """(num_beams, 5) int64: row and column of the return's cell, those of the cell that ``means`` were collected about,
    and how many they are."""
    means: np.ndarray
    """(num_beams, WINDOW_CELLS, 3) mean returns about the cell: column, row, weight."""
    moments: np.ndarray
    """(8, num_beams) the return's column and row; then of these means, from the return, in cells: sums of the weights,
    of x, y, x^2, x y and y^2; then whether they are a line, means of x and y, var x - var y, and cov x y."""
    lines: np.ndarray
    """(num_beams, 6) for each return that has a line: the return in base_link [m], a point of the line in the map [m],
    its normal."""


class ScanMatcher:
    """Fits returns to the surfaces of a map."""

    def __init__(self, config: ScanMatcherConfig, num_beams: int):
        self.config = config
        self._near = _window(config, 1.0)
        self._wide = _window(config, config.recovery_factor)
        self._refinement = RefinementSettings(
            config.translation_weight,
            config.rotation_weight,
            config.residual_scale,
            config.gate,
            config.associations,
            config.iterations,
        )
        width = 2 * max(self._near.n_linear, self._wide.n_linear) + 1
        self._workspace = Workspace(
            candidate_cells=np.empty((2, width, num_beams), np.int32),
            cells=np.empty((num_beams, 5), np.int64),
            means=np.empty((num_beams, WINDOW_CELLS, 3)),
            moments=np.empty((8, num_beams)),
            lines=np.empty((num_beams, 6)),
        )

    def match(self, grid: SurfaceGrid, predicted: Pose2, points_in_base: FloatArray) -> Match:
        """Find the pose at which the returns lie on the map's surfaces.

        Args:
            grid: The map to match against.
            predicted: ``map_from_base`` by odometry.
            points_in_base: (n, 2) returns, n at most ``num_beams`` [m].
        """
        c = self.config
        match = self._fit(grid, predicted, points_in_base, self._near)
        if match.score < c.recovery_score:
            wide = self._fit(grid, predicted, points_in_base, self._wide)
            if wide.score > match.score + 0.05:
                return wide
        return match

    def _fit(self, grid: SurfaceGrid, predicted: Pose2, points_in_base: FloatArray, window: SearchWindow) -> Match:
        x, y, yaw, score = _fit(grid.surface, points_in_base, predicted, window, self._refinement, self._workspace)
        return Match(Pose2(x, y, wrap_angle(yaw)), score)


def _window(config: ScanMatcherConfig, factor: float) -> SearchWindow:
    n_linear = round(factor * config.linear_window / config.linear_step)
    n_angular = round(factor * config.angular_window / config.angular_step)
    steps, turns = np.arange(-n_linear, n_linear + 1), np.arange(-n_angular, n_angular + 1)
    preference = np.empty((len(turns), len(steps), len(steps)))
    _prefer(config.linear_step, config.angular_step, preference)
    return SearchWindow(config.search_stride, n_linear, config.linear_step, n_angular, config.angular_step, preference)


@njit(cache=True)
def _prefer(linear_step, angular_step, preference):
    """Fill in the factor of each candidate: it falls with the distance to the prediction."""
    n_angular, n_linear = preference.shape[0] // 2, preference.shape[1] // 2
    for a in range(-n_angular, n_angular + 1):
        for u in range(-n_linear, n_linear + 1):
            for v in range(-n_linear, n_linear + 1):
                away = (u * u + v * v) * linear_step**2 * TRANSLATION_PENALTY
                away += (a * angular_step) ** 2 * ROTATION_PENALTY
                preference[a + n_angular, u + n_linear, v + n_linear] = math.exp(-away)


@njit(cache=True)
def _fit(surface, points, predicted, window, settings, workspace):
    """Search, then refine: x, y, yaw and the share of the returns that lie on a known surface."""
    start = _search(surface, points, predicted, window, workspace)
    return _refine(surface, points, predicted, start, settings, workspace)


@njit(cache=True)
def _search(surface, points, predicted, window, workspace):
    """Find the candidate with the greatest mean level of the occupied cells that returns fall in; x, y and yaw.

    The prediction is slightly preferred. Returns are turned once for each yaw, and moved once for each x and each y.
    """
    level = surface.level.ravel()
    x0, y0, yaw0 = predicted
    n, step = window.n_linear, window.linear_step
    count = (points.shape[0] + window.stride - 1) // window.stride
    full_marks = surface.limit * max(count, 1)
    row_starts, columns = workspace.candidate_cells
    preference = window.preference
    best, best_x, best_y, best_yaw = -1.0, x0, y0, yaw0
    for a in range(-window.n_angular, window.n_angular + 1):
        yaw = yaw0 + a * window.angular_step
        inside = _candidate_cells(surface, points, (x0, y0, yaw), window, row_starts, columns)
        for u in range(2 * n + 1):
            for v in range(2 * n + 1):
                total = 0
                if inside:
                    for k in range(count):
                        total += max(level[np.uint64(row_starts[v, k] + columns[u, k])], 0)
                else:
                    for k in range(count):
                        if row_starts[v, k] >= 0 and columns[u, k] >= 0:
                            total += max(level[row_starts[v, k] + columns[u, k]], 0)
                score = total / full_marks * preference[a + window.n_angular, u, v]
                # A tie goes to the prediction: strictly better, or nearer.
                if score > best + TIE or (score > best - TIE and u == n and v == n and a == 0):
                    best, best_x, best_y, best_yaw = score, x0 + (u - n) * step, y0 + (v - n) * step, yaw
    return best_x, best_y, best_yaw


@njit(cache=True)
def _candidate_cells(surface, points, pose, window, row_starts, columns):
    """Find the cells of the returns at one yaw, for each x and y of the window; returns whether all are in the grid."""
    height, width = np.int32(surface.level.shape[0]), np.int32(surface.level.shape[1])
    origin_x, origin_y, per_metre = surface.origin_x, surface.origin_y, 1.0 / surface.resolution
    x0, y0, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    n, step, stride = window.n_linear, window.linear_step, window.stride
    outside = 0
    for u in range(2 * n + 1):
        x, y = x0 + (u - n) * step, y0 + (u - n) * step
        for k in range((points.shape[0] + stride - 1) // stride):
            px, py = points[k * stride, 0], points[k * stride, 1]
            j = np.int32((x + c * px - s * py - origin_x) * per_metre)
            i = np.int32((y + s * px + c * py - origin_y) * per_metre)
            row_in, column_in = (i >= 0) & (i < height), (j >= 0) & (j < width)
            row_starts[u, k] = i * width if row_in else -1
            columns[u, k] = j if column_in else -1
            outside |= not (row_in & column_in)
    return outside == 0


@njit(cache=True)
def _gather(surface, num_points, again, workspace):
    """Collect the mean returns about the cells of all returns that have left the one they were in.

    The occupied cells are found first, without an unpredictable branch: an entry that is not occupied is overwritten by
    the next one. An occupied cell has a mean.
    """
    level, mean, count = surface.level.ravel(), surface.mean.ravel(), surface.count.ravel()
    means, cells = workspace.means, workspace.cells
    occupied = np.empty(WINDOW_CELLS + 1, np.int64)
    rows, columns = surface.level.shape
    for k in range(num_points):
        i, j = cells[k, 0], cells[k, 1]
        if again and i == cells[k, 2] and j == cells[k, 3]:
            continue
        cells[k, 2], cells[k, 3] = i, j
        n = 0
        if REACH <= i < rows - REACH and REACH <= j < columns - REACH:
            corner = (i - REACH) * columns + j - REACH
            for a in range(WIDTH):
                for b in range(WIDTH):
                    occupied[n] = WIDTH * a + b
                    n += level[np.uint64(corner + a * columns + b)] > 0
            for m in range(n):
                a, b = divmod(np.uint32(occupied[m]), np.uint32(WIDTH))
                cell = np.uint64(corner + a * columns + b)
                means[k, m, 0] = (j - REACH + b) + mean[2 * cell]
                means[k, m, 1] = (i - REACH + a) + mean[2 * cell + np.uint64(1)]
                means[k, m, 2] = min(float(count[cell]), MAX_WEIGHT)
        cells[k, 4] = n


@njit(cache=True, error_model="numpy")
def _assign(surface, points, pose, settings, again, workspace):
    """Find the line through the surface about each return; returns how many have one.

    Most returns are in the cell where they were when lines were last assigned: their neighbourhoods are kept. Cells,
    sums and lines are found one after the other for all returns, so that none waits for another's branches.

    Args:
        surface: The map.
        points: (n, 2) returns in base_link [m].
        pose: x, y, yaw in the map [m, rad].
        settings: Settings of the refinement.
        again: Whether the workspace holds these returns' cells from the last time.
        workspace: Its ``lines`` are written to.
    """
    origin_x, origin_y, resolution = surface.origin_x, surface.origin_y, surface.resolution
    cells, means, moments, lines = workspace.cells, workspace.means, workspace.moments, workspace.lines
    per_metre = 1.0 / resolution
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(points.shape[0]):
        # Everything below in cells, from the return.
        fx = (x + c * points[k, 0] - s * points[k, 1] - origin_x) * per_metre
        fy = (y + s * points[k, 0] + c * points[k, 1] - origin_y) * per_metre
        moments[0, k], moments[1, k] = fx, fy
        cells[k, 0], cells[k, 1] = int(fy), int(fx)
    _gather(surface, points.shape[0], again, workspace)
    for k in range(points.shape[0]):
        fx, fy = moments[0, k], moments[1, k]
        n = mx = my = xx = xy = yy = 0.0
        for m in range(cells[k, 4]):
            u = means[k, m, 0] - fx
            v = means[k, m, 1] - fy
            w = means[k, m, 2]
            n += w
            mx += w * u
            my += w * v
            xx += w * u * u
            xy += w * u * v
            yy += w * v * v
        moments[2, k], moments[3, k], moments[4, k] = n, mx, my
        moments[5, k], moments[6, k], moments[7, k] = xx, xy, yy
    for k in range(points.shape[0]):
        n = moments[2, k]
        mx, my = moments[3, k] / n, moments[4, k] / n
        xx = moments[5, k] / n - mx * mx
        xy = moments[6, k] / n - mx * my
        yy = moments[7, k] / n - my * my
        root = math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        along, across = 0.5 * (xx + yy) + root, 0.5 * (xx + yy) - root
        # Else a corner, a blob, or both faces of a thin wall: no line.
        moments[2, k] = (n >= MIN_WEIGHT) & (across <= LINE_RATIO * along)
        moments[3, k], moments[4, k], moments[5, k], moments[6, k] = mx, my, xx - yy, xy
    assigned = 0
    for k in range(points.shape[0]):
        if moments[2, k] == 0.0:
            continue
        mx, my = moments[3, k], moments[4, k]
        direction = 0.5 * math.atan2(2.0 * moments[6, k], moments[5, k])
        nx, ny = -math.sin(direction), math.cos(direction)
        if abs(nx * mx + ny * my) * resolution > settings.gate:
            continue
        lines[assigned, 0], lines[assigned, 1] = points[k, 0], points[k, 1]
        lines[assigned, 2] = (moments[0, k] + mx) * resolution + origin_x
        lines[assigned, 3] = (moments[1, k] + my) * resolution + origin_y
        lines[assigned, 4], lines[assigned, 5] = nx, ny
        assigned += 1
    return assigned


@njit(cache=True)
def _refine(surface, points, predicted, start, settings, workspace):
    """Gauss-Newton on Cauchy-weighted distances to lines, pulled to the prediction; pose and share of returns used."""
    x, y, yaw = start
    x0, y0, yaw0 = predicted
    translation_weight, rotation_weight = settings.translation_weight, settings.rotation_weight
    residual_scale = settings.residual_scale
    lines = workspace.lines
    n = points.shape[0]
    assigned = 0
    for association in range(settings.associations):
        assigned = _assign(surface, points, (x, y, yaw), settings, association > 0, workspace)
        for _ in range(settings.iterations):
            h00, h11, h22 = translation_weight, translation_weight, rotation_weight
            h01 = h02 = h12 = 0.0
            g0, g1, g2 = translation_weight * (x0 - x), translation_weight * (y0 - y), rotation_weight * (yaw0 - yaw)
            c, s = math.cos(yaw), math.sin(yaw)
            for k in range(assigned):
                px = c * lines[k, 0] - s * lines[k, 1]
                py = s * lines[k, 0] + c * lines[k, 1]
                nx, ny = lines[k, 4], lines[k, 5]
                r = nx * (lines[k, 2] - x - px) + ny * (lines[k, 3] - y - py)
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
