"""A shield over a local policy: its command goes through unless it is seen to end in a collision.

Every command that the body can be given is followed for ``horizon`` seconds: the body ramps to it within its limits
and stands where the scan shows something ahead, while what moves goes on as it was last seen to (``tracks``). Of those
that meet nothing the one nearest to the policy's is taken; where all do, the one that does so latest.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.policy.surroundings import cover_by_discs, distance_field, smooth_room_around
from vuca_nav.policy.tracks import MAX_TRACKS, SLOT_SIZE, Tracker
from vuca_nav.policy.unanswered import Unanswered
from vuca_nav.types import BodySpec, FloatArray, LidarSpec, Pose2, VelocityCommand


@dataclass(frozen=True, slots=True)
class ShieldConfig:
    """Costs are relative to that of changing v_x by its whole range, which costs 4."""

    num_v_x: int = 13
    num_v_y: int = 3
    """Only of bodies that go sideways."""
    num_w_z: int = 15
    horizon: float = 2.5
    """[s]"""
    time_step: float = 0.1
    """[s]"""
    hold: float = 0.2
    """A command must leave room to brake after so long: until then nothing else may be done [s]."""
    caution: float = 0.3
    """For so long whatever returned a beam stands: the corner of a wall may be taken for something that moves [s]."""
    margin: float = 0.05
    """Added to the footprint against what stands: range noise and the field's cells [m]."""
    mover_margin: float = 0.1
    """Added to the footprint against what moves [m] ..."""
    mover_growth: float = 0.08
    """... and so much more for every second ahead [m/s]."""
    risk_weight: float = 20.0
    """Cost of meeting something now, or of having no room to brake; a quarter of it at the horizon."""
    turn_weight: float = 0.5
    """Cost of changing w_z by its limit."""
    side_weight: float = 0.5
    """Cost of changing v_y by its limit."""
    moving: float = 0.25
    """Slower things stand [m/s]."""
    certain: float = 0.6
    """What is followed with less certainty stands: seen in a row three times it has more."""
    sight: float = 8.0
    """Farther things are not followed [m]."""
    reach: float = 4.0
    """Half side of the square about the robot in which the scan is looked at [m]."""
    resolution: float = 0.05
    """Of its distance field [m]."""


TRACK_SPACING = 0.1
"""Between two scans from which things are followed: over less, range noise is too much of a velocity [s]."""
_HOPELESS = 0.2
"""So much room missing costs no less than more of it [m]."""
_OWN_RETURNS = 0.15
"""So near to a moving thing's circle a return is its own [m]."""


