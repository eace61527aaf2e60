"""What the local policy sees (Section III-B): ``[O_L, O_m, O_g, O_v]``, the same for every body.

Ranges are given beyond the footprint and velocities relative to the body's limits. One class serves training
(hundreds of rows a call), simulation and robot (one row); a row's numbers do not depend on the other rows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.checks import check_fields, check_positive
from vuca_nav.errors import BadArgument
from vuca_nav.perception.tracks import DIRECTIONS, SLOT_SIZE, SLOTS, SPEEDS, Tracker
from vuca_nav.types import BodySpec, FloatArray

Kind = Literal["paper", "tracked"]
GOAL_SIZE, TWIST_SIZE, BODY_SIZE = 3, 3, 6
THINGS_SIZE = 1 + SLOTS * SLOT_SIZE
"""Of what ``tracked`` shows after the body: standing still, and the things."""
HALF_DISTANCE = 3.0
"""Distance of the goal that reads 0, halfway between here (-1) and infinitely far (+1) [m]."""
CLOSING_SPEED = 2.0
"""Of an obstacle and the body, at which a scan difference reads -1 [m/s]: two brisk walkers meeting at an angle."""
TWIST_LIMIT = 2.0
"""Velocities are clipped to so many times the body's limits: what an odometry glitch can do at most."""
SPEED_SCALE, TURN_SCALE, ACCELERATION_SCALE, RADIUS_SCALE = 1.5, 3.0, 3.0, 0.5
"""Of the body vector [m/s, rad/s, m/s^2, m]: about the greatest of the bodies in use."""

MOST_SECTORS, MOST_HISTORY = 1440, 64
"""Of a configuration: weights files bring theirs along, and one from elsewhere must not ask for all memory."""


@dataclass(frozen=True, slots=True)
class ObservationConfig:
    """What an observation is made of. Weights belong to one configuration and carry it along."""

    sectors: int = 60
    """The scan is pooled (least range) to so many; the lidar's number of beams must be a multiple. Sector k begins at
    ``-pi + k * 2 pi / sectors``; k and ``sectors - 1 - k`` are mirror images."""
    max_range: float = 6.0
    """Beyond the footprint [m]; what is farther, or nothing at all, reads as this."""
    history: int = 3
    """n of O_m, the number of past scans that the present one is compared with."""
    spacing: float = 0.1
    """Between the scans of the history [s]."""
    kind: Kind = "paper"
    """``paper``: exactly Section III-B. ``tracked``: in place of O_m what is known of moving things, and the body's
    limits and size; O_L, how soon a thing is met in each direction (``vuca_nav.perception.tracks``), O_g, O_v, body,
    the same for standing still, the most threatening things."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        for name, most in (("sectors", MOST_SECTORS), ("history", MOST_HISTORY)):
            check_fields(self, f"1 to {most}", lambda n, most=most: isinstance(n, int) and 1 <= n <= most, name)
        check_positive(self, "max_range", "spacing")
        if self.kind not in get_args(Kind):
            raise BadArgument(f"an observation is of kind {' or '.join(get_args(Kind))}, got {self.kind!r}")

    @property
    def lags(self) -> tuple[int, ...]:
        """Ages of the past scans that are looked at, in spacings."""
        return tuple(range(1, self.history + 1)) if self.kind == "paper" else ()

    @property
    def blocks(self) -> tuple[int, ...]:
        """Sizes of what comes before O_g, each a ring around the body that is its own mirror image reversed."""
        if self.kind == "paper":
            return (self.sectors,) * 2
        return (self.sectors, *(DIRECTIONS,) * len(SPEEDS))

    @property
    def goal_slice(self) -> slice:
        """Where O_g is."""
        start = sum(self.blocks)
        return slice(start, start + GOAL_SIZE)

    @property
    def size(self) -> int:
        """Numbers in an observation."""
        size = self.goal_slice.stop + TWIST_SIZE
        return size if self.kind == "paper" else size + BODY_SIZE + THINGS_SIZE

    def mirror(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Order (size,) and signs (size,) of the observation with left and right exchanged: ``o[order] * signs``."""
        order, signs = np.arange(self.size), np.ones(self.size, np.float32)
        at = 0
        for block in self.blocks:
            order[at : at + block] = order[at : at + block][::-1].copy()
            at += block
        signs[at + 2] = -1.0  # sine of the goal's bearing
        signs[at + GOAL_SIZE + 1 : at + GOAL_SIZE + 3] = -1.0  # v_y, w_z
        if self.kind == "tracked":
            first = self.size - SLOTS * SLOT_SIZE
            signs[first + 1 :: SLOT_SIZE] = -1.0  # y
            signs[first + 3 :: SLOT_SIZE] = -1.0  # v_y
        return order, signs


