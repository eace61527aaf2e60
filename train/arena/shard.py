"""A share of the arena's rows, stepped by one thread: the order of all that happens in a decision."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.clearance import Outlines, PartTrajectories, StaticScenes, overlaps_batch
from train.arena.bank import Bank
from train.arena.bodies import HIGHEST, LARGEST_RADIUS, WHEEL_ARM, WHEEL_SPEED, BodyColumns
from train.arena.config import ALL_KINDS, CROWDED_KINDS, ArenaConfig
from train.arena.kernels import (
    Driven,
    Ends,
    EpisodeSettings,
    EpisodeSource,
    Sensed,
    SensorFlaws,
    Wheels,
    assign_parts,
    draw_episodes,
    drive,
    judge,
    sense,
)
from train.arena.rows import GOAL_X, GOAL_Y, Rows
from train.arena.shared_worlds import Draw, Encounters, NoEncounters, RobotTrajectories, SharedWorlds, Sight
from vuca_nav.policy.observation import ObservationConfig, Observer, command_from_action, goal_features
from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import FloatArray, LidarSpec
from worlds.level_raycast import CurrentParts, Standing, cast_level
from worlds.motion.movers import TICK, TICK_RATE, TURN_RATE
from worlds.motion.walk import Population, WideWays, place_batch, walk_batch

MOVER_DISTANCE = 1.5
"""Distance between a mover and the robot's footprint at its start [m]."""
STANDING = (3.0, 1.5)
"""Mean times of the two phases of a mover that stops and goes, in either order [s]."""
NOISE_TABLE = 1 << 16
"""Number of beams in the table of range noise, which each scan reads from a place drawn for it."""
_TURN = np.array([math.cos(TURN_RATE * TICK), math.sin(TURN_RATE * TICK)])
MOVING_KINDS = np.array([kind not in ("static", *CROWDED_KINDS) for kind in ALL_KINDS])


class Outputs(NamedTuple):
    """Results of a decision, n rows."""

    observation: np.ndarray
    progress: np.ndarray
    clearance: np.ndarray
    turn_rate: np.ndarray
    collided: np.ndarray
    reached: np.ndarray
    timed_out: np.ndarray
    final_observation: np.ndarray
    ended: np.ndarray
    """Tick of this decision after which the episode ended."""
    way: np.ndarray
    """Length of the path driven [m]."""
    nearest: np.ndarray
    """Least reported range before this decision [m]."""


