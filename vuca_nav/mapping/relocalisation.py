"""Finding a robot again that has lost its place: a search of all submaps, then a contest of what it has found.

One scan is looked for everywhere in the map and in every direction, by branch and bound (Hess et al. 2016, Section
V-B), a few tiles of the map at a time. Places that fit nearly as well as the best one all stay in the running: from
then on each follows the robot's motion and is matched to each further scan. Only when one alone is left, and fits, has
the robot been found; as long as two rooms look alike it has not, and has to go and look.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.geometry import compose, distance, inverse, transform_points, wrap_angle
from vuca_nav.mapping.alignment import Aligner, Alignment, AlignmentConfig, Spread
from vuca_nav.mapping.graph.branch_and_bound import Pyramid, Window, build_pyramid, search
from vuca_nav.mapping.returns import Returns
from vuca_nav.mapping.submaps import SubmapStore
from vuca_nav.mapping.surfaces import Surface
from vuca_nav.types import STANDING, FloatArray, LidarSpec, Pose2

RESOLUTION = 0.05
"""Side of the cells in which a place is looked for [m]."""
_TILE = 1.55
"""Side of the tiles that are searched one by one [m]: all poses of one are under one node of the pyramid."""
_BEYOND = 2
"""Tiles beyond free ground that are searched, too: the robot may have been carried into a room that it has not seen."""
_SLIDES = (-1.2, -0.8, -0.4, 0.4, 0.8, 1.2)
"""Where else along the direction that the returns say least of the robot may be, as in a corridor [m]."""


_ABOUT = Spread(0.17, 0.02)
"""How far a place that the search has found may be off: it is the best of its tile, by few returns."""


@dataclass(frozen=True, slots=True)
class RelocalisationConfig:
    """Settings of the search and of the contest."""

    search_points: int = 90
    """Returns that the search looks at."""
    angular_step: float = 0.02
    """Step of the search in yaw [rad]."""
    sectors: int = 8
    """Parts of the full circle that are searched one by one."""
    tiles: float = 240.0
    """Tiles that are searched in a second."""
    rivals: int = 12
    """Greatest number of places that stay in the running."""
    block: float = 48.0
    """Side of the squares into which the map is cut for the search, the one about the robot first [m] ..."""
    margin: float = 20.0
    """... and how far the returns of a robot inside may lie outside [m]."""
    least_score: float = 0.25
    """Mean value of the returns' cells that the search must find."""
    kept: float = 0.65
    """A place whose score is less than this share of the best one's is out: of one at the border of what is mapped only
    a part of the returns can match."""
    most: int = 40
    """Greatest number of places that are refined."""
    apart: float = 0.4
    """Places nearer than this [m] ..."""
    apart_yaw: float = 0.2
    """... and this [rad] are one."""
    forgetting: float = 0.1
    """Share of a scan in the running means of a place."""
    least_scans: int = 6
    """Scans that a place has to stand before it is taken."""
    least_matched: float = 0.4
    """Mean share of matched returns from which on a place is taken; the others lie on new ground ..."""
    most_contradicted: float = 0.1
    """... and no more than this share on surely free ground."""
    surely_matched: float = 0.85
    """Mean share of matched returns from which on a place is sure."""
    rival: float = 0.96
    """A sure place is taken only if no other one is worth more than this share of what it is worth ..."""
    rival_of_unsure: float = 0.8
    """... and one that is not sure, if no other one is worth more than this share."""
    out: float = 0.6
    """A place that is worth less than this share of the best one is out."""
    moved: float = 0.7
    """Way after which a search begins anew while places are alike [m]."""
    patience: int = 45
    """Scans after which a search begins anew if no place is good enough."""
    deviation_factor: float = 9.0
    """Returns of one place err alike: their covariance is so many times what it would be if they did not."""


class Found(NamedTuple):
    """The robot found again."""

    submap: int
    local_from_base: Pose2
    covariance: FloatArray
    """(3, 3) of that, in the local frame's axes [m, rad]."""


