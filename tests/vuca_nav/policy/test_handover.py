from dataclasses import replace

import numpy as np

from tests.vuca_nav.rooms import LIDAR, Sensors, disc_body, ranges_to_boxes, room
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.planning.planner import Plan
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.handover import Handover
from vuca_nav.types import STANDING, Odometry, Pose2, Scan, Twist2, VelocityCommand

WIDE = LocalGoal((3.0, 0.0), is_final=False)
NARROW = WIDE._replace(is_narrow=True)
TURN = VelocityCommand(0.1, 0.0, 0.5)


class Turning(LocalPolicy):
    """Turns, whatever it sees."""

    def reset(self) -> None:
        pass

    def command(self, percept, goal):
        return TURN


class Asked(Turning):
    """Remembers what it is asked."""

    goals: list[LocalGoal | None]

    def command(self, percept, goal):
        self.goals.append(goal)
        return TURN


def test_the_window_drives_in_narrow_ways_and_goes_on_from_the_other_policys_command():
    boxes, start = room(10.0, 6.0), Pose2(3.0, 3.0, 0.0)
    percept = Sensors().see(ranges_to_boxes(boxes, start), STANDING, Twist2(0.0, 0.0, 0.0))
    policy, window = Handover(Turning(), DynamicWindow(disc_body(), LIDAR)), DynamicWindow(disc_body(), LIDAR)
    assert policy.command(percept, WIDE) == TURN
    window.follow(TURN)
    narrow = policy.command(percept, NARROW)
    assert narrow == window.command(percept, NARROW) != TURN
    policy.reset()
    assert policy.command(percept, NARROW) == DynamicWindow(disc_body(), LIDAR).command(percept, NARROW)


def test_the_window_that_knows_nothing_of_movers_does_not_drive_beside_one():
    boxes, start = room(10.0, 6.0), Pose2(3.0, 3.0, 0.0)
    percept = Sensors().see(ranges_to_boxes(boxes, start), STANDING, Twist2(0.0, 0.0, 0.0))
    for away, drives in ((1.5, "network"), (4.0, "window")):
        policy = Handover(Turning(), DynamicWindow(disc_body(), LIDAR))
        command = policy.command(replace(percept, unexplained=np.array([[0.0, away, 0.3]])), NARROW)
        assert (command == TURN) == (drives == "network")


def goals_on_the_way_through(width: float) -> list[LocalGoal]:
    """What the policy is asked in a room 1.5 m before a door of this width, in seconds of standing there."""
    side = 0.5 * (6.0 - width)
    walls = np.array([[6.0, 0.0, 6.15, side], [6.0, 6.0 - side, 6.15, 6.0]])
    boxes, start = np.vstack([room(12.0, 6.0), walls]), Pose2(4.5, 3.0, 0.0)
    policy = Asked()
    policy.goals = []
    navigator = Navigator(disc_body(), LIDAR, policy, NavigatorConfig())
    navigator.reset(start, (9.0, 3.0))
    ranges = ranges_to_boxes(boxes, start)
    for tick in range(90):
        navigator.step(Scan(tick / 30.0, ranges), Odometry(tick / 30.0, STANDING, Twist2(0.0, 0.0, 0.0)))
    return [goal for goal in policy.goals if goal is not None]


def test_the_way_is_narrow_before_a_door_and_not_in_the_open():
    assert goals_on_the_way_through(0.8)[-1].is_narrow
    assert not goals_on_the_way_through(1.6)[-1].is_narrow


def test_a_plan_counts_as_narrow_about_the_robot_alone():
    path = np.column_stack([np.arange(10.0), np.zeros(10)])
    plan = Plan(path, (9.0, 0.0), clearances=np.where(path[:, 0] == 6.0, 0.3, 1.0))
    assert [plan.narrowest((x, 0.0), 2.0) for x in (0.0, 4.0, 8.0, 9.0)] == [1.0, 0.3, 0.3, 1.0]
    assert replace(plan, clearances=np.empty(0)).narrowest((6.0, 0.0), 2.0) == np.inf