class Shard:
    """Some rows of an arena; a row depends on others of its world only.

    Args:
        config: Settings of the arena.
        observer_config: Observation of the robots.
        bank: The layouts, shared by all shards.
        bodies: The bodies, shared by all shards.
        atlas: An observer with a row for each of the bodies.
        n: Number of rows.
        outputs: Views of this shard's rows of the outputs.
        once: Whether a row that has ended stays ended.

    Attributes:
        ranges: (n, beams) ranges of the last scans, as the robots have them [m].
        motion: (n, 3) displacement in the last decision by odometry, in the decision's first base frame [m, m, rad].
        goals: (n, 2) goals in base_link, as SLAM has them [m].
        measured: (n, 3) measured velocity [m/s, m/s, rad/s].
    """

    def __init__(
        self,
        config: ArenaConfig,
        observer_config: ObservationConfig,
        bank: Bank,
        bodies: BodyColumns,
        atlas: Observer,
        n: int,
        outputs: Outputs,
        once: bool,
    ):
        beams = config.num_beams
        self.config, self.bank, self.bodies, self.outputs = config, bank, bodies, outputs
        self.n = n
        self._atlas, self._once = atlas, once
        self._num_ticks = round(TICK_RATE / config.decision_rate)
        self._period = 1.0 / config.decision_rate
        self.rows = Rows.zeros(n, config.movers[1])
        first = [body.spec for body in bodies.bodies[:1]] * n
        self._observer = Observer(observer_config, first, beams, config.decision_rate)
        self._all = np.arange(n)
        self.active = np.ones(n, np.bool_)
        ticks, parts = self._num_ticks, self.rows.parts.shape[1]
        self._poses = np.zeros((n, ticks, 3))
        self._part_poses = np.zeros((n, ticks, parts, 4))
        self._twist, self.measured = np.zeros((n, 3)), np.zeros((n, 3))
        self.motion, self.goals = np.zeros((n, 3)), np.zeros((n, 2))
        self._hit = np.zeros(n, np.int64)
        self._moved = np.empty((bodies.footprints.shape[1], 2))
        self.ranges = np.zeros((n, beams))
        self._heights, self._radii = np.zeros(n), np.zeros(n)
        self._lidar_heights = np.zeros(n)
        self._footprints = np.zeros((n, *bodies.footprints.shape[1:]))
        self._corners = np.zeros(n, np.int64)
        angles = LidarSpec(num_beams=beams).angles_in_base()
        self._beams = np.stack([np.cos(angles), np.sin(angles)])
        self._lidar = LidarSpec()
        self._reach = min(observer_config.max_range + 1.5 * LARGEST_RADIUS, self._lidar.max_range)
        self._bind()

    def _bind(self) -> None:
        """Put settings and arrays together as the kernels take them: once, as only their contents ever change."""
        config, bank, bodies, rows, out = self.config, self.bank, self.bodies, self.rows, self.outputs
        flaws, lidar = config.imperfections, self._lidar
        self._streams, self._episodes, self._robots = rows.streams(), rows.episodes(), rows.robots()
        self._request, self._movers = rows.mover_request(), rows.mover_rows()
        self._parts = rows.part_rows(self._part_poses)
        self._ways = WideWays(bank.away, bank.grid_shape, bank.grids)
        self._scenes = StaticScenes(bank.static, bank.first, bank.clearance, bank.grid_shape, bank.grids)
        self._outlines = Outlines(self._footprints, self._corners, self._radii, self._heights)
        self._moving_parts = PartTrajectories(rows.parts, self._part_poses, rows.num_parts)
        self._standing = Standing(bank.static, bank.first)
        self._current_parts = CurrentParts(rows.parts, self._part_poses[:, -1], rows.num_parts)
        self._population = Population(
            bank.mover_radius, config.patrols, config.pausing, *STANDING, bank.places, bank.places_of
        )
        self._source = EpisodeSource(
            bodies.first, bodies.shape, bodies.limits, bodies.response, bank.kind_first, bank.pairs
        )
        self._settings = EpisodeSettings(
            np.trim_zeros(np.array(config.shares), "b"), np.array(config.body_shares), MOVING_KINDS, config.movers,
            config.mover_speeds, flaws.latency, config.time_factor, config.time_slack, MOVER_DISTANCE,
            flaws.response_spread, flaws.velocity_noise, flaws.odometry_scale, flaws.odometry_turn, flaws.pose_sigma,
            flaws.yaw_sigma,
        )  # fmt: skip
        self._flaws = SensorFlaws(
            _noise_table(config), np.ascontiguousarray(bodies.limits[:, :, HIGHEST]), lidar.min_range,
            lidar.max_range, flaws.empty_scan, flaws.twist_sigma, flaws.pose_sigma, flaws.yaw_sigma, flaws.pose_time,
        )  # fmt: skip
        self._wheels = Wheels(np.ascontiguousarray(bodies.shape[:, WHEEL_ARM]), WHEEL_SPEED)
        self._driven = Driven(self._poses, self._twist, self.motion, out.way)
        self._ends = Ends(out.progress, out.collided, out.reached, out.timed_out, out.ended)
        self._sensed = Sensed(self.ranges, out.clearance, out.nearest, self.goals, self.measured)
        self._encounters: Encounters = NoEncounters()
        if config.robots > 1:
            draw = Draw(self._settings, self._source, self._streams, self._episodes, self._robots, TICK)
            trajectories = RobotTrajectories(rows.pose, self._poses)
            sight = Sight(self._lidar_heights, self._reach, self.ranges)
            self._encounters = SharedWorlds(config.robots, draw, self._outlines, trajectories, sight, self._hit)

    def reset(self) -> None:
        """Begin new episodes in all rows, and observe."""
        self.active[:] = True
        self._begin(self._all, new_worlds=True)
        self._look(self._all)
        self._observe(None)

    def restart(self, rows: np.ndarray) -> None:
        """Begin new episodes in these rows, and observe; for the others no time passes."""
        self.active[rows] = True
        self._begin(rows)
        self._look(rows)
        self._observe(rows)

    def step(self, action: NDArray[np.float32]) -> None:
        """Carry out one decision of all rows; ended episodes begin anew, or stay ended.

        Args:
            action: (n, 3) in [-1, 1].
        """
        state, out = self.rows, self.outputs
        rows = self._all if not self._once else np.flatnonzero(self.active)
        self.drive(rows, action)
        self.move(rows, self._num_ticks)
        overlaps_batch(
            rows, self._poses, self._outlines, self._scenes, state.layout, self._moving_parts, self._hit, self._moved
        )
        self._encounters.meet(rows)
        judge(rows, self._poses, self._hit, GOAL_TOLERANCE, self._episodes, self._ends)
        out.turn_rate[rows] = np.abs(self._twist[rows, 2])
        self._look(rows)
        self._observe(None, rows)
        over = rows[(out.collided | out.reached | out.timed_out)[rows]]
        if self._once:
            self.active[over] = False
            self._encounters.park(over)
        elif len(over):
            clearance, out.final_observation[over] = out.clearance[over], out.observation[over]
            self.restart(over)
            out.clearance[over] = clearance

    def send_to(self, rows: np.ndarray, goals_in_world: FloatArray) -> None:
        """Give rows other goals, (k, 2) [m]; their observations show them at once, their time limits stay."""
        state, observation = self.rows, self.outputs.observation
        state.task[rows, GOAL_X], state.task[rows, GOAL_Y] = goals_in_world.T
        away = goals_in_world - state.pose[rows, :2]
        state.distance[rows] = np.hypot(away[:, 0], away[:, 1])
        c, s = np.cos(state.pose[rows, 2]), np.sin(state.pose[rows, 2])
        self.goals[rows] = np.column_stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]])
        observation[rows, self._observer.config.goal_slice] = goal_features(self.goals[rows])

    def drive(self, rows: np.ndarray, action: NDArray[np.float32]) -> None:
        """Carry the actions out for a decision's ticks."""
        wanted = command_from_action(action.astype(np.float64), self._observer.limits)
        drive(rows, TICK, wanted, self._wheels, self._streams, self.rows.ticks, self._robots, self._driven)

    def move(self, rows: np.ndarray, ticks: int) -> None:
        """Advance the movers by a decision's ticks, or with 0 make their first choice. They do not see the robots."""
        walk_batch(rows, TICK, ticks, _TURN, self.rows.layout, self._ways, self._movers, self._parts)

    def _begin(self, rows: np.ndarray, *, new_worlds: bool = False) -> None:
        """Draw new episodes; those of all rows in new worlds, too."""
        state, bank, bodies = self.rows, self.bank, self.bodies
        draw_episodes(
            rows, TICK, self._settings, self._source, self._streams, self._episodes, self._robots, self._request
        )
        self._encounters.settle(rows, new_worlds=new_worlds)
        place_batch(rows, self._request, self._population, state.layout, self._ways, self._movers)
        assign_parts(rows, self._movers, bank.part_shapes, bank.part_local, bank.part_count, self._parts, state.parts)
        self.move(rows, 0)
        body = state.body[rows]
        self._footprints[rows], self._corners[rows] = bodies.footprints[body], bodies.corners[body]
        self._radii[rows], self._lidar_heights[rows], self._heights[rows] = bodies.shape[body, :3].T
        self._observer.take_bodies(rows, self._atlas, body)
        self._observer.reset(rows)
        self._twist[rows], self.motion[rows] = 0.0, 0.0

    def _look(self, rows: np.ndarray) -> None:
        """Scan in these rows, and compute the truth about them and the measurements."""
        state = self.rows
        cast_level(
            rows, state.pose, self._lidar_heights, state.layout, self._standing, self._current_parts, self._beams,
            self._reach, self.ranges,
        )  # fmt: skip
        self._encounters.see(rows)
        sense(
            rows, self._period, self._flaws, self._streams, self._robots, state.task, self._twist,
            self._observer.outline, self._sensed,
        )  # fmt: skip

    def _observe(self, first_of: np.ndarray | None, only: np.ndarray | None = None) -> None:
        self._observer.observe(
            self.ranges, self.goals, self.measured, self.motion, self.outputs.observation, first_of, only
        )


def _noise_table(config: ArenaConfig) -> FloatArray:
    rng = np.random.default_rng(np.random.SeedSequence((config.world_seed, 9)))
    flaws = config.imperfections
    table = flaws.range_sigma * rng.standard_normal(NOISE_TABLE + config.num_beams)
    table[rng.random(len(table)) < flaws.dropout] = np.inf
    return table
