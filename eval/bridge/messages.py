"""Readings of the simulator as ROS 2 messages, and commands and transforms back, each checked before it is believed."""

import math
from typing import Any

import numpy as np

from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transport.ros_types import message_type, new
from vuca_nav.geometry import wrap_angle
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, VelocityCommand
from vuca_nav.wire import NANOSECONDS, quaternion_of, tilt_of, yaw_of

FASTEST = 1e3
"""Greatest velocity of a command that is believed [m/s, rad/s]: the body limits it, but a larger one is no command."""
FARTHEST = 1e6
"""Greatest coordinate of a transform that is believed [m]."""
_UNIT = 1e-3
"""Greatest error of a quaternion's length."""


def time_of(nanoseconds: int) -> Any:
    """A stamp as builtin_interfaces/Time."""
    return _TIME(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def nanoseconds_of(stamp: Any) -> int:
    """Time of a builtin_interfaces/Time [ns]."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def clock_message(stamp: int) -> Any:
    """The simulated time as rosgraph_msgs/Clock."""
    return _CLOCK(clock=time_of(stamp))


def scan_message(scan: Scan, stamp: int, lidar: LidarSpec, frames: Frames) -> Any:
    """A scan as sensor_msgs/LaserScan.

    Args:
        scan: The scan.
        stamp: When it was taken [ns].
        lidar: The lidar.
        frames: Names of the frames.
    """
    return _SCAN(
        header=header(stamp, frames.lidar),
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
    message = new("nav_msgs/msg/Odometry", header=header(stamp, frames.odom), child_frame_id=frames.base)
    message.pose.pose = _pose(odometry)
    message.twist.twist = twist_message(odometry.twist)
    return message


def imu_message(odometry: Odometry, stamp: int, frames: Frames) -> Any:
    """Attitude and turn rate as sensor_msgs/Imu; accelerations are not known (a covariance of -1).

    Args:
        odometry: Odometry that holds both.
        stamp: When they were measured [ns].
        frames: Names of the frames.
    """
    message = new("sensor_msgs/msg/Imu", header=header(stamp, frames.base))
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
    pose = _pose(odometry)
    return _transform(header(stamp, frames.odom), frames.base, pose.position, pose.orientation)


def mount_transform(lidar: LidarSpec, height: float, stamp: int, frames: Frames) -> Any:
    """The transform of base_link to the lidar as tf2_msgs/TFMessage.

    Args:
        lidar: The lidar, with its mount.
        height: Height of the lidar above base_link [m].
        stamp: The time [ns].
        frames: Names of the frames.
    """
    place = _POINT(x=lidar.mount.x, y=lidar.mount.y, z=height)
    return _transform(header(stamp, frames.base), frames.lidar, place, _quaternion(0.0, 0.0, lidar.mount.yaw))


def pose_message(pose: Pose2, stamp: int, frames: Frames) -> Any:
    """A pose in the map as geometry_msgs/PoseStamped."""
    return new("geometry_msgs/msg/PoseStamped", header=header(stamp, frames.map), pose=_planar(pose))


def initial_pose_message(pose: Pose2, stamp: int, frames: Frames) -> Any:
    """A robot's pose in the map, surely known, as geometry_msgs/PoseWithCovarianceStamped."""
    message = new("geometry_msgs/msg/PoseWithCovarianceStamped", header=header(stamp, frames.map))
    message.pose.pose = _planar(pose)
    return message


def map_message(grid: OccupancyGrid, stamp: int, frames: Frames) -> Any:
    """A map as nav_msgs/OccupancyGrid: 100 where something stands, 0 where nothing does, -1 where nobody knows.

    Args:
        grid: The map.
        stamp: The time [ns].
        frames: Names of the frames.
    """
    message = new("nav_msgs/msg/OccupancyGrid", header=header(stamp, frames.map))
    rows, columns = grid.level.shape
    message.info.resolution, message.info.width, message.info.height = grid.resolution, columns, rows
    message.info.origin = _planar(Pose2(*grid.origin, 0.0))
    message.data = np.where(grid.level > 0, 100, np.where(grid.level < 0, 0, -1)).astype(np.int8).ravel()
    return message


def twist_message(velocity: tuple[float, float, float]) -> Any:
    """A planar velocity as geometry_msgs/Twist."""
    v_x, v_y, w_z = velocity
    return _TWIST(linear=_VECTOR(x=v_x, y=v_y, z=0.0), angular=_VECTOR(x=0.0, y=0.0, z=w_z))


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
            return nanoseconds_of(transform.header.stamp), Pose2(place.x, place.y, yaw_of(quaternion))
    return None


def header(stamp: int, frame: str) -> Any:
    """A std_msgs/Header.

    Args:
        stamp: The time [ns].
        frame: The frame.
    """
    return _HEADER(stamp=time_of(stamp), frame_id=frame)


def _pose(odometry: Odometry) -> Any:
    x, y, yaw = odometry.odom_from_base
    return _POSE(position=_POINT(x=x, y=y, z=0.0), orientation=_quaternion(*tilt_of(odometry.up), yaw))


def _planar(pose: Pose2) -> Any:
    return _POSE(position=_POINT(x=pose.x, y=pose.y, z=0.0), orientation=_quaternion(0.0, 0.0, wrap_angle(pose.yaw)))


def _quaternion(roll: float, pitch: float, yaw: float) -> Any:
    x, y, z, w = quaternion_of(roll, pitch, yaw)
    return _QUATERNION(x=x, y=y, z=z, w=w)


def _transform(header: Any, child: str, place: Any, turn: Any) -> Any:
    transform = new("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child)
    transform.transform.translation = _VECTOR(x=place.x, y=place.y, z=place.z)
    transform.transform.rotation = turn
    return new("tf2_msgs/msg/TFMessage", transforms=[transform])


_TIME = message_type("builtin_interfaces/msg/Time")
_CLOCK = message_type("rosgraph_msgs/msg/Clock")
_HEADER = message_type("std_msgs/msg/Header")
_SCAN = message_type("sensor_msgs/msg/LaserScan")
_TWIST = message_type("geometry_msgs/msg/Twist")
_VECTOR = message_type("geometry_msgs/msg/Vector3")
_POINT = message_type("geometry_msgs/msg/Point")
_POSE = message_type("geometry_msgs/msg/Pose")
_QUATERNION = message_type("geometry_msgs/msg/Quaternion")
