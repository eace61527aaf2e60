"""Messages with bytes changed, cut off or added: each is a reading, or refused; nothing else happens."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vuca_nav.deploy.messages import (
    Refused,
    header_message,
    lidar_of,
    odometry_of,
    pose_message,
    pose_of,
    scan_of,
    stamp_of,
    transform_message,
    vertical_of_imu,
)
from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transforms import StaticTransforms
from vuca_nav.deploy.transport.ros_types import BadMessage, decode, encode, new
from vuca_nav.types import LidarSpec, Pose2

FRAMES, NOW = Frames(), 5_000_000_007
POSE = pose_message(Pose2(1.0, 2.0, 0.3))


def scan() -> Any:
    return new(
        "sensor_msgs/msg/LaserScan",
        header=header_message(NOW, "laser"),
        angle_min=-1.5,
        angle_increment=0.1,
        range_min=0.1,
        range_max=9.0,
        ranges=np.linspace(0.5, 8.0, 31, dtype=np.float32),
    )


def odometry() -> Any:
    message = new("nav_msgs/msg/Odometry", header=header_message(NOW, "odom"), child_frame_id="base_link")
    message.pose.pose = POSE
    return message


def use_scan(message: Any) -> None:
    first = decode(encode(scan(), "sensor_msgs/msg/LaserScan"), "sensor_msgs/msg/LaserScan")
    lidar_of(message, LidarSpec())
    assert np.isfinite(scan_of(message, first).scan(0).stamp)


def use_odometry(message: Any) -> None:
    sensed = odometry_of(message, FRAMES).odometry(0)
    assert all(map(math.isfinite, (*sensed.odom_from_base, *sensed.twist, *sensed.up)))


def use_transforms(message: Any) -> None:
    static = StaticTransforms()
    static.add(message)
    mount = static.mount("base_link", "laser")
    assert mount is None or all(map(math.isfinite, mount.base_from_lidar))


def use_goal(message: Any) -> None:
    assert all(map(math.isfinite, pose_of(message.header, message.pose, "map")))


MESSAGES: dict[str, tuple[Any, Callable[[Any], object]]] = {
    "sensor_msgs/msg/LaserScan": (scan(), use_scan),
    "nav_msgs/msg/Odometry": (odometry(), use_odometry),
    "sensor_msgs/msg/Imu": (
        new("sensor_msgs/msg/Imu", header=header_message(NOW, "base_link"), orientation=POSE.orientation),
        lambda message: vertical_of_imu(message, FRAMES),
    ),
    "tf2_msgs/msg/TFMessage": (transform_message(Pose2(0.2, 0.0, 0.1), NOW, "base_link", "laser"), use_transforms),
    "geometry_msgs/msg/PoseStamped": (
        new("geometry_msgs/msg/PoseStamped", header=header_message(NOW, "map"), pose=POSE),
        use_goal,
    ),
    "rosgraph_msgs/msg/Clock": (
        new("rosgraph_msgs/msg/Clock", clock=header_message(NOW, "").stamp),
        lambda message: stamp_of(message.clock),
    ),
}


@pytest.mark.parametrize("type_name", list(MESSAGES))
def test_a_damaged_message_is_a_reading_or_refused(type_name: str) -> None:
    message, use = MESSAGES[type_name]
    whole = encode(message, type_name)
    use(decode(whole, type_name))
    rng, refused = np.random.default_rng(1), 0
    for _ in range(1500):
        data = bytearray(whole)
        kind = rng.integers(3)
        if kind == 0:  # bytes changed
            for position in rng.integers(0, len(data), rng.integers(1, 5)):
                data[position] = rng.integers(256)
        elif kind == 1:  # cut off
            del data[rng.integers(0, len(data)) :]
        else:  # a length or a number changed to an extreme
            position = 4 * int(rng.integers(0, len(data) // 4))
            data[position : position + 4] = rng.choice([b"\xff\xff\xff\xff", b"\x00\x00\xc0\x7f", b"\xff\xff\xff\x7f"])
        try:
            use(decode(bytes(data), type_name))
        except (BadMessage, Refused):
            refused += 1
    assert refused > 300
