"""A shield over a local policy: its command goes through unless it is likely to end in a collision.

Every command that the body can be given is judged by its rollouts: the body obeys for ``segment`` seconds, and then
takes the best way out in each of several futures of the tracks (``vuca_nav.shield.futures``): it heads off somewhere,
backs, or stands. That the future is known by then is the optimism of "hindsight" planning (Chong, Givan
and Chang 2000: "A framework for simulation-based network control via hindsight optimization"); that one command is
chosen now for all futures keeps the body away from places where only some of them end well. The command with the least
cost is taken: for its difference from the policy's, the clearance to brake that it lacks, and the mean harm of the
futures.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.footprint import cover_by_discs, size_of
from vuca_nav.perception.distance_field import DistanceField, fill_field
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.ring import BeamGeometry, ring_of
from vuca_nav.perception.tracks import MAX_TRACKS, TRACK_SIZE, V_X, V_Y, X, Y, select_moving
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.delay import CommandDelay
from vuca_nav.policy.observation import limits_of
from vuca_nav.shield.futures import Futures, FuturesConfig
from vuca_nav.shield.rollouts import (
    BACK,
    HEAD_OFF,
    STAND,
    BodyState,
    ShieldScene,
    ShieldSettings,
    WaysOut,
    cheapest,
    stops_clear,
    what_may_be_met,
    without_tracks,
)
from vuca_nav.types import STOP, BodySpec, FloatArray, LidarSpec, Pose2, VelocityCommand


@dataclass(frozen=True, slots=True)
class ShieldConfig:
    """Settings of the shield. Costs are relative: changing v_x by its whole range costs 4."""

    num_v_x: int = 7
    num_v_y: int = 3
    """Number of lateral velocities that are tried, for bodies that go sideways."""
    num_w_z: int = 9
    num_ways_out: int = 12
    """Number of directions to head off in after the first segment."""
    segment: float = 0.4
    """Time for which the command is obeyed [s]; then the futures are known."""
    futures: FuturesConfig = field(default_factory=FuturesConfig)
    hold: float = 0.2
    """Time after which a command must leave clearance to brake [s]: until then the body can do nothing else."""
    caution: float = 0.3
    """Time for which every return is taken to stand [s]: the corner of a wall may pass for a moving track."""
    margin: float = 0.05
    """Inflation of the footprint against static returns [m]: range noise and the field's cells."""
    mover_margin: float = 0.25
    """Inflation of the footprint against moving tracks [m]."""
    mover_growth: float = 0.03
    """Growth of that inflation with every second ahead [m/s]."""
    risk_weight: float = 40.0
    """Cost of a meeting now in all futures, or of having no clearance to brake; a quarter of it at the horizon."""
    turn_weight: float = 0.5
    """Cost of changing w_z by its limit."""
    side_weight: float = 0.5
    """Cost of changing v_y by its limit."""
    moving: float = 0.25
    """Speed below which a track is taken to stand [m/s]."""
    certainty: float = 0.6
    """Certainty below which a track is taken to stand: one that was seen three times in a row has more."""
    reach: float = 4.0
    """Half side of the distance field of static returns [m]."""
    resolution: float = 0.05
    """Side of its cells [m]."""
    far_reach: float = 8.0
    """Half side of the distance field that futures are drawn on [m]."""
    far_resolution: float = 0.1
    """Side of that field's cells [m]."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        if self.mover_margin <= 0.0 or self.mover_growth < 0.0:
            raise BadArgument(f"mover_margin must be positive and mover_growth 0 or more, got {self}")


_NONE = np.empty(0, np.int64)
_BACKWARDS = (-1.0, 0.0, 1.0)
"""Turns of the ways out backwards, as shares of the greatest."""


class CommandFilter:
    """Filters the commands of one kind of body. Its decisions do not depend on earlier ones.

    Args:
        body: The body that is driven.
        lidar: The body's lidar.
        config: Settings.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, config: ShieldConfig = ShieldConfig()):
        self._config = c = config
        ring = ring_of(lidar)
        self._beams_in_base = BeamGeometry.of(ring).directions
        discs = cover_by_discs(body.footprint)
        self._settings = ShieldSettings(
            limits=limits_of(body), accelerations=np.array([body.max_a_x, body.max_a_y, body.max_a_w]), discs=discs,
            size=size_of(discs), time_step=c.futures.time_step, segment=c.segment, hold=c.hold, caution=c.caution,
            margin=c.margin, mover_margin=c.mover_margin, mover_growth=c.mover_growth, risk_weight=c.risk_weight,
            turn_weight=c.turn_weight, side_weight=c.side_weight,
        )  # fmt: skip
        self._static = DistanceField.empty(c.reach, c.resolution)
        self._far = DistanceField.empty(c.far_reach, c.far_resolution)
        self._ranges = np.zeros(ring.num_beams)
        self._delay = body.delay
        v_x = np.union1d(np.linspace(body.min_v_x, body.max_v_x, c.num_v_x), 0.0)
        v_y = np.linspace(-body.max_v_y, body.max_v_y, c.num_v_y) if body.max_v_y > 0.0 else np.zeros(1)
        w_z = np.linspace(-body.max_w_z, body.max_w_z, c.num_w_z)
        every = np.array(np.meshgrid(v_x, v_y, w_z)).reshape(3, -1).T
        self._candidates = np.vstack([np.zeros(3), every])  # the first is the policy's
        self._futures = Futures(MAX_TRACKS, c.futures)
        self._moving = np.zeros((MAX_TRACKS, TRACK_SIZE))
        self._guess = 0
        ways = ways_out(c.num_ways_out)
        self._ways_out = WaysOut(ways, np.zeros((len(ways), self._futures.positions.shape[2], 4)))

    def choose(
        self,
        wanted: VelocityCommand,
        last: VelocityCommand,
        start: Pose2,
        percept: Percept,
        goal: LocalGoal | None = None,
    ) -> VelocityCommand:
        """The wanted command, or the one that costs least.

        Args:
            wanted: Command of the policy.
            last: Velocity of the body when the command is answered.
            start: Pose of the body then, in base_link.
            percept: The percept of this tick.
            goal: The waypoint: a round body may come nearer to what stands where the way leaves little room.

        Raises:
            BadArgument: If the percept is of another lidar.
        """
        c, settings, ranges, beams = self._config, self._settings, percept.ring, self._beams_in_base
        if len(ranges) != len(beams):
            raise BadArgument(
                f"the percept's ring has {len(ranges)} beams, the shield's {len(beams)}: give both the same LidarSpec"
            )
        if goal is not None and len(settings.discs) == 1:
            settings = settings._replace(margin=goal.margin(c.margin, is_round=True))
        state = BodyState(*start, math.cos(start.yaw), math.sin(start.yaw), *last)
        moving = self._moving[: select_moving(percept.tracks, c.moving, c.certainty, self._moving)]
        near, futures, whole, static_ranges = _NONE, self._futures.positions, percept.field, ranges
        if len(moving):
            without_tracks(ranges, percept.ring_level, moving, self._ranges)
            static_ranges = self._ranges
            fill_field(static_ranges, beams, self._far)
            moving[:, [X, Y]] += self._delay * moving[:, [V_X, V_Y]]  # to when the body answers
            self._futures.draw(moving, self._far)
            near = what_may_be_met(moving, futures, state, settings)
        if not len(near) and stops_clear(ranges, beams, wanted, state, settings, whole.uncertainty):
            return wanted
        fill_field(static_ranges, beams, self._static)
        self._candidates[0] = wanted
        scene = ShieldScene(self._static, whole.get(), moving, futures, near)
        self._guess = best = cheapest(self._candidates, state, scene, self._ways_out, settings, self._guess)
        v_x, v_y, w_z = self._candidates[best].tolist()
        return VelocityCommand(v_x, v_y, w_z)


