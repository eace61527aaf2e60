"""A shield over a local policy: its command goes through unless it is likely to end in a collision.

Every command that the body can be given is judged by what may come of it: the body obeys for ``segment`` seconds, and
then does what is best in each of several futures of what moves (``futures``): heads off somewhere, backs, or stands.
That it will know by then which future it is in is the optimism of "hindsight" planning (Chong, Givan and Chang 2000:
"A framework for simulation-based network control via hindsight optimization"); that it must decide now, for all
futures, what to do first keeps it away from where only some of them end well. Of all commands the one is taken that
costs least: for what it differs from the policy's, what room to brake it lacks, and the mean harm of the futures.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.perception.distance_field import cover_by_discs, distance_field
from vuca_nav.perception.tracks import MAX_TRACKS, SLOT_SIZE, Tracker
from vuca_nav.policy.base import LocalObservation, LocalPolicy, is_gap
from vuca_nav.policy.delay import Unanswered
from vuca_nav.shield.futures import Futures, FuturesConfig
from vuca_nav.shield.rollouts import choose, what_moves, without_movers
from vuca_nav.types import NOBODY, STOP, BodySpec, FloatArray, LidarSpec, Pose2, VelocityCommand


@dataclass(frozen=True, slots=True)
class ShieldConfig:
    """Costs are relative to that of changing v_x by its whole range, which costs 4."""

    num_v_x: int = 7
    num_v_y: int = 3
    """Only of bodies that go sideways."""
    num_w_z: int = 9
    num_ways_out: int = 12
    """Directions to head off in after the first segment."""
    segment: float = 0.4
    """For so long the command is obeyed [s]; then the futures are known."""
    futures: FuturesConfig = field(default_factory=FuturesConfig)
    hold: float = 0.2
    """A command must leave room to brake after so long: until then nothing else may be done [s]."""
    caution: float = 0.3
    """For so long whatever returned a beam stands: the corner of a wall may be taken for something that moves [s]."""
    margin: float = 0.05
    """Added to the footprint against what stands: range noise and the field's cells [m]."""
    mover_margin: float = 0.25
    """Added to the footprint against what moves [m] ..."""
    mover_growth: float = 0.03
    """... and so much more for every second ahead [m/s]."""
    risk_weight: float = 40.0
    """Cost of meeting something now in all futures, or of having no room to brake; a quarter of it at the horizon."""
    turn_weight: float = 0.5
    """Cost of changing w_z by its limit."""
    side_weight: float = 0.5
    """Cost of changing v_y by its limit."""
    moving: float = 0.25
    """Slower things stand [m/s]."""
    walking: float = 0.12
    """Slower things have a place in the map, since they will still be there [m/s]."""
    certain: float = 0.6
    """What is followed with less certainty stands: seen in a row three times it has more."""
    sight: float = 8.0
    """Farther things are not followed [m]."""
    reach: float = 4.0
    """Half side of the square about the robot in which the scan is looked at [m]."""
    resolution: float = 0.05
    """Of its distance field [m]."""
    far_reach: float = 8.0
    """The same for where things may go [m]."""
    far_resolution: float = 0.1

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        if self.mover_margin <= 0.0 or self.mover_growth < 0.0:
            raise BadArgument(f"mover_margin must be positive and mover_growth 0 or more, got {self}")


TRACK_SPACING = 0.1
"""Between two scans from which things are followed: over less, range noise is too much of a velocity [s]."""
_BACKWARDS = (-1.0, 0.0, 1.0)
"""Ways out backwards: turns, over the greatest."""


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
        self._field, self._whole_field = np.zeros((2, *_cells(c.reach, c.resolution)), np.int16)
        self._far_field = np.zeros(_cells(c.far_reach, c.far_resolution), np.int16)
        self._ranges = np.zeros(lidar.num_beams)
        self._delay = body.delay
        self._limits = np.array([body.max_v_x, body.min_v_x, body.max_v_y, body.max_w_z])
        self._accelerations = np.array([body.max_a_x, body.max_a_y, body.max_a_w])
        v_x = np.union1d(np.linspace(body.min_v_x, body.max_v_x, c.num_v_x), 0.0)
        v_y = np.linspace(-body.max_v_y, body.max_v_y, c.num_v_y) if body.max_v_y > 0.0 else np.zeros(1)
        w_z = np.linspace(-body.max_w_z, body.max_w_z, c.num_w_z)
        every = np.array(np.meshgrid(v_x, v_y, w_z)).reshape(3, -1).T
        self._candidates = np.vstack([np.zeros(3), every])  # the first is the policy's
        self._futures = Futures(MAX_TRACKS, c.futures)
        self._moving = np.zeros((MAX_TRACKS, SLOT_SIZE))
        self._ways = ways_out(c.num_ways_out)
        steps = self._futures.positions.shape[2]
        self._trajectories = np.zeros((len(self._ways), steps, 4))

    def choose(
        self, wanted: VelocityCommand, last: VelocityCommand, start: Pose2, ranges: FloatArray, things: FloatArray
    ) -> VelocityCommand:
        """The wanted command, or the one that costs least.

        Args:
            wanted: By the policy.
            last: What the body does when this is answered.
            start: Where it is then, in base_link.
            ranges: (num_beams,) of the scan; ``inf`` or NaN where nothing came back [m].
            things: (k, 6) as ``Tracker.things`` gives them.
        """
        c = self._config
        self._candidates[0] = wanted
        moving = self._moving[: what_moves(things, c.moving, c.certain, self._moving)]
        without_movers(ranges, self._beams_in_base, moving, self._ranges)
        distance_field(self._ranges, self._beams_in_base, c.resolution, c.reach, self._field)
        distance_field(ranges, self._beams_in_base, c.resolution, c.reach, self._whole_field)
        if len(moving):
            distance_field(self._ranges, self._beams_in_base, c.far_resolution, c.far_reach, self._far_field)
        moving[:, :2] += self._delay * moving[:, 2:4]  # to when the body answers
        futures = self._futures.draw(moving, self._far_field, c.far_resolution, c.far_reach)
        best = choose(
            self._field, self._whole_field, c.resolution, c.reach, self._discs, futures, moving, self._ways,
            self._trajectories, self._candidates, last, start, self._limits, self._accelerations, c.futures.time_step,
            c.segment, c.hold, c.caution, c.margin, c.mover_margin, c.mover_growth, c.risk_weight, c.turn_weight,
            c.side_weight,
        )  # fmt: skip
        v_x, v_y, w_z = self._candidates[best].tolist()
        return VelocityCommand(v_x, v_y, w_z)


