"""The local policy's observation (Zhang et al., Section III-B): ``[O_L, O_m, O_g, O_v]``, the same for every body.

Ranges are given beyond the footprint and velocities relative to the body's limits. ``Observer`` serves training
(hundreds of rows a call, with a memory of its own), ``PerceptObserver`` simulation and robot (one row, all of which is
in the percept); for the same scans and tracks the numbers are the same.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from vuca_nav.checks import check_fields
from vuca_nav.errors import BadArgument
from vuca_nav.footprint import outline_ranges
from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.ring import ring_of
from vuca_nav.perception.tracks import Tracker
from vuca_nav.policy import frames
from vuca_nav.policy.track_features import (
    DIRECTIONS,
    RADIUS_SCALE,
    SHOWN_SIZE,
    SLOT_SIZE,
    SLOTS,
    SPEEDS,
    TrackWorkspace,
    write_features,
    write_features_of_rows,
)
from vuca_nav.types import BodySpec, FloatArray, LidarSpec, VelocityCommand

Kind = Literal["paper", "tracked", "frames"]
GOAL_SIZE, TWIST_SIZE, BODY_SIZE = 3, 3, 6
HALF_DISTANCE = 3.0
"""Distance of the goal that reads 0, halfway between here (-1) and infinitely far (+1) [m]."""
CLOSING_SPEED = 2.0
"""Closing speed of an obstacle and the body at which a scan difference reads -1 [m/s]: two brisk pedestrians."""
TWIST_LIMIT = 2.0
"""Multiple of the body's limits that velocities are clipped to: a bound for odometry glitches."""
SPEED_SCALE, TURN_SCALE, ACCELERATION_SCALE = 1.5, 3.0, 3.0
"""Scales of the body vector [m/s, rad/s, m/s^2]: about the greatest of the bodies in use."""

MOST_SECTORS, MOST_HISTORY, MOST_SPACING = 1440, 64, 2.0
"""Greatest values of a configuration, the last in seconds: a weights file brings its own, and must not ask for all
memory."""
MOST_RANGE = 1000.0
"""Greatest ``max_range`` [m], beyond that of any lidar."""