def ways_out(num_directions: int) -> FloatArray:
    """Motions that the body may choose from after the first segment.

    Args:
        num_directions: Number of directions to head off in.

    Returns:
        (m, 4) as ``WaysOut.ways``: stand, head off, straight ahead first, or back.
    """
    directions = np.linspace(-math.pi, math.pi, num_directions, endpoint=False)
    ahead = [(HEAD_OFF, float(a)) for a in directions[np.argsort(np.abs(directions), kind="stable")]]
    kinds = [(STAND, 0.0), *ahead, *((BACK, turn) for turn in _BACKWARDS)]
    return np.array([(kind, number, math.cos(number), math.sin(number)) for kind, number in kinds])


class Shield(LocalPolicy):
    """Filters another policy's commands. It stands while the percept is not valid, whatever the policy says.

    Args:
        body: The body that is driven.
        lidar: The body's lidar.
        policy: The policy that is filtered.
        config: Settings.
        command_filter: Shared with other shields of the same body, lidar and settings; by default one of its own.
        rate: Rate of the ticks [Hz]; by default the lidar's.
    """

    def __init__(
        self,
        body: BodySpec,
        lidar: LidarSpec,
        policy: LocalPolicy,
        config: ShieldConfig = ShieldConfig(),
        command_filter: CommandFilter | None = None,
        rate: float | None = None,
    ):
        self.rate = lidar.rate if rate is None else rate
        self.policy, self.config = policy, config
        self._filter = command_filter or CommandFilter(body, lidar, config)
        self._delay = CommandDelay(body, self.rate)

    def reset(self) -> None:
        """Forget the last mission."""
        self.policy.reset()
        self._delay.reset()

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The policy's command, or the one that costs least."""
        command = self.policy.command(percept, goal)
        if goal is None or not percept.is_valid:
            command = STOP
        else:
            command = self._filter.choose(command, self._delay.last, self._delay.pose(), percept, goal)
        self._delay.add(command)
        return command
