import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.vuca_nav.rooms import LIDAR, NOTHING, Sensors, disc_body, ranges_to_boxes, room
from vuca_nav.geometry import compose, distance
from vuca_nav.policy.base import LocalGoal
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.types import STANDING, STOP, Pose2, Twist2

DT = 1.0 / 30.0


def drive(boxes, start: Pose2, goal: tuple[float, float], seconds: float, is_final: bool = True, at_sides: float = 9.0):
    """A body that follows its commands exactly; the poses (n, 3), the commands (n, 3) and the least range."""
    body = disc_body()
    policy, sensors = DynamicWindow(body, LIDAR), Sensors()
    policy.reset()
    pose, command, motion = start, STOP, STANDING
    poses, commands, least = [], [], math.inf
    for _ in range(round(seconds / DT)):
        ranges = ranges_to_boxes(boxes, pose)
        least = min(least, float(ranges.min()))
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        dx, dy = goal[0] - pose.x, goal[1] - pose.y
        waypoint = (c * dx + s * dy, -s * dx + c * dy)
        command = policy.command(
            sensors.see(ranges, motion, Twist2(*command)), LocalGoal(waypoint, is_final, room=at_sides)
        )
        motion = Pose2(command.v_x * DT, 0.0, command.w_z * DT)
        pose = compose(pose, motion)
        poses.append(pose)
        commands.append(command)
        if distance(pose, goal) < 0.1:
            break
    return np.array(poses), np.array(commands), least


def test_on_open_floor_it_goes_straight_at_full_speed():
    poses, commands, _ = drive(room(30.0, 10.0), Pose2(2.0, 5.0, 0.0), (25.0, 5.0), 40.0)
    assert np.abs(poses[:, 1] - 5.0).max() < 0.05
    assert commands[:, 0].max() == pytest.approx(1.0)
    assert len(poses) * DT < 27.0
    assert distance(tuple(poses[-1, :2]), (25.0, 5.0)) < 0.1


def test_it_does_not_brake_for_a_waypoint_that_it_passes():
    _, commands, _ = drive(room(30.0, 10.0), Pose2(2.0, 5.0, 0.0), (6.0, 5.0), 20.0, is_final=False)
    assert commands[-1, 0] == pytest.approx(1.0)


def ticks_through_a_door(room_at_the_sides: float) -> int:
    """Through a door 0.18 m wider than the body, at 0.3 m/s at most, straight on."""
    side = 4.0 - 0.28 - 0.09
    boxes = np.vstack([room(12.0, 8.0), [[6.0, 0.0, 6.15, side], [6.0, 8.0 - side, 6.15, 8.0]]])
    policy, sensors, pose = DynamicWindow(disc_body(), LIDAR), Sensors(), Pose2(4.5, 4.0, 0.0)
    command, motion = STOP, STANDING
    for tick in range(round(20.0 / DT)):
        goal = LocalGoal((8.0 - pose.x, 0.0), is_final=False, room=room_at_the_sides)
        command = policy.command(sensors.see(ranges_to_boxes(boxes, pose), motion, Twist2(*command)), goal)
        motion = Pose2(min(command.v_x, 0.3) * DT, 0.0, 0.0)
        pose = compose(pose, motion)
        if pose.x > 6.5:
            return tick
    return round(20.0 / DT)


def test_what_room_a_way_has_is_comfortable():
    """It does not hesitate before a door of which it knows that the way has no more room: 0.3 m/s, and a fifth more."""
    assert ticks_through_a_door(0.09) < 1.2 * 2.0 / 0.3 / DT


def test_it_turns_round_for_a_goal_behind():
    poses, _, least = drive(room(10.0, 10.0), Pose2(5.0, 5.0, 0.0), (1.5, 5.0), 30.0)
    assert distance(tuple(poses[-1, :2]), (1.5, 5.0)) < 0.1
    assert least > 0.28


