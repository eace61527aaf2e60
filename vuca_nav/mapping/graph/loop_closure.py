"""Loop closure: whether what the robot sees now is a place of a finished submap, and where in it the robot stands."""

import functools
import math
from collections import OrderedDict
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.geometry import between, transform_points
from vuca_nav.mapping.alignment import Aligner, Alignment, AlignmentConfig, Spread
from vuca_nav.mapping.graph.branch_and_bound import Pyramid, Window, build_pyramid, score_along, search
from vuca_nav.mapping.submaps import Keyframe
from vuca_nav.mapping.surfaces import PackedSurfaces, Surface
from vuca_nav.types import STANDING, FloatArray, Pose2

_SLIDES = np.array([-3.0, -2.0, -1.4, -1.0, -0.7, -0.5, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0])
"""Where else along a line the returns of a closure are tried [m]."""


@dataclass(frozen=True, slots=True)
class ClosureConfig:
    """Settings of the search for closures and of their acceptance."""

    bundle: int = 10
    """Number of last keyframes whose returns are matched together: one scan alone fits in many places."""
    search_points: int = 150
    """Returns that the search looks at."""
    refined_points: int = 600
    """Returns that the refinement looks at."""
    angular_step: float = 0.0125
    """Step of the search [rad]."""
    least_score: float = 0.35
    """Mean value of the returns' cells that the search must find."""
    least_matched: float = 0.75
    """Share of the returns that must lie on the submap's surfaces after refinement."""
    most_contradicted: float = 0.1
    """Share of the returns that may lie where the submap is surely free."""
    apart: float = 0.03
    """Where the search has found a place so far from where the robot should be [m] ..."""
    apart_yaw: float = 0.01
    """... or this [rad], both are refined, and the better fit wins."""
    position_floor: float = 0.01
    """Deviation of a closure however many returns it rests on [m]."""
    yaw_floor: float = 0.003
    """[rad]"""
    factor: float = 9.0
    """Returns of one place err alike: their covariance is so many times what it would be if they did not."""
    weakest: float = 0.02
    """A direction of which the returns say less than this share of what they say of the best is left open."""
    alike: float = 0.85
    """Where returns fit this well, as a share of the best fit, at another place along the direction that they say least
    of, the direction is left open."""
    lever: float = 3.0
    """Length by which a yaw and a position are compared for that [m]."""
    kept: int = 24
    """Submaps that are held ready to be searched in."""


class Bundle(NamedTuple):
    """Returns of the last keyframes about the latest of them."""

    local_from_base: Pose2
    submap: int
    """Number of the submap that it was matched to."""
    points: FloatArray
    """(n, 2) in base_link [m]."""
    normals: FloatArray
    """(n, 2)"""


class Closure(NamedTuple):
    """A place found again."""

    local_from_base: Pose2
    """Where the robot is by the old submap."""
    information: FloatArray
    """(3, 3) inverse covariance of it, in base_link's axes."""
    matched: float
    """Share of matched returns."""


class _Ready(NamedTuple):
    surface: Surface
    pyramid: Pyramid


@functools.cache
def warm_up(alignment: AlignmentConfig) -> None:
    """Compile what a search needs, or load it, once a process: the first closure would stall the loop for a second."""
    level = np.zeros((100, 100), np.int8)
    level[20:80, 20] = level[20, 20:80] = 1
    cells = np.flatnonzero(level).astype(np.int32)
    mean, count = np.full((len(cells), 2), 0.5, np.float32), np.ones(len(cells), np.uint8)
    corner = PackedSurfaces(level, cells, mean, count, (0.0, 0.0), 0.05, 1)
    along = np.arange(1.025, 3.0, 0.05)
    points = np.concatenate([np.column_stack([along, 0 * along + 1.025]), np.column_stack([0 * along + 1.025, along])])
    bundle = Bundle(STANDING, 0, points, np.zeros_like(points))
    ClosureSearch(alignment).find(0, corner, bundle, STANDING, Spread(0.3, 0.05))


def bundle_of(keyframes: list[Keyframe], config: ClosureConfig) -> Bundle:
    """Collect the returns of the last keyframes, one for each cell of 5 cm."""
    latest = keyframes[-1]
    points, normals = [], []
    for keyframe in keyframes[-config.bundle :]:
        base_from_then = between(latest.local_from_base, keyframe.local_from_base)
        points.append(transform_points(base_from_then, keyframe.points.astype(np.float64)))
        turn = Pose2(0.0, 0.0, base_from_then.yaw)
        normals.append(transform_points(turn, keyframe.normals.astype(np.float64)))
    all_points, all_normals = np.concatenate(points), np.concatenate(normals)
    cells = np.floor(all_points / 0.05).astype(np.int64)
    _, first = np.unique(cells[:, 0] * 1_000_003 + cells[:, 1], return_index=True)
    first = _thinned(first, config.refined_points)
    return Bundle(latest.local_from_base, latest.submap, all_points[first], all_normals[first])


