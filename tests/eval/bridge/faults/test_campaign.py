import signal
from typing import Any

import numpy as np
import pytest

from eval.bridge.faults.campaign import RESUMES_WITHIN, FaultyStack, Means, MissionOver
from eval.bridge.remote_stack import RealTime
from eval.bridge.robot_wire import RobotWire
from robots.registry import make_body
from tests.eval.bridge.other_side import OtherSide
from tests.vuca_nav.deploy.loopback import Network
from vuca_nav.types import STOP, Odometry, Pose2, Scan, Twist2, VelocityCommand

FORWARD = VelocityCommand(0.8, 0.0, 0.0)
TICK = 1.0 / 30.0
BRAKES = 1.0
"""Deceleration of the body [m/s^2]: TIAGo's."""


class Ticks(RealTime):
    """Real time without a wall clock: a tick is a tick."""

    def command(self, wire: Any, stamp, is_new_scan):
        wire.now += TICK
        for command in wire.take():
            self.last = command
        self.is_stale = self.last is None or wire.now - self.last.received > 0.2 - TICK + 1e-9
        return STOP if self.last is None or self.is_stale else self.last.velocity


class Robot:
    """A point that drives in a hall, behind a wire, and a stack that drives it as long as it gets scans."""

    def __init__(self, fault, reacts=0.1, brakes=BRAKES):
        self.network = Network()
        self.other = OtherSide(self.network, self.decide)
        self.reacts, self.brakes = reacts, brakes
        self.signals: list[signal.Signals] = []
        self.is_paused = False
        wire: Any = RobotWire(self.network.join(), make_body("tiago"), clock=lambda: wire.now)
        wire.now = 0.0
        self.wire = wire
        means = Means(self, self.network.join, self.forge)
        self.stack = FaultyStack(wire, Ticks(), make_body("tiago").spec, lambda: fault, means)
        self.x = self.speed = 0.0
        self.heard, self.heard_at = None, 0.0

    def send(self, number):
        self.signals.append(number)
        self.is_paused = number in (signal.SIGSTOP, signal.SIGKILL)
        self.other.decide = None if self.is_paused else self.decide

    def check(self):
        pass

    def forge(self, type_name) -> Any:
        class Forged:
            publish = staticmethod(lambda data: None)
            close = staticmethod(lambda: None)

        return Forged

    def decide(self, scan, odometry):
        return FORWARD

    def watchdog(self):
        """Zero commands while no scan has come for a while, as the safety layer of a deployed stack."""
        heard = self.other.heard[-1][0] if self.other.heard else None
        if heard != self.heard:
            self.heard, self.heard_at = heard, self.wire.now
        elif self.wire.now - self.heard_at > self.reacts and not self.is_paused:
            self.other.send(STOP, 5)

    def drive(self, seconds) -> Any:
        self.stack.reset(Pose2(0.0, 0.0, 0.0), (100.0, 0.0))
        for tick in range(round(seconds / TICK)):
            self.stack.truth.true_pose(Pose2(self.x, 0.0, 0.0))
            scan = Scan(tick * TICK, np.full(360, 5.0))
            self.watchdog()
            command = self.stack.step(
                scan, Odometry(tick * TICK, Pose2(self.x, 0.0, 0.0), Twist2(self.speed, 0.0, 0.0))
            )
            change = np.clip(command.v_x - self.speed, -self.brakes * TICK, 1.0 * TICK)
            self.speed += float(change)
            self.x += self.speed * TICK
            if self.stack.trials:
                return self.stack.trials[0]
        return None


def test_a_silent_lidar_is_measured_from_the_fault_to_zero_to_rest_and_to_going_on():
    trial: Any = Robot("lidar_silent").drive(20.0)
    assert trial.speed > 0.4
    assert trial.zero == pytest.approx(0.1, abs=2.5 * TICK)
    assert not trial.by_base
    assert trial.rest == pytest.approx(trial.zero + (trial.speed - 0.05) / BRAKES, abs=3 * TICK)
    assert (trial.held, trial.stopped_in_time, trial.rested_in_time, trial.went_on) == (True, True, True, True)
    assert trial.resumed is not None
    assert trial.resumed < 3 * TICK


def test_a_zero_command_that_comes_late_is_told():
    trial = Robot("lidar_silent", reacts=0.25).drive(20.0)
    assert trial.zero > 0.2 or trial.by_base
    assert not (trial.stopped_in_time and not trial.by_base)


def test_a_body_that_brakes_worse_than_it_says_is_told():
    trial = Robot("lidar_silent", brakes=0.3).drive(30.0)
    assert trial.rest > trial.rest_within
    assert not trial.rested_in_time


def test_a_program_that_is_paused_is_stopped_by_the_base_and_goes_on():
    robot = Robot("process_paused")
    trial = robot.drive(20.0)
    assert robot.signals == [signal.SIGSTOP, signal.SIGCONT]
    assert trial.by_base
    assert trial.zero == pytest.approx(0.2, abs=TICK)
    assert trial.held
    assert trial.went_on


def test_a_program_that_is_killed_ends_the_mission():
    robot = Robot("process_killed")
    with pytest.raises(MissionOver):
        robot.drive(20.0)
    (trial,) = robot.stack.trials
    assert robot.signals == [signal.SIGKILL]
    assert (trial.by_base, trial.resumed, trial.went_on) == (True, None, True)


def test_bad_messages_beside_good_ones_need_not_stop_it():
    trial = Robot("lidar_beside").drive(20.0)
    assert (trial.zero, trial.driving, trial.kind) == (None, 1.0, "truncated")
    assert (trial.stopped_in_time, trial.rested_in_time) == (True, True)


def test_a_stack_that_does_not_go_on_ends_the_mission():
    robot = Robot("lidar_silent")
    watchdog = robot.watchdog

    def latching():
        watchdog()
        if robot.stack.fault is not None:
            robot.other.decide = lambda *_: STOP

    robot.watchdog = latching
    with pytest.raises(MissionOver):
        robot.drive(20.0 + RESUMES_WITHIN)
    assert robot.stack.trials[0].resumed is None
    assert not robot.stack.trials[0].went_on


def test_a_robot_that_does_not_drive_is_given_up():
    robot = Robot("lidar_silent")
    robot.other.decide = lambda *_: STOP
    with pytest.raises(MissionOver):
        robot.drive(40.0)
