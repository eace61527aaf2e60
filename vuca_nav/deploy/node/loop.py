"""The loop: what is heard goes through the stack and the safety layer, and the command out."""

import gc
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from vuca_nav.checks import check_fields
from vuca_nav.cli import undisturbed
from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.node.action import NavigateToPose, Progress, Status
from vuca_nav.deploy.node.base import RosBase
from vuca_nav.deploy.node.inputs import EMERGENCY_STOP, Inputs
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.node.outputs import Outputs
from vuca_nav.deploy.node.pace import Lockstep, Pace, RealTime
from vuca_nav.deploy.node.unitree import UnitreeBase
from vuca_nav.deploy.safety.config import DEFAULTS
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.status import Tick
from vuca_nav.deploy.transport.interface import Transport
from vuca_nav.geometry import compose, distance, inverse
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, Odometry, Pose2, Scan
from vuca_nav.wire import seconds

ARRIVED_TIME = 1.0
"""Time for which the robot has to be at an action's goal before the action has succeeded [s]."""
_FEEDBACK_TICKS = 10
_COLLECT_TICKS = 30
_KEPT = 3000
"""Number of the last ticks whose times are kept, for the diagnostics: 100 s."""


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """How the node runs."""

    lockstep: bool = False
    """A tick for each pair of scan and odometry, without a wall clock; with a simulator only."""
    use_sim_time: bool = False
    """Whether time is that of ``/clock``."""
    stamped: bool = True
    """Whether commands are TwistStamped; otherwise Twist."""
    base: Literal["ros", "unitree"] = "ros"
    """What the base speaks: ROS's cmd_vel and odom, or a Unitree Go2's own requests and state."""
    speed: float = 1.0
    """Share of the body's greatest velocities that commands may have."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a speed that is no share."""
        check_fields(self, "above 0 and at most 1", lambda share: 0.0 < share <= 1.0, "speed")


class LoopTimes(NamedTuple):
    """Times of the last ticks [s]: median and 99.9th percentile."""

    ticks: int
    compute: tuple[float, float]
    """From the begin of a tick to the command."""
    latency: tuple[float, float]
    """From a scan's arrival to the command."""
    period: tuple[float, float]
    """From one command to the next."""