def _thinned(index: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of them, evenly."""
    if len(index) <= most:
        return index
    return index[np.arange(most) * len(index) // most]


class ClosureSearch:
    """Looks for bundles in finished submaps."""

    def __init__(self, alignment: AlignmentConfig, config: ClosureConfig = ClosureConfig()):
        self.config = config
        self._aligner = Aligner(alignment, config.refined_points)
        self._ready: OrderedDict[int, _Ready] = OrderedDict()

    def find(
        self, number: int, submap: PackedSurfaces, bundle: Bundle, centre: Pose2, spread: Spread
    ) -> Closure | None:
        """Look for a bundle in a submap.

        Args:
            number: The submap's number.
            submap: The submap.
            bundle: The returns.
            centre: Where the robot should be in the submap's local frame.
            spread: Half widths of the window [m, rad].

        Returns:
            The closure, None if there is none.
        """
        c, ready = self.config, self.prepare(number, submap)
        if len(bundle.points) < 30:
            return None
        few = bundle.points[_thinned(np.arange(len(bundle.points)), c.search_points)]
        window = Window(centre, spread.position, spread.yaw, c.angular_step)
        found = search(ready.pyramid, np.ascontiguousarray(few), window, c.least_score)
        if found is None:
            return None
        fit = self._refined(ready.surface, found.pose, bundle)
        away = between(centre, fit.pose)
        if math.hypot(away.x, away.y) > c.apart or abs(away.yaw) > c.apart_yaw:
            # Along a corridor one place looks like another: where the robot should be counts for something.
            there = self._refined(ready.surface, centre, bundle)
            third = Spread(spread.position / 3.0, spread.yaw / 3.0)
            fit = max(fit, there, key=lambda one: self._aligner.worth(one, centre, third))
        if fit.matched < c.least_matched or fit.contradicted > c.most_contradicted:
            return None
        off = between(centre, fit.pose)
        if math.hypot(off.x, off.y) > 1.5 * spread.position + 0.1 or abs(off.yaw) > 1.2 * spread.yaw + 0.02:
            return None
        return Closure(fit.pose, self._information(ready.pyramid, few, fit), fit.matched)

    def _refined(self, surface: Surface, start: Pose2, bundle: Bundle) -> Alignment:
        """The fit about a pose, without a pull."""
        return self._aligner.refine(surface, start, bundle.points, bundle.normals, start, Spread(1.0, 1.0))

    def _information(self, pyramid: Pyramid, points: FloatArray, fit: Alignment) -> FloatArray:
        """Inverse covariance in base_link's axes; directions that the returns do not show are left open."""
        c, deviation = self.config, self._aligner.config.return_deviation
        by_returns, yaw = fit.information, fit.pose.yaw
        cos, sin = math.cos(yaw), math.sin(yaw)
        local_from_base = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        scale = np.diag([1.0, 1.0, 1.0 / c.lever])
        scaled = scale @ local_from_base.T @ by_returns @ local_from_base @ scale
        values, vectors = np.linalg.eigh(scaled)
        x, y, _ = vectors[:, 0]
        length = math.hypot(x, y)
        if length > 0.5 and self._slides(
            pyramid, points, fit.pose, ((cos * x - sin * y) / length, (sin * x + cos * y) / length)
        ):
            values[0] = 0.0
        floor = (c.position_floor**2, c.position_floor**2, (c.yaw_floor * c.lever) ** 2)
        total = np.zeros((3, 3))
        for value, vector in zip(values, vectors.T):
            if value > c.weakest * values[-1]:
                variance = c.factor * deviation**2 / value + float((vector**2 * np.array(floor)).sum())
                total += np.outer(vector, vector) / variance
        unscale = np.diag([1.0, 1.0, c.lever])
        return unscale @ total @ unscale

    def _slides(self, pyramid: Pyramid, points: FloatArray, pose: Pose2, direction: tuple[float, float]) -> bool:
        """Whether the returns fit elsewhere along a line, too, as along a corridor."""
        here = score_along(pyramid, points, pose, direction, np.zeros(1))
        return score_along(pyramid, points, pose, direction, _SLIDES) > self.config.alike * here

    def is_ready(self, number: int) -> bool:
        """Whether a submap can be searched in at once."""
        return number in self._ready

    def prepare(self, number: int, submap: PackedSurfaces) -> _Ready:
        """The submap unpacked, with its pyramid; those used last are kept."""
        if number in self._ready:
            self._ready.move_to_end(number)
            return self._ready[number]
        ready = _Ready(submap.surface(), build_pyramid(submap.level > 0, submap.origin, submap.resolution))
        self._ready[number] = ready
        if len(self._ready) > self.config.kept:
            self._ready.popitem(last=False)
        return ready