class Observer:
    """Makes observations, a row for each robot.

    Args:
        config: What of.
        bodies: One for each row.
        num_beams: Of the scans; beam i points at ``-pi + i * 2 pi / num_beams``.
        rate: Calls of ``observe`` a second [Hz].

    Raises:
        BadArgument: If the sectors do not divide the beams, or the calls the spacing, or a body's outline does not
            enclose its base_link.
    """

    def __init__(self, config: ObservationConfig, bodies: Sequence[BodySpec], num_beams: int, rate: float):
        if num_beams % config.sectors:
            raise BadArgument(f"{config.sectors} sectors do not divide the {num_beams} beams of the lidar evenly")
        stride = round(config.spacing * rate)
        if stride < 1 or abs(stride - config.spacing * rate) > 1e-6:
            raise BadArgument(f"scans spaced by {config.spacing} s cannot be had from {rate} Hz exactly")
        self.config = config
        self.size = config.size
        n = len(bodies)
        self._every = np.arange(n)
        self._fresh = np.ones(n, np.bool_)
        self._lags = np.array(config.lags, np.int64) * stride
        self._scans = np.empty((n, max(config.lags, default=0) * stride + 1, config.sectors))
        self._slot = 0
        self._tracker = None
        if config.kind == "tracked":
            self._tracker = Tracker(n, num_beams, 1.0 / rate, config.spacing)
        self.outline = np.empty((n, num_beams))
        """Of each row's footprint along each beam [m]."""
        self.limits = np.empty((n, 4))
        """Each row's, as ``limits_of`` gives them."""
        self._bodies = np.empty((n, BODY_SIZE))
        self._radii, self._reaches = np.empty(n), np.empty(n)
        for i, body in enumerate(bodies):
            self.set_body(i, body)

    def set_body(self, i: int, body: BodySpec) -> None:
        """Row ``i`` is this body from now on."""
        self.outline[i] = outline = outline_ranges(body.footprint, self.outline.shape[1])
        self._radii[i], self._reaches[i] = outline.mean(), self.config.max_range + outline.max()
        self.limits[i] = limits_of(body)
        self._bodies[i] = (
            body.max_v_x / SPEED_SCALE,
            body.min_v_x / SPEED_SCALE,
            body.max_v_y / SPEED_SCALE,
            body.max_w_z / TURN_SCALE,
            body.max_a_x / ACCELERATION_SCALE,
            body.radius / RADIUS_SCALE,
        )

    def take_bodies(self, rows: NDArray[np.int64], source: "Observer", source_rows: NDArray[np.int64]) -> None:
        """These rows are from now on the bodies of another observer's rows, for as many beams."""
        for name in ("outline", "limits", "_bodies", "_radii", "_reaches"):
            getattr(self, name)[rows] = getattr(source, name)[source_rows]

    def reset(self, rows: NDArray[np.bool_] | NDArray[np.int64] | slice = slice(None)) -> None:
        """Forget the past of these rows (a mask or indices): their next scan stands for all of it."""
        self._fresh[rows] = True

    def observe(
        self,
        ranges: NDArray[np.floating],
        goals_in_base: NDArray[np.floating],
        twists: NDArray[np.floating],
        motions: NDArray[np.floating],
        out: NDArray[np.float32],
        first_of: NDArray[np.int64] | None = None,
        only: NDArray[np.int64] | None = None,
    ) -> None:
        """The next observation of every row.

        Args:
            ranges: (n, num_beams) [m]; ``inf`` or NaN where nothing came back.
            goals_in_base: (n, 2) the waypoints [m].
            twists: (n, 3) measured velocities in base_link [m/s, m/s, rad/s].
            motions: (n, 3) the base's displacement since the last call by odometry: x, y, yaw in the base frame of
                then [m, m, rad]. Not looked at by ``paper``.
            out: (n, size), written to.
            first_of: Only the first observation of these rows, which were reset since the last call; for the others
                no time passes.
            only: Leave the other rows' observations alone; they must be reset before they are looked at again.
        """
        config = self.config
        if first_of is None:
            self._slot = (self._slot + 1) % self._scans.shape[1]
        rows = next((rows for rows in (first_of, only) if rows is not None), self._every)
        _observe(
            rows, ranges, goals_in_base, twists, self.outline, self.limits, self._bodies, self._scans, self._fresh,
            self._slot, self._lags, config.sectors, config.max_range, config.spacing, config.goal_slice.start, out,
        )  # fmt: skip
        if self._tracker is not None:
            goal = config.goal_slice
            self._tracker.update(rows, ranges, motions, self._reaches, self._fresh)
            self._tracker.features(
                rows,
                self._radii,
                self.limits[:, 0],
                out[:, config.sectors : goal.start],
                out[:, goal.stop + TWIST_SIZE + BODY_SIZE :],
            )
        self._fresh[rows] = False


