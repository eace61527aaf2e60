"""The oracles as stacks: search a path through space and time, and follow it."""

import math

import numpy as np

from eval.baselines.oracle.config import OracleConfig
from eval.baselines.oracle.search import STEP, Path, SpaceTimeSearch
from eval.baselines.oracle.truth import CROWD_FORESIGHT, Future, Truth, foreseen, outlines_of, straight_on
from vuca_nav.geometry import inverse, transform_points, wrap_angle
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.stack import Stack
from vuca_nav.task import time_limit
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import Odometry, Pose2, Scan, VelocityCommand
from worlds.clearance import clearance_field
from worlds.motion.movers import TICK_RATE

RESOLUTION = 0.05
"""Side of the cells of the true map [m]."""
REACH = 1.5
"""Clearances beyond this are alike [m]."""
_GAIN_X, _GAIN_Y, _GAIN_YAW = 1.5, 4.0, 2.5
"""Gains of the path's follower (Kanayama et al. 1990): 1/s of the way behind, 1/m^2 of the way aside, 1/s of the angle;
critically damped at 1 m/s."""


class Oracle(Stack):
    """Knows the true map, its own true pose, and the movers; with ``knows_future`` all that they will do.

    Movers that are blind to the robot have one future. Pedestrians react, so theirs is foreseen for 10 s with a robot
    that stands, and again at every search.

    Args:
        config: Settings.
        truth: The episode as it is.
        telemetry: Receives the path.
    """

    def __init__(self, config: OracleConfig, truth: Truth, telemetry: Telemetry = Telemetry()):
        self.config, self.truth, self.telemetry = config, truth, telemetry
        self.body = truth.body.spec
        height = truth.body.height
        obstacles = [o for o in truth.world.obstacles if o.shape.base < height]
        world = truth.world
        self._static = clearance_field(obstacles, world.bounds, RESOLUTION, REACH, world.open_borders)
        self._outlines = outlines_of(truth.movers, height)
        self._is_certain = config.knows_future and not truth.reacts
        self.reset(truth.world.start, truth.world.goal)

    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Implements :class:`~vuca_nav.stack.Stack`; the map is the true one."""
        self.goal, self.map_from_base = goal, start
        self._search = SpaceTimeSearch(self.body, self._static, self._outlines, goal, self.config.search)
        self._path: Path | None = None
        self._searched_at = 0.0
        self._future: Future | None = None
        self._future_from = 0.0

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """Implements :class:`~vuca_nav.stack.Stack`. Of the odometry only the velocity is used."""
        now, pose = scan.stamp, self.truth.pose
        self.map_from_base = pose
        if self._is_search_due(now, pose):
            future = self._future_at(now, pose)
            horizon = math.inf if self._is_certain else self.config.horizon
            twist = odometry.twist
            since = now - self._future_from
            self._path = self._search.search(pose, (twist.v_x, twist.w_z), future, horizon, since)
            self._searched_at = now
            self.telemetry.path(self._path.states[:, :2])
        self.telemetry.estimated_pose(pose, pose)
        command = self._follow(now, pose)
        self.telemetry.command(command)
        return command

    def _is_search_due(self, now: float, pose: Pose2) -> bool:
        path = self._path
        if path is None:
            return True
        period = self.config.period
        if self._is_certain:
            period = math.inf if path.arrives else max(period, 0.5 * STEP * len(path.states))
        if now - self._searched_at >= period - 1e-9:
            return True
        wanted = self._state_at(now - self._searched_at)
        return math.hypot(wanted[0] - pose.x, wanted[1] - pose.y) > self.config.tolerance

    def _future_at(self, now: float, pose: Pose2) -> Future:
        """The movers' future from now on, as far as it is known."""
        config, movers = self.config, self.truth.movers
        if not config.knows_future:
            return straight_on(movers, config.foresight, self._static, pose, self.truth.body.lidar.max_range)
        if not self._is_certain:
            return foreseen(movers, CROWD_FORESIGHT, (pose.x, pose.y, self.body.radius))
        if self._future is None:
            self._future, self._future_from = foreseen(movers, self._time_limit(), None), now
            self._search.foresee(self._future)
        since = round((now - self._future_from) * TICK_RATE)
        return Future(self._future.movers[since:], self._future.parts[since:])

    def _time_limit(self) -> float:
        """Time that the way to the goal can take at most [s]."""
        start = self.map_from_base
        shortest = self._search.length_to_goal(start.x, start.y)
        limit = time_limit(shortest if math.isfinite(shortest) else 0.0, self.body.max_v_x)
        return max(limit, self.truth.world.time_limit or 0.0)

    def _state_at(self, time: float) -> np.ndarray:
        """State (5,) of the path at a time after the search; at its end, it stays there."""
        assert self._path is not None
        states = self._path.states
        at = min(max(time / STEP, 0.0), len(states) - 1.0)
        before = min(int(at), len(states) - 1)
        after = min(before + 1, len(states) - 1)
        state = states[before] + (at - before) * (states[after] - states[before])
        if at >= len(states) - 1.0:
            state[3:] = 0.0
        return state

    def _follow(self, now: float, pose: Pose2) -> VelocityCommand:
        """The velocities of the path, corrected by how far the robot is off it (Kanayama et al. 1990)."""
        since = now - self._searched_at
        x, y, yaw, v, _ = self._state_at(since)
        ((ahead, aside),) = transform_points(inverse(pose), np.array([(x, y)])).tolist()
        turn = wrap_angle(yaw - pose.yaw)
        # A command acts until the next scan, after the body's delay: its velocities are those of then.
        _, _, _, v_next, w_next = self._state_at(since + self.body.delay + 1.0 / TICK_RATE)
        body = self.body
        v_x = v_next * math.cos(turn) + _GAIN_X * ahead
        w_z = w_next + _GAIN_Y * v * aside + _GAIN_YAW * math.sin(turn)
        return VelocityCommand(
            min(max(v_x, body.min_v_x), body.max_v_x), 0.0, min(max(w_z, -body.max_w_z), body.max_w_z)
        )
