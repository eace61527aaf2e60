"""SLAM as the navigator uses it (Zhang et al., Section III-C, SLAM-based mapping): localise, and draw the map.

SLAM corrects one transform, ``map_from_odom``. Where the robot is, ``GraphSlam`` says, by submaps that change slowly
and only as the robot moves. What it navigates by is the *navigation* grid: that takes every scan, and within a fraction
of a second forgets obstacles that have moved away. When a loop closure has moved the submaps, the navigation grid is
drawn anew beside the present one, some scans a tick, and swapped together with the pose.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose, distance, inverse
from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.graph_slam import GraphSlam, GraphSlamConfig
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.redraw import Drawing, DrawnMap, RedrawRule
from vuca_nav.mapping.tracking import Tracking
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.readings import FARTHEST
from vuca_nav.types import STANDING, FloatArray, LidarSpec, Pose2

_SIDE = 3
"""Beams to either side whose returns give a surface's direction at a return."""
_LEAST_SINE = 0.04
"""Least sine of the angle between beam and surface: at 2.3 degrees a beam grazes at most 2.5 m of a wall."""


@dataclass(frozen=True, slots=True)
class SlamConfig:
    """Settings of localisation and of the maps."""

    localisation: Literal["slam", "odometry"] = "slam"
    """"odometry" trusts the body's own pose: dead reckoning, or the true pose where odometry is exact."""
    navigation_grid: GridConfig = field(default_factory=GridConfig)
    graph: GraphSlamConfig = field(default_factory=GraphSlamConfig)
    redraw_shift: float = 0.025
    """The navigation grid is drawn anew once loop closures have moved a submap by more than this: half a cell [m]."""
    redraw_scans: int = 8
    """Scans of the past that are drawn anew in a tick."""
    neighbours: int = 2
    """A beam without a return frees only as far as the shortest of so many neighbours on each side, since a dropped
    beam looks the same and would open the wall it stood on."""
    surface_thickness: float = 0.1
    """A beam does not empty occupied cells while it is this near to the surface it ends on: two cells [m]. Without it
    beams that skim a wall wash it away, cell by cell, since they pass twenty of its cells for each that they hit."""


@dataclass(frozen=True, slots=True)
class SlamEstimate:
    """SLAM's estimate after a scan."""

    map_from_base: Pose2
    map_from_odom: Pose2
    map_correction: Pose2
    """Transform of the map about the robot since the last scan, from the old place of a point to the new one.
    Everything remembered in the map has to follow. ``STANDING`` but where the map was redrawn or corrected."""
    score: float
    """Quality of the match, 0 to 1: share of the returns that lie on known surfaces, of those that do not lie on new
    ground; 1 where none was made."""
    points_in_map: FloatArray
    """(n, 2) the scan's returns [m]; valid until the next scan."""
    navigation_grid: OccupancyGrid
    """The navigation grid after this scan; later scans change it."""
    is_mapped: bool = True
    """False if the scan reaches beyond the greatest size of a map: it has not been written into it."""
    tracking: Tracking = "tracked"
    """Whether the pose is to be trusted. While it is weak the robot has to slow down, while it is lost to stop."""
    must_look: bool = False
    """Whether the robot is lost and will not be found where it is: it has to go and look."""


class _BeamRule(NamedTuple):
    """Settings of the classification of beam ends."""

    min_range: float
    max_range: float
    neighbours: int
    thickness: float
    wraps: bool
    """Whether the last beam is the first one's neighbour."""


