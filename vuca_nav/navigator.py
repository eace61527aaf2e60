"""The stack: ``Navigator.step(scan, odometry) -> VelocityCommand``, each stage at its rate.

A tick reads as the figure of Zhang et al., Section III-A: perceive, localise and map, explore, plan, act.
"""

import math
from dataclasses import dataclass, field

from vuca_nav.errors import BadArgument
from vuca_nav.exploration.explorer import Explorer, ExplorerConfig
from vuca_nav.exploration.heuristic import Critic, NoCritic
from vuca_nav.footprint import ROOM, cover_by_discs, half_way
from vuca_nav.geometry import compose, distance, transform_points
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.slam import Slam, SlamConfig, SlamEstimate
from vuca_nav.mapping.tracking import Tracking
from vuca_nav.perception.percept import MOVERS_NEAR, Percept
from vuca_nav.perception.perception import Perception, PerceptionConfig
from vuca_nav.perception.readings import FARTHEST
from vuca_nav.perception.ring import ring_of
from vuca_nav.perception.standing_map import StandingMap
from vuca_nav.planning.costmap import CostmapConfig
from vuca_nav.planning.looking import Looking
from vuca_nav.planning.planner import Planner, no_plan, straight_plan
from vuca_nav.planning.survey import Survey
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.recovery import NO_RECOVERY, SAID, Recovery, RecoveryConfig, Rung
from vuca_nav.stack import Stack
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, BodySpec, LidarSpec, Odometry, Pose2, Scan, VelocityCommand

NO_WAY = "no way leads there through what has been seen, and nothing more can be explored"
"""The finding of a stack that has explored everything."""


@dataclass(frozen=True, slots=True)
class NavigatorConfig:
    """Rates (Section III-A) and the settings of the stages."""

    rate: float = 30.0
    """Mapping and local control [Hz]."""
    planning_rate: float = 1.0
    """[Hz]"""
    exploration_rate: float = 0.2
    """Rate of choices [Hz]; triggers cause others in between."""
    alert_rate: float | None = None
    """Rate of choices while something is seen to move [Hz]; None for the same as else."""
    trigger_rate: float = 5.0
    """Rate at which the triggers are looked at [Hz]."""
    goal_tolerance: float = 0.05
    """Estimated distance at which the robot stops [m]: the rest of the mission's tolerance is left for SLAM's error."""
    goal_error: float = 0.02
    """Part of the mission's tolerance that is left for SLAM's error where a place beside the goal stands for it [m]."""
    goal_slack: float = 0.12
    """Distance beyond which the robot approaches again, should the estimate have changed [m]."""
    waypoint_reached: float = 0.5
    """Distance below which the next waypoint is planned at once [m]."""
    stuck_time: float = 12.0
    """Time after which a target is given up if the robot has not moved ``stuck_distance`` [s]."""
    stuck_distance: float = 0.5
    """[m]"""
    closed_time: float = 5.0
    """Time without anything to explore or a way to the goal after which that is a finding [s]."""
    narrow: float = 1.1
    """Width of the path, on the map, below which it is narrow [m]: networks are trained among gaps of 1.1 m and more
    (``worlds.scenes.training.GAP``), which cells of the map make up to 0.1 m narrower."""
    widest_narrow: float = 1.4
    """Greatest width that counts as narrow once the robot has hovered before it [m]."""
    narrow_step: float = 0.1
    """Width by which narrow ways may be wider than the one that the robot has hovered before [m]."""
    narrow_reach: float = 2.0
    """Distance from the robot within which a narrow path counts [m]."""
    weak_speed: float = 0.5
    """Share of the commanded velocity that is driven while tracking is weak."""
    direct: bool = False
    """Whether the local policy heads for the goal itself: nothing is explored, and no path is planned."""
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    slam: SlamConfig = field(default_factory=SlamConfig)
    recovery: RecoveryConfig | None = field(default_factory=RecoveryConfig)
    """None for a stack that only gives its target up where it makes no progress."""
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


