import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.bridge.messages import (
    command_of,
    imu_message,
    mount_transform,
    nanoseconds_of,
    odometry_message,
    odometry_transform,
    scan_message,
    transform_of,
)
from vuca_nav.deploy.messages import time_message, twist_message
from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transport.ros_types import decode, encode
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand
from vuca_nav.wire import round_odometry, round_scan, up_of, yaw_of

FRAMES = Frames()
FINITE = st.floats(-1e3, 1e3)


def crossed(message):
    """The message as it is received."""
    name = message.__msgtype__
    return decode(encode(message, name), name)


def orientation(pose):
    turn = pose.orientation
    return turn.x, turn.y, turn.z, turn.w


@settings(deadline=None)  # the first message of a type compiles its code
@given(x=FINITE, y=FINITE, yaw=st.floats(-math.pi, math.pi), v=FINITE, w=FINITE, lean=st.floats(-0.5, 0.5))
def test_odometry_comes_back_to_the_bit(x, y, yaw, v, w, lean):
    up = -math.sin(lean), math.cos(lean) * math.sin(0.1), math.cos(lean) * math.cos(0.1)
    sent = round_odometry(Odometry(0.0, Pose2(x, y, yaw), Twist2(v, -v, w), up))
    message = crossed(odometry_message(sent, 1_000_000_033, FRAMES))
    pose, twist = message.pose.pose, message.twist.twist
    assert (pose.position.x, pose.position.y, yaw_of(orientation(pose))) == sent.odom_from_base
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == sent.twist
    assert up_of(orientation(pose)) == sent.up
    imu = crossed(imu_message(sent, 5, FRAMES))
    turn = imu.orientation
    assert up_of((turn.x, turn.y, turn.z, turn.w)) == sent.up
    assert nanoseconds_of(message.header.stamp) == 1_000_000_033
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    found = transform_of(crossed(odometry_transform(sent, 7, FRAMES)), "odom", "base_link")
    assert found == (7, pytest.approx(sent.odom_from_base, rel=1e-12, abs=1e-12))


def test_a_scan_comes_back_to_the_bit_and_says_where_its_beams_are():
    lidar = LidarSpec(num_beams=5, angle_min=-1.0, angle_increment=0.5, rate=10.0, min_range=0.05, max_range=8.0)
    sent = round_scan(Scan(0.0, np.array([0.1, 1.0 / 3.0, math.inf, 7.9, math.nan])))
    message = crossed(scan_message(sent, 42, lidar, FRAMES))
    assert message.ranges.astype(np.float64).tobytes() == sent.ranges.tobytes()
    figures = message.angle_min, message.angle_increment, message.angle_max, message.range_min, message.range_max
    assert figures == pytest.approx((-1.0, 0.5, 1.0, 0.05, 8.0))
    assert (message.scan_time, message.header.frame_id) == (pytest.approx(0.1), "laser")


@pytest.mark.parametrize("stamp", [0, 1, 999_999_999, 1_000_000_000, 2**31 * 1_000_000_000 - 1])
def test_stamps_come_back(stamp):
    assert nanoseconds_of(time_message(stamp)) == stamp


@settings(deadline=None)
@given(command=st.tuples(FINITE, FINITE, FINITE))
def test_a_command_comes_back_to_the_bit(command):
    assert command_of(crossed(twist_message(VelocityCommand(*command)))) == command


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 1e4])
@pytest.mark.parametrize("place", range(3))
def test_a_command_that_is_none_is_refused_whole(wrong, place):
    command = [0.1, 0.2, 0.3]
    command[place] = wrong
    assert command_of(crossed(twist_message(VelocityCommand(*command)))) is None


def test_the_lidars_mount_is_a_transform_of_base_link():
    lidar = replace(LidarSpec(), mount=Pose2(0.2, -0.1, math.pi / 2.0))
    message = crossed(mount_transform(lidar, 0.3, 0, FRAMES))
    assert transform_of(message, "base_link", "laser") == (0, pytest.approx((0.2, -0.1, math.pi / 2.0)))
    assert message.transforms[0].transform.translation.z == 0.3
    assert transform_of(message, "map", "odom") is None


@pytest.mark.parametrize(
    ("field", "value"),
    [("translation.x", math.nan), ("translation.y", math.nan), ("rotation.w", math.nan), ("rotation.w", 2.0)],
)
def test_a_transform_that_is_none_is_not_believed(field, value):
    message = odometry_transform(Odometry(0.0, Pose2(1.0, 2.0, 0.0), Twist2(0.0, 0.0, 0.0)), 0, FRAMES)
    assert transform_of(message, "odom", "base_link") is not None
    part, name = field.split(".")
    setattr(getattr(message.transforms[0].transform, part), name, value)
    assert transform_of(message, "odom", "base_link") is None