def test_it_rounds_a_pillar_without_touching_it():
    boxes = np.vstack([room(12.0, 8.0), [[5.7, 3.4, 6.3, 4.0]]])
    poses, _, least = drive(boxes, Pose2(2.0, 4.0, 0.0), (10.0, 4.0), 40.0)
    assert distance(tuple(poses[-1, :2]), (10.0, 4.0)) < 0.1
    assert least > 0.28


def test_it_drives_up_to_a_goal_that_is_nearer_to_a_wall_than_is_comfortable():
    poses, _, least = drive(room(12.0, 8.0), Pose2(2.0, 4.0, 0.0), (11.6, 4.0), 30.0, at_sides=0.12)
    assert distance(tuple(poses[-1, :2]), (11.6, 4.0)) < 0.1
    assert least > 0.28


def test_it_stops_before_a_wall_that_the_waypoint_lies_behind():
    boxes = np.vstack([room(12.0, 8.0), [[6.0, -0.1, 6.3, 8.1]]])
    poses, _, least = drive(boxes, Pose2(2.0, 4.0, 0.0), (10.0, 4.0), 20.0, is_final=False)
    assert least > 0.28
    assert poses[:, 0].max() > 4.0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
@example(194)  # a corner between two places of a fast trajectory
def test_among_random_pillars_it_never_touches_anything(seed):
    rng = np.random.default_rng(seed)
    centres = rng.uniform((2.5, 0.5), (9.5, 7.5), (8, 2))
    boxes = np.vstack([room(12.0, 8.0), np.hstack([centres - 0.2, centres + 0.2])])
    _, commands, least = drive(boxes, Pose2(1.0, 4.0, rng.uniform(-3, 3)), (11.0, 4.0), 12.0)
    assert least > 0.28
    body = disc_body()
    assert commands[:, 0].max() <= body.max_v_x + 1e-12
    assert np.abs(commands[:, 2]).max() <= body.max_w_z + 1e-12


def test_an_empty_scan_is_open_floor():
    policy, sensors = DynamicWindow(disc_body(), LIDAR), Sensors()
    policy.reset()
    command = STOP
    for _ in range(30):
        command = policy.command(sensors.see(NOTHING), LocalGoal((5.0, 0.0), False))
    assert command.v_x == pytest.approx(1.0)


def at_full_speed() -> tuple[DynamicWindow, Sensors]:
    policy, sensors = DynamicWindow(disc_body(), LIDAR), Sensors()
    for _ in range(60):
        command = policy.command(sensors.see(NOTHING), LocalGoal((5.0, 0.0), False))
    assert command == (1.0, 0.0, 0.0)  # pyright: ignore[reportPossiblyUnboundVariable]
    return policy, sensors


@pytest.mark.parametrize(
    "broken",
    [
        {"ranges": np.full(360, np.nan)},
        {"ranges": np.where(np.arange(360) < 200, np.nan, 3.0)},
        {"twist": Twist2(0.0, 0.0, math.nan)},
        {"motion": Pose2(math.nan, 0.0, 0.0)},
    ],
)
def test_it_stands_while_its_sensors_are_broken(broken):
    policy, sensors = at_full_speed()
    assert policy.command(sensors.see(**{"ranges": NOTHING, **broken}), LocalGoal((5.0, 0.0), False)) == STOP


@pytest.mark.parametrize("reason", ["no goal", "broken sensors"])
def test_its_window_lies_about_a_stand_afterwards(reason):
    policy, sensors = at_full_speed()
    if reason == "no goal":
        command = policy.command(sensors.see(NOTHING), None)
    else:
        command = policy.command(sensors.see(np.full(360, np.nan)), LocalGoal((5.0, 0.0), False))
    assert command == STOP
    again = policy.command(sensors.see(NOTHING), LocalGoal((5.0, 0.0), False))
    assert again.v_x == pytest.approx(0.3)  # what a window of 0.3 s allows of 1 m/s^2
    policy.reset()
    assert policy.command(sensors.see(NOTHING), LocalGoal((5.0, 0.0), False)) == again