class Guard:
    """Decides on one body's commands.

    Args:
        body: What is driven.
        lidar: What it sees with.
        config: Settings.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, config: ShieldConfig = ShieldConfig()):
        self._config = c = config
        angles = lidar.angles_in_base()
        self._beams_in_base = np.column_stack([np.cos(angles), np.sin(angles)])
        self._discs = cover_by_discs(body.footprint)
        cells = 2 * round(c.reach / c.resolution)
        self._field, self._whole_field = np.zeros((2, cells, cells), np.int16)
        self._ranges = np.zeros(lidar.num_beams)
        self._limits = np.array([body.max_v_x, body.min_v_x, body.max_v_y, body.max_w_z])
        self._accelerations = np.array([body.max_a_x, body.max_a_y, body.max_a_w])
        v_x = np.append(np.linspace(body.min_v_x, body.max_v_x, c.num_v_x), 0.0)
        v_y = np.linspace(-body.max_v_y, body.max_v_y, c.num_v_y) if body.max_v_y > 0.0 else np.zeros(1)
        w_z = np.linspace(-body.max_w_z, body.max_w_z, c.num_w_z)
        every = np.array(np.meshgrid(v_x, v_y, w_z)).reshape(3, -1).T
        self._candidates = np.vstack([np.zeros(3), every])  # the first is the policy's

    def choose(
        self, wanted: VelocityCommand, last: VelocityCommand, start: Pose2, ranges: FloatArray, things: FloatArray
    ) -> VelocityCommand:
        """The wanted command, or the nearest one that is safe.

        Args:
            wanted: By the policy.
            last: What the body does when this is answered.
            start: Where it is then, in base_link.
            ranges: (num_beams,) of the scan; ``inf`` or NaN where nothing came back [m].
            things: (k, 6) as ``Tracker.things`` gives them.
        """
        c = self._config
        self._candidates[0] = wanted
        _without_movers(ranges, self._beams_in_base, things, c.moving, c.certain, self._ranges)
        distance_field(self._ranges, self._beams_in_base, c.resolution, c.reach, self._field)
        distance_field(ranges, self._beams_in_base, c.resolution, c.reach, self._whole_field)
        best = _choose(
            self._field, self._whole_field, c.resolution, c.reach, self._discs, things, c.moving, c.certain,
            self._candidates, last, start, self._limits, self._accelerations, c.horizon, c.time_step, c.hold,
            c.caution, c.margin, c.mover_margin, c.mover_growth, c.risk_weight, c.turn_weight, c.side_weight,
        )  # fmt: skip
        v_x, v_y, w_z = self._candidates[best].tolist()
        return VelocityCommand(v_x, v_y, w_z)


class Shield(LocalPolicy):
    """Guards another policy.

    Args:
        body: What is driven.
        lidar: What it sees with.
        policy: Who is guarded.
        config: Settings.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, policy: LocalPolicy, config: ShieldConfig = ShieldConfig()):
        self.policy = policy
        self._guard = Guard(body, lidar, config)
        self._unanswered = Unanswered(body, lidar.rate)
        self._tracker = Tracker(1, lidar.num_beams, 1.0 / lidar.rate, TRACK_SPACING)
        self._row, self._reaches = np.zeros(1, np.int64), np.array([config.sight])
        self._motion, self._fresh = np.zeros((1, 3)), np.ones(1, np.bool_)
        self._things = np.zeros((MAX_TRACKS, SLOT_SIZE))

    def reset(self) -> None:
        """Forget the last episode."""
        self.policy.reset()
        self._unanswered.reset()
        self._fresh[0] = True

    def look(self, observation: LocalObservation) -> None:
        """Take in what the sensors say now."""
        self.policy.look(observation)
        self._motion[0] = observation.motion
        self._tracker.update(self._row, observation.scan.ranges[None], self._motion, self._reaches, self._fresh)
        self._fresh[0] = False

    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The policy's command, or the nearest one that is safe."""
        wanted = self.policy.command(observation)
        things = self._things[: self._tracker.things(0, self._things)]
        start, last = self._unanswered.pose(), self._unanswered.last
        command = self._guard.choose(wanted, last, start, observation.scan.ranges, things)
        self._unanswered.add(command)
        return command


@njit(cache=True)
def _moves(thing, moving, certain):
    return thing[5] > certain and thing[2] * thing[2] + thing[3] * thing[3] > moving * moving


@njit(cache=True)
def _without_movers(ranges, beams, things, moving, certain, out):
    """The scan without the returns of what moves."""
    for b in range(len(ranges)):
        out[b] = ranges[b] if ranges[b] < np.inf else np.inf
        x, y = ranges[b] * beams[b, 0], ranges[b] * beams[b, 1]
        for k in range(len(things)):
            near = things[k, 4] + _OWN_RETURNS
            if _moves(things[k], moving, certain) and (x - things[k, 0]) ** 2 + (y - things[k, 1]) ** 2 < near * near:
                out[b] = np.inf


@njit(cache=True)
def _towards(value, target, step):
    return value + min(max(target - value, -step), step)


@njit(cache=True)
def _choose(
    field, whole_field, resolution, reach, discs, things, moving, certain, candidates, last, start, limits,
    accelerations, horizon, dt, hold, caution, margin, mover_margin, mover_growth, risk_weight, turn_weight,
    side_weight,
):  # fmt: skip
    """Index of the cheapest candidate."""
    c, s = math.cos(start[2]), math.sin(start[2])
    room_now = smooth_room_around(field, resolution, reach, discs, start[0], start[1], c, s) - margin
    whole_room_now = smooth_room_around(whole_field, resolution, reach, discs, start[0], start[1], c, s) - margin
    best, best_cost = 0, np.inf
    for n in range(len(candidates)):
        u = candidates[n]
        cost = 4.0 * ((u[0] - candidates[0, 0]) / (limits[0] - limits[1])) ** 2
        cost += turn_weight * ((u[2] - candidates[0, 2]) / limits[3]) ** 2
        if limits[2] > 0.0:
            cost += side_weight * ((u[1] - candidates[0, 1]) / limits[2]) ** 2
        if cost >= best_cost:
            continue
        lack = _lack_of_room(
            field, whole_field, resolution, reach, discs, u, last, start, accelerations, 0.5 * dt, hold, caution,
            margin, room_now, whole_room_now,
        )  # fmt: skip
        if lack > 0.0:
            cost += risk_weight * min(0.5 + lack / _HOPELESS, 1.0)
        met = _meets_at(
            field, resolution, reach, discs, things, moving, certain, u, last, start, accelerations, horizon, dt,
            margin, mover_margin, mover_growth, room_now,
        )  # fmt: skip
        if met < horizon:
            cost += risk_weight * (1.0 - 0.75 * met / horizon)
        if cost < best_cost:
            best, best_cost = n, cost
    return best


