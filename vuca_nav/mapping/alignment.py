"""Scan to submap: correlative search for the basin, Gauss-Newton on lines, normals and points for the rest.

In two steps like Cartographer's local SLAM (Hess et al. 2016, Section IV). The prediction comes with its spread, which
sets the search's window and the pull back to the prediction. Along directions that the returns say nothing about the
prediction stands (Zhang, Kaess and Singh 2016, "On degeneracy of optimization-based state estimation problems").

A return is matched to the line through the mean returns of the cells about it. Where they show no line, on new ground
that few scans have seen, it is matched to the nearest mean along its own scan's normal; where that has none either, to
the nearest mean as a point, with little weight.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vuca_nav.geometry import between, wrap_angle
from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.surfaces import Surface
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
TIE = 1e-12
"""Scores nearer to each other than this are equal, and the prediction wins."""
ABSOLUTE = 1e9
"""Weight that holds the pose at the prediction along a direction that the returns say nothing about."""


class Spread(NamedTuple):
    """How far a prediction may be off: standard deviations, and the motion that it comes from."""

    position: float
    """Along each of x and y [m]."""
    yaw: float
    """[rad]"""
    way: float = 0.0
    """Way since the last match [m]."""
    turn: float = 0.0
    """Turning since the last match [rad]."""


@dataclass(frozen=True, slots=True)
class AlignmentConfig:
    """Settings of the alignment."""

    deviations: float = 3.0
    """The search goes this many standard deviations from the prediction each way ..."""
    slip: float = 2.0
    """... or this many times as far as odometry has gone: wheels may slip, and an odometer has the wrong sign."""
    spin: float = 1.0
    """... and in yaw this many times as far as it has turned."""
    widest_position: float = 0.5
    """... but no farther than this [m] ..."""
    widest_yaw: float = 0.6
    """... and this [rad]."""
    angular_step: float = 0.01
    """Step of the search in yaw: a cell at 5 m [rad]."""
    search_points: int = 120
    """The search looks at about so many of the returns."""
    apart: float = 0.075
    """Where the best pose within a few deviations and the best one farther out are so far apart [m] ..."""
    apart_yaw: float = 0.025
    """... or this [rad], both are refined, and the better fit wins."""
    preference: float = 0.03
    """A candidate m standard deviations from the prediction loses this share of its score times log(1 + m^2), so that
    among equals the likeliest wins."""
    residual_scale: float = 0.03
    """Distance at which a return's weight has fallen to a half (Cauchy) [m]: 1.5 sigma of range noise."""
    gate: float = 0.12
    """A return farther than this from every known surface has no part in the match [m]."""
    normal_weight: float = 0.5
    """Weight of a return that is matched along its own scan's normal."""
    point_weight: float = 0.1
    """Weight of a return that is matched to a point."""
    return_deviation: float = 0.02
    """Standard deviation of what one return says [m]: it weighs the returns against the prediction."""
    least_share: float = 0.005
    """A direction along which the returns say less than this share of what they could say is left to odometry: it
    is what an error of 4 degrees in their normals feigns."""
    surely_free: int = -5
    """Level from which a cell is known to be free: five scans saw through it, and none met anything."""
    associations: int = 3
    """Number of times that returns are assigned to surfaces."""
    iterations: int = 2
    """Gauss-Newton steps for each assignment."""


class AlignmentSettings(NamedTuple):
    """The settings of ``AlignmentConfig`` that the refinement takes."""

    residual_scale: float
    gate: float
    normal_weight: float
    point_weight: float
    return_deviation: float
    least_share: float
    surely_free: int
    associations: int
    iterations: int


class SearchWindow(NamedTuple):
    """The candidates of the correlative search, in steps about the prediction."""

    stride: int
    """Stride of the search over the returns."""
    n_linear: int
    """Cells each way along x and y."""
    n_angular: int
    angular_step: float
    """[rad]"""
    preference: float
    """See ``AlignmentConfig``."""
    per_metre: float
    """Squared deviations of a squared metre."""
    per_radian: float
    """... of a squared radian."""


