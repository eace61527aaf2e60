"""What is out of the lidar's sight: unknown at first, known for a while after it was seen."""

import math

import numpy as np
import pytest

from tests.vuca_nav.rooms import REST, disc_body, ranges_to_boxes, room
from vuca_nav.geometry import compose
from vuca_nav.perception.perception import Perception
from vuca_nav.perception.seen_space import MEMORY, START_ROOM
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.shield.shield import Shield
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan, VelocityCommand

DT = 1.0 / 30.0
BODY = disc_body()
HALF = LidarSpec(num_beams=361, angle_min=-math.pi / 2.0, angle_increment=math.pi / 360, mount=Pose2(0.2, 0.0, 0.0))
BEHIND, AHEAD = 0, 180
"""Beams of the ring."""
HALL = room(20.0, 8.0)


class Drive:
    """A robot in a hall whose lidar looks ahead; odometry has no error."""

    def __init__(self):
        self.perception, self.tick = Perception(HALF, body=BODY, rate=30.0), 0
        self.start = self.pose = Pose2(6.0, 4.0, 0.0)
        self.odom = STANDING
        self.percept = None

    def step(self, v_x: float = 0.0, w_z: float = 0.0):
        """A tick at this velocity, then a look."""
        motion = Pose2(v_x * DT, 0.0, w_z * DT)
        self.pose, self.odom = compose(self.pose, motion), compose(self.odom, motion)
        x, y, _ = compose(self.pose, HALF.mount)
        scan = Scan(self.tick * DT, ranges_to_boxes(HALL, Pose2(x, y, self.pose.yaw), HALF))
        self.percept = self.perception.update(scan, Odometry(self.tick * DT, self.odom, REST))
        self.tick += 1
        return self.percept


def test_behind_a_robot_that_was_put_down_nothing_is_known_but_its_own_place():
    drive = Drive()
    ring = drive.step().ring
    assert 0.28 < ring[BEHIND] < 0.28 + START_ROOM + 0.2
    assert ring[AHEAD] == pytest.approx(14.0, abs=0.01) or ring[AHEAD] == np.inf
    side = round(0.5 * (AHEAD + BEHIND))
    assert ring[side + 20] < 7.0
    assert drive.percept is not None
    assert len(drive.percept.tracks) == 0  # the border of the unknown is nothing that may move


def test_a_wall_beside_the_body_that_is_out_of_sight_stays_where_it_was_seen():
    """The body goes along a wall and turns its blind side to it: 5 cm of room must not become free ground."""
    drive = Drive()
    drive.pose = drive.start = Pose2(6.0, 0.33, 0.0)  # the disc's edge is 5 cm from the wall at y = 0
    for _ in range(30):
        drive.step(v_x=1.0)
    for _ in range(45):
        ring = drive.step(w_z=math.pi / 3.0).ring
    # It looks away from the wall now, which lies behind.
    assert drive.pose.yaw == pytest.approx(math.pi / 2.0)
    assert ring[BEHIND] == pytest.approx(0.33, abs=0.06)


def test_what_it_has_passed_it_knows_until_it_forgets():
    drive = Drive()
    for _ in range(90):
        ring = drive.step(v_x=1.0).ring
    assert ring[BEHIND] == pytest.approx(3.0 + 0.28 + START_ROOM, abs=0.25)  # back to where it was put down
    for _ in range(round((MEMORY + 0.5) / DT)):
        ring = drive.step().ring
    assert 0.28 < ring[BEHIND] < 0.9
    # A turn shows it what is there.
    for _ in range(95):
        ring = drive.step(w_z=2.0).ring
    assert ring.min() > 1.0


def test_a_new_mission_knows_nothing_of_the_last_one():
    drive = Drive()
    for _ in range(90):
        drive.step(v_x=1.0)
    drive.perception.reset()
    drive.odom = STANDING
    assert drive.step().ring[BEHIND] < 0.9


class Stubborn(LocalPolicy):
    """Gives one command, whatever is there."""

    def __init__(self, wanted: VelocityCommand):
        self.wanted = wanted

    def reset(self) -> None:
        pass

    def command(self, percept, goal):
        return self.wanted


def test_the_shield_does_not_back_into_what_was_never_seen():
    drive, backwards = Drive(), VelocityCommand(-0.2, 0.0, 0.0)
    shield = Shield(BODY, HALF, Stubborn(backwards))
    command = VelocityCommand(0.0, 0.0, 0.0)
    for _ in range(300):
        command = shield.command(drive.step(command.v_x, command.w_z), LocalGoal((-5.0, 0.0), False))
    assert drive.start.x - drive.pose.x < START_ROOM + 0.05
    # It backs where it has been.
    ahead = Drive()
    for _ in range(60):
        ahead.step(v_x=1.0)
    shield, turned_at = Shield(BODY, HALF, Stubborn(backwards)), ahead.pose.x
    command = VelocityCommand(0.0, 0.0, 0.0)
    for _ in range(150):
        command = shield.command(ahead.step(command.v_x), LocalGoal((-5.0, 0.0), False))
    assert turned_at - ahead.pose.x > 0.7


def test_the_dynamic_window_turns_to_a_goal_behind_it():
    drive, window = Drive(), DynamicWindow(BODY, HALF)
    goal = (3.0, 4.0)
    command = VelocityCommand(0.0, 0.0, 0.0)
    for _ in range(600):
        percept = drive.step(command.v_x, command.w_z)
        dx, dy = goal[0] - drive.pose.x, goal[1] - drive.pose.y
        c, s = math.cos(drive.pose.yaw), math.sin(drive.pose.yaw)
        if math.hypot(dx, dy) < 0.05:
            break  # a stack would stand from here on
        command = window.command(percept, LocalGoal((c * dx + s * dy, c * dy - s * dx), True))
    assert math.dist(drive.pose[:2], goal) < 0.05
