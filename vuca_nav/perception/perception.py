"""The perceive stage: ``Perception.update(scan, odometry) -> Percept``, once a tick, for every method alike."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vuca_nav.checks import check_not_negative, check_positive
from vuca_nav.errors import BadArgument
from vuca_nav.footprint import cover_by_discs
from vuca_nav.geometry import between, levelling, multiplied
from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import LevelScan, Percept
from vuca_nav.perception.readings import UPRIGHT, CheckedOdometry, CheckedScan, OdometryCheck, ScanCheck
from vuca_nav.perception.ring import BeamGeometry, find_gaps, ring_of, write_ring
from vuca_nav.perception.scan_memory import ScanField, ScanHistory
from vuca_nav.perception.seen_space import SeenSpace
from vuca_nav.perception.standing_map import StandingMap
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
from vuca_nav.types import STANDING, BodySpec, FloatArray, LidarSpec, Odometry, Scan

MOST_PERIODS = 2.5
"""Longest time between two scans over which the past is kept, in periods of lidar or loop, the slower. A single lost
scan is no gap. After as long without a new scan the body stands."""
MOST_INVALID = 0.5
"""Share of a scan's beams that may be NaN (REP-117: a fault, not an empty beam) before the scan is invalid. Where a
lidar does not look it has no beams."""


_UPRIGHT_AXES = levelling(UPRIGHT)
_NOTHING_MOVES = np.zeros((0, 3))


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
        body: The body that the sensors are on; without one, odometry may jump and no return is the body's own.
        rate: Rate of the ticks [Hz]; by default the lidar's. A lidar may be slower or faster.
    """

    def __init__(
        self,
        lidar: LidarSpec,
        config: PerceptionConfig = PerceptionConfig(),
        body: BodySpec | None = None,
        rate: float | None = None,
    ):
        self.lidar, self.config = lidar, config
        self._rate = lidar.rate if rate is None else rate
        self._beams = BeamGeometry.of(lidar)
        self._scan_check = ScanCheck(lidar, None if body is None else body.footprint)
        self._odometry_check = OdometryCheck(body, self._rate)
        self._longest_gap = MOST_PERIODS / min(lidar.rate, self._rate)
        self._level = _level_of(self._beams)
        self._band = _Band((config.lowest - 1.0) * lidar.height, config.highest, lidar.max_range)
        ring = ring_of(lidar, self._rate)
        n = ring.num_beams
        ring_beams = BeamGeometry.of(ring)
        self._is_ring = lidar.is_centred_ring and lidar.num_beams == n and lidar.rate >= self._rate
        self._ring, self._gaps = np.zeros(n), np.zeros(n, np.bool_)
        self._ring_level = _level_of(ring_beams)
        self._ring_beams = ring_beams
        self._space = SeenSpace(np.zeros((1, 3)) if body is None else cover_by_discs(body.footprint), self._rate)
        self._history = ScanHistory(round(config.memory * self._rate) + 1, n)
        self._field = ScanField(ring_beams.directions, config.field_reach, config.field_resolution)
        self._tracker = Tracker(1, n, 1.0 / self._rate, config.spacing) if config.tracks else None
        self._row, self._reaches = np.zeros(1, np.int64), np.array([config.sight])
        self._motion, self._fresh = np.zeros((1, 3)), np.ones(1, np.bool_)
        self._tracks, self._moving = np.zeros((2, MAX_TRACKS, TRACK_SIZE))
        self.reset()

    def reset(self) -> None:
        """Forget the last mission."""
        self._fresh[0] = True
        self._odometry_check.reset()
        self._space.reset()
        self._stamp = -math.inf
        self._odom_at_scan = STANDING
        self._is_seen, self._was_upright = True, False
        self._age = 0

    def update(self, scan: Scan, odometry: Odometry, standing: StandingMap | None = None) -> Percept:
        """Take in the sensors' present readings.

        After a gap in time, or while the readings are not valid, tracks and past scans are forgotten.

        Args:
            scan: The lidar's latest scan; the same one again, by its stamp, while there is no newer one.
            odometry: The body's odometry now.
            standing: What was mapped as standing; without it, nothing explains a track.

        Raises:
            BadArgument: If the scan has another number of beams than the lidar, or ranges that are no numbers.
        """
        checked, measured = self._scan_check.check(scan), self._odometry_check.check(odometry)
        scan, is_new, is_gap = self._timed(checked.scan)
        fault = measured.fault or self._fault_of(checked, is_new)
        up, is_upright = measured.up, measured.up == UPRIGHT
        axes = _UPRIGHT_AXES if is_upright else levelling(up)
        if is_new:
            self._odom_at_scan = measured.odom_from_base
            if is_upright and self._was_upright:
                self._level.ranges[:] = scan.ranges
            else:
                _level_scan(scan.ranges, self._beams, up, axes, self._band, self._level)
            self._was_upright = is_upright
        seen, ring, ring_level = self._ring_of(scan, checked, measured, is_new)
        if ring_level is not self._level:
            _level_scan(ring, self._ring_beams, up, axes, self._band, ring_level)
        is_valid = fault is None
        self._fresh[0] |= is_gap
        num_tracks = num_moving = 0
        if is_valid:
            if self._fresh[0]:
                self._history.begin(ring)
            else:
                self._history.add(ring)
            if self._tracker is not None and (is_new or not self._fresh[0]):
                self._motion[0] = measured.motion
                if is_new:
                    self._tracker.update(self._row, seen[None], self._motion, self._reaches, self._fresh)
                else:
                    self._tracker.predict(self._row, self._motion)
                num_tracks = self._tracker.tracks_in_base(0, self._tracks)
                if num_tracks:
                    tracks = self._tracks[:num_tracks]
                    if not is_upright:
                        tracks[:, [X, Y]] = multiplied(axes, tracks[:, [X, Y]])
                        tracks[:, [V_X, V_Y]] = multiplied(axes, tracks[:, [V_X, V_Y]])
                    c = self.config
                    num_moving = select_moving(tracks, c.moving_speed, c.certainty, self._moving)
        moving = unexplained = self._moving[:num_moving]
        if num_moving and standing is not None:
            unexplained = standing.unexplained(moving, self._level, measured.odom_from_base)
        if num_moving:
            _mark_movers(self._level, moving, self.config.own_returns)
        else:
            self._level.is_mover[:] = False
        self._fresh[0] = not is_valid or (self._fresh[0] and not is_new)
        self._field.set_scan(ring)
        return Percept(
            scan=scan,
            is_new=is_new,
            ring=ring,
            ring_level=ring_level,
            odom_from_base=measured.odom_from_base,
            odometry_is_known=measured.is_known,
            motion=measured.motion,
            twist=measured.twist,
            is_valid=is_valid,
            fault=fault,
            is_blind=checked.returns == 0,
            level=self._level,
            tracks=self._tracks[:num_tracks],
            moving=moving[:, [X, Y, RADIUS]] if num_moving else _NOTHING_MOVES,
            unexplained=unexplained[:, [X, Y, RADIUS]] if num_moving else _NOTHING_MOVES,
            history=self._history,
            field=self._field,
            odometry_has_jumped=measured.has_jumped,
        )

    def _timed(self, scan: Scan) -> tuple[Scan, bool, bool]:
        """The scan at a time that is finite, whether it is new, and whether it is no successor of the last one."""
        try:
            stamp = float(scan.stamp)
        except (TypeError, ValueError, OverflowError) as error:
            raise BadArgument(f"the scan's stamp must be a number, got {scan.stamp!r}") from error
        if not math.isfinite(stamp):
            return Scan(self._stamp if math.isfinite(self._stamp) else 0.0, scan.ranges), False, True
        is_new = stamp != self._stamp
        is_gap = is_new and not 0.0 < stamp - self._stamp < self._longest_gap
        self._stamp = stamp
        return scan, is_new, is_gap

    def _fault_of(self, checked: CheckedScan, is_new: bool) -> str | None:
        """What is wrong with the scan."""
        self._age = 0 if is_new else self._age + 1
        beams = self.lidar.num_beams
        if checked.invalid > MOST_INVALID * beams:
            return f"{checked.invalid} of the scan's {beams} ranges are NaN"
        if self._age > self._longest_gap * self._rate:
            return f"no new scan for {self._age / self._rate:.2f} s: stamps stay, or are not finite"
        return None

    def _ring_of(
        self, scan: Scan, checked: CheckedScan, measured: CheckedOdometry, is_new: bool
    ) -> tuple[FloatArray, FloatArray, LevelScan]:
        """The ring as it was seen, the ring with what is known of the rest, and the latter's levelled scan."""
        here = measured.odom_from_base
        if is_new and self._is_ring and not (checked.unknown and find_gaps(scan.ranges, self._gaps)):
            self._is_seen = False
            return scan.ranges, scan.ranges, self._level
        self._space.stand(here)
        if is_new or not self._is_seen:
            self._space.see(self._odom_at_scan, scan.ranges, self._beams)
            self._is_seen = True
        base_from_then = STANDING if is_new else between(here, self._odom_at_scan)
        write_ring(scan.ranges, self._beams, base_from_then, self._ring)
        seen = ring = self._ring
        if find_gaps(seen, self._gaps):
            ring = seen.copy()
            self._space.fill(here, ring, self._gaps)
        return seen, ring, self._ring_level


