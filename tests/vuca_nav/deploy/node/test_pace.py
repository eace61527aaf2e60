"""When a node in lockstep ticks, with a lidar slower than the ticks."""

import math
import time
from types import SimpleNamespace
from typing import Any, cast

import pytest

from vuca_nav.deploy.node.pace import Lockstep
from vuca_nav.types import LidarSpec
from vuca_nav.wire import tick_nanoseconds

RATE = 30


class Robot:
    """Inputs and transport of a simulator that sends odometry at each tick, and the scan after it where one is due.

    Scans are due as in ``robots.simulation``.
    """

    def __init__(self, lidar_rate, warm_up=0):
        self.lidar_rate, self.warm_up, self.tick = lidar_rate, warm_up, -1
        self.scan = self.odometry = None
        self.clock, self.odometry_received = 0, -math.inf

    def begin_tick(self):
        self.tick += 1
        self.odometry, self.odometry_received = SimpleNamespace(stamp=self.stamp()), time.monotonic()

    def stamp(self):
        return 1_000_000_000 + tick_nanoseconds(self.tick, RATE)

    def is_due(self):
        if self.tick <= self.warm_up:
            return True
        due = [math.floor((self.tick - self.warm_up - k) * self.lidar_rate / RATE + 1e-9) for k in (0, 1)]
        return due[0] != due[1]

    def send_scan(self):
        self.scan = SimpleNamespace(stamp=self.stamp())

    def take(self):
        pass

    def wait(self, timeout):
        time.sleep(min(timeout, 0.001))
        return True


def ticks_of(robot, count):
    """For each tick, whether its scan was there, and the waits that it took; scans come after a wait in vain."""
    pace = Lockstep(cast(Any, robot), cast(Any, robot), RATE, LidarSpec(rate=robot.lidar_rate))
    ticks = []
    for _ in range(count):
        robot.begin_tick()
        waits = 1
        if not pace.wait():
            if robot.is_due():
                robot.send_scan()
            while not pace.wait():
                waits += 1
        ticks.append((robot.scan.stamp == robot.stamp(), waits))
    return ticks


@pytest.mark.parametrize("lidar_rate", [5.0, 10.0, 12.0, 15.0])
def test_every_scan_is_waited_for_and_none_where_the_lidar_has_none(lidar_rate):
    robot = Robot(lidar_rate)
    ticks = ticks_of(robot, 60)
    robot.tick, due = -1, []
    for _ in ticks:
        robot.begin_tick()
        due.append(robot.is_due())
    assert [scanned for scanned, _ in ticks] == due
    second = due.index(True, 1)
    in_vain = [k for k, (_, waits) in enumerate(ticks) if waits > 5 and k > second]
    # At 12 Hz the scans are two and three ticks apart: two ticks after one, nobody can know.
    assert len(in_vain) == (11 if lidar_rate == 12.0 else 0)


def test_where_scans_came_at_every_tick_they_are_waited_for():
    """As while a stack is warmed up, and from a lidar that is faster than the bundle says."""
    assert all(scanned for scanned, _ in ticks_of(Robot(10.0, warm_up=20), 20))