@njit(cache=True)
def _meets_at(
    field, resolution, reach, discs, things, moving, certain, u, last, start, accelerations, horizon, dt,
    margin, mover_margin, mover_growth, room_now,
):  # fmt: skip
    """When something that moves is met [s]; the body stands before what stands. ``horizon`` if nothing is by then."""
    x, y, yaw = start[0], start[1], start[2]
    v_x, v_y, w_z = last[0], last[1], last[2]
    stands = False
    for step in range(int(round(horizon / dt))):
        t = (step + 1) * dt
        if not stands:
            v_x = _towards(v_x, u[0], accelerations[0] * dt)
            v_y = _towards(v_y, u[1], accelerations[1] * dt)
            w_z = _towards(w_z, u[2], accelerations[2] * dt)
            c, s = math.cos(yaw + 0.5 * w_z * dt), math.sin(yaw + 0.5 * w_z * dt)
            next_x, next_y, next_yaw = x + (v_x * c - v_y * s) * dt, y + (v_x * s + v_y * c) * dt, yaw + w_z * dt
            room = smooth_room_around(
                field, resolution, reach, discs, next_x, next_y, math.cos(next_yaw), math.sin(next_yaw)
            ) - margin  # fmt: skip
            stands = room < min(0.0, room_now + 1e-3)
            if not stands:
                x, y, yaw = next_x, next_y, next_yaw
        c, s = math.cos(yaw), math.sin(yaw)
        for k in range(len(things)):
            thing = things[k]
            if not _moves(thing, moving, certain):
                continue
            there_x, there_y = thing[0] + thing[2] * t - x, thing[1] + thing[3] * t - y
            for d in range(len(discs)):
                away_x = there_x - (c * discs[d, 0] - s * discs[d, 1])
                away_y = there_y - (s * discs[d, 0] + c * discs[d, 1])
                apart = discs[d, 2] + thing[4] + mover_margin + mover_growth * t
                if away_x * away_x + away_y * away_y < apart * apart:
                    return t
    return horizon


@njit(cache=True)
def _lack_of_room(
    field, whole_field, resolution, reach, discs, u, last, start, accelerations, dt, hold, caution, margin, room_now,
    whole_room_now,
):  # fmt: skip
    """How much room is missing to go on so for ``hold`` and then come to a stand, 0 if none is [m]."""
    x, y, yaw = start[0], start[1], start[2]
    v_x, v_y, w_z = last[0], last[1], last[2]
    t, lack = 0.0, 0.0
    while True:
        held = t < hold
        v_x = _towards(v_x, u[0] if held else 0.0, accelerations[0] * dt)
        v_y = _towards(v_y, u[1] if held else 0.0, accelerations[1] * dt)
        w_z = _towards(w_z, u[2] if held else 0.0, accelerations[2] * dt)
        if not held and v_x == 0.0 and v_y == 0.0 and w_z == 0.0:
            return lack
        c, s = math.cos(yaw + 0.5 * w_z * dt), math.sin(yaw + 0.5 * w_z * dt)
        x += (v_x * c - v_y * s) * dt
        y += (v_x * s + v_y * c) * dt
        yaw += w_z * dt
        t += dt
        c, s = math.cos(yaw), math.sin(yaw)
        # Too near an obstacle one may stay as one is, or move away from it.
        room = smooth_room_around(field, resolution, reach, discs, x, y, c, s) - margin
        lack = max(lack, min(0.0, room_now) - room)
        if t <= caution:
            room = smooth_room_around(whole_field, resolution, reach, discs, x, y, c, s) - margin
            lack = max(lack, min(0.0, whole_room_now) - room)
