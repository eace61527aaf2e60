"""The dynamic window under a body that is longer than wide, and under one that answers late."""

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, NOTHING, Sensors, ranges_to_boxes, room
from vuca_nav.geometry import between, compose, distance
from vuca_nav.policy.base import LocalGoal
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.types import STANDING, STOP, BodySpec, Pose2, Twist2

DT = 1.0 / 30.0
OUTLINE = np.array([[-0.38, -0.19], [0.38, -0.19], [0.38, 0.19], [-0.38, 0.19]])
LONG = BodySpec("long", OUTLINE, 1.2, -0.6, 0.4, 1.2, 2.0, 2.0, 5.0)
_SHARES = np.linspace(0.0, 1.0, 40, endpoint=False)[:, None]
EDGE = np.vstack([a + _SHARES * (b - a) for a, b in zip(OUTLINE, np.roll(OUTLINE, -1, axis=0), strict=True)])


def clearance(boxes: np.ndarray, pose: Pose2) -> float:
    """Of the outline's edge to the nearest box [m], 0 inside of one."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    points = EDGE @ np.array([[c, s], [-s, c]]) + pose[:2]
    beyond = np.maximum(np.maximum(boxes[:, :2] - points[:, None], points[:, None] - boxes[:, 2:]), 0.0)
    return float(np.hypot(beyond[..., 0], beyond[..., 1]).min())


def drive(
    boxes: np.ndarray, start: Pose2, goal: tuple[float, float], seconds: float, believed: BodySpec, delay: float = 0.0
):
    """A body of ``LONG``'s limits that answers ``delay`` late: poses (n, 3), least clearance, least distance to go."""
    policy, sensors = DynamicWindow(believed, LIDAR), Sensors()
    pending = deque([STOP] * round(delay / DT))
    pose, asked, motion, rng = start, STOP, STANDING, np.random.default_rng(0)
    poses, least, to_go = [], math.inf, math.inf
    for _ in range(round(seconds / DT)):
        ranges = ranges_to_boxes(boxes, pose) + rng.normal(0.0, 0.02, LIDAR.num_beams)
        waypoint = between(pose, Pose2(*goal, 0.0))[:2]
        command = policy.command(sensors.see(ranges, motion, Twist2(*asked)), LocalGoal(waypoint, False))
        limits = np.array([LONG.max_a_x, LONG.max_a_y, LONG.max_a_w]) * DT
        pending.append(type(STOP)(*(asked + np.clip(np.subtract(command, asked), -limits, limits)).tolist()))
        asked = pending[-1]
        motion = Pose2(*(np.array(pending.popleft()) * DT).tolist())
        pose = compose(pose, motion)
        poses.append(pose)
        least, to_go = min(least, clearance(boxes, pose)), min(to_go, distance(pose, goal))
        if to_go < 0.3:
            break
    return np.array(poses), least, to_go


@pytest.mark.parametrize("goal", [(3.5, 4.0), (3.0, 4.0), (1.0, 3.0)])
@pytest.mark.parametrize("room_beside", [0.06, 0.12])
def test_from_beside_a_wall_where_it_cannot_turn_it_gets_out_without_touching(goal, room_beside):
    """Parallel to a wall, another one ahead: turning on the spot would sweep its corners into them."""
    boxes = np.vstack([room(8.0, 6.0), [[3.5, -0.1, 4.0, 1.5]]])
    _, least, to_go = drive(boxes, Pose2(3.0, 0.19 + room_beside, 0.0), goal, 20.0, LONG)
    assert least > 0.02
    assert to_go < 0.3


def test_it_stands_rather_than_turn_where_it_is_shut_in():
    """0.08 m of room on either side, 0.12 m before and behind: less than any turn takes."""
    pose = Pose2(4.0, 3.0, 0.0)
    inner = np.array([3.5, 2.73, 4.5, 3.27])
    x0, y0, x1, y1 = inner
    boxes = np.array(
        [[x0 - 1, y0 - 1, x1 + 1, y0], [x0 - 1, y1, x1 + 1, y1 + 1], [x0 - 1, y0, x0, y1], [x1, y0, x1 + 1, y1]]
    )
    _, least, _ = drive(boxes, pose, (4.0, 6.0), 15.0, LONG)
    assert least > 0.05


def command_at_full_speed(body: BodySpec, to_wall: float) -> float:
    """[m/s], for the first scan in which a wall is straight ahead [m]."""
    policy, sensors = DynamicWindow(body, LIDAR), Sensors()
    commands = [policy.command(sensors.see(NOTHING), LocalGoal((6.0, 0.0), False)) for _ in range(60)]
    assert commands[-1] == (1.2, 0.0, 0.0)
    wall = np.array([[to_wall, -8.0, to_wall + 0.2, 8.0]])
    percept = sensors.see(ranges_to_boxes(wall, STANDING))
    return policy.command(percept, LocalGoal((to_wall + 0.1, 0.0), False)).v_x


@pytest.mark.parametrize("to_wall", [0.8, 0.9, 1.1, 1.4, 1.7, 2.0])
def test_a_late_body_decides_as_a_prompt_one_that_is_already_where_it_will_be(to_wall):
    """At 1.2 m/s a delay of 1/6 s is 0.2 m of way: its command is the other's, seen from 0.2 m farther away."""
    late = command_at_full_speed(replace(LONG, delay=1.0 / 6.0), to_wall + 0.2)
    assert late == pytest.approx(command_at_full_speed(LONG, to_wall), abs=0.08)  # 0.075 between two of the window


@pytest.mark.parametrize("to_wall", [0.8, 0.9, 1.0])
def test_a_late_body_brakes_harder_than_a_prompt_one(to_wall):
    prompt = command_at_full_speed(LONG, to_wall)
    assert 0.6 < prompt < 1.2
    assert command_at_full_speed(replace(LONG, delay=1.0 / 6.0), to_wall) < prompt - 0.2