@dataclass(frozen=True, slots=True)
class ObservationConfig:
    """Parts of an observation. Weights belong to one configuration and carry it along."""

    sectors: int = 60
    """Number of sectors that the scan, for ``frames`` the half of it ahead, is pooled to (least range); it divides the
    number of beams. Sector k begins at ``-pi + k * 2 pi / sectors``, for ``frames`` at ``-pi / 2 + k * pi / sectors``;
    k and ``sectors - 1 - k`` are mirror images."""
    max_range: float = 6.0
    """Greatest range beyond the footprint [m]; farther returns, and beams without one, read as this."""
    history: int = 3
    """Number n of past scans that O_m compares with the present one."""
    spacing: float = 0.1
    """Time between the scans of the history [s]."""
    kind: Kind = "paper"
    """``paper``: exactly Section III-B. ``tracked``: in place of O_m the tracks, and the body's limits
    and size; O_L, the urgency of meeting a track in each direction (``vuca_nav.policy.track_features``), O_g, O_v,
    body, the urgency for standing still, the most threatening tracks. ``frames``: the past scans ahead and the present
    one, goal and speed (``vuca_nav.policy.frames``)."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        for name, most in (("sectors", MOST_SECTORS), ("history", MOST_HISTORY)):
            check_fields(self, f"1 to {most}", lambda n, most=most: isinstance(n, int) and 1 <= n <= most, name)
        for name, most in (("max_range", MOST_RANGE), ("spacing", MOST_SPACING)):
            check_fields(self, f"above 0 and at most {most:g}", lambda n, most=most: 0.0 < n <= most, name)
        if self.kind not in get_args(Kind):
            raise BadArgument(f"an observation is of kind {' or '.join(get_args(Kind))}, got {self.kind!r}")

    @property
    def lags(self) -> tuple[int, ...]:
        """Ages of the past scans that are looked at, in spacings."""
        return () if self.kind == "tracked" else tuple(range(1, self.history + 1))

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of the blocks before O_g, each a row of directions that is its own mirror image reversed."""
        if self.kind == "frames":
            return (self.sectors,) * (self.history + 1)
        if self.kind == "paper":
            return (self.sectors,) * 2
        return (self.sectors, *(DIRECTIONS,) * len(SPEEDS))

    @property
    def goal_slice(self) -> slice:
        """Indices of O_g."""
        start = sum(self.blocks)
        return slice(start, start + (frames.GOAL_SIZE if self.kind == "frames" else GOAL_SIZE))

    @property
    def size(self) -> int:
        """Number of values in an observation."""
        if self.kind == "frames":
            return self.goal_slice.stop + frames.SPEED_SIZE
        size = self.goal_slice.stop + TWIST_SIZE
        return size if self.kind == "paper" else size + BODY_SIZE + SHOWN_SIZE

    @property
    def memory(self) -> float:
        """Age of the oldest scan that is looked at [s]."""
        return max(self.lags, default=0) * self.spacing

    def mirror(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Order (size,) and signs (size,) of the observation with left and right exchanged: ``o[order] * signs``."""
        order, signs = np.arange(self.size), np.ones(self.size, np.float32)
        at = 0
        for block in self.blocks:
            order[at : at + block] = order[at : at + block][::-1].copy()
            at += block
        if self.kind == "frames":
            signs[[at + 1, at + 3]] = -1.0  # the goal's y, w_z
            return order, signs
        signs[at + 2] = -1.0  # sine of the goal's bearing
        signs[at + GOAL_SIZE + 1 : at + GOAL_SIZE + 3] = -1.0  # v_y, w_z
        if self.kind == "tracked":
            first = self.size - SLOTS * SLOT_SIZE
            signs[first + 1 :: SLOT_SIZE] = -1.0  # y
            signs[first + 3 :: SLOT_SIZE] = -1.0  # v_y
        return order, signs


class _Layout(NamedTuple):
    """Places and scales of an observation's parts."""

    sectors: int
    max_range: float
    goal_start: int
    per_metre: float
    """Scale of O_m's sum, to [-1, 1]."""
    tracked: bool


class _Bodies(NamedTuple):
    """Properties of n bodies that observations depend on."""

    outline: FloatArray
    """(n, num_beams) distance to the footprint's edge along each beam [m]."""
    limits: FloatArray
    """(n, 4) limits as ``limits_of`` gives them."""
    vectors: FloatArray
    """(n, BODY_SIZE) body vectors of ``tracked``."""
    radii: FloatArray
    """(n,) mean radius of the footprint [m]."""
    reaches: FloatArray
    """(n,) greatest distance from base_link at which anything is seen [m]."""


class _Ring(NamedTuple):
    """Pooled scans of the past, n rows."""

    scans: FloatArray
    """(n, depth, sectors) pooled scans."""
    fresh: NDArray[np.bool_]
    """(n,) rows whose next scan stands for all of the past."""
    lags: NDArray[np.int64]
    """Ages of the scans that are looked at, in calls."""


class Observer:
    """Makes observations, a row for each robot, and remembers the past scans that they need.

    Args:
        config: Parts of the observation.
        bodies: A body for each row.
        num_beams: Beams of a scan; beam i points at ``-pi + i * 2 pi / num_beams``.
        rate: Rate of ``observe`` [Hz].

    Raises:
        BadArgument: If the sectors do not divide the beams, or the calls the spacing, or a body's outline does not
            enclose its base_link.
    """

    def __init__(self, config: ObservationConfig, bodies: Sequence[BodySpec], num_beams: int, rate: float):
        lags = _lags_in_ticks(config, num_beams, rate)
        self.config = config
        self.size = config.size
        n = len(bodies)
        self._every = np.arange(n)
        self._layout = _layout_of(config)
        depth = int(lags.max(initial=0)) + 1
        self._ring = _Ring(np.empty((n, depth, config.sectors)), np.ones(n, np.bool_), lags)
        self._slot = 0
        self._tracker = Tracker(n, num_beams, 1.0 / rate, config.spacing) if config.kind == "tracked" else None
        self._workspace = TrackWorkspace.new()
        self._bodies = _Bodies(
            np.empty((n, num_beams)), np.empty((n, 4)), np.empty((n, BODY_SIZE)), np.empty(n), np.empty(n)
        )
        for i, body in enumerate(bodies):
            _write_body(self._bodies, i, body, config)

    @property
    def outline(self) -> FloatArray:
        """(n, num_beams) distance to each row's footprint's edge along each beam [m]."""
        return self._bodies.outline

    @property
    def limits(self) -> FloatArray:
        """(n, 4) limits of each row as ``limits_of`` gives them."""
        return self._bodies.limits

    def take_bodies(self, rows: NDArray[np.int64], source: "Observer", source_rows: NDArray[np.int64]) -> None:
        """Give these rows the bodies of another observer's rows; both must have as many beams."""
        for own, other in zip(self._bodies, source._bodies):
            own[rows] = other[source_rows]

    def reset(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice = slice(None)) -> None:
        """Forget the past of these rows (a mask or indices): their next scan stands for all of it."""
        self._ring.fresh[rows] = True

    def observe(
        self,
        ranges: FloatArray,
        goals_in_base: FloatArray,
        twists: FloatArray,
        motions: FloatArray,
        out: NDArray[np.float32],
        first_of: NDArray[np.int64] | None = None,
        only: NDArray[np.int64] | None = None,
    ) -> None:
        """Make the next observation of every row.

        Args:
            ranges: (n, num_beams) [m]; ``inf`` or NaN where nothing came back.
            goals_in_base: (n, 2) the waypoints [m].
            twists: (n, 3) measured velocities in base_link [m/s, m/s, rad/s].
            motions: (n, 3) the base's displacement since the last call by odometry: x, y, yaw in the base frame of
                then [m, m, rad]. ``paper`` does not use them.
            out: (n, size) float32, written to.
            first_of: Make only the first observation of these rows, which were reset since the last call; for the
                others no time passes.
            only: Leave the other rows' observations alone; they must be reset before they are observed again.

        Raises:
            BadArgument: If an array has another shape.
        """
        n, beams = self._bodies.outline.shape
        for what, array, width in (
            ("ranges", ranges, beams), ("goals_in_base", goals_in_base, 2), ("twists", twists, 3),
            ("motions", motions, 3), ("out", out, self.size),
        ):  # fmt: skip
            if array.shape != (n, width):
                raise BadArgument(f"{what} has shape {array.shape}, expected {(n, width)}: a row for each robot")
        config, bodies, ring = self.config, self._bodies, self._ring
        if first_of is None:
            self._slot = (self._slot + 1) % ring.scans.shape[1]
        rows = next((rows for rows in (first_of, only) if rows is not None), self._every)
        if config.kind == "frames":
            frames.write_frames_of_rows(
                rows, ranges, goals_in_base, twists, bodies, ring, self._slot, config.max_range, out
            )
        else:
            _observe_rows(rows, ranges, goals_in_base, twists, bodies, ring, self._slot, self._layout, out)
        if self._tracker is not None:
            goal = config.goal_slice
            self._tracker.update(rows, ranges, motions, bodies.reaches, ring.fresh)
            meetings, shown = out[:, config.sectors : goal.start], out[:, goal.stop + TWIST_SIZE + BODY_SIZE :]
            write_features_of_rows(
                rows, self._tracker.state, bodies.radii, bodies.limits[:, 0], self._workspace, meetings, shown
            )
        ring.fresh[rows] = False


class PerceptObserver:
    """Makes the observation of one robot from a percept. It keeps no memory.

    Args:
        config: Parts of the observation.
        body: The body that is driven.
        lidar: The body's lidar.
        rate: Rate of the ticks [Hz]; by default the lidar's.

    Raises:
        BadArgument: Under the conditions of ``Observer``, for the beams of the lidar's ring.
    """

    def __init__(self, config: ObservationConfig, body: BodySpec, lidar: LidarSpec, rate: float | None = None):
        self.config = config
        ring = ring_of(lidar, rate)
        self._lags = _lags_in_ticks(config, ring.num_beams, ring.rate)
        self._layout = _layout_of(config)
        self._workspace = TrackWorkspace.new()
        self._body = _Bodies(
            np.empty((1, ring.num_beams)), np.empty((1, 4)), np.empty((1, BODY_SIZE)), np.empty(1), np.empty(1)
        )
        _write_body(self._body, 0, body, config)
        self._observation = np.zeros(config.size, np.float32)

    def observe(self, percept: Percept, goal_in_base: tuple[float, float]) -> NDArray[np.float32]:
        """Make the observation with this waypoint [m], (size,); valid until the next call.

        Raises:
            BadArgument: If the percept does not go back far enough, or is of another lidar.
        """
        if percept.ring.shape != self._body.outline[0].shape:
            raise BadArgument(
                f"the percept's ring has {len(percept.ring)} beams, the policy's {self._body.outline.shape[1]}: give "
                "both the same LidarSpec"
            )
        depth = int(self._lags.max(initial=0)) + 1
        if depth > percept.history.depth:
            raise BadArgument(
                f"the policy compares scans of {self.config.memory:g} s, perception keeps {percept.history.depth} of "
                f"the {depth} that takes: give it a greater memory"
            )
        past = percept.history.past(self._lags)
        if self.config.kind == "frames":
            frames.write_frames(
                percept.ring, past, goal_in_base, percept.twist, self._body, self.config.max_range,
                self._observation,
            )  # fmt: skip
            return self._observation
        _observe_percept(
            percept.ring, past, percept.tracks, goal_in_base, percept.twist, self._body, self._layout,
            self._workspace, self._observation,
        )  # fmt: skip
        return self._observation


def _lags_in_ticks(config: ObservationConfig, num_beams: int, rate: float) -> NDArray[np.int64]:
    """Ages of O_m's scans in ticks; raises BadArgument under the conditions of ``Observer``."""
    if config.kind == "frames" and (num_beams % (2 * config.sectors) or num_beams % 4):
        raise BadArgument(
            f"{config.sectors} sectors ahead do not divide half of the {num_beams} beams of the lidar evenly, or a "
            "quarter of them is no whole number"
        )
    if num_beams % config.sectors:
        raise BadArgument(f"{config.sectors} sectors do not divide the {num_beams} beams of the lidar evenly")
    stride = round(config.spacing * rate)
    if stride < 1 or abs(stride - config.spacing * rate) > 1e-6:
        raise BadArgument(f"scans spaced by {config.spacing} s cannot be had from {rate} Hz exactly")
    return np.array(config.lags, np.int64) * stride


def _layout_of(config: ObservationConfig) -> _Layout:
    per_metre = 1.0 / (CLOSING_SPEED * max(len(config.lags), 1) * config.spacing)
    return _Layout(config.sectors, config.max_range, config.goal_slice.start, per_metre, config.kind == "tracked")


def _write_body(bodies: _Bodies, i: int, body: BodySpec, config: ObservationConfig) -> None:
    """Write a body into row ``i``."""
    bodies.outline[i] = outline = outline_ranges(body.footprint, bodies.outline.shape[1])
    bodies.radii[i], bodies.reaches[i] = outline.mean(), config.max_range + outline.max()
    bodies.limits[i] = limits_of(body)
    bodies.vectors[i] = (
        body.max_v_x / SPEED_SCALE,
        body.min_v_x / SPEED_SCALE,
        body.max_v_y / SPEED_SCALE,
        body.max_w_z / TURN_SCALE,
        body.max_a_x / ACCELERATION_SCALE,
        body.radius / RADIUS_SCALE,
    )


def limits_of(body: BodySpec) -> FloatArray:
    """Limits (4,) of a body: max_v_x, min_v_x, max_v_y, max_w_z [m/s, m/s, m/s, rad/s]."""
    return np.array([body.max_v_x, body.min_v_x, body.max_v_y, body.max_w_z])


def command_from_action(action: NDArray[np.floating], limits: NDArray[np.floating]) -> NDArray[np.floating]:
    """Convert actions in [-1, 1] to velocities; actions beyond are clipped.

    Args:
        action: (..., 3) shares of the body's limits.
        limits: (..., 4) as ``limits_of`` gives them.

    Returns:
        (..., 3) v_x, v_y [m/s] and w_z [rad/s] in base_link.
    """
    share = np.clip(action, -1.0, 1.0)
    forward = share[..., 0]
    command = np.empty_like(share)
    command[..., 0] = np.where(forward >= 0.0, forward * limits[..., 0], -forward * limits[..., 1])
    command[..., 1:] = share[..., 1:] * limits[..., 2:]
    return command


def action_from_command(command: VelocityCommand, limits: NDArray[np.floating]) -> tuple[float, float, float]:
    """The inverse of ``command_from_action`` for a command within the limits (4,)."""
    v_x, v_y, w_z = command
    backward = -limits[1] if limits[1] < 0.0 else 1.0
    return (
        v_x / limits[0] if v_x >= 0.0 else v_x / backward,
        v_y / limits[2] if limits[2] > 0.0 else 0.0,
        w_z / limits[3],
    )


def goal_features(points_in_base: NDArray[np.floating]) -> NDArray[np.float32]:
    """O_g of points (m, 2) [m]: squashed distance, cosine and sine of the bearing, (m, 3)."""
    out = np.empty((len(points_in_base), GOAL_SIZE), np.float32)
    _write_goals(points_in_base, out)
    return out


@njit(cache=True, nogil=True)
def _observe_rows(rows, ranges, goals, twists, bodies, ring, slot, layout, out):
    depth, lags, sectors = ring.scans.shape[1], ring.lags, layout.sectors
    for i in rows:
        _pool(ranges[i], bodies.outline[i], layout, out[i])
        if not layout.tracked:
            for s in range(sectors):
                now = 0.5 * (out[i, s] + 1.0) * layout.max_range
                if ring.fresh[i]:
                    ring.scans[i, :, s] = now
                ring.scans[i, slot, s] = now
                # O_m = sum_{k=1..n} (O_L^t - O_L^{t-k}) / k
                motion = 0.0
                for k in range(len(lags)):
                    motion += (now - ring.scans[i, (slot - lags[k]) % depth, s]) / (k + 1)
                out[i, sectors + s] = min(max(motion * layout.per_metre, -1.0), 1.0)
        _write_motion(i, goals[i], twists[i], bodies, layout, out[i])


@njit(cache=True, nogil=True)
def _observe_percept(ranges, past, tracks, goal, twist, body, layout, workspace, out):
    sectors, start = layout.sectors, layout.goal_start
    _pool(ranges, body.outline[0], layout, out)
    if layout.tracked:
        shown = out[start + GOAL_SIZE + TWIST_SIZE + BODY_SIZE :]
        write_features(
            tracks, body.reaches[0], body.radii[0], body.limits[0, 0], workspace, out[sectors:start], shown
        )  # fmt: skip
    else:
        out[sectors : 2 * sectors] = 0.0
        motions = np.zeros(sectors)
        then = np.empty(sectors, np.float32)
        for k in range(len(past)):
            _pool(past[k], body.outline[0], layout, then)
            for s in range(sectors):
                # In metres, as the sum is.
                now, before = 0.5 * (out[s] + 1.0) * layout.max_range, 0.5 * (then[s] + 1.0) * layout.max_range
                motions[s] += (now - before) / (k + 1)
        for s in range(sectors):
            out[sectors + s] = min(max(motions[s] * layout.per_metre, -1.0), 1.0)
    _write_motion(0, goal, twist, body, layout, out)


@njit(cache=True, nogil=True)
def _write_motion(i, goal, twist, bodies, layout, out):
    """Write O_g, O_v, and for ``tracked`` the body's vector, of row ``i``."""
    at = layout.goal_start
    _write_goal(goal[0], goal[1], out[at : at + GOAL_SIZE])
    at += GOAL_SIZE
    limits = bodies.limits[i]
    forward = limits[0] if twist[0] >= 0.0 or limits[1] >= 0.0 else -limits[1]
    out[at] = _relative(twist[0], forward)
    out[at + 1] = _relative(twist[1], limits[2])
    out[at + 2] = _relative(twist[2], limits[3])
    if layout.tracked:
        at += TWIST_SIZE
        out[at : at + BODY_SIZE] = bodies.vectors[i]


@njit(cache=True, nogil=True)
def _relative(velocity, limit):
    """A velocity as a share of its limit; 0 where the body cannot move that way."""
    return min(max(velocity / limit, -TWIST_LIMIT), TWIST_LIMIT) if limit > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _write_goals(points, out):
    for i in range(points.shape[0]):
        _write_goal(points[i, 0], points[i, 1], out[i])


@njit(cache=True, nogil=True)
def _write_goal(x, y, out):
    away = math.sqrt(x * x + y * y)
    out[0] = 2.0 * away / (away + HALF_DISTANCE) - 1.0
    out[1] = x / away if away > 0.0 else 1.0
    out[2] = y / away if away > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _pool(ranges, outline, layout, out):
    """Write O_L: least clearance of each sector's beams, from [0, max_range] to [-1, 1].

    The beam on a border belongs to both sectors, which makes the mirror image of a scan that of its sectors.
    """
    sectors, max_range = layout.sectors, layout.max_range
    num_beams = len(ranges)
    per_sector = num_beams // sectors
    for s in range(sectors):
        least = max_range
        for k in range(s * per_sector, (s + 1) * per_sector + 1):
            b = k if k < num_beams else 0
            clearance = ranges[b] - outline[b]
            if clearance < least:  # neither inf nor NaN is
                least = clearance
        out[s] = 2.0 * max(least, 0.0) / max_range - 1.0
