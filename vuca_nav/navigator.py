"""The stack: ``Navigator.step(scan, odometry) -> VelocityCommand``, each stage at its rate (Section III-A)."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.exploration.explorer import Explorer, ExplorerConfig
from vuca_nav.exploration.heuristic import NoCritic, SafetyCritic
from vuca_nav.geometry import between, compose, distance, levelling, transform_points
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.slam import Slam, SlamConfig
from vuca_nav.planning.costmap import Costmap, CostmapConfig
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.waypoints import farthest_free_waypoint
from vuca_nav.policy.base import STANDING, LocalObservation, LocalPolicy
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, BodySpec, FloatArray, LidarSpec, Odometry, Pose2, Scan, VelocityCommand

_RESORTS = ((False, False), (True, False), (False, True), (True, True))
"""What is tried until there is something to head for: whether to doubt what has not been seen lately, for somebody may
have been seen to stand in the way and have left it unseen; whether to try again what was given up."""


@dataclass(frozen=True, slots=True)
class NavigatorConfig:
    """Rates (Section III-A), and the settings of the stages."""

    rate: float = 30.0
    """Mapping and local control [Hz]."""
    planning_rate: float = 1.0
    """[Hz]"""
    exploration_rate: float = 0.2
    """[Hz]; its triggers act between."""
    trigger_rate: float = 5.0
    """At which the triggers are looked at [Hz]."""
    goal_tolerance: float = 0.05
    """Distance by its own estimate at which the robot stops [m]: what is left of the mission's tolerance is SLAM's."""
    goal_slack: float = 0.12
    """Distance from which on it approaches again, should the estimate have changed [m]."""
    waypoint_reached: float = 0.5
    """Nearer than this the next waypoint is planned without waiting [m]."""
    stuck_time: float = 12.0
    """Without ``stuck_distance`` of way in this time a target is given up [s]."""
    stuck_distance: float = 0.5
    """[m]"""
    slam: SlamConfig = field(default_factory=SlamConfig)
    explorer: ExplorerConfig = field(default_factory=ExplorerConfig)
    costmap: CostmapConfig = field(default_factory=CostmapConfig)

    def ticks(self, rate: float) -> int:
        """Ticks of the loop between two runs of a stage.

        Raises:
            BadArgument: If the rates do not divide.
        """
        ticks = round(self.rate / rate)
        if ticks < 1 or abs(ticks * rate - self.rate) > 1e-9 * self.rate:
            raise BadArgument(f"a stage's rate of {rate} Hz does not divide the loop's {self.rate} Hz exactly")
        return ticks


class Navigator:
    """Cerebrum (mapping, exploration, planning) over cerebellum (a local policy)."""

    def __init__(
        self,
        body: BodySpec,
        lidar: LidarSpec,
        policy: LocalPolicy,
        config: NavigatorConfig = NavigatorConfig(),
        telemetry: Telemetry = Telemetry(),
        critic: SafetyCritic = NoCritic(),
    ):
        """Build.

        Args:
            body: What is driven.
            lidar: What it sees with; its rate must be the loop's.
            policy: The lower layer.
            config: Rates and settings.
            telemetry: Who listens.
            critic: What rates frontiers for safety.

        Raises:
            BadArgument: If rates do not divide.
        """
        if lidar.rate != config.rate:
            raise BadArgument(f"the lidar runs at {lidar.rate} Hz, the navigator at {config.rate} Hz: make them equal")
        self.body = body
        self.config = config
        self.policy = policy
        self.telemetry = telemetry
        self.slam = Slam(lidar, config.slam)
        self.explorer = Explorer(config.explorer, critic, telemetry)
        self._planning_ticks = config.ticks(config.planning_rate)
        self._exploration_ticks = config.ticks(config.exploration_rate)
        self._trigger_ticks = config.ticks(config.trigger_rate)
        self.reset(Pose2(0.0, 0.0, 0.0), (0.0, 0.0))

    @property
    def map_from_base(self) -> Pose2:
        """Where the robot believes it is."""
        return self.slam.map_from_base

    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Begin a mission.

        Args:
            start: ``map_from_base`` now; it defines the map's frame.
            goal: In the map [m].
            prior_map: A map known beforehand, if there is one.
        """
        self.slam.reset(start, prior_map)
        self.explorer.reset(goal)
        self.policy.reset()
        self.goal = goal
        self.start = start
        self.arrived = False
        self._tick = 0
        self._path_in_map: FloatArray = np.empty((0, 2))
        self._waypoint = (start.x, start.y)
        self._moved_from = start
        self._moved_tick = 0
        self._odom_from_before: Pose2 | None = None
        self._up = (0.0, 0.0, 1.0)

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """One tick: localise and map; explore and plan when due; command.

        Args:
            scan: The lidar's latest.
            odometry: The body's, at the same time.

        Returns:
            The command to hold until the next tick.
        """
        telemetry = self.telemetry
        before = self._odom_from_before  # when the policy looked last
        now_from_before = STANDING if before is None else between(odometry.odom_from_base, before)
        estimate = self.slam.update(scan, odometry, self._walkers(now_from_before))
        pose = estimate.map_from_base
        telemetry.estimated_pose(pose, compose(self.start, odometry.odom_from_base))
        telemetry.scan(scan, estimate.points_in_map)
        seen = self._observation(scan, odometry, pose)
        self._up = odometry.up
        self.policy.look(seen)
        self._cerebrum(scan.stamp, pose)
        config = self.config
        self.arrived = distance(pose, self.goal) < (config.goal_slack if self.arrived else config.goal_tolerance)
        if self.arrived or not len(self._path_in_map):
            self.policy.stopped()
            command = STOP
        else:
            command = self._cerebellum(seen, pose)
        telemetry.command(command)
        self._tick += 1
        return command

    def _walkers(self, frame_from_base: Pose2) -> FloatArray:
        """Who the policy knew to walk when it looked, in the frame that a pose of the base is given in.

        (k, 3) x, y, radius [m].
        """
        walkers = self.policy.walkers()
        level = walkers[:, :2] @ levelling(self._up).T
        return np.column_stack([transform_points(frame_from_base, level), walkers[:, 2]])

    def _observation(self, scan: Scan, odometry: Odometry, pose: Pose2) -> LocalObservation:
        """What the local policy may look at, with the waypoint as it is before the cerebrum reconsiders it."""
        last, self._odom_from_before = self._odom_from_before, odometry.odom_from_base
        motion = STANDING if last is None else between(last, odometry.odom_from_base)
        is_final = self._waypoint == self.goal
        return LocalObservation(scan, self._waypoint_in_base(pose), is_final, odometry.twist, motion)

    def _cerebellum(self, seen: LocalObservation, pose: Pose2) -> VelocityCommand:
        is_final = self._waypoint == self.goal
        return self.policy.command(replace(seen, waypoint_in_base=self._waypoint_in_base(pose), is_final=is_final))

    def _waypoint_in_base(self, pose: Pose2) -> tuple[float, float]:
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        dx, dy = self._waypoint[0] - pose.x, self._waypoint[1] - pose.y
        return c * dx + s * dy, -s * dx + c * dy

    def _cerebrum(self, now: float, pose: Pose2) -> None:
        """Explore and plan, if it is time or there is cause."""
        tick = self._tick
        reason = "it is time" if tick % self._exploration_ticks == 0 else None
        if tick % self._trigger_ticks == 0:
            if self._is_stuck(pose):
                self.explorer.give_up(now)
                self.telemetry.event("no progress: target given up", "WARN")
            reason = self.explorer.trigger(now, self.slam.navigation_grid, (pose.x, pose.y)) or reason
        reached = (
            self._waypoint != self.goal
            and len(self._path_in_map) > 0
            and distance(pose, self._waypoint) < self.config.waypoint_reached
            and tick % self._trigger_ticks == 0
        )
        if reason is not None or reached or tick % self._planning_ticks == 0:
            self._plan(now, pose, reason)

    def _plan(self, now: float, pose: Pose2, reason: str | None) -> None:
        grid, telemetry, position = self.slam.navigation_grid, self.telemetry, (pose.x, pose.y)
        costmap, paths = self._survey(pose)
        target = self.explorer.target
        if target is not None and not paths.reaches(*target.approach):
            reason = "no path leads to the target"
        if reason is not None or target is None:
            last = target
            surveys = {False: (costmap, paths)}
            for doubting, forgiving in _RESORTS:
                if doubting not in surveys:
                    surveys[doubting] = self._survey(pose, doubting=doubting)
                costmap, paths = surveys[doubting]
                self.explorer.target = last  # it is known to be preferred
                target = self.explorer.choose(now, grid, costmap, paths, pose, forgiving=forgiving)
                if target is not None:
                    break
            if target is not None and (last is None or target.point != last.point):
                what = "the goal" if target.is_goal else f"({target.point[0]:.1f}, {target.point[1]:.1f})"
                telemetry.event(f"{reason}: now heading for {what}")
        if target is not None:
            self._path_in_map = paths.path_to(*target.approach)
            self._waypoint = farthest_free_waypoint(costmap, self._path_in_map, position)
        else:
            # Somebody stands in the way, most likely: the last path is the best guess.
            telemetry.event("nothing can be reached: keeping the last path", "WARN")
        telemetry.grid(grid)
        telemetry.entropy(grid.entropy)
        telemetry.path(self._path_in_map)
        telemetry.waypoint(self._waypoint)

    def _survey(self, pose: Pose2, *, doubting: bool = False) -> tuple[Costmap, PathField]:
        """What the map means to this body, and its ways in it."""
        grid, position, walkers = self.slam.navigation_grid, (pose.x, pose.y), self._walkers(pose)
        costmap = Costmap(grid, self.body.radius, position, self.config.costmap, walkers, doubting)
        return costmap, PathField(costmap, position)

    def _is_stuck(self, pose: Pose2) -> bool:
        if distance(pose, self._moved_from) > self.config.stuck_distance:
            self._moved_from, self._moved_tick = pose, self._tick
        if self.arrived or self._tick - self._moved_tick < self.config.stuck_time * self.config.rate:
            return False
        self._moved_tick = self._tick
        return True