class Node:
    """The deployed stack on the network.

    Args:
        bundle: The bundle that drives.
        transport: The network.
        config: How it runs.
        telemetry: Listens to the stack.
        log: Keeps what is heard, said and done.
    """

    def __init__(
        self, bundle: Bundle, transport: Transport, config: NodeConfig, telemetry: Telemetry, log: NodeLog
    ) -> None:
        self._bundle, self._config, self._telemetry, self._log = bundle, config, telemetry, log
        self._rate = bundle.config.navigator.rate
        base = RosBase(bundle.robot, config.stamped) if config.base == "ros" else UnitreeBase()
        self.inputs = Inputs(transport, bundle.robot, base, log, config.use_sim_time)
        self.outputs = Outputs(transport, bundle.robot, base, log)
        self.action = NavigateToPose(transport, bundle.robot.frames.map)
        self.after_tick: Callable[[], None] = lambda: None
        """Called at the end of each tick, and in lockstep while there is none."""
        self.navigator = bundle.navigator(telemetry)
        self.navigator.head_for(None)
        self.safety = self._safety_layer()
        self.pace: Pace
        if config.lockstep:
            self.pace = Lockstep(transport, self.inputs, self._rate, bundle.lidar)
        else:
            self.pace = RealTime(transport, self.inputs, self._rate, bundle.lidar, config.use_sim_time)
        self._lidar = bundle.lidar
        self._epoch: int | None = None
        self._start: Pose2 | None = None
        self._arrived_ticks = self._ticks = self._goal_ticks = 0
        self._drives_action = False
        self._goal_distance = math.nan
        self._said = -math.inf
        self._compute: deque[float] = deque(maxlen=_KEPT)
        self._latency: deque[float] = deque(maxlen=_KEPT)
        self._period: deque[float] = deque(maxlen=_KEPT)

    def run(self) -> None:
        """Tick until something ends it; the last command is zero, whatever does."""
        gc.collect()
        gc.freeze()
        gc.disable()
        try:
            while True:
                if self.pace.wait():
                    self.tick()
                elif self._config.lockstep:  # which may never tick
                    self.after_tick()
        finally:
            with undisturbed():
                self.outputs.farewell(self.now())
            gc.enable()
            gc.unfreeze()

    def now(self) -> int:
        """The time that stamps are of [ns]: in lockstep that of the newest reading."""
        if self._config.lockstep:
            return self._newest()
        return (self.inputs.clock or 0) if self._config.use_sim_time else time.time_ns()

    def tick(self) -> None:
        """One tick: the command is out before anything else is said."""
        began = time.monotonic()
        inputs = self.inputs
        self._meet_requests()
        sensed, proposed = self._sensed(), None
        if sensed is not None:
            self._telemetry.time(sensed[1].stamp)
            proposed = self.navigator.step(*sensed)
            self._log.ticked(sensed[0], inputs.scan_number, sensed[1], proposed, time.time_ns())
        if inputs.is_stopped:
            self.safety.stop(f"true on {EMERGENCY_STOP}")
        elif self.safety.state.action == "emergency":
            self.safety.release()
        command = self.safety.step(self._safety_tick(sensed), proposed).command
        newest = self._newest() or self.now()
        self.outputs.command(command if sensed is not None else STOP, newest)
        self._time(began)
        if sensed is not None:
            self.outputs.show(self.navigator, self._map_from_odom(), newest)
            self._report_action()
        self.outputs.diagnose(self.safety, self._loop_values(), self.now())
        self._ticks += 1
        if self._ticks % _COLLECT_TICKS == 0:
            gc.collect()  # of what came since the loop began: all that was there before is frozen
        self.after_tick()

    @property
    def log_failure(self) -> str | None:
        """Why the log is not whole; None while it is."""
        return self._log.failure

    def times(self) -> LoopTimes:
        """Times of the last ticks."""
        return LoopTimes(self._ticks, _summary(self._compute), _summary(self._latency), _summary(self._period))

    def status(self) -> str:
        """One line about what the robot does."""
        navigator, state = self.navigator, self.safety.state
        needed = ("clock", "scan", "odometry") if self._config.use_sim_time else ("scan", "odometry")
        missing = [name for name in needed if getattr(self.inputs, name) is None]
        if missing:
            return f"waiting for {' and '.join(missing)}"
        goal = "no goal" if navigator.goal is None else f"{self._way_to_go():.2f} m to the goal"
        return f"{state.action}: {state.message}; {goal}"

    def _meet_requests(self) -> None:
        """Take over initial pose, goal and cancellation."""
        start = self.inputs.take_start()
        if start is not None:
            self._reset(*start)
        if self.action.was_canceled() and self._drives_action:
            self._head_for(None, is_action=False)
        goal = self.inputs.take_goal()
        if goal is not None:
            self.action.finish(Status.ABORTED)
            self._head_for(goal, is_action=False)
        goal = self.action.take(self.now())
        if goal is not None:
            self._head_for(goal, is_action=True)

    def _head_for(self, goal: Pose2 | None, *, is_action: bool) -> None:
        self._drives_action, self._arrived_ticks, self._goal_ticks = is_action, 0, 0
        self.navigator.head_for(None if goal is None else (goal.x, goal.y))
        self._log.heads_for(self.navigator.goal, time.time_ns())

    def _reset(self, start: Pose2, since: int) -> None:
        """Begin anew from a pose in the map, with readings from a time on [ns]; the goal is forgotten."""
        self.action.finish(Status.ABORTED)
        self._drives_action = False
        self._start, self._epoch = start, None
        self.navigator.reset(start, None)
        self.inputs.forget_before(since)

    def _begin(self, stamp: int, odom_from_base: Pose2) -> int:
        """Begin with the first readings; the time from which the stack counts, that of the scan [ns]."""
        if self.inputs.lidar is not None and self.inputs.lidar != self._lidar:
            self._rebuild()
        # Where nobody has said where the robot is, the map begins where the odometry did.
        start, goal = self._start or odom_from_base, self.navigator.goal
        self.navigator.reset(start, goal)
        self.safety.reset()
        self._log.began(start, goal, self._lidar, time.time_ns())
        self._epoch = stamp
        return stamp

    def _rebuild(self) -> None:
        """Build the stack for the lidar that the robot really has."""
        lidar = self.inputs.lidar
        assert lidar is not None
        goal, self._lidar = self.navigator.goal, lidar
        self.navigator = self._bundle.navigator(self._telemetry, lidar)
        self.navigator.head_for(goal)
        self.safety = self._safety_layer()

    def _sensed(self) -> tuple[Scan, Odometry] | None:
        """The latest readings, their times counted from the first scan; None while one is missing."""
        scan, odometry = self.inputs.scan, self.inputs.odometry
        if scan is None or odometry is None:
            return None
        if self._epoch is not None and self.inputs.lidar != self._lidar:  # tf_static came after the first scan
            self._start, self._epoch = self.navigator.map_from_base, None
        epoch = self._begin(scan.stamp, odometry.odom_from_base) if self._epoch is None else self._epoch
        return scan.scan(epoch), odometry.odometry(epoch)

    def _map_from_odom(self) -> Pose2:
        """The transform of odom into the map, by the odometry as the robot publishes it."""
        navigator, odometry = self.navigator, self.inputs.odometry
        assert odometry is not None
        assert navigator.percept is not None
        believed = navigator.slam.map_from_odom
        if believed is not None and navigator.percept.odom_from_base == odometry.odom_from_base:
            return believed
        return compose(navigator.map_from_base, inverse(odometry.odom_from_base))

    def _safety_layer(self) -> SafetyLayer:
        lidar = self._bundle.lidar if self.inputs.lidar is None else self.inputs.lidar
        # In lockstep both clocks are the simulator's, as under ``vuca run --monitor``.
        simulated = self._config.use_sim_time and not self._config.lockstep
        watchdogs = replace(DEFAULTS.watchdogs, simulated_clock=simulated)
        config = replace(DEFAULTS, rate=self._rate, odometry_rate=self._rate, watchdogs=watchdogs)
        body, share = self._bundle.body, self._config.speed
        if share < 1.0:
            limits = {name: share * getattr(body, name) for name in ("max_v_x", "min_v_x", "max_v_y", "max_w_z")}
            body = replace(body, **limits)
        return SafetyLayer(body, lidar, config)

    def _safety_tick(self, sensed: tuple[Scan, Odometry] | None) -> Tick:
        """What the safety layer knows at this tick."""
        inputs, has_goal = self.inputs, self.navigator.goal is not None
        scan, odometry = (None, None) if sensed is None else sensed
        if self._config.lockstep:  # there is no clock but that of the readings
            now = seconds(self._newest()) if odometry is None else odometry.stamp
            scanned = now if scan is None else scan.stamp
            return Tick(now, now, scan, scanned, odometry, now, has_goal=has_goal)
        return Tick(
            now=time.monotonic(),
            clock=seconds(self.now() - (self._epoch or 0)),
            scan=scan,
            scan_received=inputs.scan_received,
            odometry=odometry,
            odometry_received=inputs.odometry_received,
            has_goal=has_goal,
            publishers=self.outputs.publishers_of_commands,
        )

    def _newest(self) -> int:
        """Stamp of the newest reading [ns]; 0 before there is one."""
        inputs = self.inputs
        return max((0 if reading is None else reading.stamp) for reading in (inputs.scan, inputs.odometry))

    def _report_action(self) -> None:
        """Feedback of the action, and its end at the goal."""
        if not self._drives_action or not self.action.is_active:
            return
        self._goal_ticks += 1
        self._arrived_ticks = self._arrived_ticks + 1 if self.navigator.arrived else 0
        if self._arrived_ticks >= ARRIVED_TIME * self._rate:
            self._head_for(None, is_action=False)
            self.action.finish(Status.SUCCEEDED)
        elif self._goal_ticks % _FEEDBACK_TICKS == 1:
            left, elapsed = self._way_to_go(), self._goal_ticks / self._rate
            remaining = left / max(self._bundle.body.max_v_x, 1e-3)
            self.action.tell(Progress(self.navigator.map_from_base, elapsed, remaining, left), self.now())

    def _way_to_go(self) -> float:
        """Length of the plan, where it leads to the goal; else the distance to the goal [m]."""
        navigator = self.navigator
        if navigator.goal is None:
            return 0.0
        path, here = navigator.plan.path_in_map, navigator.map_from_base
        straight = distance(here, navigator.goal)
        if len(path) < 2 or math.dist(path[-1], navigator.goal) > 0.5:
            return straight
        nearest = int(np.argmin(np.hypot(path[:, 0] - here.x, path[:, 1] - here.y)))
        return max(straight, float(np.hypot(*np.diff(path[nearest:], axis=0).T).sum()))

    def _time(self, began: float) -> None:
        """Take the times of a tick, whose command is out."""
        now = time.monotonic()
        self._compute.append(now - began)
        if self.inputs.scan_received > self._said:
            self._latency.append(now - self.inputs.scan_received)
        if self._said > -math.inf:
            self._period.append(now - self._said)
        self._said = now

    def _loop_values(self) -> tuple[tuple[str, str], ...]:
        return (
            ("ticks", str(self._ticks)),
            ("last tick [ms]", f"{1e3 * self._compute[-1]:.2f}" if self._compute else ""),
            ("last period [ms]", f"{1e3 * self._period[-1]:.2f}" if self._period else ""),
            ("log", self._log.failure or "whole"),
        )


def _summary(times: deque[float]) -> tuple[float, float]:
    """Median and 99.9th percentile [s]."""
    if not times:
        return math.nan, math.nan
    low, high = np.percentile(np.array(times), [50.0, 99.9])
    return float(low), float(high)
