"""Laser SLAM, the local part: predict by odometry, match, insert. Loop closure would correct ``map_from_base`` here.

The map is kept twice. The *matching* grid changes slowly and only as the robot moves, so that walls stay sharp; the
*navigation* grid takes every scan and forgets within a fraction of a second what has moved away.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numba import njit

from vuca_nav.geometry import between, compose, levelling, wrap_angle
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.scan_matching import ScanMatcher, ScanMatcherConfig
from vuca_nav.mapping.surfaces import SurfaceGrid
from vuca_nav.types import NOBODY, FloatArray, LidarSpec, Odometry, Pose2, Scan


@dataclass(frozen=True, slots=True)
class SlamConfig:
    """How the pose is found and what is written into the maps."""

    localisation: Literal["slam", "odometry"] = "slam"
    """"odometry" trusts the body's own pose: dead reckoning, or the truth where the body is told it."""
    navigation_grid: GridConfig = field(default_factory=GridConfig)
    matching_grid: GridConfig = field(default_factory=lambda: GridConfig(unit=0.1, hit=6, miss=1, limit=25))
    matcher: ScanMatcherConfig = field(default_factory=ScanMatcherConfig)
    insert_distance: float = 0.05
    """The matching grid takes a scan after this much motion [m] ..."""
    insert_angle: float = math.radians(1.5)
    """... or this much turning [rad] ..."""
    insert_period: float = 1.0
    """... or this much time [s]."""
    first_scans: int = 10
    """So many scans go into the matching grid unconditionally, to have something to match against."""
    neighbours: int = 2
    """A beam without a return frees only as far as the shortest of so many neighbours on each side, since a dropped
    beam looks the same and would open the wall it stood on."""
    lowest: float = 0.3
    """A beam that ends lower than this share of the lidar's height by the measured lean may have met the floor ..."""
    highest: float = 0.25
    """... and one that ends this much above the lidar may have passed over something low: neither is mapped [m]."""
    walker_margin: float = 0.2
    """What returns so near to who walks is a part of him [m]."""
    surface_thickness: float = 0.1
    """A beam does not empty occupied cells while it is this near to the surface it ends on: two cells [m]. Without it
    beams that skim a wall wash it away, cell by cell, since they pass twenty of its cells for each that they hit."""


@dataclass(frozen=True, slots=True)
class SlamEstimate:
    """What SLAM knows after a scan."""

    map_from_base: Pose2
    score: float
    """Of the match, 0 to 1; 1 where none was made."""
    points_in_map: FloatArray
    """(n, 2) the scan's returns [m]; valid until the next scan."""


class Slam:
    """``update(scan, odometry) -> SlamEstimate`` at the lidar's rate."""

    def __init__(self, lidar: LidarSpec, config: SlamConfig = SlamConfig()):
        self.config = config
        self.lidar = lidar
        angles = lidar.angles_in_base()
        self._beams_in_base = np.column_stack([np.cos(angles), np.sin(angles)])
        self._ranges = np.zeros(lidar.num_beams)
        self._level_beams = self._beams_in_base.copy()
        self._ends_in_base = np.zeros((lidar.num_beams, 2))
        self._ends_in_map = np.zeros((lidar.num_beams, 2))
        self._grazed = np.zeros(lidar.num_beams)
        self._box = np.zeros(4)
        self._matcher = ScanMatcher(config.matcher, lidar.num_beams)
        self.reset(Pose2(0.0, 0.0, 0.0))

    def reset(self, start: Pose2, prior_map: OccupancyGrid | None = None) -> None:
        """Forget everything and start at a pose of the map.

        Args:
            start: ``map_from_base`` now.
            prior_map: A map known beforehand, if there is one.
        """
        self.navigation_grid = OccupancyGrid(self.config.navigation_grid, (start.x, start.y))
        self.matching_grid = SurfaceGrid(self.config.matching_grid, (start.x, start.y))
        if prior_map is not None:
            self.navigation_grid.fill(prior_map.level, prior_map.origin)
            self.matching_grid.fill(prior_map.level, prior_map.origin)
        self.map_from_base = start
        self._odom_from_base: Pose2 | None = None
        self._num_scans = 0
        self._inserted_at = start
        self._inserted_stamp = -math.inf

    def update(self, scan: Scan, odometry: Odometry, walkers: FloatArray = NOBODY) -> SlamEstimate:
        """Localise the scan in the map, then write it into the map.

        Args:
            scan: The lidar's latest.
            odometry: The body's, at the same time.
            walkers: (k, 3) x, y in the base_link of this scan, levelled, and radius of what is known to move [m]: it
                is no landmark, and has no place in a map. Beams that end on it empty the cells on their way, as
                others do.
        """
        config = self.config
        predicted = self._predict(odometry)
        _level(
            scan.ranges,
            self._beams_in_base,
            odometry.up,
            levelling(odometry.up),
            self.lidar.max_range,
            (config.lowest - 1.0) * self.lidar.height,
            config.highest,
            self._ranges,
            self._level_beams,
        )
        num_hits, num_returns, num_ends = _beam_ends(
            self._ranges,
            self._level_beams,
            self.lidar.min_range,
            self.lidar.max_range,
            config.neighbours,
            config.surface_thickness,
            walkers,
            config.walker_margin,
            self._ends_in_base,
            self._grazed,
        )
        score = 1.0
        self.map_from_base = predicted
        if config.localisation == "slam" and self._num_scans > 0 and num_hits > 0:
            match = self._matcher.match(self.matching_grid, predicted, self._ends_in_base[:num_hits])
            self.map_from_base, score = match.map_from_base, match.score
        pose = self.map_from_base
        _to_map(pose.x, pose.y, pose.yaw, self._ends_in_base, num_ends, self._ends_in_map, self._box)
        ends_in_map = self._ends_in_map[:num_ends]
        self.navigation_grid.insert(pose, ends_in_map, num_hits, self._grazed, self._box)
        if config.localisation == "slam" and self._is_due(scan.stamp):
            self.matching_grid.insert(pose, ends_in_map, num_hits, self._grazed, self._box)
            self._inserted_at, self._inserted_stamp = pose, scan.stamp
        self._num_scans += 1
        return SlamEstimate(pose, score, ends_in_map[:num_returns])

    def _predict(self, odometry: Odometry) -> Pose2:
        previous, self._odom_from_base = self._odom_from_base, odometry.odom_from_base
        if previous is None:
            return self.map_from_base
        return compose(self.map_from_base, between(previous, odometry.odom_from_base))

    def _is_due(self, stamp: float) -> bool:
        c, pose, last = self.config, self.map_from_base, self._inserted_at
        return (
            self._num_scans < c.first_scans
            or math.hypot(pose.x - last.x, pose.y - last.y) > c.insert_distance
            or abs(wrap_angle(pose.yaw - last.yaw)) > c.insert_angle
            or stamp - self._inserted_stamp >= c.insert_period
        )