class Navigator(Stack):
    """Cerebrum (mapping, exploration, planning) over cerebellum (a local policy)."""

    def __init__(
        self,
        body: BodySpec,
        lidar: LidarSpec,
        policy: LocalPolicy,
        config: NavigatorConfig = NavigatorConfig(),
        telemetry: Telemetry = Telemetry(),
        critic: Critic = NoCritic(),
    ):
        """Build the stages.

        Args:
            body: The body that is driven.
            lidar: The body's lidar. It may be slower or faster than the loop.
            policy: The lower layer, made for the loop's rate.
            config: Rates and settings.
            telemetry: Receives what the stages report.
            critic: Rates frontiers for safety.

        Raises:
            BadArgument: If rates do not divide.
        """
        if policy.rate not in (None, config.rate):
            raise BadArgument(
                f"the policy is made for {policy.rate} Hz, the navigator's loop runs at {config.rate} Hz: make the "
                f"policy with rate={config.rate}"
            )
        self.body = body
        self._discs = cover_by_discs(body.footprint)
        self._half_width = float(self._discs[:, 2].max())
        self._least_width = 2.0 * (
            half_way(body.footprint) - ROOM
        )  # of the body: what is narrower on the map is the network's
        self.config = config
        self.telemetry = telemetry
        self.perception = Perception(lidar, config.perception, body, config.rate)
        self._standing = StandingMap(config.rate)
        self.slam = Slam(lidar, config.slam)
        self.explorer = Explorer(config.explorer, critic, telemetry)
        self.planner = Planner(telemetry)
        self.recovery = Recovery(config.recovery or NO_RECOVERY, 1.0 / config.trigger_rate)
        self._looking = Looking(ring_of(lidar, config.rate), config.rate)
        self.policy = policy
        self._planning_ticks = config.ticks(config.planning_rate)
        self._exploration_ticks = config.ticks(config.exploration_rate)
        self._alert_ticks = config.ticks(config.alert_rate or config.exploration_rate)
        self._trigger_ticks = config.ticks(config.trigger_rate)
        self.reset(Pose2(0.0, 0.0, 0.0), (0.0, 0.0))

    @property
    def grid(self) -> OccupancyGrid:
        """The navigation grid as it is now."""
        return self.slam.navigation_grid

    def reset(self, start: Pose2, goal: tuple[float, float] | None, prior_map: OccupancyGrid | None = None) -> None:
        """Begin a mission.

        Args:
            start: ``map_from_base`` now; it defines the map's frame.
            goal: Goal in the map [m]; None to stand and map until ``head_for`` gives one.
            prior_map: A map known beforehand, if there is one.

        Raises:
            BadArgument: If start or goal is not finite or too far out, or the map is larger than a map can be.
        """
        goal = None if goal is None else _checked_goal(goal)
        start = Pose2(*(float(value) for value in start))
        self.perception.reset()
        self._standing.reset()
        self.slam.reset(start, prior_map)
        self.policy.reset()
        self.start = start
        self.map_from_base = start
        """Estimated pose of the robot."""
        self.percept: Percept | None = None
        """Percept of the last tick."""
        self._tick = 0
        self._is_faulty, self._is_map_full = False, False
        self._tracking: Tracking = "tracked"
        self._looking.reset()
        self.head_for(goal)

    def head_for(self, goal: tuple[float, float] | None) -> None:
        """Go to another goal from where the robot is: the map stays, and what was given up is looked at again.

        Args:
            goal: Goal in the map [m]; None to stand, and to go on mapping.

        Raises:
            BadArgument: If the goal is not finite or too far out.
        """
        self.goal = None if goal is None else _checked_goal(goal)
        """Goal in the map [m]; None if there is none."""
        self.arrived = False
        self.explorer.reset(self.goal or (0.0, 0.0), max(self.tolerance - self.config.goal_error, 0.0))
        self.plan = no_plan(self.map_from_base)
        self.finding, self._closed_since = None, math.inf
        self.recovery.reset()
        self._narrow = self.config.narrow
        self._is_goal_new = True
        self._moved_from, self._moved_tick = self.map_from_base, self._tick

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """One tick.

        Args:
            scan: The lidar's latest scan; the same one again, by its stamp, while there is no newer one.
            odometry: The body's odometry now.

        Returns:
            The command to hold until the next tick.

        Raises:
            BadArgument: If the scan has another number of beams than the lidar, or ranges that are no numbers.
        """
        self.percept = percept = self.perception.update(scan, odometry, self._standing)
        estimate = self.slam.update(percept)
        self._follow(estimate.map_correction)
        self.map_from_base = estimate.map_from_base
        grid = estimate.navigation_grid
        poses = estimate.map_from_base, percept.odom_from_base
        self._standing.take(grid.level, grid.origin, grid.resolution, poses)
        self.telemetry.estimated_pose(estimate.map_from_base, compose(self.start, percept.odom_from_base))
        if percept.is_new:
            self.telemetry.scan(percept.scan, estimate.points_in_map)
        self._report(percept, estimate)
        if self.goal is None or estimate.tracking == "lost":
            self._show_plan(estimate)
            return self._act(percept, estimate)
        if self.config.direct:
            self.plan = straight_plan(estimate.map_from_base, self.goal)
            self._show_plan(estimate)
            return self._act(percept, estimate)
        cause = self._cause_to_explore(percept, estimate)
        if cause is not None or self._is_planning_due(estimate.map_from_base):
            survey = self._survey(percept, estimate)
            exploration = self.explorer.update(cause, percept, survey)
            self._judge_goal(percept, exploration.target is None)
            self.plan = self.planner.update(exploration.target, exploration.paths, self.plan)
            self.telemetry.grid(estimate.navigation_grid)
            self.telemetry.entropy(estimate.navigation_grid.entropy)
        return self._act(percept, estimate)

    def _show_plan(self, estimate: SlamEstimate) -> None:
        """Report plan and map at the planning rate, where no planner is asked."""
        if self._tick % self._planning_ticks == 0:
            self.telemetry.path(self.plan.path_in_map)
            self.telemetry.waypoint(self.plan.waypoint_in_map)
            self.telemetry.grid(estimate.navigation_grid)
            self.telemetry.entropy(estimate.navigation_grid.entropy)

    def _act(self, percept: Percept, estimate: SlamEstimate) -> VelocityCommand:
        """Ask the lower layer, and end the tick."""
        if estimate.tracking == "lost":
            goal = self._looking.goal(percept) if estimate.must_look and self.goal and percept.is_valid else None
        else:
            goal = self._local_goal(percept, estimate.map_from_base)
        command = self.policy.command(percept, goal)
        if estimate.tracking != "tracked":
            command = VelocityCommand(*(self.config.weak_speed * part for part in command))
        self.telemetry.command(command)
        self._tick += 1
        return command

    def _report(self, percept: Percept, estimate: SlamEstimate) -> None:
        """Report faults of the sensors and of localisation as they begin and end, and once that the map is full."""
        is_faulty = percept.fault is not None
        if is_faulty != self._is_faulty:
            self.telemetry.event(f"the robot stands: {percept.fault}" if is_faulty else "the sensors are valid", "WARN")
        self._is_faulty = is_faulty
        if estimate.tracking != self._tracking:
            self._take_tracking(estimate)
        if not estimate.is_mapped and not self._is_map_full:
            self._is_map_full = True
            self.telemetry.event("the map has its greatest size: scans that reach beyond are not mapped", "WARN")

    def _take_tracking(self, estimate: SlamEstimate) -> None:
        """Say how well the robot knows where it is; plan anew where it has been found again."""
        before, self._tracking = self._tracking, estimate.tracking
        if estimate.tracking == "lost":
            self.telemetry.event("the robot does not know where it is: it stands and looks", "WARN")
        elif before == "lost":
            x, y, _ = estimate.map_from_base
            self.telemetry.event(f"the robot has been found again at ({x:.1f}, {y:.1f})")
            self.plan = no_plan(estimate.map_from_base)
            self._moved_from, self._moved_tick = estimate.map_from_base, self._tick
            self._is_goal_new = True
            self._looking.reset()
            self.recovery.reset()
            self._closed_since = math.inf
        elif estimate.tracking == "weak":
            self.telemetry.event("scans contradict the map: slower, and by odometry", "WARN")

    def _follow(self, map_correction: Pose2) -> None:
        """Move everything that is remembered in the map along with it."""
        if map_correction != STANDING:
            self.plan = self.plan.moved(map_correction)
            self.explorer.follow(map_correction)
            self.recovery.follow(map_correction)
            self._standing.reset()  # what it holds is where the map was
            self._moved_from = compose(map_correction, self._moved_from)
            self.telemetry.map_correction(map_correction)

    def _cause_to_explore(self, percept: Percept, estimate: SlamEstimate) -> str | None:
        """Cause for the explorer to choose anew, None if there is none."""
        ticks = self._alert_ticks if len(percept.moving) else self._exploration_ticks
        cause = "it is time" if self._tick % ticks == 0 else None
        if self._is_goal_new:
            cause, self._is_goal_new = cause or "there is a new goal", False
        if self._tick % self._trigger_ticks == 0:
            pose = estimate.map_from_base
            if self._is_stuck(pose):
                self.explorer.give_up(percept.stamp)
                self.telemetry.event("no progress: target given up", "WARN")
            cause = self.explorer.trigger(percept.stamp, estimate.navigation_grid, (pose.x, pose.y)) or cause
            cause = self._recover(percept, estimate) or cause
        return cause

    def _recover(self, percept: Percept, estimate: SlamEstimate) -> str | None:
        """Watch the progress, and say what is tried where there is none; cause for the explorer to choose anew."""
        place = estimate.map_from_base[:2]
        if self.arrived or not percept.is_valid or estimate.tracking == "lost":
            return None
        rung = self.recovery.update(percept.stamp, place, self.plan, percept.moves_within(MOVERS_NEAR))
        if rung is None:
            return None
        self.telemetry.event(SAID[rung], "WARN")
        if rung == Rung.ANOTHER_WAY and self.recovery.bar(percept.stamp, place, self.plan):
            target = self.explorer.target
            if target is not None and not self._survey(percept, estimate).paths().reaches(*target.approach):
                self.recovery.barred.pop()
                self.telemetry.event("there is no other way", "WARN")
        return "no progress"

    def _judge_goal(self, percept: Percept, is_closed: bool) -> None:
        """Find out that the goal cannot be reached, or that it can after all.

        Without sight or place, or where the robot itself bars a way for a while, nothing is found out.

        Args:
            percept: The percept of this tick.
            is_closed: Whether neither the goal nor anything unknown can be reached.
        """
        if not is_closed:
            if self.finding is not None:
                self.telemetry.event("there is a way again")
            self._closed_since, self.finding = math.inf, None
            return
        if not percept.is_valid or percept.is_blind or self._tracking != "tracked" or self.recovery.barred:
            self._closed_since = math.inf
            return
        self._closed_since = min(self._closed_since, percept.stamp)
        if self.finding is None and percept.stamp - self._closed_since >= self.config.closed_time:
            self.finding = NO_WAY
            self.telemetry.event(f"the goal cannot be reached: {NO_WAY}", "WARN")

    def _is_planning_due(self, map_from_base: Pose2) -> bool:
        """Whether a plan is due: at the planning rate, and as soon as the waypoint is reached."""
        if self._tick % self._planning_ticks == 0:
            return True
        plan = self.plan
        return (
            self._tick % self._trigger_ticks == 0
            and len(plan.path_in_map) > 0
            and not plan.is_final
            and distance(map_from_base, plan.waypoint_in_map) < self.config.waypoint_reached
        )

    def _survey(self, percept: Percept, estimate: SlamEstimate) -> Survey:
        """Survey of the map for this body at its present pose."""
        moving_in_map = percept.moving.copy()
        moving_in_map[:, :2] = transform_points(estimate.map_from_base, percept.moving[:, :2])
        return Survey(
            estimate.navigation_grid,
            self._discs,
            estimate.map_from_base,
            moving_in_map,
            self.config.costmap,
            self.recovery.barred_in_map(),
            doubting=self.recovery.rung == Rung.CLEAR,
        )

    def _local_goal(self, percept: Percept, map_from_base: Pose2) -> LocalGoal | None:
        """The waypoint as the lower layer sees it; None if the body has to stand."""
        config = self.config
        if self.goal is None:
            return None
        stop = config.goal_slack if self.arrived else config.goal_tolerance
        end = self.plan.waypoint_in_map if self.plan.is_final else self.goal
        left = self.tolerance - distance(end, self.goal)
        self.arrived = distance(map_from_base, end) < min(self.stops_within(stop), max(0.5 * left, config.goal_error))
        if self.arrived or not len(self.plan.path_in_map) or not percept.is_valid:
            return None
        if self.recovery.waits:
            return None
        back = self.recovery.waypoint(map_from_base[:2])
        waypoint = back or self.plan.waypoint_in_map
        c, s = math.cos(map_from_base.yaw), math.sin(map_from_base.yaw)
        dx, dy = waypoint[0] - map_from_base.x, waypoint[1] - map_from_base.y
        width = 2.0 * self.plan.narrowest(map_from_base[:2], config.narrow_reach)
        if self._narrow < width <= config.widest_narrow and self.recovery.hovers:
            self._narrow = width + config.narrow_step
            self.recovery.try_again()
        # Where the window has not got on either, the network has another try once the robot has backed out.
        fits = self._least_width <= width <= self._narrow
        is_narrow = back is not None or (fits and not self.recovery.tries_other_driver)
        room = 0.5 * width - self._half_width
        if self.plan.is_final and len(self.plan.clearances):
            room = min(room, float(self.plan.clearances[-1]) - self.body.radius)
        return LocalGoal((c * dx + s * dy, -s * dx + c * dy), self.plan.is_final and back is None, is_narrow, room)

    def _is_stuck(self, pose: Pose2) -> bool:
        if distance(pose, self._moved_from) > self.config.stuck_distance:
            self._moved_from, self._moved_tick = pose, self._tick
        if self.arrived or self._tick - self._moved_tick < self.config.stuck_time * self.config.rate:
            return False
        self._moved_tick = self._tick
        return True


def _checked_goal(goal: tuple[float, float]) -> tuple[float, float]:
    """The goal in plain numbers.

    Raises:
        BadArgument: If it is not finite or too far out.
    """
    goal = float(goal[0]), float(goal[1])
    if not all(abs(value) < FARTHEST for value in goal):
        raise BadArgument(f"the goal {goal} must be finite, within {FARTHEST:g} m of the map's origin")
    return goal
