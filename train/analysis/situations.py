"""The situation of each robot of the arena by the ground truth: for analyses, as no robot has it.

One label a decision. Where several fit, the first of sudden mover, known mover, dead end, tight passage is taken: the
one that leaves the least time comes first, then the one that leaves the fewest directions.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.arena.arena import Arena
from train.arena.bodies import LIDAR_HEIGHT
from vuca_nav.footprint import outline_ranges
from vuca_nav.kernel_cache import njit
from vuca_nav.policy.track_features import time_to_meeting
from vuca_nav.task import NEAR_RANGE
from vuca_nav.types import FloatArray, LidarSpec
from worlds.level_raycast import CurrentParts, Standing, cast_level
from worlds.motion.mover_columns import RADIUS, V_X, V_Y, X, Y

SITUATIONS = ("open floor", "tight passage", "sudden mover", "dead end", "known mover", "other")
OPEN_FLOOR, TIGHT_PASSAGE, SUDDEN_MOVER, DEAD_END, KNOWN_MOVER, OTHER = range(6)
"""Indices into ``SITUATIONS``."""
NEAR = 1.5
"""Clearance up to which an obstacle is near [m]: TIAGo and Go2 stop within a third of it at full speed, and with space
for a turn on top, no obstacle beyond it calls for another command."""
ROOM = 2.0 * NEAR_RANGE
"""Greatest clearance left and right of the body together in a tight passage [m]: in its middle less than the 0.6 m on
either side at which R_o and ARSPS begin to count."""
BESIDE = math.radians(30.0)
"""Half angle about straight left within which an obstacle is to the left [rad]; likewise to the right. A body that is
turned further from its passage is turning, not passing."""
POCKET = 3.0
"""Length that no way ahead reaches in a dead end [m]. The factory's blind alleys are 1.8 to 2.9 m wide and at least 5 m
deep: in about their last 3 m the walls block every way but the one behind, and the way back is longer."""
WAYS = 72
"""Number of directions in which a way is looked for, 5 degrees apart: a door of 1 m, 3 m off, is open to TIAGo over 8
degrees."""
MEETING = 2.0
"""Time within which a mover that would be met as both go on is a threat [s]: full speed to a stop takes TIAGo 1 s, and
so does getting out of the way from there."""
NEWS = 1.0
"""Time for which a threat is sudden [s]; a threat that has been over for so long begins anew if it comes back. The
tracks that a policy sees take three to five scans, 0.3 to 0.5 s, to find a velocity: as long again is left to act."""
PRECEDENCE = (SUDDEN_MOVER, KNOWN_MOVER, DEAD_END, TIGHT_PASSAGE, OPEN_FLOOR, OTHER)
DEFINITIONS = {
    "open floor": f"nothing, standing or moving, within {NEAR} m of the footprint, and nobody who would be met within "
    f"{MEETING:.0f} s",
    "tight passage": f"what stands leaves less than {ROOM:.1f} m of room to the left and the right of the body "
    f"together, each within {math.degrees(BESIDE):.0f} degrees of straight aside",
    "sudden mover": f"a mover in sight would be met within {MEETING:.0f} s as both go straight on, and that for less "
    f"than {NEWS:.0f} s (at an episode's start all is new)",
    "dead end": f"turned to any direction within 90 degrees of ahead, the body could not go {POCKET:.0f} m straight on "
    "for what stands there; in some direction behind it could",
    "known mover": f"as a sudden mover, but for {NEWS:.0f} s or longer",
    "other": f"none of these: something, standing or moving, is within {NEAR} m",
}
"""Definitions of the situations in words; where several fit, the first by PRECEDENCE is taken."""


class Sight(NamedTuple):
    """Static obstacles around n robots, along evenly spaced beams of which the first is at -pi."""

    standing: np.ndarray
    """Ranges to static obstacles, (n, num_beams) [m]."""
    outline: np.ndarray
    """Radius of the footprint along each beam, (n, num_beams) [m]."""


class Threats(NamedTuple):
    """Movers that threaten n robots, at most m each."""

    age: np.ndarray
    """State: time for which each mover has been a threat, (n, m) [s]."""
    calm: np.ndarray
    """State: time since each mover last was a threat, (n, m) [s]; ``inf`` at first."""
    sudden: np.ndarray
    """Output: whether a mover threatens that was no threat a while ago, (n,)."""
    threatened: np.ndarray
    """Output: whether any mover threatens, (n,)."""
    gap: np.ndarray
    """Output: distance from the footprint to the nearest mover's circle, 0 inside, ``inf`` if there is none, (n,)
    [m]."""


@njit(cache=True, nogil=True)
def follow_threats(rows, period, robots, radius, movers, sight, threats):
    """Find the robots that a mover threatens, and those that one threatens that was no threat a while ago.

    Args:
        rows: Indices of the rows, (k,).
        period: Time since the last call [s].
        robots: A ``train.arena.rows.Robots``.
        radius: Mean radius of the footprint, as the policy's tracks take it, (n,) [m].
        movers: A ``MoverRows``.
        sight: A ``Sight``.
        threats: ``Threats``; changed.
    """
    pose, velocity = robots.pose, robots.velocity
    standing, outline = sight
    counts, constants, state = movers.counts, movers.constants, movers.state
    age, calm, sudden, threatened, gap = threats
    num_beams = standing.shape[1]
    for r in range(len(rows)):
        i = rows[r]
        cos, sin = math.cos(pose[i, 2]), math.sin(pose[i, 2])
        own_x = cos * velocity[i, 0] - sin * velocity[i, 1]
        own_y = sin * velocity[i, 0] + cos * velocity[i, 1]
        sudden[i], threatened[i], gap[i] = False, False, math.inf
        for m in range(counts[i]):
            x, y = state[i, m, X] - pose[i, 0], state[i, m, Y] - pose[i, 1]
            size, away = constants[i, m, RADIUS], math.hypot(x, y)
            bearing = math.atan2(cos * y - sin * x, cos * x + sin * y)
            beam = int(round((bearing + math.pi) / (2.0 * math.pi) * num_beams)) % num_beams
            gap[i] = min(gap[i], max(away - size - outline[i, beam], 0.0))
            in_sight = standing[i, beam] >= away - size
            reach = radius[i] + size
            meets = time_to_meeting(x, y, state[i, m, V_X] - own_x, state[i, m, V_Y] - own_y, reach) < MEETING
            calm[i, m] += period
            age[i, m] += period
            if in_sight and meets:
                if calm[i, m] > NEWS + 1e-9:
                    age[i, m] = 0.0
                calm[i, m] = 0.0
                threatened[i] = True
                sudden[i] |= age[i, m] < NEWS - 1e-9


@njit(cache=True, nogil=True)
def label_situations(rows, beams, sight, half_width, front, threats, label):
    """Label the situation of each of the rows.

    Args:
        rows: Indices of the rows, (k,).
        beams: cos, sin in base_link, (2, num_beams); the first at -pi, evenly spaced.
        sight: A ``Sight``.
        half_width: Half width of the footprint, (n,) [m].
        front: Distance from base_link to the footprint's foremost point, (n,) [m].
        threats: ``Threats``.
        label: Output, indices into ``SITUATIONS``, (n,).
    """
    standing, outline, sudden, threatened, gap = (
        sight.standing,
        sight.outline,
        threats.sudden,
        threats.threatened,
        threats.gap,
    )
    num_beams = beams.shape[1]
    side = math.sin(math.pi / 2.0 - BESIDE) - 1e-9
    for r in range(len(rows)):
        i = rows[r]
        nearest, left, right = math.inf, math.inf, math.inf
        for k in range(num_beams):
            room = max(standing[i, k] - outline[i, k], 0.0)
            nearest = min(nearest, room)
            if beams[1, k] >= side:
                left = min(left, room)
            elif beams[1, k] <= -side:
                right = min(right, room)
        if sudden[i]:
            label[i] = SUDDEN_MOVER
        elif threatened[i]:
            label[i] = KNOWN_MOVER
        elif nearest < POCKET and _is_dead_end(standing[i], beams, half_width[i], front[i]):
            label[i] = DEAD_END
        elif left + right < ROOM:
            label[i] = TIGHT_PASSAGE
        elif min(nearest, gap[i]) >= NEAR:
            label[i] = OPEN_FLOOR
        else:
            label[i] = OTHER


@njit(cache=True, nogil=True)
def _is_dead_end(standing, beams, half_width, front):
    quarter = WAYS // 4
    for k in range(quarter + 1):  # ahead first, as most ways lead on
        for direction in (k, -k):
            if not _is_blocked(standing, beams, half_width, front, direction):
                return False
    for direction in range(quarter + 1, WAYS - quarter):
        if not _is_blocked(standing, beams, half_width, front, direction):
            return True
    return False  # boxed in


@njit(cache=True, nogil=True)
def _is_blocked(standing, beams, half_width, front, direction):
    """Whether the body, turned that way, has less than POCKET straight ahead; beams are 0.1 m apart at that range."""
    angle = 2.0 * math.pi * direction / WAYS
    cos, sin = math.cos(angle), math.sin(angle)
    for k in range(len(standing)):
        if standing[k] < math.inf:
            along = standing[k] * (cos * beams[0, k] + sin * beams[1, k])
            aside = standing[k] * (cos * beams[1, k] - sin * beams[0, k])
            if 0.0 < along < front + POCKET and abs(aside) < half_width:
                return True
    return False


class ArenaSituations:
    """Situations of an arena's rows. To be made before the first decision.

    Args:
        arena: An arena on one thread whose rows run one episode each.

    Attributes:
        label: Indices into ``SITUATIONS``, (n,).
    """

    def __init__(self, arena: Arena):
        (self._shard,) = arena.shards
        n, beams = arena.n, arena.config.num_beams
        self._period = 1.0 / arena.config.decision_rate
        angles = LidarSpec(num_beams=beams).angles_in_base()
        self._beams = np.stack([np.cos(angles), np.sin(angles)])
        self._reach = LidarSpec().max_range
        bodies, body = arena.bodies, self._shard.rows.body
        outlines = np.stack([outline_ranges(each.spec.footprint, beams) for each in bodies.bodies])
        self._sight = Sight(np.zeros((n, beams)), outlines[body])
        self._heights, self._radius = bodies.shape[body, LIDAR_HEIGHT], self._sight.outline.mean(axis=1)
        sizes = [(np.abs(each.spec.footprint[:, 1]).max(), each.spec.footprint[:, 0].max()) for each in bodies.bodies]
        self._half_width, self._front = np.ascontiguousarray(np.array(sizes)[body].T)
        state, bank = self._shard.rows, self._shard.bank
        self._layouts = Standing(bank.static, bank.first)
        self._no_parts = CurrentParts(state.parts, np.zeros((n, 1, 4)), np.zeros(n, np.int64))
        self._robots, self._movers = state.robots(), state.mover_rows()
        movers = state.movers.shape[1]
        self._threats = Threats(
            np.zeros((n, movers)), np.full((n, movers), math.inf), np.zeros(n, np.bool_), np.zeros(n, np.bool_),
            np.zeros(n),
        )  # fmt: skip
        self.label = np.full(n, OTHER)

    def look(self, rows: NDArray[np.int64]) -> None:
        """Label the rows as they are now; to be called once before each decision."""
        state, sight = self._shard.rows, self._sight
        cast_level(
            rows, state.pose, self._heights, state.layout, self._layouts, self._no_parts, self._beams, self._reach,
            sight.standing,
        )  # fmt: skip
        follow_threats(rows, self._period, self._robots, self._radius, self._movers, sight, self._threats)
        label_situations(rows, self._beams, sight, self._half_width, self._front, self._threats, self.label)

    def movers_in_base(self, row: int) -> FloatArray:
        """Movers of a row: x, y, v_x, v_y, radius, in base_link's present frame, velocities over the ground, (m, 5)."""
        state = self._shard.rows
        count, (x, y, yaw) = state.counts[row], state.pose[row]
        base_from_world = np.array([(math.cos(yaw), math.sin(yaw)), (-math.sin(yaw), math.cos(yaw))])
        movers = state.movers[row, :count]
        places = (movers[:, [X, Y]] - (x, y)) @ base_from_world.T
        return np.column_stack(
            [places, movers[:, [V_X, V_Y]] @ base_from_world.T, state.constants[row, :count, RADIUS]]
        )
