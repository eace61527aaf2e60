"""What the stack hears as its own values, and what it says as messages. Nothing that comes is believed unchecked.

A message with one wrong part is refused whole. The reasons are fixed sentences, without values of the message.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transport.ros_types import message_type, new
from vuca_nav.errors import BadArgument, VucaError
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.perception.readings import FARTHEST, FASTEST, FASTEST_TURN
from vuca_nav.perception.tracks import HAS_LEFT, RADIUS, V_X, V_Y, X, Y
from vuca_nav.types import MOST_BEAMS, FloatArray, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand
from vuca_nav.wire import NANOSECONDS, Quaternion, quaternion_of, seconds, up_of, yaw_of

_UNIT = 1e-2
"""Greatest error of a quaternion's length: drivers of single precision stay a thousand times below."""
_SAME_ANGLE = 1e-4
"""Greatest difference of a scan's angles from those of its first scan: single precision at pi has 2e-7 [rad]."""
MOST_MAP_CELLS = 1 << 22
"""Greatest number of cells of a published map; a larger one is published with a coarser resolution."""
_MOST_PATH_POSES = 1000
_TRACK_HEIGHT = 1.7
"""Height at which a track is drawn, a person's [m]."""
_TRACK_LIFETIME = 0.3
"""Time after which a track that is not repeated vanishes from the drawing [s]."""


class Refused(VucaError):
    """A message that is not believed."""


class SensedScan(NamedTuple):
    """A scan with its stamp in whole nanoseconds."""

    stamp: int
    """[ns]"""
    ranges: FloatArray
    """(num_beams,) [m]"""

    def scan(self, epoch: int) -> Scan:
        """The scan, its time counted from an epoch [ns]."""
        return Scan(seconds(self.stamp - epoch), self.ranges)


class SensedOdometry(NamedTuple):
    """Odometry with its stamp in whole nanoseconds."""

    stamp: int
    """[ns]"""
    odom_from_base: Pose2
    twist: Twist2
    up: tuple[float, float, float]

    def odometry(self, epoch: int) -> Odometry:
        """The odometry, its time counted from an epoch [ns]."""
        return Odometry(seconds(self.stamp - epoch), self.odom_from_base, self.twist, self.up)


# -- what comes in ------------------------------------------------------------------------------------------------


def stamp_of(stamp: Any, *, may_be_zero: bool = False) -> int:
    """Time of a builtin_interfaces/Time [ns].

    Raises:
        Refused: If it is none, or zero, which is no time to ROS.
    """
    if stamp.sec < 0 or stamp.nanosec >= NANOSECONDS:
        raise Refused("the stamp is no time")
    time = stamp.sec * NANOSECONDS + stamp.nanosec
    if time == 0 and not may_be_zero:
        raise Refused("it has no stamp")
    return time


def lidar_of(message: Any, lidar: LidarSpec, mount: Pose2 | None = None, *, is_inverted: bool = False) -> LidarSpec:
    """The lidar that a sensor_msgs/LaserScan is of.

    Args:
        message: The scan.
        lidar: The lidar that is expected, which is returned if the scan can be its.
        mount: Pose of the lidar in base_link, if it is known better than by ``lidar``.
        is_inverted: Whether the lidar hangs upside down: its angles then count clockwise.

    Raises:
        Refused: If the scan is of no lidar.
    """
    sign = -1.0 if is_inverted else 1.0
    number, first, pitch = len(message.ranges), sign * message.angle_min, sign * message.angle_increment
    if not 1 < number <= MOST_BEAMS:
        raise Refused(f"it does not have 2 to {MOST_BEAMS} ranges")
    if not all(map(math.isfinite, (first, pitch, message.range_min, message.range_max, message.scan_time))):
        raise Refused("an angle or a limit of the ranges is not finite")
    mount = lidar.mount if mount is None else mount
    is_expected = (
        number == lidar.num_beams
        and abs(first - lidar.angle_min) < _SAME_ANGLE
        and abs(pitch - lidar.pitch) * number < _SAME_ANGLE
        and math.isclose(message.range_min, lidar.min_range, rel_tol=1e-6)
        and math.isclose(message.range_max, lidar.max_range, rel_tol=1e-6)
        and all(math.isclose(a, b, abs_tol=1e-6) for a, b in zip(mount, lidar.mount))
    )
    if is_expected:
        return lidar
    try:
        return LidarSpec(
            num_beams=number,
            min_range=float(message.range_min),
            max_range=float(message.range_max),
            rate=lidar.rate,
            height=lidar.height,
            angle_min=float(first),
            angle_increment=float(pitch),
            mount=mount,
        )
    except BadArgument as error:
        raise Refused("its angles or limits are no lidar's") from error