class Alignment(NamedTuple):
    """The pose at which a scan fits, and how well."""

    pose: Pose2
    """Pose of the base in the submap's frame."""
    matched: float
    """Share of the returns that lie on a known surface."""
    fit: float
    """Mean weight of the returns by their distance from the surfaces: 1 if all are on them, 0 if none is near any."""
    contradicted: float
    """Share of the returns that lie where the submap is surely free; the rest is new ground."""
    information: FloatArray
    """(3, 3) what the returns say of x, y and yaw about the base, in returns; the pull has no part in it."""
    is_degenerate: bool
    """Whether there is a direction that the returns say nothing about."""

    @property
    def quality(self) -> float:
        """Share of the matched ones among the returns that the submap knows something about; 1 on new ground."""
        known = self.matched + self.contradicted
        return self.matched / known if known > 0.0 else 1.0


class Workspace(NamedTuple):
    """Scratch arrays of the kernels, allocated once."""

    cells: np.ndarray
    """(n, 4) int64: row and column of the return's cell, where ``means`` were collected about, how many they are."""
    means: np.ndarray
    """(n, WINDOW_CELLS, 3) mean returns about the cell: column, row, weight."""
    moments: np.ndarray
    """(8, n) as in ``_assign``."""
    lines: np.ndarray
    """(2 n, 7) residuals: the return in base_link [m], a point of the surface in the map [m], a normal, a weight."""


def squared_deviations(predicted: Pose2, pose: Pose2, spread: Spread) -> float:
    """Squared distance of a pose from its prediction, in standard deviations."""
    off = between(predicted, pose)
    away = (off.x * off.x + off.y * off.y) / max(spread.position, 1e-3) ** 2
    return away + (off.yaw / max(spread.yaw, 1e-3)) ** 2