class Slam:
    """``update(percept) -> SlamEstimate`` at the lidar's rate."""

    def __init__(self, lidar: LidarSpec, config: SlamConfig = SlamConfig()):
        self.config = config
        self.lidar = lidar
        self._rule = _BeamRule(
            lidar.min_range, lidar.max_range, config.neighbours, config.surface_thickness, lidar.sees_all_round
        )
        self._ends_in_base = np.zeros((lidar.num_beams, 2))
        self._ends_in_map = np.zeros((lidar.num_beams, 2))
        self._grazed = np.zeros(lidar.num_beams)
        self._box = np.zeros(4)
        self._is_mounted = lidar.mount[:2] != (0.0, 0.0)
        self._graph = GraphSlam(lidar, config.graph)
        self.reset(Pose2(0.0, 0.0, 0.0))

    def reset(self, start: Pose2, prior_map: OccupancyGrid | None = None) -> None:
        """Forget everything and start at a pose of the map.

        Args:
            start: ``map_from_base`` now.
            prior_map: A map known beforehand, if there is one: the robot is localised in it and goes on mapping.

        Raises:
            BadArgument: If the pose is not finite or too far out, or the map is larger than a map can be.
        """
        start = Pose2(*(float(value) for value in start))
        if not all(abs(value) < FARTHEST for value in start):
            raise BadArgument(f"the start {tuple(start)} must be finite, within {FARTHEST:g} m of the map's origin")
        c = self.config
        grid = OccupancyGrid(c.navigation_grid, (start.x, start.y))
        if prior_map is not None:
            grid.fill(prior_map.level, prior_map.origin)
        self._map = DrawnMap(grid, RedrawRule(c.redraw_shift, c.redraw_scans))
        self._graph.reset(start, prior_map)
        self.map_from_odom: Pose2 | None = None
        """The correction; None before the first scan, which is taken at ``start``."""
        self._map_from_base = start
        self._correction = STANDING
        self._seen_from, self._seen_within = STANDING, math.inf
        """Where the last returns were seen from by odometry, and how far away half of them were [m]."""
        self._is_blind = False

    @property
    def tracking(self) -> Tracking:
        """Whether the pose is to be trusted."""
        return "lost" if self._is_blind else self._graph.tracking

    @property
    def must_look(self) -> bool:
        """Whether the robot is lost and will not be found where it is."""
        return not self._is_blind and self._graph.must_look

    @property
    def navigation_grid(self) -> OccupancyGrid:
        """The navigation grid; after a correction it is another one."""
        return self._map.grid

    def correct(self, map_correction: Pose2) -> None:
        """Take over that the map about the robot has moved.

        The pose moves along, and the next estimate reports the correction, once. The navigation grid is the caller's:
        whoever moves the map has drawn it anew.

        Args:
            map_correction: Transform from where a point of the map was to where it is now.
        """
        self._graph.correct(map_correction)
        self._map.correct(map_correction)
        self._take_correction(map_correction)

    def _take_correction(self, map_correction: Pose2) -> None:
        self._map_from_base = compose(map_correction, self._map_from_base)
        if self.map_from_odom is not None:
            self.map_from_odom = compose(map_correction, self.map_from_odom)
        self._correction = compose(map_correction, self._correction)

    def update(self, percept: Percept) -> SlamEstimate:
        """Localise the scan in the map, then write it into the map.

        Moving tracks are no landmarks and have no place in a map. Beams that end on one empty the cells on their way,
        as others do. While odometry is not known the estimate stays, and nothing is mapped. A tick without a new scan
        moves the estimate on by odometry. Where the map cannot grow any more the robot is localised in what there is.

        Raises:
            BadArgument: If the percept is of a lidar with another number of beams.
        """
        if percept.level.ranges.shape != (self.lidar.num_beams,):
            raise BadArgument(
                f"the percept is of {len(percept.level.ranges)} beams, SLAM's lidar has {self.lidar.num_beams}: give "
                "both the same LidarSpec"
            )
        if percept.odometry_has_jumped and self.config.localisation == "slam" and self.map_from_odom is not None:
            self._graph.doubt()
        if not (percept.odometry_is_known and math.isfinite(sum(percept.odom_from_base))):
            return self._stay()
        if not percept.is_new:
            if self.map_from_odom is not None:
                self._map_from_base = compose(self.map_from_odom, percept.odom_from_base)
            return self._stay()
        level, ends_in_base = percept.level, self._ends_in_base
        num_hits, num_returns, num_ends = _beam_ends(level, self._rule, ends_in_base, self._grazed)
        pose, score = self._localise(percept)
        map_from_lidar = pose
        if self._is_mounted:
            map_from_lidar = compose(pose, Pose2(float(level.origin[0]), float(level.origin[1]), 0.0))
        _to_map(pose, map_from_lidar, ends_in_base[:num_ends], self._ends_in_map, self._box)
        ends_in_map = self._ends_in_map[:num_ends]
        is_mapped = True
        if self._may_draw(percept, score):
            is_mapped = self.navigation_grid.insert(map_from_lidar, ends_in_map, num_hits, self._grazed, self._box)
        self._remember(num_hits, num_ends, level.origin)
        self._map_from_base = pose
        correction, self._correction = self._correction, STANDING
        assert self.map_from_odom is not None
        return SlamEstimate(
            pose,
            self.map_from_odom,
            correction,
            score,
            ends_in_map[:num_returns],
            self.navigation_grid,
            is_mapped,
            self.tracking,
            self.must_look,
        )

    def _localise(self, percept: Percept) -> tuple[Pose2, float]:
        """Pose of a new scan in the map as it is drawn, and the quality of its match."""
        if self.config.localisation == "odometry":
            if self.map_from_odom is None:
                self.map_from_odom = compose(self._map_from_base, inverse(percept.odom_from_base))
                return self._map_from_base, 1.0
            return compose(self.map_from_odom, percept.odom_from_base), 1.0
        graph, is_first = self._graph, self.map_from_odom is None
        graph.update(percept.level, percept.odom_from_base, percept.stamp)
        place, drawn = graph.place, self._map
        drawn.take_submaps(graph.store)
        correction = drawn.step(graph.store, graph.back_end.num_optimised, place)
        if correction is not None:
            self._take_correction(correction)
        pose = drawn.map_from_base(place)
        self.map_from_odom = compose(pose, inverse(percept.odom_from_base))
        assert graph.tracked is not None
        return pose, 1.0 if is_first or percept.is_blind else graph.tracked.quality

    def _may_draw(self, percept: Percept, score: float) -> bool:
        """Whether a scan may be drawn: its pose is known, and it is no dead lidar's."""
        self._is_blind = self._is_dead(percept)
        return self.tracking != "lost" and score >= self.config.graph.front_end.maps

    def _is_dead(self, percept: Percept) -> bool:
        """Whether no return comes where surfaces were near a moment ago."""
        if percept.is_blind:
            return distance(percept.odom_from_base, self._seen_from) + self._seen_within < self.lidar.max_range
        within = _middle_range(percept.level, self.lidar.max_range)
        if within < math.inf:
            self._seen_from, self._seen_within = percept.odom_from_base, within
        return False

    def _remember(self, num_hits: int, num_ends: int, origin: FloatArray) -> None:
        """Keep what the last scan draws, if it became a keyframe."""
        tracked = self._graph.tracked
        if self.config.localisation == "slam" and tracked is not None and tracked.keyframe is not None:
            ends, grazed = self._ends_in_base[:num_ends].astype(np.float32), self._grazed[:num_ends].astype(np.float32)
            lidar = float(origin[0]), float(origin[1])
            scan = self.navigation_grid.scan_index
            self._map.drawings.append(Drawing(self._graph.place, scan, ends, num_hits, grazed, lidar))

    def _stay(self) -> SlamEstimate:
        """The present estimate, without a scan."""
        correction, self._correction = self._correction, STANDING
        map_from_odom = self._map_from_base if self.map_from_odom is None else self.map_from_odom
        return SlamEstimate(
            self._map_from_base,
            map_from_odom,
            correction,
            1.0,
            self._ends_in_map[:0],
            self.navigation_grid,
            tracking=self.tracking,
            must_look=self.must_look,
        )


