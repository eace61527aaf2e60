"""A stack on the wire to which faults happen while it drives: when its body stands, and when it goes on."""

import signal
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from eval.bridge.faults.raw import KINDS, RawPublisher
from eval.bridge.faults.tamper import Tamper
from eval.bridge.remote_stack import TICK_RATE, RealTime, RemoteStack
from eval.bridge.robot_wire import Readings, RobotWire
from vuca_nav.deploy.safety.faults import FAULTS, ZERO_WITHIN
from vuca_nav.deploy.transport.interface import Publisher, Transport
from vuca_nav.geometry import distance, wrap_angle
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, BodySpec, Odometry, Pose2, Scan, VelocityCommand

FAULT_TIME = 1.0
"""How long a fault lasts that does not happen once [s]."""
ONCE = ("odometry_jump", "clock_back", "clock_ahead")
"""Faults that happen once. The stack goes on a healthy second after them."""
ONCE_TIME = 0.8
"""How long one that happens once is looked at before the stack may go on [s]."""
REST_WITHIN = 5.0
"""Time after which a body that does not rest is given up [s]."""
RESUMES_WITHIN = 6.0
"""Time after the end of a fault after which a stack that does not go on is given up [s]: a healthy second, the time of
tracks and plans, and of an obstacle in the way."""
DRIVES = 0.4
"""Share of the body's greatest speed from which on it drives: faults happen then."""
DRIVES_FOR = 1.0
"""Time for which it drives before [s]."""
IDLE = 25.0
"""Time without driving after which a mission is given up [s]."""
NOT_NEAR = 2.0
"""Distance from the goal below which no fault begins [m]: the mission would end in its middle."""
AT_REST, AT_REST_TURN = 0.05, 0.1
"""Mean speeds over a cycle of a gait below which a body rests [m/s, rad/s]: a legged one sways within it."""
_CYCLE = 12
"""Ticks of a cycle: Go2 trots at 2.5 Hz."""
_WINDOW = 3
"""Ticks over which the speed of a body that drives is measured."""


class MissionOver(Exception):
    """The mission has served its purpose: the next one is due."""


class Program(Protocol):
    """The deployed stack as a process."""

    def send(self, number: signal.Signals) -> None:
        """Send it a signal."""

    def check(self) -> None:
        """Raise an error if it does not run."""


class Means(NamedTuple):
    """What faults are made with."""

    program: Program
    """The deployed stack."""
    intrude: Callable[[], Transport]
    """Joins the network as another program."""
    forge: Callable[[str], RawPublisher]
    """Makes a publisher of bytes on the topic of scans, which announces a type."""


class TruePoses(Telemetry):
    """The robot's true poses at the last ticks."""

    def __init__(self) -> None:
        self.poses: deque[Pose2] = deque(maxlen=_CYCLE + 1)

    def true_pose(self, world_from_base: Pose2) -> None:
        """Remember a pose."""
        self.poses.append(world_from_base)

    def speeds(self, ticks: int = _WINDOW) -> tuple[float, float]:
        """Speed over ground and turn rate, means over the last ticks [m/s, rad/s]."""
        ticks = min(ticks, len(self.poses) - 1)
        if ticks < 1:
            return 0.0, 0.0
        first, last = self.poses[-1 - ticks], self.poses[-1]
        elapsed = ticks / TICK_RATE
        return distance(first, last) / elapsed, abs(wrap_angle(last.yaw - first.yaw)) / elapsed


