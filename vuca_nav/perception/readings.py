"""Checks of what the sensors say, at the entry of a tick: behind it every number is finite, or says why it is not.

A range has one meaning for every stage, whatever the driver writes:

- Within ``min_range`` and ``max_range`` it is a return.
- ``inf``, from ``max_range`` on, 0.0 and negative numbers: nothing came back. These become ``inf``. REP-117 knows
  ``inf`` only; many drivers write 0.0, some -1.0 or a number beyond the maximum.
- Above 0 but below ``min_range``, and ``-inf`` (REP-117): an obstacle too near to be measured. It is kept clear of, but
  not mapped.
- NaN: a fault (REP-117), nothing is known. So is a beam that ends on the body itself, but that is no fault.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.geometry import between, compose, inverse
from vuca_nav.kernel_cache import njit
from vuca_nav.types import STANDING, BodySpec, FloatArray, LidarSpec, Odometry, Pose2, Scan, Twist2

OWN_BODY = 0.1
"""A return deeper inside the footprint than this is of the body itself, a post or an arm, and tells nothing about the
beam's direction [m]. Five times the range noise: an obstacle that touches is not taken for it."""
FARTHEST = 1e6
"""Greatest coordinate of a pose [m]: up to here double precision keeps it to a nanometre."""
SPEED_MARGIN = 2.0
"""Factor on the body's greatest velocities in the greatest step of its odometry: slip, scale errors, uneven ticks."""
STEP_SLACK, TURN_SLACK = 0.1, 0.2
"""Addition to the greatest step, and to the greatest turn: what legged odometry may jump by [m, rad]."""
LONGEST_STEP = 1.0
"""Longest time between two readings for which a body may have moved on by odometry alone [s]."""
UPRIGHT = (0.0, 0.0, 1.0)
LEAST_UPRIGHT = 0.5
"""Vertical part of the body's measured vertical below which it has fallen: a lean of 60 degrees."""
FASTEST, FASTEST_TURN = 20.0, 50.0
"""Velocities beyond which odometry is wrong whatever the body [m/s, rad/s]; a fall is slower."""
_UNIT = 0.1
"""Greatest error of the length of the vertical, a unit vector."""


class CheckedScan(NamedTuple):
    """A scan whose ranges are above 0, ``inf`` or NaN."""

    scan: Scan
    invalid: int
    """Number of ranges that were NaN, a fault."""
    unknown: int
    """Number of ranges that are NaN now: faults, and beams that end on the body itself."""
    returns: int
    """Number of beams that came back."""


class CheckedOdometry(NamedTuple):
    """Odometry without faults: its pose goes on evenly whatever happens."""

    odom_from_base: Pose2
    motion: Pose2
    """Displacement since the last tick, in the base frame of then; none while it is not known."""
    twist: Twist2
    up: tuple[float, float, float]
    is_known: bool
    """Whether the pose is measured; otherwise it is the last one that was."""
    fault: str | None
    """What is wrong with the reading, None if nothing is."""
    has_jumped: bool
    """Whether the pose has jumped farther than the body can."""


class ScanCheck:
    """Checks scans of one lidar.

    Args:
        lidar: The lidar.
        footprint: Outline of the body (k, 2) in base_link [m]; None if there is none.
    """

    def __init__(self, lidar: LidarSpec, footprint: FloatArray | None):
        self._lidar = lidar
        self._own = np.zeros((lidar.num_beams, 2))
        if footprint is not None:
            self._own = own_ranges(lidar, footprint)

    def check(self, scan: Scan) -> CheckedScan:
        """Bring a scan into shape.

        Returns:
            The scan itself if there is nothing to change.

        Raises:
            BadArgument: If the ranges are no numbers, or not as many as the lidar's beams.
        """
        ranges, beams = as_numbers(scan.ranges, "the scan's ranges"), self._lidar.num_beams
        if ranges.shape != (beams,):
            raise BadArgument(
                f"the scan has ranges of shape {ranges.shape}, the lidar {beams} beams: give it a LidarSpec of the "
                "scans that it gets"
            )
        changed, invalid, unknown, returns = _examine(ranges, self._lidar.min_range, self._lidar.max_range, self._own)
        if changed:
            ranges = ranges.copy()
            _rewrite(ranges, self._lidar.min_range, self._lidar.max_range, self._own)
        if ranges is not scan.ranges:
            scan = Scan(scan.stamp, ranges)
        return CheckedScan(scan, invalid, unknown, returns)