def scan_of(message: Any, first: Any) -> SensedScan:
    """The scan of a sensor_msgs/LaserScan.

    Args:
        message: The scan.
        first: The first scan that was accepted: a lidar stays as it is.

    Raises:
        Refused: If it is of another lidar than the first.
    """
    stamp = stamp_of(message.header.stamp)
    if message.header.frame_id != first.header.frame_id:
        raise Refused("its frame is not that of the first scan")
    number = len(first.ranges)
    if len(message.ranges) != number:
        raise Refused("it has another number of ranges than the first scan")
    if not (
        abs(message.angle_min - first.angle_min) < _SAME_ANGLE
        and abs(message.angle_increment - first.angle_increment) * number < _SAME_ANGLE
        and message.range_min == first.range_min
        and message.range_max == first.range_max
    ):
        raise Refused("its angles or limits are not those of the first scan")
    return SensedScan(stamp, message.ranges.astype(np.float64))


def odometry_of(message: Any, frames: Frames, up: tuple[float, float, float] | None = None) -> SensedOdometry:
    """The odometry of a nav_msgs/Odometry.

    Args:
        message: The odometry.
        frames: Names of the frames.
        up: The vertical in base_link, if something shows it better than the message's own orientation.

    Raises:
        Refused: If it is of other frames, or a number is none.
    """
    stamp = stamp_of(message.header.stamp)
    _check_frame(message.header.frame_id, frames.odom)
    if message.child_frame_id.lstrip("/") != frames.base:
        raise Refused("its child frame is not that of the robot's base")
    place, orientation = message.pose.pose.position, _quaternion_of(message.pose.pose.orientation)
    _check_place(place)
    linear, turn = message.twist.twist.linear, message.twist.twist.angular
    if not (abs(linear.x) < FASTEST and abs(linear.y) < FASTEST and abs(turn.z) < FASTEST_TURN):
        raise Refused("a velocity is not finite, or no body's")
    return SensedOdometry(
        stamp,
        Pose2(place.x, place.y, yaw_of(orientation)),
        Twist2(linear.x, linear.y, turn.z),
        up_of(orientation) if up is None else up,
    )


def vertical_of_imu(message: Any, frames: Frames) -> tuple[float, float, float]:
    """The vertical in base_link that a sensor_msgs/Imu shows.

    Raises:
        Refused: If it has no orientation, or is not in base_link.
    """
    stamp_of(message.header.stamp)
    _check_frame(message.header.frame_id, frames.base)
    if message.orientation_covariance[0] == -1.0:
        raise Refused("it has no orientation")
    return up_of(_quaternion_of(message.orientation))


def pose_of(header: Any, pose: Any, frame: str) -> Pose2:
    """The planar pose of a geometry_msgs/Pose, a goal's or an initial one.

    Args:
        header: Its header.
        pose: The pose.
        frame: The frame that it must be in.

    Raises:
        Refused: If it is in another frame, or a number is none.
    """
    _check_frame(header.frame_id, frame)
    _check_place(pose.position)
    quaternion = pose.orientation
    if (quaternion.x, quaternion.y, quaternion.z, quaternion.w) == (0.0, 0.0, 0.0, 0.0):
        raise Refused("a quaternion is zero")
    return Pose2(pose.position.x, pose.position.y, yaw_of(_quaternion_of(quaternion)))


def _check_frame(given: str, expected: str) -> None:
    if given.lstrip("/") != expected:
        raise Refused(f"its frame is not {expected}")


def _check_place(place: Any) -> None:
    if not (abs(place.x) < FARTHEST and abs(place.y) < FARTHEST and abs(place.z) < FARTHEST):
        raise Refused("a position is not finite, or too far out")


