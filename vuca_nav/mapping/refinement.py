"""The refinement of an alignment: Gauss-Newton on lines, normals and points, pulled to the prediction."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit

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
ABSOLUTE = 1e9
"""Weight that holds the pose at the prediction along a direction that the returns say nothing about."""


class RefinementSettings(NamedTuple):
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


class Workspace(NamedTuple):
    """Scratch arrays of the kernels, allocated once."""

    cells: np.ndarray
    """(n, 5) int64: row and column of the return's cell, those of the cell that ``means`` were collected about, and how
    many they are."""
    means: np.ndarray
    """(n, WINDOW_CELLS, 3) mean returns about the cell: column, row, weight."""
    moments: np.ndarray
    """(8, n) as in ``_assign``."""
    lines: np.ndarray
    """(2 n, 7) residuals: the return in base_link [m], a point of the surface in the map [m], a normal, a weight."""


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
def _assign(surface, returns, pose, settings, again, workspace):
    """Find the surface about each return: residuals into ``workspace.lines``.

    Most returns are in the cell where they were when surfaces were last assigned (``again``): their neighbourhoods are
    kept.

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
        # Else a corner, a blob, both faces of a thin wall, or too few returns: no line.
        moments[2, k] = (n >= MIN_WEIGHT) & (across <= LINE_RATIO * along)
        moments[3, k], moments[4, k], moments[5, k], moments[6, k] = mx, my, xx - yy, xy
    used = matched = contradicted = 0
    gate = settings.gate * per_metre
    for k in range(points.shape[0]):
        if cells[k, 4] == 0:
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
            for m in range(cells[k, 4]):
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
def refine(surface, returns, prior, start, settings, workspace, information):
    """Gauss-Newton on Cauchy-weighted residuals, pulled to the prediction.

    Args:
        surface: The submap.
        returns: (n, 2) returns and (n, 2) their scan's normals, in base_link.
        prior: The prediction x, y, yaw in the submap's frame, and the pulls of position and yaw to it, in returns.
        start: Pose to begin at.
        settings: Settings.
        workspace: Scratch arrays.
        information: (3, 3) written to: what the returns say of the pose.

    Returns:
        x, y, yaw; shares of the matched returns, of their weights, and of the contradicted ones; whether there is a
        direction that the returns say nothing about.
    """
    x, y, yaw = start
    (x0, y0, yaw0), (pull_position, pull_yaw) = prior
    lines = workspace.lines
    n = max(returns[0].shape[0], 1)
    per_return = 1.0 / settings.return_deviation**2
    matched = contradicted = 0
    fit = 0.0
    is_degenerate = False
    h = information
    for association in range(settings.associations):
        used, matched, contradicted = _assign(surface, returns, (x, y, yaw), settings, association > 0, workspace)
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
