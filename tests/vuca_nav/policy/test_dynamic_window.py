import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from tests.vuca_nav.rooms import LIDAR, disc_body, ranges_to_boxes, room
from vuca_nav.geometry import compose, distance
from vuca_nav.perception.distance_field import cover_by_discs, distance_field
from vuca_nav.policy.base import LocalObservation
from vuca_nav.policy.dynamic_window import DynamicWindow, DynamicWindowConfig
from vuca_nav.types import Pose2, Scan, Twist2, VelocityCommand

DT = 1.0 / 30.0


def drive(boxes, start: Pose2, goal: tuple[float, float], seconds: float, is_final: bool = True):
    """A body that follows its commands exactly; the poses (n, 3), the commands (n, 3) and the least range."""
    body = disc_body()
    policy = DynamicWindow(body, LIDAR)
    policy.reset()
    pose, command = start, VelocityCommand(0.0, 0.0, 0.0)
    poses, commands, least = [], [], math.inf
    for k in range(round(seconds / DT)):
        ranges = ranges_to_boxes(boxes, pose)
        least = min(least, float(ranges.min()))
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        dx, dy = goal[0] - pose.x, goal[1] - pose.y
        waypoint = (c * dx + s * dy, -s * dx + c * dy)
        command = policy.command(LocalObservation(Scan(k * DT, ranges), waypoint, is_final, Twist2(*command)))
        pose = compose(pose, Pose2(command.v_x * DT, 0.0, command.w_z * DT))
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


def test_it_turns_round_for_a_goal_behind():
    poses, _, least = drive(room(10.0, 10.0), Pose2(5.0, 5.0, 0.0), (1.5, 5.0), 30.0)
    assert distance(tuple(poses[-1, :2]), (1.5, 5.0)) < 0.1
    assert least > 0.28


def test_it_rounds_a_pillar_without_touching_it():
    boxes = np.vstack([room(12.0, 8.0), [[5.7, 3.4, 6.3, 4.0]]])
    poses, _, least = drive(boxes, Pose2(2.0, 4.0, 0.0), (10.0, 4.0), 40.0)
    assert distance(tuple(poses[-1, :2]), (10.0, 4.0)) < 0.1
    assert least > 0.28


def test_it_stops_before_a_wall_that_the_waypoint_lies_behind():
    boxes = np.vstack([room(12.0, 8.0), [[6.0, -0.1, 6.3, 8.1]]])
    poses, _, least = drive(boxes, Pose2(2.0, 4.0, 0.0), (10.0, 4.0), 20.0, is_final=False)
    assert least > 0.28
    assert poses[:, 0].max() > 4.0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
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
    policy = DynamicWindow(disc_body(), LIDAR)
    policy.reset()
    nothing = Scan(0.0, np.full(360, np.inf))
    for _ in range(30):
        command = policy.command(LocalObservation(nothing, (5.0, 0.0), False, Twist2(0.0, 0.0, 0.0)))
    assert command.v_x == pytest.approx(1.0)  # pyright: ignore[reportPossiblyUnboundVariable]


def test_distance_field_is_close_to_the_euclidean_distance():
    config = DynamicWindowConfig()
    cells = 2 * round(config.reach / config.resolution)
    field = np.zeros((cells, cells), np.int16)
    angles = LIDAR.angles_in_base()
    beams = np.column_stack([np.cos(angles), np.sin(angles)])
    ranges = ranges_to_boxes(room(4.0, 3.0), Pose2(1.7, 1.1, 0.3))
    distance_field(ranges, beams, config.resolution, config.reach, field)
    exact = np.asarray(distance_transform_edt(field != 0))
    inner = slice(1, -1)
    assert np.abs(field[inner, inner] / 5.0 - exact[inner, inner]).max() < 0.08 * exact.max()


@given(st.floats(0.2, 1.0), st.floats(0.2, 1.0))
def test_discs_cover_the_footprint(length, width):
    outline = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2.0
    discs = cover_by_discs(outline)
    rng = np.random.default_rng(0)
    inside = rng.uniform(-0.5, 0.5, (500, 2)) * (length, width)
    away = np.hypot(inside[:, None, 0] - discs[:, 0], inside[:, None, 1] - discs[:, 1])
    if length >= 0.7 * width:
        assert (away <= discs[:, 2] + 1e-9).any(axis=1).all()


def test_a_round_body_is_one_disc():
    np.testing.assert_allclose(cover_by_discs(disc_body(0.3).footprint), [[0.0, 0.0, 0.3]])