@njit(cache=True)
def _level(ranges, beams, up, axes, max_range, lowest, highest, levelled, level_beams):
    """A scan taken leaning, seen from above: ranges over ground, and directions by ``geometry.levelling``, ``axes``.

    Ranges are nan where a beam ended below or above the band about the lidar.
    """
    leans = axes[0, 0] != 1.0 or axes[1, 1] != 1.0
    for k in range(ranges.shape[0]):
        rise = up[0] * beams[k, 0] + up[1] * beams[k, 1]
        end = rise * min(ranges[k], max_range)
        levelled[k] = ranges[k] * math.sqrt(1.0 - rise * rise) if lowest <= end <= highest else math.nan
        x, y = beams[k, 0], beams[k, 1]
        if leans:
            x, y = axes[0, 0] * x + axes[0, 1] * y, axes[1, 1] * y
            length = math.sqrt(x * x + y * y)
            x, y = x / length, y / length
        level_beams[k, 0], level_beams[k, 1] = x, y


@njit(cache=True)
def _beam_ends(ranges, beams, min_range, max_range, neighbours, thickness, walkers, margin, ends, grazed):
    """What stands, who walks, and the ends of beams that met nothing; how many of the first, of two, of all three.

    ``grazed`` becomes the last part of each beam that runs within ``thickness`` of the surface which the returns to
    its left and right show.
    """
    n = ranges.shape[0]
    count = num_hits = 0
    for walks in (False, True):
        for k in range(n):
            r = ranges[k]
            if not min_range <= r < max_range:
                continue
            x, y = r * beams[k, 0], r * beams[k, 1]
            if _is_of_walker(x, y, walkers, margin) != walks:
                continue
            ends[count, 0], ends[count, 1] = x, y
            # The more grazing of the angles to the returns on either side: beyond a wall's end there may be none.
            sine = 1.0
            for d in (-3, 3):
                j = (k + d) % n
                if ranges[j] < max_range:
                    tx = ranges[j] * beams[j, 0] - x
                    ty = ranges[j] * beams[j, 1] - y
                    cross = abs(beams[k, 0] * ty - beams[k, 1] * tx)
                    sine = min(sine, cross / max(math.hypot(tx, ty), 1e-9))
            grazed[count] = thickness / max(sine, 0.04)
            count += 1
        if not walks:
            num_hits = count
    num_returns = count
    for k in range(n):
        if ranges[k] >= max_range:
            free = max_range
            for d in range(-neighbours, neighbours + 1):
                free = min(free, ranges[(k + d) % n])
            if free >= min_range:
                ends[count, 0] = free * beams[k, 0]
                ends[count, 1] = free * beams[k, 1]
                grazed[count] = 0.0
                count += 1
    return num_hits, num_returns, count


@njit(cache=True)
def _is_of_walker(x, y, walkers, margin):
    for walker in walkers:
        near = walker[2] + margin
        if (x - walker[0]) ** 2 + (y - walker[1]) ** 2 < near * near:
            return True
    return False


@njit(cache=True)
def _to_map(x, y, yaw, points_in_base, count, points_in_map, box):
    """Transform, and the bounding box of the result and the origin."""
    c, s = math.cos(yaw), math.sin(yaw)
    box[0] = box[2] = x
    box[1] = box[3] = y
    for k in range(count):
        px = x + c * points_in_base[k, 0] - s * points_in_base[k, 1]
        py = y + s * points_in_base[k, 0] + c * points_in_base[k, 1]
        points_in_map[k, 0] = px
        points_in_map[k, 1] = py
        box[0] = min(box[0], px)
        box[1] = min(box[1], py)
        box[2] = max(box[2], px)
        box[3] = max(box[3], py)