class Aligner:
    """Fits returns to the surfaces of a submap.

    Args:
        config: Settings.
        most_points: Greatest number of returns.
    """

    def __init__(self, config: AlignmentConfig, most_points: int):
        self.config = c = config
        self._settings = AlignmentSettings(
            c.residual_scale,
            c.gate,
            c.normal_weight,
            c.point_weight,
            c.return_deviation,
            c.least_share,
            c.surely_free,
            c.associations,
            c.iterations,
        )
        self._workspace = Workspace(
            np.empty((most_points, 4), np.int64),
            np.empty((most_points, WINDOW_CELLS, 3)),
            np.empty((8, most_points)),
            np.empty((2 * most_points, 7)),
        )

    def align(
        self, surface: Surface, predicted: Pose2, spread: Spread, points: FloatArray, normals: FloatArray
    ) -> Alignment:
        """Find the pose at which the returns lie on the submap's surfaces.

        Args:
            surface: The submap.
            predicted: Pose of the base in the submap's frame.
            spread: How far that may be off.
            points: (n, 2) returns in base_link [m].
            normals: (n, 2) their scan's normals, or zeros.
        """
        c = self.config
        near_start, far_start = predicted, predicted
        near = c.deviations * spread.position, c.deviations * spread.yaw
        far = max(near[0], c.slip * spread.way), max(near[1], c.spin * spread.turn)
        near_start = self._searched(surface, predicted, spread, near, points)
        best = self.refine(surface, near_start, points, normals, predicted, spread)
        if far > near:
            far_start = self._searched(surface, predicted, spread, far, points)
            away = between(near_start, far_start)
            if math.hypot(away.x, away.y) > c.apart or abs(away.yaw) > c.apart_yaw:
                other = self.refine(surface, far_start, points, normals, predicted, spread)
                if self.worth(other, predicted, spread) > self.worth(best, predicted, spread):
                    best = other
        return best

    def worth(self, alignment: Alignment, predicted: Pose2, spread: Spread) -> float:
        """Fit of an alignment, less what its distance from the prediction costs."""
        away = squared_deviations(predicted, alignment.pose, spread)
        return alignment.fit - self.config.preference * math.log(1.0 + away)

    def _searched(
        self, surface: Surface, predicted: Pose2, spread: Spread, widths: tuple[float, float], points: FloatArray
    ) -> Pose2:
        """Best pose of a window of these half widths [m, rad]."""
        c = self.config
        n_linear = int(min(widths[0], c.widest_position) / surface.resolution + 0.5)
        n_angular = int(min(widths[1], c.widest_yaw) / c.angular_step + 0.5)
        if n_linear == 0 and n_angular == 0:
            return predicted
        window = SearchWindow(
            max(1, len(points) // c.search_points),
            n_linear,
            n_angular,
            c.angular_step,
            c.preference,
            1.0 / max(spread.position, 1e-3) ** 2,
            1.0 / max(spread.yaw, 1e-3) ** 2,
        )
        return Pose2(*_search(surface, points, predicted, window))

    def refine(
        self,
        surface: Surface,
        start: Pose2,
        points: FloatArray,
        normals: FloatArray,
        predicted: Pose2,
        spread: Spread,
    ) -> Alignment:
        """The refinement alone, from ``start`` on; ``align`` says the rest."""
        deviation = self.config.return_deviation
        pull = (
            (deviation / max(spread.position, 1e-5)) ** 2,
            (deviation / max(spread.yaw, 1e-5)) ** 2,
        )
        information = np.zeros((3, 3))
        x, y, yaw, matched, fit, contradicted, is_degenerate = _refine(
            surface, (points, normals), (predicted, pull), start, self._settings, self._workspace, information
        )
        return Alignment(Pose2(x, y, wrap_angle(yaw)), matched, fit, contradicted, information, is_degenerate)


@njit(cache=True)
def _search(surface, points, predicted, window):
    """Find the candidate with the greatest mean level of the occupied cells that returns fall in; x, y and yaw.

    Candidates are whole cells apart, so that one look-up goes to the return's cell and a fixed offset from there.
    """
    level = surface.level.ravel()
    rows, columns = surface.level.shape
    x0, y0, yaw0 = predicted
    n, step = window.n_linear, surface.resolution
    per_metre = 1.0 / step
    full_marks = surface.limit * max((points.shape[0] + window.stride - 1) // window.stride, 1)
    cells = np.empty(points.shape[0] // window.stride + 1, np.int32)
    best, best_x, best_y, best_yaw = -1e9, x0, y0, yaw0
    for a in range(-window.n_angular, window.n_angular + 1):
        yaw = yaw0 + a * window.angular_step
        c, s = math.cos(yaw), math.sin(yaw)
        count = 0
        for k in range(0, points.shape[0], window.stride):
            i = int(math.floor((y0 + s * points[k, 0] + c * points[k, 1] - surface.origin_y) * per_metre))
            j = int(math.floor((x0 + c * points[k, 0] - s * points[k, 1] - surface.origin_x) * per_metre))
            if n <= i < rows - n and n <= j < columns - n:
                cells[count] = i * columns + j
                count += 1
        turned = (a * window.angular_step) ** 2 * window.per_radian
        for v in range(-n, n + 1):
            for u in range(-n, n + 1):
                offset = v * columns + u
                total = 0
                for k in range(count):
                    total += max(level[np.uint64(cells[k] + offset)], 0)
                away = turned + (u * u + v * v) * step * step * window.per_metre
                score = total / full_marks * (1.0 - window.preference * math.log(1.0 + away))
                # A tie goes to the prediction: strictly better, or nearer.
                if score > best + TIE or (score > best - TIE and u == 0 and v == 0 and a == 0):
                    best, best_x, best_y, best_yaw = score, x0 + u * step, y0 + v * step, yaw
    return best_x, best_y, best_yaw


@njit(cache=True)
def _gather(surface, num_points, workspace):
    """Collect the mean returns about the cells of all returns.

    The occupied cells are found first, without an unpredictable branch: an entry that is not occupied is overwritten by
    the next one. An occupied cell has a mean.
    """
    level, mean, count = surface.level.ravel(), surface.mean.ravel(), surface.count.ravel()
    means, cells = workspace.means, workspace.cells
    occupied = np.empty(WINDOW_CELLS + 1, np.int64)
    rows, columns = surface.level.shape
    for k in range(num_points):
        i, j = cells[k, 0], cells[k, 1]
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
        cells[k, 2] = n


@njit(cache=True, error_model="numpy")
def _assign(surface, returns, pose, settings, workspace):
    """Find the surface about each return: residuals into ``workspace.lines``.

    Returns:
        The number of residuals, of returns that have one, and of returns on surely free ground.
    """
    points, normals = returns
    origin_x, origin_y, resolution = surface.origin_x, surface.origin_y, surface.resolution
    cells, means, moments, lines = workspace.cells, workspace.means, workspace.moments, workspace.lines
    level = surface.level
    rows, columns = level.shape
    per_metre = 1.0 / resolution
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(points.shape[0]):
        # Everything below in cells, from the return.
        fx = (x + c * points[k, 0] - s * points[k, 1] - origin_x) * per_metre
        fy = (y + s * points[k, 0] + c * points[k, 1] - origin_y) * per_metre
        moments[0, k], moments[1, k] = fx, fy
        cells[k, 0], cells[k, 1] = int(math.floor(fy)), int(math.floor(fx))
    _gather(surface, points.shape[0], workspace)
    for k in range(points.shape[0]):
        fx, fy = moments[0, k], moments[1, k]
        n = mx = my = xx = xy = yy = 0.0
        for m in range(cells[k, 2]):
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
        # Else a corner, a blob, both faces of a thin wall, or too few returns: no line.
        moments[2, k] = (n >= MIN_WEIGHT) & (across <= LINE_RATIO * along)
        moments[3, k], moments[4, k], moments[5, k], moments[6, k] = mx, my, xx - yy, xy
    used = matched = contradicted = 0
    gate = settings.gate * per_metre
    for k in range(points.shape[0]):
        if cells[k, 2] == 0:
            i, j = cells[k, 0], cells[k, 1]
            if 0 <= i < rows and 0 <= j < columns and level[i, j] <= settings.surely_free:
                contradicted += 1
            continue
        weight = 1.0
        if moments[2, k] != 0.0:
            dx, dy = moments[3, k], moments[4, k]
            direction = 0.5 * math.atan2(2.0 * moments[6, k], moments[5, k])
            nx, ny = -math.sin(direction), math.cos(direction)
            if abs(nx * dx + ny * dy) > gate:
                continue
        else:
            dx = dy = 0.0
            nearest = 1e9
            for m in range(cells[k, 2]):
                u, v = means[k, m, 0] - moments[0, k], means[k, m, 1] - moments[1, k]
                if u * u + v * v < nearest:
                    nearest, dx, dy = u * u + v * v, u, v
            if nearest > gate * gate:
                continue
            nx = c * normals[k, 0] - s * normals[k, 1]
            ny = s * normals[k, 0] + c * normals[k, 1]
            weight = settings.normal_weight
            if nx == 0.0 and ny == 0.0:
                weight, nx = settings.point_weight, 1.0
        matched += 1
        while True:
            lines[used, 0], lines[used, 1] = points[k, 0], points[k, 1]
            lines[used, 2] = (moments[0, k] + dx) * resolution + origin_x
            lines[used, 3] = (moments[1, k] + dy) * resolution + origin_y
            lines[used, 4], lines[used, 5], lines[used, 6] = nx, ny, weight
            used += 1
            if weight != settings.point_weight or ny == 1.0:
                break
            nx, ny = 0.0, 1.0  # the point's other residual
    return used, matched, contradicted


@njit(cache=True)
def _refine(surface, returns, prior, start, settings, workspace, information):
    """Gauss-Newton on Cauchy-weighted residuals, pulled to the prediction."""
    x, y, yaw = start
    (x0, y0, yaw0), (pull_position, pull_yaw) = prior
    lines = workspace.lines
    n = max(returns[0].shape[0], 1)
    per_return = 1.0 / settings.return_deviation**2
    matched = contradicted = 0
    fit = 0.0
    is_degenerate = False
    h = information
    for _association in range(settings.associations):
        used, matched, contradicted = _assign(surface, returns, (x, y, yaw), settings, workspace)
        for _ in range(settings.iterations):
            h00 = h11 = h22 = h01 = h02 = h12 = g0 = g1 = g2 = total = turning = fit = 0.0
            c, s = math.cos(yaw), math.sin(yaw)
            for k in range(used):
                px = c * lines[k, 0] - s * lines[k, 1]
                py = s * lines[k, 0] + c * lines[k, 1]
                nx, ny = lines[k, 4], lines[k, 5]
                r = nx * (lines[k, 2] - x - px) + ny * (lines[k, 3] - y - py)
                w = 1.0 / (1.0 + (r / settings.residual_scale) ** 2)
                fit += w if lines[k, 6] != settings.point_weight else 0.5 * w
                w *= lines[k, 6]
                j2 = ny * px - nx * py
                total += w
                turning += w * (px * px + py * py)
                h00 += w * nx * nx
                h01 += w * nx * ny
                h02 += w * nx * j2
                h11 += w * ny * ny
                h12 += w * ny * j2
                h22 += w * j2 * j2
                g0 += w * nx * r
                g1 += w * ny * r
                g2 += w * j2 * r
            h[0, 0], h[1, 1], h[2, 2] = h00, h11, h22
            h[0, 1] = h[1, 0] = h01
            h[0, 2] = h[2, 0] = h02
            h[1, 2] = h[2, 1] = h12
            dx, dy, dyaw = x0 - x, y0 - y, yaw0 - yaw
            # Odometry's errors have long tails: the farther it is off, the weaker its pull (Cauchy, too).
            away = per_return * ((dx * dx + dy * dy) * pull_position + dyaw * dyaw * pull_yaw)
            here_position, here_yaw = pull_position / (1.0 + away), pull_yaw / (1.0 + away)
            # What the returns say of the yaw with the position free: nothing in a round hall.
            det = h00 * h11 - h01 * h01
            known = h22
            if det > 1e-9 * total * total:
                known -= (h02 * (h11 * h02 - h01 * h12) + h12 * (h00 * h12 - h01 * h02)) / det
            turns_freely = known <= settings.least_share * turning
            # The direction along which they say least: along a bare corridor nothing.
            a00, a01, a11 = h00, h01, h11
            if not turns_freely:
                a00, a01, a11 = h00 - h02 * h02 / h22, h01 - h02 * h12 / h22, h11 - h12 * h12 / h22
            least = 0.5 * (a00 + a11) - math.sqrt(0.25 * (a00 - a11) ** 2 + a01 * a01)
            slides_freely = least <= settings.least_share * total
            is_degenerate = turns_freely or slides_freely
            h00 += here_position
            h11 += here_position
            g0 += here_position * dx
            g1 += here_position * dy
            weight = ABSOLUTE if turns_freely else here_yaw
            h22 += weight
            g2 += weight * dyaw
            if slides_freely:
                direction = 0.5 * math.atan2(2.0 * a01, a00 - a11) + 0.5 * math.pi
                ux, uy = math.cos(direction), math.sin(direction)
                off = ux * dx + uy * dy
                h00 += ABSOLUTE * ux * ux
                h01 += ABSOLUTE * ux * uy
                h11 += ABSOLUTE * uy * uy
                g0 += ABSOLUTE * ux * off
                g1 += ABSOLUTE * uy * off
            # Solve the symmetric 3 x 3 system by Cholesky: cofactors would cancel beside the absolute weight.
            l00 = math.sqrt(h00)
            l10, l20 = h01 / l00, h02 / l00
            l11 = math.sqrt(max(h11 - l10 * l10, 1e-12))
            l21 = (h12 - l20 * l10) / l11
            l22 = math.sqrt(max(h22 - l20 * l20 - l21 * l21, 1e-12))
            z0 = g0 / l00
            z1 = (g1 - l10 * z0) / l11
            z2 = (g2 - l20 * z0 - l21 * z1) / l22
            step_yaw = z2 / l22
            step_y = (z1 - l21 * step_yaw) / l11
            step_x = (z0 - l10 * step_y - l20 * step_yaw) / l00
            x += step_x
            y += step_y
            yaw += step_yaw
    return x, y, yaw, matched / n, fit / n, contradicted / n, is_degenerate
