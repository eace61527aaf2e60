"""The perceive stage: ``Perception.update(scan, odometry) -> Percept``, once a tick, for every method alike."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vuca_nav.checks import check_not_negative, check_positive
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import between, levelling, multiplied
from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import LevelScan, Percept
from vuca_nav.perception.scan_memory import ScanField, ScanHistory
from vuca_nav.perception.tracks import (
    MAX_TRACKS,
    RADIUS,
    TRACK_SIZE,
    V_X,
    V_Y,
    Tracker,
    X,
    Y,
    is_of_track,
    select_moving,
)
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan

MOST_PERIODS = 2.5
"""Longest time between two scans over which the past is kept, in periods. A single lost scan is no gap."""
MOST_INVALID = 0.5
"""Share of a scan's beams that may be NaN (REP-117: a fault, not an empty beam) before the scan is invalid."""
UPRIGHT = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class PerceptionConfig:
    """Settings of perception."""

    tracks: bool = True
    """Whether moving obstacles are tracked; without tracks, moving obstacles are mapped like all others."""
    sight: float = 8.0
    """Range beyond which nothing is tracked [m]."""
    spacing: float = 0.1
    """Time between two scans that correct tracks [s]: over less, range noise is too much of a velocity."""
    certainty: float = 0.6
    """Certainty below which a track is taken to stand: one that was seen three times in a row has more."""
    moving_speed: float = 0.12
    """Speed below which a track is taken to stand [m/s]: it stays in the map, since it will still be there."""
    own_returns: float = 0.2
    """Returns this near to a moving track's circle are its own [m]."""
    lowest: float = 0.3
    """A beam that ends lower than this share of the lidar's height, by the measured lean, may have met the floor: it is
    not mapped."""
    highest: float = 0.25
    """A beam that ends this much above the lidar may have passed over a low obstacle: it is not mapped [m]."""
    memory: float = 0.3
    """Age of the oldest scan that is kept [s]: n = 3 scans, 0.1 s apart, make O_m (Zhang et al., Section III-B)."""
    field_reach: float = 2.6
    """Half side of the distance field [m]."""
    field_resolution: float = 0.05
    """Side of the distance field's cells [m]."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_positive(self, "sight", "spacing", "own_returns", "field_reach", "field_resolution")
        check_not_negative(self, "memory", "moving_speed", "certainty")


class _Band(NamedTuple):
    """Heights over the lidar between which a beam must end to be mapped [m]."""

    lowest: float
    highest: float
    max_range: float


class Perception:
    """Reads scans and odometry.

    Args:
        lidar: The body's lidar.
        config: Settings.
    """

    def __init__(self, lidar: LidarSpec, config: PerceptionConfig = PerceptionConfig()):
        self.lidar, self.config = lidar, config
        angles = lidar.angles_in_base()
        self._beams = np.column_stack([np.cos(angles), np.sin(angles)])
        n = lidar.num_beams
        self._level = LevelScan(np.zeros(n), self._beams.copy(), np.zeros(n, np.bool_))
        self._band = _Band((config.lowest - 1.0) * lidar.height, config.highest, lidar.max_range)
        self._history = ScanHistory(round(config.memory * lidar.rate) + 1, n)
        self._field = ScanField(self._beams, config.field_reach, config.field_resolution)
        self._tracker = Tracker(1, n, 1.0 / lidar.rate, config.spacing) if config.tracks else None
        self._row, self._reaches = np.zeros(1, np.int64), np.array([config.sight])
        self._motion, self._fresh = np.zeros((1, 3)), np.ones(1, np.bool_)
        self._tracks, self._moving = np.zeros((2, MAX_TRACKS, TRACK_SIZE))
        self.reset()

    def reset(self) -> None:
        """Forget the last mission."""
        self._fresh[0] = True
        self._odom_from_before: Pose2 | None = None
        self._stamp = -math.inf

    def update(self, scan: Scan, odometry: Odometry) -> Percept:
        """Take in the sensors' present readings.

        After a gap in time, or while the readings are not valid, tracks and past scans are forgotten.

        Args:
            scan: The lidar's latest scan.
            odometry: The body's odometry at the same time.

        Raises:
            BadArgument: If the scan has another number of beams than the lidar.
        """
        scan = self._checked(scan)
        before, self._odom_from_before = self._odom_from_before, odometry.odom_from_base
        motion = STANDING if before is None else between(before, odometry.odom_from_base)
        if not 0.0 < scan.stamp - self._stamp < MOST_PERIODS / self.lidar.rate:
            self._fresh[0] = True
        self._stamp = scan.stamp
        up = float(odometry.up[0]), float(odometry.up[1]), float(odometry.up[2])
        axes = levelling(up)
        invalid, returns = _level_scan(scan.ranges, self._beams, up, axes, self._band, self._level)
        is_finite = math.isfinite(sum(odometry.twist) + sum(motion) + sum(up))
        is_valid = is_finite and invalid <= MOST_INVALID * self.lidar.num_beams
        num_tracks = num_moving = 0
        if is_valid:
            if self._fresh[0]:
                self._history.begin(scan.ranges)
            else:
                self._history.add(scan.ranges)
            if self._tracker is not None:
                self._motion[0] = motion
                self._tracker.update(self._row, scan.ranges[None], self._motion, self._reaches, self._fresh)
                num_tracks = self._tracker.tracks_in_base(0, self._tracks)
                if num_tracks:
                    tracks = self._tracks[:num_tracks]
                    if up != UPRIGHT:
                        tracks[:, [X, Y]] = multiplied(axes, tracks[:, [X, Y]])
                        tracks[:, [V_X, V_Y]] = multiplied(axes, tracks[:, [V_X, V_Y]])
                    c = self.config
                    num_moving = select_moving(tracks, c.moving_speed, c.certainty, self._moving)
        moving = self._moving[:num_moving]
        _mark_movers(self._level, moving, self.config.own_returns)
        self._fresh[0] = not is_valid
        self._field.set_scan(scan.ranges)
        return Percept(
            scan=scan,
            odom_from_base=odometry.odom_from_base,
            motion=motion,
            twist=odometry.twist,
            is_valid=is_valid,
            is_blind=returns == 0,
            level=self._level,
            tracks=self._tracks[:num_tracks],
            moving=moving[:, [X, Y, RADIUS]],
            history=self._history,
            field=self._field,
        )

    def _checked(self, scan: Scan) -> Scan:
        """The scan with as many ranges as the lidar has beams, in double precision."""
        if scan.ranges.shape != (self.lidar.num_beams,):
            raise BadArgument(
                f"the scan has ranges of shape {scan.ranges.shape}, the lidar {self.lidar.num_beams} beams: give it a "
                "LidarSpec of the scans that it gets"
            )
        ranges = np.ascontiguousarray(scan.ranges, np.float64)
        return scan if ranges is scan.ranges else Scan(scan.stamp, ranges)


@njit(cache=True)
def _level_scan(ranges, beams, up, axes, band, level):
    """Project a leaning body's scan onto the floor: ranges over ground, and directions by ``axes``, its levelling.

    Ranges become NaN where a beam ended outside of the band.

    Returns:
        The number of ranges that are NaN, and of beams that came back.
    """
    leans = up[0] != 0.0 or up[1] != 0.0
    invalid = returns = 0
    for k in range(ranges.shape[0]):
        r = ranges[k]
        if math.isnan(r):
            invalid += 1
        elif r < np.inf:
            returns += 1
        if not leans:
            level.ranges[k] = r
            continue
        rise = up[0] * beams[k, 0] + up[1] * beams[k, 1]
        end = rise * min(r, band.max_range)
        level.ranges[k] = r * math.sqrt(1.0 - rise * rise) if band.lowest <= end <= band.highest else math.nan
        x, y = axes[0, 0] * beams[k, 0] + axes[0, 1] * beams[k, 1], axes[1, 1] * beams[k, 1]
        length = math.sqrt(x * x + y * y)
        level.beams[k, 0], level.beams[k, 1] = x / length, y / length
    if not leans:
        level.beams[:] = beams
    return invalid, returns


@njit(cache=True)
def _mark_movers(level, moving, margin):
    """Mark the returns that belong to a moving track."""
    level.is_mover[:] = False
    if not len(moving):
        return
    for k in range(level.ranges.shape[0]):
        r = level.ranges[k]
        if r < np.inf:
            level.is_mover[k] = is_of_track(r * level.beams[k, 0], r * level.beams[k, 1], moving, margin)