def ways_out(num_directions: int) -> FloatArray:
    """What the body may do after the first segment.

    Args:
        num_directions: To head off in.

    Returns:
        (m, 2) which kind, and its number: 0 stand; 1 head off in a direction of the present base_link [rad]; 2 back,
        turning at a share of the limit.
    """
    directions = np.linspace(-math.pi, math.pi, num_directions, endpoint=False)
    ahead = [(1.0, float(a)) for a in directions[np.argsort(np.abs(directions), kind="stable")]]
    return np.array([(0.0, 0.0), *ahead, *((2.0, turn) for turn in _BACKWARDS)])


def _cells(reach: float, resolution: float) -> tuple[int, int]:
    n = 2 * round(reach / resolution)
    return n, n


class Shield(LocalPolicy):
    """Guards another policy.

    It stops while what it is given cannot be trusted (``LocalObservation.is_trustworthy``), whatever the policy says.

    Args:
        body: What is driven.
        lidar: What it sees with.
        policy: Who is guarded.
        config: Settings.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, policy: LocalPolicy, config: ShieldConfig = ShieldConfig()):
        self.policy, self.config = policy, config
        self._guard = Guard(body, lidar, config)
        self._unanswered = Unanswered(body, lidar.rate)
        self._tracker = Tracker(1, lidar.num_beams, 1.0 / lidar.rate, TRACK_SPACING, lidar.num_beams)
        self._row, self._reaches = np.zeros(1, np.int64), np.array([config.sight])
        self._motion, self._fresh = np.zeros((1, 3)), np.ones(1, np.bool_)
        self._things = np.zeros((MAX_TRACKS, SLOT_SIZE))
        self._rate, self._seen_at = lidar.rate, -math.inf

    def reset(self) -> None:
        """Forget the last episode."""
        self.policy.reset()
        self._unanswered.reset()
        self._fresh[0], self._seen_at = True, -math.inf

    def look(self, observation: LocalObservation) -> None:
        """Take in what the sensors say now; what was followed is forgotten after a gap, or if they are wrong."""
        self.policy.look(observation)
        if is_gap(self._seen_at, observation.scan.stamp, self._rate):
            self._fresh[0] = True
        self._seen_at = observation.scan.stamp
        if not observation.is_trustworthy:
            self._fresh[0] = True
            return
        self._motion[0] = observation.motion
        self._tracker.update(self._row, observation.scan.ranges[None], self._motion, self._reaches, self._fresh)
        self._fresh[0] = False

    def walkers(self) -> FloatArray:
        """What is known to move, (k, 3) x, y of the centre in base_link and radius [m]."""
        if self._fresh[0]:
            return NOBODY
        things = self._things[: self._tracker.things(0, self._things)]
        moving = things[: what_moves(things, self.config.walking, self.config.certain, things)]
        return moving[:, [0, 1, 4]]

    def stopped(self) -> None:
        """The body was told to stand."""
        self.policy.stopped()
        self._unanswered.add(STOP)

    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The policy's command, or the one that costs least."""
        if not observation.is_trustworthy:
            self.stopped()
            return STOP
        wanted = self.policy.command(observation)
        things = self._things[: self._tracker.things(0, self._things)]
        start, last = self._unanswered.pose(), self._unanswered.last
        command = self._guard.choose(wanted, last, start, observation.scan.ranges, things)
        self._unanswered.add(command)
        return command