@dataclass(slots=True)
class _Place:
    """Where the robot may be."""

    submap: int
    local_from_base: Pose2
    alignment: Alignment
    worth: float
    """Running mean of the fit, less the share of contradicted returns."""
    matched: float
    contradicted: float
    """Running means."""


class _Block(NamedTuple):
    """A square part of the map, ready to be searched."""

    pyramid: Pyramid
    tiles: list[tuple[float, float]]
    """Centres of the tiles with free ground in or near them [m]."""


class Relocaliser:
    """``begin`` when the robot is lost, then ``update`` with each scan until it is found.

    Args:
        alignment: Settings of the match.
        lidar: The lidar.
        config: Settings.
    """

    def __init__(
        self, alignment: AlignmentConfig, lidar: LidarSpec, config: RelocalisationConfig = RelocalisationConfig()
    ):
        self.config = config
        self._aligner = Aligner(alignment, lidar.num_beams)
        self._tiles = max(1, round(config.tiles / lidar.rate))
        self.begin()

    def begin(self) -> None:
        """Begin anew, with the next scan; what was found so far is forgotten."""
        self._search: Iterator[None] | None = None
        self._places: list[_Place] = []
        self._surfaces: dict[int, Surface] = {}
        self._since = STANDING
        self._scans, self._way = 0, 0.0
        self.is_ambiguous = False
        """Whether standing still will not help: places are alike, or none fits."""

    def update(self, store: SubmapStore, returns: Returns, motion: Pose2, map_from_base: Pose2) -> Found | None:
        """Do the next part of the search, or go on with the contest.

        Args:
            store: The submaps.
            returns: A scan.
            motion: Motion since the last scan by odometry.
            map_from_base: Where the robot would be by odometry: the search begins there.

        Returns:
            Where the robot is, once that is known.
        """
        self._since = compose(self._since, motion)
        if self._search is None and not self._places:
            if len(returns.points) < 30:
                return None
            self._since = STANDING
            self._search = self._look(store, returns.points.copy(), map_from_base)
        if self._search is not None:
            if next(self._search, self) is not self:
                return None
            self._search = None
            for place in self._places:
                place.local_from_base = compose(place.local_from_base, self._since)
            self._scans = 0
        else:
            for place in self._places:
                place.local_from_base = compose(place.local_from_base, motion)
        return self._judge(store, returns, motion)

    # -- the contest ------------------------------------------------------------------------------

    def _judge(self, store: SubmapStore, returns: Returns, motion: Pose2) -> Found | None:
        """Match all places to a scan; the one that is left, if it is."""
        c = self.config
        if len(returns.points) < 30:
            return None
        self._scans += 1
        for place in self._places:
            alignment = self._fit(store, place.submap, place.local_from_base, returns)
            share = max(c.forgetting, 1.0 / self._scans)
            place.alignment, place.local_from_base = alignment, alignment.pose
            place.worth += share * (_worth(alignment) - place.worth)
            place.matched += share * (alignment.matched - place.matched)
            place.contradicted += share * (alignment.contradicted - place.contradicted)
        self._places = self._distinct(store, self._places)
        best = self._places[0] if self._places else None
        if best is None or (self._scans > c.patience and not self._is_good(best)):
            self.begin()
            self.is_ambiguous = True
            return None
        self._places = [place for place in self._places if place.worth > c.out * best.worth]
        if self._scans < c.least_scans:
            return None
        rival = (c.rival if best.matched >= c.surely_matched else c.rival_of_unsure) * best.worth
        self.is_ambiguous = (
            not self._is_good(best)
            or any(place.worth > rival for place in self._places[1:])
            or self._slides(store, best, returns)
        )
        if self.is_ambiguous:
            self._way += math.hypot(motion.x, motion.y)
            if self._way > c.moved:
                self.begin()
                self.is_ambiguous = True
            return None
        return Found(best.submap, best.local_from_base, self._covariance(best.alignment))

    def _is_good(self, place: _Place) -> bool:
        c = self.config
        return place.matched >= c.least_matched and place.contradicted <= c.most_contradicted

    def _distinct(self, store: SubmapStore, places: list[_Place]) -> list[_Place]:
        """Of places that are one the best, the best of all first."""
        c = self.config
        kept: list[tuple[Pose2, _Place]] = []
        for place in sorted(places, key=lambda one: -one.worth):
            pose = compose(store.submaps[place.submap].map_from_local, place.local_from_base)
            if all(
                distance(pose, other) > c.apart or abs(wrap_angle(pose.yaw - other.yaw)) > c.apart_yaw
                for other, _ in kept
            ):
                kept.append((pose, place))
        return [place for _, place in kept]

    def _slides(self, store: SubmapStore, place: _Place, returns: Returns) -> bool:
        """Whether the returns fit as well elsewhere along the direction that they say least of."""
        _, vectors = np.linalg.eigh(place.alignment.information[:2, :2])
        (dx, dy), here = vectors[:, 0].tolist(), place.local_from_base
        enough = self.config.rival * _worth(place.alignment)
        for away in _SLIDES:
            start = here._replace(x=here.x + away * dx, y=here.y + away * dy)
            other = self._fit(store, place.submap, start, returns)
            if distance(other.pose, here) > 0.5 * abs(away) and _worth(other) > enough:
                return True
        return False

    def _fit(self, store: SubmapStore, submap: int, start: Pose2, returns: Returns) -> Alignment:
        """The best pose near one in a submap, without a pull."""
        surface = self._surface(store, submap)
        return self._aligner.refine(surface, start, returns.points, returns.normals, start, Spread(1.0, 1.0))

    def _surface(self, store: SubmapStore, submap: int) -> Surface:
        grid = store.submaps[submap].grid
        if grid is not None:
            return grid.surface
        if submap not in self._surfaces:
            self._surfaces[submap] = store.surfaces_of(submap).surface()
        return self._surfaces[submap]

    def _covariance(self, alignment: Alignment) -> FloatArray:
        """Covariance of a fit; a direction that the returns do not show is as good as unknown."""
        variance = self.config.deviation_factor * self._aligner.config.return_deviation**2
        information = alignment.information
        floor = np.diag([1e-4, 1e-4, 4e-6])
        return variance * np.linalg.inv(information + 1e-3 * np.trace(information) * np.eye(3)) + floor

    # -- the search -------------------------------------------------------------------------------

    def _look(self, store: SubmapStore, points: FloatArray, here: Pose2) -> Iterator[None]:
        """Look for a scan in the whole map, a part at a time; the places that fit become ``_places``."""
        c = self.config
        num_few = min(c.search_points, len(points))
        few = points[np.arange(num_few) * len(points) // num_few]
        occupied, free = [], []
        for number in range(len(store.submaps)):
            hits, clear = _cells_of(store, number)
            occupied.append(hits)
            free.append(clear)
            if number % 4 == 3:
                yield
        all_occupied, all_free = np.concatenate(occupied), np.concatenate(free)
        if not len(all_free):
            return
        yield
        found: list[tuple[float, Pose2]] = []
        best = 0.0
        for centre in _block_centres(all_free, here, c.block):
            block = self._prepare(all_occupied, all_free, centre)
            yield
            for number, tile in enumerate(block.tiles):
                for sector in range(c.sectors):
                    yaw = 2.0 * math.pi * sector / c.sectors
                    window = Window(
                        Pose2(*tile, wrap_angle(yaw)), 0.5 * (_TILE - RESOLUTION), math.pi / c.sectors, c.angular_step
                    )
                    one = search(block.pyramid, few, window, max(c.least_score, c.kept * best))
                    if one is not None:
                        found.append((one.score, one.pose))
                        best = max(best, one.score)
                if number % self._tiles == self._tiles - 1:
                    yield
        found = [one for one in found if one[0] >= c.kept * best]
        found.sort(key=lambda one: -one[0])
        yield
        normals = np.zeros_like(points)
        scan = Returns(points, normals, points, len(points), np.zeros(len(points)), (0.0, 0.0))
        places = []
        for _, pose in found[: c.most]:
            places.append(self._refined(store, pose, scan))
            yield
        self._places = self._distinct(store, [place for place in places if place is not None])[: c.rivals]

    def _prepare(self, occupied: FloatArray, free: FloatArray, centre: tuple[float, float]) -> _Block:
        c = self.config
        half = 0.5 * c.block + c.margin
        cells = round(2.0 * half / RESOLUTION)
        origin = (centre[0] - half, centre[1] - half)
        grid = np.zeros((cells, cells), np.bool_)
        index = np.floor((occupied - origin) / RESOLUTION).astype(np.int64)
        inside = ((index >= 0) & (index < cells)).all(axis=1)
        grid[index[inside, 1], index[inside, 0]] = True
        corner = np.array(centre) - 0.5 * c.block
        tile = np.floor((free - corner) / _TILE).astype(np.int64)
        per_side = math.ceil(c.block / _TILE)
        is_open = np.zeros((per_side + 2 * _BEYOND, per_side + 2 * _BEYOND), np.bool_)
        tile = tile[((tile >= -_BEYOND) & (tile < per_side + _BEYOND)).all(axis=1)] + _BEYOND
        is_open[tile[:, 0], tile[:, 1]] = True
        around = np.lib.stride_tricks.sliding_window_view(is_open, (2 * _BEYOND + 1, 2 * _BEYOND + 1))
        tiles = [
            (float(corner[0] + (i + 0.5) * _TILE), float(corner[1] + (j + 0.5) * _TILE))
            for i, j in np.argwhere(around.any(axis=(2, 3))).tolist()
        ]
        tiles.sort(key=lambda one: (math.dist(one, centre), one))
        return _Block(build_pyramid(grid, origin, RESOLUTION), tiles)

    def _refined(self, store: SubmapStore, map_from_base: Pose2, returns: Returns) -> _Place | None:
        """A pose in the submap that it fits best in; None if it fits in none."""
        near = []
        for number, submap in enumerate(store.submaps):
            pose = compose(inverse(submap.map_from_local), map_from_base)
            away = float(((store.places_of(number) - pose[:2]) ** 2).sum(axis=1).min())
            near.append((away, number, pose))
        near.sort()
        best: _Place | None = None
        for _, number, pose in near[:4]:
            surface = self._surface(store, number)
            fit = self._aligner.align(surface, pose, _ABOUT, returns.points, returns.normals)
            if best is None or _worth(fit) > best.worth:
                best = _Place(number, fit.pose, fit, _worth(fit), fit.matched, fit.contradicted)
        return best


def _worth(alignment: Alignment) -> float:
    return alignment.fit - alignment.contradicted


def _cells_of(store: SubmapStore, number: int) -> tuple[FloatArray, FloatArray]:
    """Centres of a submap's occupied cells, and of some of its free ones, in the map (n, 2) [m]."""
    packed, map_from_local = store.surfaces_of(number), store.submaps[number].map_from_local

    def centres(cells: NDArray[np.int64]) -> FloatArray:
        rows, columns = np.divmod(cells, packed.level.shape[1])
        local = np.column_stack([columns + 0.5, rows + 0.5]) * packed.resolution + packed.origin
        return transform_points(map_from_local, local)

    return centres(packed.cells.astype(np.int64)), centres(np.flatnonzero(packed.level < 0)[::7])


def _block_centres(free: FloatArray, here: Pose2, side: float) -> list[tuple[float, float]]:
    """Centres of the blocks that hold free ground, on a lattice about the robot, the nearest first."""
    cells = np.floor((free - here[:2]) / side + 0.5).astype(np.int64)
    low = cells.min(axis=0)
    rows, columns = (cells - low).max(axis=0) + 1
    is_held = np.zeros((rows, columns), np.bool_)
    is_held[tuple((cells - low).T)] = True
    centres = [(here.x + side * i, here.y + side * j) for i, j in (np.argwhere(is_held) + low).tolist()]
    return sorted(centres, key=lambda centre: (math.dist(centre, here[:2]), centre))