class OdometryCheck:
    """Checks odometry: what is not finite, or farther from the last reading than the body can get, is a fault.

    After a jump the odometry goes on from where it was: the body has not moved as far, and nobody knows how far.

    Args:
        body: The body whose limits bound a step; None: any step is possible.
        rate: Rate of the ticks [Hz].
    """

    def __init__(self, body: BodySpec | None, rate: float):
        self._period = 1.0 / rate
        self._speed = self._turn = math.inf
        if body is not None:
            self._speed = SPEED_MARGIN * math.hypot(max(body.max_v_x, -body.min_v_x), body.max_v_y)
            self._turn = SPEED_MARGIN * body.max_w_z
        self.reset()

    def reset(self) -> None:
        """Forget the last mission."""
        self._before: Pose2 | None = None
        self._stamp = -math.inf
        self._has_jumped = False
        self._checked: Pose2 | None = None
        self._checked_from_raw: Pose2 | None = None

    def check(self, odometry: Odometry) -> CheckedOdometry:
        """Take in the next reading.

        Raises:
            BadArgument: If a part of it is no numbers.
        """
        try:
            x, y, z = odometry.up
            up = float(x), float(y), float(z)
            twist = Twist2(float(odometry.twist[0]), float(odometry.twist[1]), float(odometry.twist[2]))
            x, y, yaw = odometry.odom_from_base
            raw = Pose2(float(x), float(y), float(yaw))
            stamp = float(odometry.stamp)
        except (TypeError, ValueError, OverflowError, IndexError) as error:
            raise BadArgument(f"the odometry's stamp, pose, velocity or vertical is no numbers: {odometry}") from error
        fault = None
        if not abs(math.sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]) - 1.0) < _UNIT:
            fault, up = f"the vertical is no unit vector: {up}", UPRIGHT
        elif up[2] < LEAST_UPRIGHT:
            fault = f"the body has fallen: its vertical is {up}"
        if not (abs(twist[0]) < FASTEST and abs(twist[1]) < FASTEST and abs(twist[2]) < FASTEST_TURN):
            fault = f"the odometry's velocity is not finite, or no body's: {tuple(twist)}"
        self._has_jumped = False
        here, motion, wrong = self._follow(raw, stamp)
        return CheckedOdometry(here, motion, twist, up, wrong is None, wrong or fault, self._has_jumped)

    def _follow(self, raw: Pose2, stamp: float) -> tuple[Pose2, Pose2, str | None]:
        """The checked pose, the motion since the last tick, and what is wrong."""
        here = self._checked or STANDING
        if not (abs(raw.x) < FARTHEST and abs(raw.y) < FARTHEST and abs(raw.yaw) < FARTHEST):
            return here, STANDING, f"the odometry's pose is not finite or beyond {FARTHEST:g} m: {tuple(raw)}"
        before, self._before = self._before, raw
        elapsed, self._stamp = stamp - self._stamp, stamp
        if before is None:
            self._checked = raw
            return raw, STANDING, None
        motion = between(before, raw)
        elapsed = min(max(elapsed, self._period), LONGEST_STEP) if math.isfinite(elapsed) else self._period
        way = math.hypot(motion.x, motion.y)
        if way > self._speed * elapsed + STEP_SLACK or abs(motion.yaw) > self._turn * elapsed + TURN_SLACK:
            self._checked_from_raw = compose(here, inverse(raw))
            self._has_jumped = True
            jump = f"{way:.3g} m and {motion.yaw:.3g} rad in {elapsed:.3g} s"
            return here, STANDING, f"the odometry jumped by {jump}, farther than the body can"
        self._checked = raw if self._checked_from_raw is None else compose(self._checked_from_raw, raw)
        return self._checked, motion, None


def as_numbers(values: object, what: str) -> FloatArray:
    """Take numbers for the compiled code: contiguous doubles that may be written to.

    Args:
        values: The numbers; returned as they are if nothing has to change.
        what: Name of the values, for the error.

    Raises:
        BadArgument: If they are no real numbers.
    """
    try:
        array = values if isinstance(values, np.ndarray) else np.asarray(values)
    except ValueError as error:
        raise BadArgument(f"{what} must be numbers: {error}") from error
    if array.dtype.kind not in "fiu":
        raise BadArgument(f"{what} must be numbers, got an array of {array.dtype}")
    fits = type(array) is np.ndarray and array.dtype == np.float64 and array.dtype.isnative
    if fits and array.flags.c_contiguous and array.flags.writeable and array.flags.aligned:
        return array
    return np.array(array, np.float64, order="C", subok=False)


def own_ranges(lidar: LidarSpec, footprint: FloatArray) -> FloatArray:
    """First and last range between which a return is of the body itself, for each beam (num_beams, 2) [m].

    Args:
        lidar: The lidar.
        footprint: Convex outline in base_link, counter-clockwise, (k, 2) [m].
    """
    edges = np.roll(footprint, -1, axis=0) - footprint
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None]  # outwards
    offsets = (normals * footprint).sum(axis=1) - OWN_BODY
    angles = lidar.angles_in_base()
    approach = np.column_stack([np.cos(angles), np.sin(angles)]) @ normals.T  # (num_beams, k)
    left = offsets - normals @ np.array([lidar.mount.x, lidar.mount.y])  # distance that each edge is ahead
    with np.errstate(divide="ignore", invalid="ignore"):
        meets = left / approach
    enter = np.where(approach < -1e-12, meets, np.where((abs(approach) <= 1e-12) & (left < 0.0), np.inf, 0.0))
    leave = np.where(approach > 1e-12, meets, np.inf)
    first, last = enter.max(axis=1, initial=0.0), leave.min(axis=1, initial=np.inf)
    return np.where((first < last)[:, None], np.column_stack([first, last]), 0.0)


@njit(cache=True)
def _examine(ranges, min_range, max_range, own):
    """Whether there is a range to change, and how many were NaN, will be NaN, and are returns."""
    changed = False
    invalid = unknown = returns = 0
    for k in range(len(ranges)):
        r = ranges[k]
        if r != r:
            invalid += 1
            continue
        meant = _meaning(r, min_range, max_range, own[k])
        changed |= meant != r
        unknown += meant != meant
        returns += meant < np.inf
    return changed, invalid, unknown + invalid, returns


@njit(cache=True)
def _rewrite(ranges, min_range, max_range, own):
    for k in range(len(ranges)):
        if ranges[k] == ranges[k]:
            ranges[k] = _meaning(ranges[k], min_range, max_range, own[k])


@njit(cache=True)
def _meaning(r, min_range, max_range, own):
    """The range that a number stands for: itself, ``inf``, or NaN if it is of the body."""
    if r == -np.inf and min_range > 0.0:
        r = 0.5 * min_range
    if not 0.0 < r < max_range:
        return np.inf
    return np.nan if own[0] <= r < own[1] else r
