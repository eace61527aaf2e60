"""A stack in another process, behind a robot's ROS 2 topics, as a ``Stack``: the loop of an episode is the same.

In lockstep the simulation waits for the command that answers each scan. In real time it goes on by the wall clock with
the last command that came, and with none that is too old.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass

from eval.bridge.robot_wire import Command, Readings, RobotWire
from vuca_nav.checks import check_positive
from vuca_nav.errors import VucaError
from vuca_nav.geometry import compose
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.stack import Stack
from vuca_nav.types import STOP, Odometry, Pose2, Scan, VelocityCommand
from vuca_nav.wire import NANOSECONDS, nanoseconds

COMMAND_TIMEOUT = 0.2
"""Age beyond which the base carries out no command, and stops [s of the simulation]: what a real base has to do."""
FIRST_STAMP = NANOSECONDS
"""Simulated time at which the clock begins [ns]: to ROS a stamp of zero means none."""
BETWEEN_MISSIONS = NANOSECONDS
"""Time by which the clock goes on from the end of a mission to the beginning of the next [ns]."""
TICK_RATE = 30.0
"""Rate of the simulation's ticks [Hz]."""
_POSE_PATIENCE = 5.0
"""Time for which a stack's estimate is waited for in lockstep after its first command [s]."""
_KEPT_LATENCIES = 100_000
"""Number of the last latencies that are kept: an hour's."""


class StackSilent(VucaError):
    """The stack on the other side of the wire does not answer."""


@dataclass(frozen=True, slots=True)
class PaceConfig:
    """How the simulation's time goes on."""

    lockstep: bool = False
    """Wait for the command that answers each scan, however long it takes."""
    factor: float = 1.0
    """Simulated time over wall time, in real time."""
    timeout: float = 30.0
    """Longest wait for a command in lockstep, and for a stack to be there at all [s of the wall clock]."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a factor or a time-out that is not positive."""
        check_positive(self, "factor", "timeout")


class Pace(ABC):
    """How the simulation waits for its commands."""

    @abstractmethod
    def begin(self) -> None:
        """Begin a mission."""

    @abstractmethod
    def command(self, wire: RobotWire, stamp: int, is_new_scan: bool) -> VelocityCommand:
        """The command that the base carries out from now on.

        Args:
            wire: The robot's topics, on which the readings of this time have just been published.
            stamp: The time [ns].
            is_new_scan: Whether there was a scan among them.
        """


class Lockstep(Pace):
    """Waits for the command whose stamp is that of the readings.

    Args:
        timeout: Longest wait [s].
    """

    def __init__(self, timeout: float):
        self._timeout = timeout
        self.begin()

    def begin(self) -> None:
        """Take the stack to tell its estimate at every tick, until it does not."""
        self._pose_patience = min(_POSE_PATIENCE, self._timeout)

    def command(self, wire: RobotWire, stamp: int, is_new_scan: bool) -> VelocityCommand:
        """The command of this stamp.

        Raises:
            StackSilent: If none comes in time.
        """
        deadline = time.monotonic() + self._timeout
        last = 0
        while True:
            for command in wire.take():
                last = command.stamp
                if command.stamp == stamp:
                    self._wait_for_pose(wire, stamp)
                    return command.velocity
            left = deadline - time.monotonic()
            if left <= 0.0:
                got = f"the last had {last / NANOSECONDS:.9f} s" if last else "none came"
                raise StackSilent(
                    f"no command on cmd_vel with the stamp {stamp / NANOSECONDS:.9f} s in {self._timeout:g} s ({got}): "
                    "in lockstep the stack answers the readings of each time by a TwistStamped with their stamp, as "
                    "vuca deploy --lockstep does"
                )
            wire.wait(left)

    def _wait_for_pose(self, wire: RobotWire, stamp: int) -> None:
        """Wait for the transform of map to odom of this stamp, which the stack may publish after its command."""
        deadline = time.monotonic() + self._pose_patience
        while wire.map_from_odom is None or wire.map_from_odom[0] != stamp:
            left = deadline - time.monotonic()
            if left <= 0.0:
                self._pose_patience = 0.0
                return
            wire.wait(left)
            wire.take()
        self._pose_patience = self._timeout  # it is one that does


