"""MCAP recordings of ROS 2 (an .mcap file, or the directory of a rosbag2): LaserScan with Odometry or tf."""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vuca_nav.data_files import shown
from vuca_nav.geometry import compose
from vuca_nav.slam_log.robot_log import BadLog, RobotLog
from vuca_nav.types import STANDING, FloatArray, LidarSpec, Pose2

LONGEST_GAP = 0.5
"""A scan farther than this from every pose of odometry has none [s]."""
SCAN, ODOMETRY, TF = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
ODOM = "odom"
"""Name of the frame that tf counts odometry in (REP-105)."""


class _Scan(NamedTuple):
    stamp: float
    frame: str
    geometry: tuple[int, float, float]
    """Number of beams, first angle, increment [rad]."""
    limits: tuple[float, float]
    """Least and greatest range [m]."""
    ranges: FloatArray


class _Transform(NamedTuple):
    stamp: float
    parent: str
    child: str
    pose: Pose2


def read_mcap(path: Path) -> RobotLog:
    """Read a recording: the LaserScan topic with most messages, and Odometry, or else tf from odom on.

    Raises:
        BadLog: If it is no such recording, or has no scan with odometry.
    """
    scans: dict[str, list[_Scan]] = {}
    odometry: dict[str, list[_Transform]] = {}
    transforms: list[_Transform] = []
    for topic, kind, message in _messages(path):
        if kind == SCAN:
            scans.setdefault(topic, []).append(_scan_of(message))
        elif kind == ODOMETRY:
            head, child = message.header, message.child_frame_id
            pose = _planar(message.pose.pose.position, message.pose.pose.orientation)
            odometry.setdefault(topic, []).append(_Transform(_seconds(head.stamp), head.frame_id, child, pose))
        else:
            transforms += [
                _Transform(
                    _seconds(t.header.stamp),
                    t.header.frame_id.lstrip("/"),
                    t.child_frame_id.lstrip("/"),
                    _planar(t.transform.translation, t.transform.rotation),
                )
                for t in message.transforms
            ]
    if not scans:
        raise BadLog(f"{path} holds no sensor_msgs/msg/LaserScan: a recording of a planar lidar would be right")
    chosen = max(scans.values(), key=len)
    if odometry:
        poses = max(odometry.values(), key=len)
    else:
        poses = [t for t in transforms if t.parent == ODOM]
    if not poses:
        raise BadLog(f"{path} holds neither nav_msgs/msg/Odometry nor a tf from {ODOM} on: SLAM needs odometry")
    return _log_of(path, chosen, poses, transforms)


def _messages(path: Path) -> Iterator[tuple[str, str, Any]]:
    """Topic, type and content of the messages that are needed, in the order of time."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore
    from rosbags.typesys.base import TypesysError

    store = get_typestore(Stores.ROS2_HUMBLE)
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    if not files:
        raise BadLog(f"{path} holds no .mcap file: the directory of a rosbag2 in MCAP would be right")
    for file in files:
        try:
            with file.open("rb") as stream:
                for schema, channel, message in make_reader(stream).iter_messages():
                    if schema is None or schema.name not in (SCAN, ODOMETRY, TF):
                        continue
                    yield channel.topic, schema.name, store.deserialize_cdr(message.data, schema.name)
        except (McapError, TypesysError, ValueError, EOFError) as error:
            raise BadLog(f"{file} is no MCAP recording, or damaged: {shown(error)}") from error
        except OSError as error:
            raise BadLog(f"{file} cannot be read: {error.strerror}") from error


def _seconds(stamp: Any) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def _planar(position: Any, rotation: Any) -> Pose2:
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return Pose2(float(position.x), float(position.y), yaw)


def _scan_of(message: Any) -> _Scan:
    ranges = np.asarray(message.ranges, np.float64)
    return _Scan(
        _seconds(message.header.stamp),
        message.header.frame_id.lstrip("/"),
        (len(ranges), float(message.angle_min), float(message.angle_increment)),
        (float(message.range_min), float(message.range_max)),
        ranges,
    )


def _log_of(path: Path, scans: list[_Scan], poses: list[_Transform], transforms: list[_Transform]) -> RobotLog:
    poses = sorted((pose for pose in poses if math.isfinite(sum(pose.pose))), key=lambda pose: pose.stamp)
    stamps = np.array([pose.stamp for pose in poses])
    x, y, yaw = np.array([pose.pose for pose in poses]).T
    yaw = np.unwrap(yaw)
    (beams, first, increment), _ = Counter(scan.geometry for scan in scans).most_common(1)[0]
    skipped: Counter[str] = Counter()
    kept: list[_Scan] = []
    for scan in scans:
        if scan.geometry != (beams, first, increment):
            skipped["another size"] += 1
        elif np.isnan(scan.ranges).mean() > 0.5:
            skipped["more than half of the ranges NaN"] += 1
        elif abs(stamps - scan.stamp).min() > LONGEST_GAP:
            skipped["no odometry"] += 1
        elif kept and scan.stamp < kept[-1].stamp:
            skipped["time runs backwards"] += 1
        else:
            kept.append(scan)
    if len(kept) < skipped.total() or not kept:
        causes = ", ".join(f"{cause}: {number}" for cause, number in skipped.items())
        raise BadLog(f"{path}: of {len(scans)} scans most are of no use ({causes})")
    low, high = kept[0].limits
    lidar = LidarSpec(
        num_beams=beams,
        min_range=max(low, 0.0),
        max_range=high,
        angle_min=first,
        angle_increment=increment,
        mount=_mount(kept[0].frame, poses[0].child.lstrip("/"), transforms),
    )
    times = np.array([scan.stamp for scan in kept])
    odometry = np.column_stack([np.interp(times, stamps, column) for column in (x, y, yaw)])
    return RobotLog(lidar, times, np.array([scan.ranges for scan in kept], np.float32), odometry, dict(skipped))


def _mount(frame: str, base: str, transforms: list[_Transform]) -> Pose2:
    """Pose of the lidar in the frame whose odometry it is, along tf; that frame itself if tf does not tell."""
    parents = {t.child: t for t in transforms if t.parent != ODOM}
    pose, seen = STANDING, set()
    while frame != base and frame in parents and frame not in seen:
        seen.add(frame)
        pose = compose(parents[frame].pose, pose)
        frame = parents[frame].parent
    return pose if frame == base else STANDING