class Trial(NamedTuple):
    """What became of a fault. Times are from its beginning [s]; None for what did not happen.

    Commands are timed by the wall clock, base and body by the simulated one, in which they live: they are the same as
    long as the simulator keeps its ticks.
    """

    fault: str
    kind: str
    """Kind of the messages, for those that are malformed."""
    speed: float
    """Speed of the body at the beginning [m/s]."""
    zero: float | None
    """When the zero command came, or the base timed out."""
    by_base: bool
    """Whether the base timed out first."""
    held: bool
    """Whether every command was zero from then to the end of the fault."""
    rest: float | None
    """When the body was at rest."""
    rest_within: float
    """By when it has to be: 0.2 s and its speed over its greatest deceleration. Its speed is the greatest one in the
    fault: a body answers its last commands with a delay."""
    resumed: float | None
    """Time from the end of the fault, or from the beginning of one that happens once, until a command to move again."""
    driving: float
    """Share of the ticks of the fault in which the command was not zero."""

    @property
    def stopped_in_time(self) -> bool:
        """Whether the command was zero in time, or did not have to be."""
        if FAULTS[self.fault].stopped_by == "nobody":
            return True
        return self.zero is not None and self.zero <= ZERO_WITHIN and self.held

    @property
    def rested_in_time(self) -> bool:
        """Whether the body was at rest in time, or did not have to be: what happens once may be over before."""
        if FAULTS[self.fault].stopped_by == "nobody":
            return True
        if self.fault in ONCE and self.rest is None:
            return self.resumed is not None
        return self.rest is not None and self.rest <= self.rest_within

    @property
    def went_on(self) -> bool:
        """Whether it went on afterwards, if it should."""
        return self.resumed is not None or not FAULTS[self.fault].resumes


@dataclass
class _Running:
    """A fault that goes on."""

    fault: str
    kind: str
    speed: float
    rest_within: float
    began: float
    """[s of the steady clock]"""
    zero: float | None = None
    by_base: bool = False
    held: bool = True
    rest: float | None = None
    ended: float | None = None
    resumed: float | None = None
    ticks: int = 0
    """Since its beginning."""
    fault_ticks: int = 0
    moving: int = 0
    """Ticks of the fault at which the command was not zero."""


def _leave(transport: Transport, _publisher: Publisher) -> None:
    """Leave the network; a publisher that nobody holds would have left it before."""
    transport.close()


