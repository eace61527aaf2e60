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
from vuca_nav.mapping.refinement import WINDOW_CELLS, RefinementSettings, Workspace, refine
from vuca_nav.mapping.surfaces import Surface
from vuca_nav.types import FloatArray, Pose2

TIE = 1e-12
"""Scores nearer to each other than this are equal, and the prediction wins."""


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
    least_position: float = 0.0
    """The search goes at least as far as if ``position`` were this [m]: what was learnt to err little may slip."""
    least_yaw: float = 0.0
    """[rad]"""


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
        self._settings = RefinementSettings(
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
            np.empty((most_points, 5), np.int64),
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
        near = (
            c.deviations * max(spread.position, spread.least_position),
            c.deviations * max(spread.yaw, spread.least_yaw),
        )
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
        x, y, yaw, matched, fit, contradicted, is_degenerate = refine(
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