def _quaternion_of(message: Any) -> Quaternion:
    quaternion = message.x, message.y, message.z, message.w
    length = math.sqrt(sum(part * part for part in quaternion))
    if not abs(length - 1.0) < _UNIT:
        raise Refused("a quaternion is no rotation")
    return quaternion


# -- what goes out ------------------------------------------------------------------------------------------------


def time_message(nanoseconds: int) -> Any:
    """A builtin_interfaces/Time."""
    return _TIME(sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def duration_message(time: float) -> Any:
    """A builtin_interfaces/Duration of a time that is not negative [s]."""
    whole = round(max(time, 0.0) * NANOSECONDS)
    return new("builtin_interfaces/msg/Duration", sec=whole // NANOSECONDS, nanosec=whole % NANOSECONDS)


def header_message(stamp: int, frame: str) -> Any:
    """A std_msgs/Header.

    Args:
        stamp: The time [ns].
        frame: The frame.
    """
    return _HEADER(stamp=time_message(stamp), frame_id=frame)


def twist_message(command: VelocityCommand) -> Any:
    """A command as geometry_msgs/Twist."""
    return _TWIST(linear=_VECTOR(x=command.v_x, y=command.v_y, z=0.0), angular=_VECTOR(x=0.0, y=0.0, z=command.w_z))


def twist_stamped_message(command: VelocityCommand, stamp: int, frames: Frames) -> Any:
    """A command as geometry_msgs/TwistStamped.

    Args:
        command: The command.
        stamp: Stamp of the readings that it answers [ns].
        frames: Names of the frames.
    """
    return _TWIST_STAMPED(header=header_message(stamp, frames.base), twist=twist_message(command))


def pose_message(pose: Pose2) -> Any:
    """A planar pose as geometry_msgs/Pose."""
    x, y, z, w = quaternion_of(0.0, 0.0, pose.yaw)
    return _POSE(position=_POINT(x=pose.x, y=pose.y, z=0.0), orientation=_QUATERNION(x=x, y=y, z=z, w=w))


def pose_stamped_message(pose: Pose2, stamp: int, frame: str) -> Any:
    """A planar pose as geometry_msgs/PoseStamped."""
    return _POSE_STAMPED(header=header_message(stamp, frame), pose=pose_message(pose))


def transform_message(parent_from_child: Pose2, stamp: int, parent: str, child: str) -> Any:
    """A planar transform as tf2_msgs/TFMessage."""
    pose = pose_message(parent_from_child)
    transform = new("geometry_msgs/msg/Transform", rotation=pose.orientation)
    transform.translation.x, transform.translation.y = parent_from_child.x, parent_from_child.y
    stamped = new(
        "geometry_msgs/msg/TransformStamped",
        header=header_message(stamp, parent),
        child_frame_id=child,
        transform=transform,
    )
    return new("tf2_msgs/msg/TFMessage", transforms=[stamped])


def map_message(grid: OccupancyGrid, stamp: int, frames: Frames) -> Any:
    """The known part of a map as nav_msgs/OccupancyGrid: 100 is occupied, 0 free, -1 unknown.

    A map of more than ``MOST_MAP_CELLS`` is given coarser: a cell is occupied if part of it is.
    """
    x_min, y_min, x_max, y_max = grid.known_box
    (first_row, first_column), (last_row, last_column) = grid.cell(x_min, y_min), grid.cell(x_max, y_max)
    first_row, first_column = max(first_row, 0), max(first_column, 0)
    level = grid.level[first_row : last_row + 1, first_column : last_column + 1]
    cells = np.where(level > 0, 100, np.where(level < 0, 0, -1)).astype(np.int8)
    factor = math.ceil(math.sqrt(cells.size / MOST_MAP_CELLS))
    if factor > 1:
        rows, columns = (-(-side // factor) * factor for side in cells.shape)
        padded = np.full((rows, columns), -1, np.int8)
        padded[: cells.shape[0], : cells.shape[1]] = cells
        cells = padded.reshape(rows // factor, factor, columns // factor, factor).max(axis=(1, 3))
    message = new("nav_msgs/msg/OccupancyGrid", header=header_message(stamp, frames.map))
    message.info.map_load_time = time_message(stamp)
    message.info.resolution = grid.resolution * factor
    message.info.height, message.info.width = cells.shape
    corner = grid.origin[0] + first_column * grid.resolution, grid.origin[1] + first_row * grid.resolution
    message.info.origin = pose_message(Pose2(*corner, 0.0))
    message.data = np.ascontiguousarray(cells).ravel()
    return message


def path_message(path_in_map: FloatArray, stamp: int, frames: Frames) -> Any:
    """A path (n, 2) as nav_msgs/Path; each pose looks along it."""
    path = path_in_map[:: -(-max(len(path_in_map), 1) // _MOST_PATH_POSES)]
    steps = np.diff(path, axis=0, append=path[-1:])
    yaws = [math.atan2(dy, dx) for dx, dy in steps.tolist()]
    if len(yaws) > 1:
        yaws[-1] = yaws[-2]
    poses = [pose_stamped_message(Pose2(x, y, yaw), stamp, frames.map) for (x, y), yaw in zip(path.tolist(), yaws)]
    return new("nav_msgs/msg/Path", header=header_message(stamp, frames.map), poses=poses)


def tracks_message(tracks: FloatArray, stamp: int, frames: Frames) -> Any:
    """Tracks as visualization_msgs/MarkerArray: a cylinder each, and an arrow of its way in a second if it has moved.

    Args:
        tracks: (k, TRACK_SIZE) in base_link.
        stamp: The time [ns].
        frames: Names of the frames.
    """
    header, lifetime = header_message(stamp, frames.base), duration_message(_TRACK_LIFETIME)
    markers = []
    for number, track in enumerate(tracks.tolist()):
        has_left = track[HAS_LEFT] > 0.0
        colour = new("std_msgs/msg/ColorRGBA", r=1.0 if has_left else 0.5, g=0.4 if has_left else 0.5, b=0.5, a=0.7)
        body = new("visualization_msgs/msg/Marker", header=header, ns="tracks", id=number, type=_CYLINDER)
        body.pose = pose_message(Pose2(track[X], track[Y], 0.0))
        body.pose.position.z = 0.5 * _TRACK_HEIGHT
        body.scale = _VECTOR(x=2.0 * track[RADIUS], y=2.0 * track[RADIUS], z=_TRACK_HEIGHT)
        body.color, body.lifetime = colour, lifetime
        markers.append(body)
        if has_left:
            arrow = new("visualization_msgs/msg/Marker", header=header, ns="velocities", id=number, type=_ARROW)
            arrow.pose = pose_message(Pose2(0.0, 0.0, 0.0))
            ahead = track[X] + track[V_X], track[Y] + track[V_Y]
            arrow.points = [_POINT(x=track[X], y=track[Y], z=0.1), _POINT(x=ahead[0], y=ahead[1], z=0.1)]
            arrow.scale = _VECTOR(x=0.05, y=0.1, z=0.1)
            arrow.color, arrow.lifetime = colour, lifetime
            markers.append(arrow)
    return new("visualization_msgs/msg/MarkerArray", markers=markers)


def status_message(level: int, name: str, message: str, values: tuple[tuple[str, str], ...]) -> Any:
    """A diagnostic_msgs/DiagnosticStatus."""
    pairs = [new("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values]
    return new(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=name,
        message=message,
        hardware_id="vuca_deploy",
        values=pairs,
    )


_CYLINDER, _ARROW = 3, 0
"""Kinds of a visualization_msgs/Marker."""
_TIME = message_type("builtin_interfaces/msg/Time")
_HEADER = message_type("std_msgs/msg/Header")
_VECTOR = message_type("geometry_msgs/msg/Vector3")
_POINT = message_type("geometry_msgs/msg/Point")
_POSE = message_type("geometry_msgs/msg/Pose")
_POSE_STAMPED = message_type("geometry_msgs/msg/PoseStamped")
_QUATERNION = message_type("geometry_msgs/msg/Quaternion")
_TWIST = message_type("geometry_msgs/msg/Twist")
_TWIST_STAMPED = message_type("geometry_msgs/msg/TwistStamped")