class FaultyStack(RemoteStack):
    """The other side of the wire, to which faults happen.

    Args:
        wire: The robot's topics.
        pace: Real time, as faults are a matter of clocks.
        body: The robot.
        choose: Names the next fault; raises MissionOver if there is none.
        means: What faults are made with.
    """

    def __init__(self, wire: RobotWire, pace: RealTime, body: BodySpec, choose: Callable[[], str], means: Means):
        super().__init__(wire, pace)
        self.truth, self.trials = TruePoses(), list[Trial]()
        self._body, self._choose, self._means = body, choose, means
        self._real_time, self._tamper = pace, Tamper()
        self._running: _Running | None = None
        self._rng = np.random.default_rng(0)
        self._kinds = 0
        self._cleanup: Callable[[], Any] = lambda: None
        self._bad: tuple[RawPublisher, Callable[[np.random.Generator], bytes]] | None = None
        self._driving_ticks = self._idle_ticks = 0

    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Begin a mission, without a fault."""
        self.abandon()
        self._tamper.new_mission()
        self._driving_ticks = self._idle_ticks = 0
        super().reset(start, goal, prior_map)

    def publish(self, readings: Readings) -> None:
        """Publish what the fault makes of the readings."""
        super().publish(self._tamper(readings))
        if self._bad is not None:
            publisher, make = self._bad
            publisher.publish(make(self._rng))

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """One tick: begin, follow or end a fault.

        Raises:
            MissionOver: The next mission is due.
        """
        if self.fault != "process_killed":
            self._means.program.check()
        if self._running is None and self._is_time():
            self._begin_fault(self._choose())
        command = super().step(scan, odometry)
        if self._running is not None:
            self._follow(self._running, command)
        return command

    @property
    def fault(self) -> str | None:
        """Name of the fault that goes on or was the last; None if all is well."""
        return None if self._running is None else self._running.fault

    def abandon(self) -> None:
        """Leave out the fault that goes on, for the mission has ended."""
        if self._running is not None and self._running.ended is None:
            self._end_fault(self._running)
        self._running = None

    def _is_time(self) -> bool:
        """Whether the robot drives, and has for a while."""
        speed, _ = self.truth.speeds()
        drives = speed > DRIVES * self._body.max_v_x
        self._driving_ticks = self._driving_ticks + 1 if drives else 0
        self._idle_ticks = 0 if drives else self._idle_ticks + 1
        if self._idle_ticks > IDLE * TICK_RATE:
            raise MissionOver
        if distance(self.truth.poses[-1], self._goal) < NOT_NEAR:
            return False
        return self._driving_ticks > DRIVES_FOR * TICK_RATE

    def _begin_fault(self, fault: str) -> None:
        speed, turn = self.truth.speeds()
        body, kind = self._body, ""
        rest_within = ZERO_WITHIN + max(speed / body.max_a_x, turn / body.max_a_w)
        if fault in ("lidar_malformed", "lidar_beside"):
            kind = list(KINDS)[self._kinds % len(KINDS)]
            self._kinds += 1
            type_name, make = KINDS[kind]
            publisher = self._means.forge(type_name)
            self._cleanup = publisher.close
            self._bad = publisher, make
        elif fault == "second_publisher":
            other = self._means.intrude()
            publisher = other.advertise("cmd_vel", "geometry_msgs/msg/TwistStamped")
            self._cleanup = partial(_leave, other, publisher)
        elif fault == "process_paused":
            self._means.program.send(signal.SIGSTOP)
        elif fault == "process_killed":
            self._means.program.send(signal.SIGKILL)
        else:
            self._tamper.begin(fault)
        if fault == "lidar_malformed":
            self._tamper.begin(fault)
        self._driving_ticks = 0
        self._running = _Running(fault, kind, speed, rest_within, self.wire.clock())

    def _end_fault(self, running: _Running) -> None:
        running.ended = self.wire.clock()
        self._tamper.end()
        self._bad = None
        self._cleanup()
        self._cleanup = lambda: None
        if running.fault == "process_paused":
            self._means.program.send(signal.SIGCONT)

    def _follow(self, running: _Running, command: VelocityCommand) -> None:
        """Note what the stack and the body do."""
        is_zero = command == STOP
        running.ticks += 1
        self._note_body(running)
        if running.ended is None:
            self._note_command(running, is_zero)
            self._end_if_due(running)
            return
        after = self.wire.clock() - (running.began if running.fault in ONCE else running.ended)
        if not is_zero:
            running.resumed = after
        waits = FAULTS[running.fault].resumes and running.resumed is None and after < RESUMES_WITHIN
        if not waits:
            self._finish(running)

    def _end_if_due(self, running: _Running) -> None:
        """End the fault after its time, or when the body rests."""
        elapsed = self.wire.clock() - running.began
        if running.fault in ONCE:
            if elapsed >= ONCE_TIME:
                self._end_fault(running)
            return
        waits_for_rest = running.zero is not None and running.rest is None and elapsed < REST_WITHIN
        if elapsed >= FAULT_TIME and not waits_for_rest:
            self._end_fault(running)

    def _note_body(self, running: _Running) -> None:
        """Note the body's speed at the beginning of this tick."""
        if running.rest is not None:
            return
        body, (speed, turn) = self._body, self.truth.speeds()
        bound = ZERO_WITHIN + max(speed / body.max_a_x, turn / body.max_a_w)
        running.rest_within = max(running.rest_within, bound)
        if running.zero is not None:
            speed, turn = self.truth.speeds(_CYCLE)
            if speed < AT_REST and turn < AT_REST_TURN:  # a mean speed is that of the middle
                running.rest = max((running.ticks - 1 - 0.5 * _CYCLE) / TICK_RATE, running.zero)

    def _note_command(self, running: _Running, is_zero: bool) -> None:
        """Note the command at the end of this tick."""
        running.fault_ticks += 1
        running.moving += not is_zero
        if running.zero is not None:
            running.held &= is_zero
        elif is_zero:
            last, running.by_base = self._real_time.last, self._real_time.is_stale
            if running.by_base or last is None:
                running.zero = running.ticks / TICK_RATE
            else:
                running.zero = max(last.received - running.began, 0.0)

    def _finish(self, running: _Running) -> None:
        self.trials.append(
            Trial(
                running.fault, running.kind, running.speed, running.zero, running.by_base, running.held, running.rest,
                running.rest_within, running.resumed, running.moving / max(running.fault_ticks, 1),
            )
        )  # fmt: skip
        self._running = None
        if not FAULTS[running.fault].resumes or running.resumed is None:
            raise MissionOver
