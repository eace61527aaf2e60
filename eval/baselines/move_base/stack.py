"""move_base as a stack: localise and map, mark, plan at 1 Hz, follow the path by the dynamic window, recover."""

import numpy as np

from eval.baselines.move_base.config import MoveBaseConfig
from eval.baselines.move_base.layers import LayeredCostmap, LayeredSurvey, ObstacleLayer
from eval.baselines.move_base.recovery import Recovery
from eval.user_method import Request
from vuca_nav.exploration.explorer import Explorer, ExplorerConfig
from vuca_nav.geometry import compose, distance, inverse, transform_points
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.slam import Slam, SlamConfig, SlamEstimate
from vuca_nav.navigator import NavigatorConfig
from vuca_nav.perception.distance_field import clearance_at
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.perception import Perception
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.planner import no_plan
from vuca_nav.planning.target import Target
from vuca_nav.planning.waypoints import farthest_free_waypoint
from vuca_nav.policy.base import LocalGoal
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.stack import Stack
from vuca_nav.types import STANDING, STOP, FloatArray, Odometry, Pose2, Scan, VelocityCommand


class MoveBase(Stack):
    """move_base over the project's SLAM.

    After the last recovery behaviour move_base aborts. Here the goal is then sent again at once, as a user would; with
    exploration the frontier is given up, and another is chosen.

    Args:
        config: Settings.
        request: Body and lidar.
    """

    def __init__(self, config: MoveBaseConfig, request: Request):
        body, lidar, localisation, telemetry = request
        self.config, self.body, self.telemetry = config, body, telemetry
        self._loop = NavigatorConfig()
        self.perception = Perception(lidar)
        self.slam = Slam(lidar, SlamConfig(localisation=localisation))
        self.obstacles = ObstacleLayer(config.layers)
        self.explorer: Explorer | None = None
        if config.explorer is not None:
            asked = config.explorer
            chooses = ExplorerConfig(score=asked.score, hysteresis=asked.hysteresis, unknown=asked.unknown)
            self.explorer = Explorer(chooses, telemetry=telemetry)
            self._exploration_ticks = self._loop.ticks(config.explorer.rate)
        self.policy = DynamicWindow(body, lidar, config.window)
        self.recovery = Recovery(config.recovery)
        self._planning_ticks = self._loop.ticks(config.planning_rate)
        self._trigger_ticks = self._loop.ticks(self._loop.trigger_rate)
        self._angles = lidar.angles_in_base()
        self._turning_disc = np.array([[0.0, 0.0, body.radius]])
        self.reset(STANDING, (0.0, 0.0))

    @property
    def grid(self) -> OccupancyGrid:
        """The map of its SLAM as it is now."""
        return self.slam.navigation_grid

    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Implements :class:`~vuca_nav.stack.Stack`."""
        self.perception.reset()
        self.slam.reset(start, prior_map)
        self.obstacles.reset()
        self.policy.reset()
        if self.explorer is not None:
            self.explorer.reset(goal)
        self.start, self.goal = start, goal
        self.map_from_base = start
        self.arrived = False
        self.plan = no_plan(start)
        self.percept: Percept | None = None
        """Percept of the last tick."""
        self._has_plan = True
        self._tick = 0
        self.recovery.reset(0.0, start)

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """Implements :class:`~vuca_nav.stack.Stack`."""
        self.percept = percept = self.perception.update(scan, odometry)
        estimate = self.slam.update(percept)
        self._follow(estimate.map_correction)
        self.map_from_base = estimate.map_from_base
        self.telemetry.estimated_pose(estimate.map_from_base, compose(self.start, odometry.odom_from_base))
        self.telemetry.scan(scan, estimate.points_in_map)
        self.obstacles.update(estimate.navigation_grid, estimate.map_from_base, percept.scan.ranges, self._angles)
        if estimate.tracking == "lost":  # nothing is mapped: there is nothing to plan on
            self._tick += 1
            return self.policy.command(percept, None)
        if self._is_planning_due():
            self._plan(percept, estimate)
        command = self._turn_about(percept) if self.recovery.is_turning else self._drive(percept)
        self.telemetry.command(command)
        self._tick += 1
        return command

    def _follow(self, map_correction: Pose2) -> None:
        """Move plan and target along with the map; marks are soon seen again."""
        if map_correction != STANDING:
            self.plan = self.plan.moved(map_correction)
            self.obstacles.reset()
            if self.explorer is not None:
                self.explorer.follow(map_correction)
            self.telemetry.map_correction(map_correction)

    def _is_planning_due(self) -> bool:
        """At the planning rate, and as soon as the waypoint is reached."""
        if self._tick % self._planning_ticks == 0:
            return True
        is_near = distance(self.map_from_base, self.plan.waypoint_in_map) < self._loop.waypoint_reached
        return self._tick % self._trigger_ticks == 0 and self._has_plan and not self.plan.is_final and is_near

    def _plan(self, percept: Percept, estimate: SlamEstimate) -> None:
        """Plan to the goal, or to the frontier that the explorer chooses; keep the last plan where there is none."""
        grid, pose = estimate.navigation_grid, estimate.map_from_base
        goal = self.goal if self.explorer is None else None
        position = pose.x, pose.y
        costmap = LayeredCostmap(grid, self.obstacles, self.body, position, goal, self.config.layers)
        if self.explorer is None:
            paths = PathField(costmap, position)
            target = Target(self.goal, self.goal, is_goal=True) if paths.reaches(*self.goal) else None
        else:
            cause = "it is time" if self._tick % self._exploration_ticks == 0 else None
            cause = self.explorer.trigger(percept.stamp, grid, position) or cause
            target, paths = self._explored(cause, percept, LayeredSurvey(grid, costmap, pose))
        self._has_plan = target is not None
        if target is None:
            self.telemetry.event("no plan: keeping the last path", "WARN")
        else:
            path = paths.path_to(*target.approach)
            ahead = _cut(path, self.config.look_ahead)
            waypoint = farthest_free_waypoint(costmap, ahead, position, nearest=0.0)
            final = target.is_goal and waypoint == target.approach
            self.plan = type(self.plan)(path, waypoint, final)
        self.telemetry.path(self.plan.path_in_map)
        self.telemetry.waypoint(self.plan.waypoint_in_map)
        self.telemetry.grid(grid)
        self.telemetry.entropy(grid.entropy)

    def _explored(self, cause: str | None, percept: Percept, survey: LayeredSurvey) -> tuple[Target | None, PathField]:
        assert self.explorer is not None
        exploration = self.explorer.update(cause, percept, survey)
        return exploration.target, exploration.paths

    def _drive(self, percept: Percept) -> VelocityCommand:
        """Follow the path; see whether a recovery is due."""
        goal = self._local_goal(percept)
        if not self.arrived:
            due = self.recovery.update(percept.stamp, self.map_from_base, self._has_plan)
            if due is not None:
                self.telemetry.event(f"recovery: {due}", "WARN")
            self._recover(due, percept.stamp)
        return self.policy.command(percept, None if self.recovery.is_turning else goal)

    def _recover(self, behaviour: str | None, now: float) -> None:
        position = self.map_from_base.x, self.map_from_base.y
        c = self.config.recovery
        if behaviour == "conservative clear":
            self.obstacles.clear_beyond(c.conservative_distance, position)
        elif behaviour == "aggressive clear":
            self.obstacles.clear_beyond(c.aggressive_factor * self.body.radius, position)
        elif behaviour == "abort" and self.explorer is not None:
            self.explorer.give_up(now)

    def _turn_about(self, percept: Percept) -> VelocityCommand:
        """Turn on the spot, as long as there is room for it."""
        field = percept.distance_field
        has_room = percept.is_valid and clearance_at(field, self._turning_disc, 0.0, 0.0, 1.0, 0.0) > 0.0
        self.recovery.turn(percept.motion.yaw, percept.stamp, has_room)
        self.policy.command(percept, None)  # it stands meanwhile, as far as it knows
        turns = self.recovery.is_turning
        return VelocityCommand(0.0, 0.0, self.config.recovery.turn_share * self.body.max_w_z) if turns else STOP

    def _local_goal(self, percept: Percept) -> LocalGoal | None:
        """The waypoint as the dynamic window sees it; None if the body has to stand."""
        pose, loop = self.map_from_base, self._loop
        stop = loop.goal_slack if self.arrived else loop.goal_tolerance
        self.arrived = distance(pose, self.goal) < self.stops_within(stop)
        if self.arrived or not len(self.plan.path_in_map) or not percept.is_valid:
            return None
        ((x, y),) = transform_points(inverse(pose), np.array([self.plan.waypoint_in_map])).tolist()
        return LocalGoal((x, y), self.plan.is_final)


def _cut(path_in_map: FloatArray, length: float) -> FloatArray:
    """The first part of a path (n, 2), up to a length along it [m]; at least two points of it."""
    along = np.hypot(*np.diff(path_in_map, axis=0).T).cumsum()
    return path_in_map[: max(2, 1 + int((along <= length).sum()))]
