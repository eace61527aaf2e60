"""Readings of the simulator as ROS 2 messages, and commands and transforms back, each checked before it is believed.

``vuca_nav.deploy.messages`` is the other side: what the stack hears and says.
"""

import math
from typing import Any

import numpy as np

from vuca_nav.deploy.messages import header_message, pose_message, time_message, twist_message
from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transport.ros_types import message_type, new
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, VelocityCommand
from vuca_nav.wire import NANOSECONDS, quaternion_of, tilt_of

FASTEST = 1e3
"""Greatest velocity of a command that is believed [m/s, rad/s]: the body limits it, but a larger one is no command."""
FARTHEST = 1e6
"""Greatest coordinate of a transform that is believed [m]."""
_UNIT = 1e-3
"""Greatest error of a quaternion's length."""


def nanoseconds_of(stamp: Any) -> int:
    """Time of a builtin_interfaces/Time [ns], 0 for none."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def clock_message(stamp: int) -> Any:
    """The simulated time as rosgraph_msgs/Clock."""
    return _CLOCK(clock=time_message(stamp))


def scan_message(scan: Scan, stamp: int, lidar: LidarSpec, frames: Frames) -> Any:
    """A scan as sensor_msgs/LaserScan.

    Args:
        scan: The scan.
        stamp: When it was taken [ns].
        lidar: The lidar.
        frames: Names of the frames.
    """
    return _SCAN(
        header=header_message(stamp, frames.lidar),
        angle_min=lidar.angle_min,
        angle_max=lidar.angle_min + (lidar.num_beams - 1) * lidar.pitch,
        angle_increment=lidar.pitch,
        time_increment=0.0,  # all beams are cast at once
        scan_time=1.0 / lidar.rate,
        range_min=lidar.min_range,
        range_max=lidar.max_range,
        ranges=scan.ranges.astype(np.float32),
        intensities=np.zeros(0, np.float32),
    )


def odometry_message(odometry: Odometry, stamp: int, frames: Frames) -> Any:
    """Odometry as nav_msgs/Odometry; its orientation holds the body's tilt, too.

    Args:
        odometry: The odometry.
        stamp: When it was measured [ns].
        frames: Names of the frames.
    """
    message = new("nav_msgs/msg/Odometry", header=header_message(stamp, frames.odom), child_frame_id=frames.base)
    message.pose.pose = _pose(odometry)
    message.twist.twist = twist_message(VelocityCommand(*odometry.twist))
    return message


def imu_message(odometry: Odometry, stamp: int, frames: Frames) -> Any:
    """Attitude and turn rate as sensor_msgs/Imu; accelerations are not known (a covariance of -1).

    Args:
        odometry: Odometry that holds both.
        stamp: When they were measured [ns].
        frames: Names of the frames.
    """
    message = new("sensor_msgs/msg/Imu", header=header_message(stamp, frames.base))
    message.orientation = _pose(odometry).orientation
    message.angular_velocity.z = odometry.twist.w_z
    message.linear_acceleration_covariance[0] = -1.0
    return message


def odometry_transform(odometry: Odometry, stamp: int, frames: Frames) -> Any:
    """The transform of odom to base_link as tf2_msgs/TFMessage.

    Args:
        odometry: The odometry.
        stamp: When it was measured [ns].
        frames: Names of the frames.
    """
    return _transform(_pose(odometry), stamp, frames.odom, frames.base)


def mount_transform(lidar: LidarSpec, height: float, stamp: int, frames: Frames) -> Any:
    """The transform of base_link to the lidar as tf2_msgs/TFMessage.

    Args:
        lidar: The lidar, with its mount.
        height: Height of the lidar above base_link [m].
        stamp: The time [ns].
        frames: Names of the frames.
    """
    pose = pose_message(lidar.mount)
    pose.position.z = height
    return _transform(pose, stamp, frames.base, frames.lidar)


def initial_pose_message(pose: Pose2, stamp: int, frames: Frames) -> Any:
    """A robot's pose in the map, surely known, as geometry_msgs/PoseWithCovarianceStamped."""
    message = new("geometry_msgs/msg/PoseWithCovarianceStamped", header=header_message(stamp, frames.map))
    message.pose.pose = pose_message(pose)
    return message


def command_of(twist: Any) -> VelocityCommand | None:
    """The command of a geometry_msgs/Twist; None if it is not finite or larger than any command."""
    command = VelocityCommand(float(twist.linear.x), float(twist.linear.y), float(twist.angular.z))
    return command if all(abs(value) <= FASTEST for value in command) else None


def transform_of(message: Any, parent: str, child: str) -> tuple[int, Pose2] | None:
    """The stamp [ns] and the planar transform of a tf2_msgs/TFMessage between two frames; None if it holds none.

    A transform that is not finite, too far out, or whose rotation is no unit quaternion counts as none.

    Args:
        message: The message.
        parent: The frame that it leads to.
        child: The frame that it comes from.
    """
    for transform in message.transforms:
        if transform.header.frame_id.lstrip("/") != parent or transform.child_frame_id.lstrip("/") != child:
            continue
        place, turn = transform.transform.translation, transform.transform.rotation
        quaternion = turn.x, turn.y, turn.z, turn.w
        is_near = abs(place.x) <= FARTHEST and abs(place.y) <= FARTHEST
        if is_near and abs(math.hypot(*quaternion) - 1.0) <= _UNIT:
            x, y, z, w = quaternion
            yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            return nanoseconds_of(transform.header.stamp), Pose2(place.x, place.y, yaw)
    return None


def _pose(odometry: Odometry) -> Any:
    """The body's pose in odom, with its tilt."""
    x, y, yaw = odometry.odom_from_base
    pose = pose_message(Pose2(x, y, 0.0))
    turn = pose.orientation
    turn.x, turn.y, turn.z, turn.w = quaternion_of(*tilt_of(odometry.up), yaw)
    return pose


def _transform(pose: Any, stamp: int, parent: str, child: str) -> Any:
    stamped = new("geometry_msgs/msg/TransformStamped", header=header_message(stamp, parent), child_frame_id=child)
    move, place = stamped.transform.translation, pose.position
    move.x, move.y, move.z = place.x, place.y, place.z
    stamped.transform.rotation = pose.orientation
    return new("tf2_msgs/msg/TFMessage", transforms=[stamped])


_CLOCK = message_type("rosgraph_msgs/msg/Clock")
_SCAN = message_type("sensor_msgs/msg/LaserScan")
