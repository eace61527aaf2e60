"""Logs of missions for tests: a stack that drives by made-up scans, logged as ``vuca deploy`` does."""

from pathlib import Path

import numpy as np

from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.log import MissionLog
from vuca_nav.deploy.transport.ros_types import encode, new
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand
from vuca_nav.wire import NANOSECONDS

SCAN, ODOMETRY, COMMAND = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"
PERIOD = NANOSECONDS // 30


def scan_message(ranges: np.ndarray, stamp: int, lidar: LidarSpec):
    """A scan as sensor_msgs/LaserScan."""
    time = new("builtin_interfaces/msg/Time", sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)
    return new(
        SCAN,
        header=new("std_msgs/msg/Header", stamp=time, frame_id="laser"),
        angle_min=lidar.angle_min,
        angle_increment=lidar.pitch,
        range_min=lidar.min_range,
        range_max=lidar.max_range,
        ranges=ranges.astype(np.float32),
    )


def odometry_message(pose: Pose2, twist: Twist2, stamp: int):
    """Odometry as nav_msgs/Odometry."""
    time = new("builtin_interfaces/msg/Time", sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)
    message = new(ODOMETRY, header=new("std_msgs/msg/Header", stamp=time, frame_id="odom"), child_frame_id="base_link")
    message.pose.pose.position.x, message.pose.pose.position.y = pose.x, pose.y
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = np.sin(pose.yaw / 2), np.cos(pose.yaw / 2)
    message.twist.twist.linear.x, message.twist.twist.angular.z = twist.v_x, twist.w_z
    return message


def drive(bundle: Bundle, log: MissionLog, ticks: int, lidar: LidarSpec | None = None) -> list[VelocityCommand]:
    """Drive in a hall of 8 m by 6 m, with noise; a second goal halfway."""
    lidar = lidar or bundle.lidar
    navigator, rng = bundle.navigator(lidar=lidar), np.random.default_rng(0)
    pose, command, commands = Pose2(0.0, 0.0, 0.0), VelocityCommand(0.0, 0.0, 0.0), []
    navigator.reset(pose, (2.0, 0.5))
    log.began(pose, (2.0, 0.5), lidar, 0)
    for tick in range(ticks):
        now = NANOSECONDS + tick * PERIOD
        if tick == ticks // 2:
            navigator.head_for((-1.0, 1.0))
            log.heads_for((-1.0, 1.0), now)
        angles = lidar.angles_in_base() + pose.yaw
        with np.errstate(divide="ignore"):
            walls = [(4.0 - pose.x) / np.cos(angles), (-4.0 - pose.x) / np.cos(angles),
                     (3.0 - pose.y) / np.sin(angles), (-3.0 - pose.y) / np.sin(angles)]  # fmt: skip
        ranges = np.min([np.where(wall > 0.0, wall, np.inf) for wall in walls], axis=0)
        ranges = (ranges + 0.01 * rng.normal(size=lidar.num_beams)).astype(np.float32)
        twist = Twist2(*command)
        data = encode(scan_message(ranges, now, lidar), SCAN)
        number = log.received("/scan", SCAN, data, now)
        log.received("/odom", ODOMETRY, encode(odometry_message(pose, twist, now), ODOMETRY), now)
        scan, odometry = Scan(now / NANOSECONDS, ranges.astype(np.float64)), Odometry(now / NANOSECONDS, pose, twist)
        command = navigator.step(scan, odometry)
        log.ticked(scan, number, odometry, command, now + 1_000_000)
        sent = new(COMMAND)
        sent.linear.x, sent.angular.z = command.v_x, command.w_z
        log.sent("/cmd_vel", COMMAND, encode(sent, COMMAND), now + 2_000_000)
        commands.append(command)
        pose = Pose2(
            pose.x + command.v_x * np.cos(pose.yaw) / 30.0,
            pose.y + command.v_x * np.sin(pose.yaw) / 30.0,
            pose.yaw + command.w_z / 30.0,
        )
    return commands


def write_log(bundle: Bundle, path: Path, ticks: int = 90, lidar: LidarSpec | None = None) -> list[VelocityCommand]:
    """A whole log, and its commands."""
    with MissionLog(path, bundle.manifest) as log:
        return drive(bundle, log, ticks, lidar)