def _level_of(beams: BeamGeometry) -> LevelScan:
    """An upright scan of these beams, to be written to."""
    n = len(beams.directions)
    return LevelScan(np.zeros(n), beams.directions.copy(), np.zeros(n, np.bool_), beams.origin.copy())


@njit(cache=True)
def _level_scan(ranges, beams, up, axes, band, level):
    """Project a leaning body's scan onto the floor: ranges over ground, and directions by ``axes``, its levelling.

    Ranges become NaN where a beam ended outside of the band.
    """
    directions, origin = beams.directions, beams.origin
    if up[0] == 0.0 and up[1] == 0.0:
        level.ranges[:] = ranges
        level.beams[:] = directions
        level.origin[:] = origin
        return
    level.origin[0], level.origin[1] = axes[0, 0] * origin[0] + axes[0, 1] * origin[1], axes[1, 1] * origin[1]
    higher = up[0] * origin[0] + up[1] * origin[1]  # than if it stood on base_link's z axis
    for k in range(ranges.shape[0]):
        r = ranges[k]
        rise = up[0] * directions[k, 0] + up[1] * directions[k, 1]
        end = higher + rise * min(r, band.max_range)
        level.ranges[k] = r * math.sqrt(max(1.0 - rise * rise, 0.0)) if band.lowest <= end <= band.highest else math.nan
        x = axes[0, 0] * directions[k, 0] + axes[0, 1] * directions[k, 1]
        y = axes[1, 1] * directions[k, 1]
        length = math.sqrt(x * x + y * y)
        level.beams[k, 0], level.beams[k, 1] = x / length, y / length


@njit(cache=True)
def _mark_movers(level, moving, margin):
    """Mark the returns that belong to a moving track."""
    level.is_mover[:] = False
    for k in range(level.ranges.shape[0]):
        r = level.ranges[k]
        if r < np.inf:
            x, y = level.origin[0] + r * level.beams[k, 0], level.origin[1] + r * level.beams[k, 1]
            level.is_mover[k] = is_of_track(x, y, moving, margin)