def limits_of(body: BodySpec) -> FloatArray:
    """(4,) max_v_x, min_v_x, max_v_y, max_w_z [m/s, m/s, m/s, rad/s]."""
    return np.array([body.max_v_x, body.min_v_x, body.max_v_y, body.max_w_z])


def command_from_action(action: NDArray[np.floating], limits: NDArray[np.floating]) -> NDArray[np.floating]:
    """Velocities from actions in [-1, 1]; what is beyond is clipped.

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


def goal_features(points_in_base: NDArray[np.floating]) -> NDArray[np.float32]:
    """O_g of points (m, 2) [m]: squashed distance, cosine and sine of the bearing, (m, 3)."""
    out = np.empty((len(points_in_base), GOAL_SIZE), np.float32)
    _goals(points_in_base, out)
    return out


def outline_ranges(footprint: FloatArray, num_beams: int) -> FloatArray:
    """Distance from base_link's origin to a convex outline along each beam, (num_beams,) [m].

    Args:
        footprint: Counter-clockwise, (k, 2) [m].
        num_beams: Of the lidar.

    Raises:
        BadArgument: If the origin is not inside.
    """
    edges = np.roll(footprint, -1, axis=0) - footprint
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])  # outwards
    offsets = (normals * footprint).sum(axis=1)
    if not (offsets > 0.0).all():
        raise BadArgument("a footprint must be convex, counter-clockwise and enclose base_link's origin")
    angles = -np.pi + np.arange(num_beams) * (2.0 * np.pi / num_beams)
    approach = np.column_stack([np.cos(angles), np.sin(angles)]) @ normals.T  # (num_beams, k)
    with np.errstate(divide="ignore"):
        distances = np.where(approach > 1e-12, offsets / approach, np.inf)
    return distances.min(axis=1)


@njit(cache=True, nogil=True)
def _observe(
    rows, ranges, goals, twists, outline, limits, bodies, scans, fresh, slot, lags, sectors, max_range, spacing,
    goal_start, out,
):  # fmt: skip
    depth = scans.shape[1]
    for i in rows:
        _pool(ranges[i], outline[i], sectors, max_range, out[i])
        if len(lags):
            per_metre = 1.0 / (CLOSING_SPEED * len(lags) * spacing)
            for s in range(sectors):
                now = 0.5 * (out[i, s] + 1.0) * max_range
                if fresh[i]:
                    scans[i, :, s] = now
                scans[i, slot, s] = now
                # O_m = sum_{k=1..n} (O_L^t - O_L^{t-k}) / k
                motion = 0.0
                for k in range(len(lags)):
                    motion += (now - scans[i, (slot - lags[k]) % depth, s]) / (k + 1)
                out[i, sectors + s] = min(max(motion * per_metre, -1.0), 1.0)
        at = goal_start
        _goals(goals[i : i + 1], out[i : i + 1, at : at + 3])
        at += 3
        forward = limits[i, 0] if twists[i, 0] >= 0.0 or limits[i, 1] >= 0.0 else -limits[i, 1]
        out[i, at] = _relative(twists[i, 0], forward)
        out[i, at + 1] = _relative(twists[i, 1], limits[i, 2])
        out[i, at + 2] = _relative(twists[i, 2], limits[i, 3])
        if not len(lags):  # tracked
            out[i, at + 3 : at + 3 + bodies.shape[1]] = bodies[i]


@njit(cache=True, nogil=True)
def _relative(velocity, limit):
    """A velocity as a share of its limit; 0 where the body cannot move that way."""
    return min(max(velocity / limit, -TWIST_LIMIT), TWIST_LIMIT) if limit > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _goals(points, out):
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        away = math.sqrt(x * x + y * y)
        out[i, 0] = 2.0 * away / (away + HALF_DISTANCE) - 1.0
        out[i, 1] = x / away if away > 0.0 else 1.0
        out[i, 2] = y / away if away > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _pool(ranges, outline, sectors, max_range, out):
    """Least clearance of each sector's beams, from [0, max_range] to [-1, 1].

    The beam on a border belongs to both sectors, which makes the mirror image of a scan that of its sectors.
    """
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