class RealTime(Pace):
    """Goes on by the wall clock, with the last command that came; a late tick delays all that follow.

    Args:
        factor: Simulated time over wall time.

    Attributes:
        latencies: Times from a scan's publication to that of the command that answers it [s].
        periods: Times between the publications of two commands in a row, the stack's own period [s].
        overruns: Ticks that ended late by more than a quarter of a period: the simulator's own fault.
        stale: Number of ticks at which the base stopped because the last command was too old.
        last: The last command that has come in this mission; None before.
        is_stale: Whether the base stopped so at the last tick, or no command has come yet.
    """

    def __init__(self, factor: float = 1.0):
        self._period = 1.0 / (TICK_RATE * factor)
        self._oldest = COMMAND_TIMEOUT / factor - self._period  # it is carried out for another period
        self.latencies: deque[float] = deque(maxlen=_KEPT_LATENCIES)
        self.periods: deque[float] = deque(maxlen=_KEPT_LATENCIES)
        self.stale = self.overruns = 0
        self.begin()

    def begin(self) -> None:
        """Forget the last command."""
        self.last: Command | None = None
        self._unanswered: deque[tuple[int, int]] = deque(maxlen=_KEPT_LATENCIES)
        self._deadline: float | None = None
        self.is_stale = True

    def command(self, wire: RobotWire, stamp: int, is_new_scan: bool) -> VelocityCommand:
        """The last command at the end of this tick."""
        published = wire.clock()
        before = self._deadline
        self._deadline = published + self._period if before is None else max(before + self._period, published)
        if is_new_scan:
            self._unanswered.append((stamp, wire.scan_sent))
        while True:
            for command in wire.take():
                self._time(command)
                self.last = command
            left = self._deadline - wire.clock()
            if left <= 0.0:
                break
            wire.wait(left)
        now = wire.clock()
        self.overruns += now - self._deadline > 0.25 * self._period
        self.is_stale = self.last is None or now - self.last.received > self._oldest
        if self.last is None or self.is_stale:
            self.stale += self.last is not None
            return STOP
        return self.last.velocity

    def _time(self, command: Command) -> None:
        """Take the times of a command, which answers the scans up to its stamp, or all if it has none."""
        if self.last is not None:
            self.periods.append((command.sent - self.last.sent) / NANOSECONDS)
        while self._unanswered:
            stamp, sent = self._unanswered[0]
            if sent > command.sent or 0 < command.stamp < stamp:
                return
            self.latencies.append((command.sent - sent) / NANOSECONDS)
            self._unanswered.popleft()


class RemoteStack(Stack):
    """The stack on the other side of a robot's topics.

    Its estimate of the pose is the transform of map to odom that it publishes, over the odometry; as long as it has
    published none, the map is where the odometry began.

    Args:
        wire: The robot's topics.
        pace: How the simulation waits for commands.
        warm_up: Simulated time before each mission in which the robot stands, its first readings come again and again
            and there is no goal: a stack that needs them to start has them [s].
    """

    def __init__(self, wire: RobotWire, pace: Pace, warm_up: float = 0.0):
        self.wire, self.pace = wire, pace
        self._warm_up = round(warm_up * TICK_RATE)
        self._begins = self._now = self._clock_began = FIRST_STAMP
        self._scan_stamp = -1
        self._goal = (0.0, 0.0)
        self._start = self.map_from_base = Pose2(0.0, 0.0, 0.0)

    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Begin a mission: the clock goes on, the odometry begins anew at the start, and the goal is published.

        Args:
            start: The robot's pose in the map.
            goal: Goal in the map [m].
            prior_map: A map known beforehand, published on ``map``.
        """
        self._begins = self._now = self._now + BETWEEN_MISSIONS if self._scan_stamp >= 0 else FIRST_STAMP
        self._clock_began = self._begins
        self._start, self._goal, self._scan_stamp = start, goal, -1
        self._is_begun = False
        self.wire.map_from_odom = None
        self.wire.tell_time(self._begins)
        if prior_map is not None:
            self.wire.publish_map(prior_map, self._begins)

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """Publish the readings, and wait for the command as the pace has it."""
        if not self._is_begun:
            self._begin(scan, odometry)
        stamp, scan_stamp = self._stamp(odometry.stamp), self._stamp(scan.stamp)
        is_new = scan_stamp != self._scan_stamp
        self._scan_stamp, self._now = scan_stamp, stamp
        self.publish(Readings(scan if is_new else None, odometry, scan_stamp, stamp, stamp))
        command = self.pace.command(self.wire, stamp, is_new)
        self.map_from_base = self._estimate(odometry)
        return command

    def publish(self, readings: Readings) -> None:
        """Publish the time and the readings of a tick."""
        self.wire.tell_time(readings.clock)
        self.wire.sense(readings)

    def _begin(self, scan: Scan, odometry: Odometry) -> None:
        """Place the robot, warm the stack up, and give it the goal."""
        self.wire.place(self._start, self._begins)
        self.pace.begin()
        for tick in range(self._warm_up):
            stamp = self._begins + round(tick / TICK_RATE * NANOSECONDS)
            self.publish(Readings(scan, odometry, stamp, stamp, stamp))
            self.pace.command(self.wire, stamp, True)
        self._begins += round(self._warm_up / TICK_RATE * NANOSECONDS)
        self.wire.send_goal(self._goal, self._begins)
        self._is_begun = True

    def _stamp(self, time: float) -> int:
        """Stamp of a time of the mission [ns]."""
        return self._begins + nanoseconds(time)

    def _estimate(self, odometry: Odometry) -> Pose2:
        found = self.wire.map_from_odom
        map_from_odom = self._start
        if found is not None and found[0] >= self._clock_began:  # else of the mission before, and taken only now
            map_from_odom = found[1]
        return compose(map_from_odom, odometry.odom_from_base)