@njit(cache=True)
def _middle_range(level, max_range):
    """Median range of the static returns, inf if there are none."""
    seen = np.empty(level.ranges.shape[0])
    n = 0
    for k in range(level.ranges.shape[0]):
        if level.ranges[k] < max_range and not level.is_mover[k]:
            seen[n] = level.ranges[k]
            n += 1
    return np.median(seen[:n]) if n else np.inf


@njit(cache=True)
def _beam_ends(level, rule, ends, grazed):
    """Write the beams' ends in base_link: static returns, then returns of moving tracks, then ends of free beams.

    ``grazed`` becomes the last part of each beam that runs within ``thickness`` of the surface which the returns to
    its left and right show.

    Returns:
        The number of ends of the first kind, of the first two, and of all three.
    """
    ranges, beams, origin = level.ranges, level.beams, level.origin
    min_range, max_range, wraps = rule.min_range, rule.max_range, rule.wraps
    n = ranges.shape[0]
    count = num_hits = 0
    for moves in (False, True):
        for k in range(n):
            r = ranges[k]
            if not min_range <= r < max_range or level.is_mover[k] != moves:
                continue
            x, y = r * beams[k, 0], r * beams[k, 1]
            ends[count, 0], ends[count, 1] = origin[0] + x, origin[1] + y
            # The more grazing of the angles to the returns on either side: beyond a wall's end there may be none.
            sine = 1.0
            for d in (-_SIDE, _SIDE):
                j = (k + d) % n
                if ranges[j] < max_range and (wraps or j == k + d):
                    tx = ranges[j] * beams[j, 0] - x
                    ty = ranges[j] * beams[j, 1] - y
                    cross = abs(beams[k, 0] * ty - beams[k, 1] * tx)
                    sine = min(sine, cross / max(math.hypot(tx, ty), 1e-9))
            grazed[count] = rule.thickness / max(sine, _LEAST_SINE)
            count += 1
        if not moves:
            num_hits = count
    num_returns = count
    for k in range(n):
        if ranges[k] >= max_range:
            free = max_range
            for d in range(-rule.neighbours, rule.neighbours + 1):
                j = (k + d) % n
                if wraps or j == k + d:
                    free = min(free, ranges[j])
            if free >= min_range:
                ends[count, 0] = origin[0] + free * beams[k, 0]
                ends[count, 1] = origin[1] + free * beams[k, 1]
                grazed[count] = 0.0
                count += 1
    return num_hits, num_returns, count


@njit(cache=True)
def _to_map(map_from_base, map_from_lidar, points_in_base, points_in_map, box):
    """Transform points into the map, and find the bounding box of the result and the lidar."""
    x, y, yaw = map_from_base
    c, s = math.cos(yaw), math.sin(yaw)
    box[0] = box[2] = map_from_lidar[0]
    box[1] = box[3] = map_from_lidar[1]
    for k in range(points_in_base.shape[0]):
        px = x + c * points_in_base[k, 0] - s * points_in_base[k, 1]
        py = y + s * points_in_base[k, 0] + c * points_in_base[k, 1]
        points_in_map[k, 0] = px
        points_in_map[k, 1] = py
        box[0] = min(box[0], px)
        box[1] = min(box[1], py)
        box[2] = max(box[2], px)
        box[3] = max(box[3], py)
