"""MCAP recordings of ROS 2 (an .mcap file, or the directory of a rosbag2): LaserScan with Odometry or tf.

Logs of ``vuca deploy`` are such recordings: where no tf tells it, they say themselves where the lidar stands.
"""

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from vuca_nav.data_files import parse_json, shown
from vuca_nav.deploy.log import MISSION_TYPE
from vuca_nav.deploy.messages import Refused
from vuca_nav.deploy.replay.log_file import LogFile
from vuca_nav.deploy.transforms import LidarMount, StaticTransforms
from vuca_nav.deploy.transport.ros_types import BadMessage, decode
from vuca_nav.errors import BadArgument, BadLog
from vuca_nav.plain import from_plain
from vuca_nav.slam_log.robot_log import RobotLog, check_use
from vuca_nav.types import STANDING, FloatArray, LidarSpec, Pose2

LONGEST_GAP = 0.5
"""A scan farther than this from every pose of odometry has none [s]."""
SCAN, ODOMETRY, TF = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
ODOM, MAP = "odom", "map"
"""Names of the frames that tf counts odometry and the map in (REP-105)."""
BASES = ("base_link", "base_footprint")
"""Names of the robot's frame, where its odometry does not tell it."""


class _Scan(NamedTuple):
    stamp: float
    frame: str
    geometry: tuple[int, float, float]
    """Number of beams, first angle, increment [rad]."""
    limits: tuple[float, float]
    """Least and greatest range [m]."""
    ranges: FloatArray


@dataclass(slots=True)
class _Odometry:
    """Poses of one child frame, as they came."""

    child: str
    stamps: list[float] = field(default_factory=list)
    poses: list[Pose2] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)

    def add(self, stamp: float, position: Any, rotation: Any) -> None:
        """Take in a pose, or count why not."""
        x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        pose = Pose2(float(position.x), float(position.y), yaw)
        if not math.isfinite(sum(pose)):
            self.refused["no finite pose"] += 1
        elif self.stamps and stamp < self.stamps[-1]:
            self.refused["time runs backwards"] += 1
        else:
            self.stamps.append(stamp)
            self.poses.append(pose)


@dataclass(slots=True)
class _Content:
    """What a recording holds."""

    scans: dict[str, list[_Scan]] = field(default_factory=dict)
    odometry: dict[str, _Odometry] = field(default_factory=dict)
    """By topic."""
    moves: dict[str, _Odometry] = field(default_factory=dict)
    """tf from odom on, by child frame."""
    frames: StaticTransforms = field(default_factory=StaticTransforms)
    lidar: LidarSpec | None = None
    """The lidar that a log of ``vuca deploy`` tells."""
    warnings: list[str] = field(default_factory=list)

    def take(self, topic: str, kind: str, message: Any) -> None:
        """Take in a message."""
        if kind == SCAN:
            self.scans.setdefault(topic, []).append(_scan_of(message))
        elif kind == ODOMETRY:
            child = message.child_frame_id.lstrip("/")
            pose = message.pose.pose
            self.odometry.setdefault(topic, _Odometry(child)).add(
                _seconds(message.header.stamp), pose.position, pose.orientation
            )
        elif kind == TF:
            self._take_transforms(message.transforms)
        elif message.is_reset:
            self.lidar = from_plain(LidarSpec, parse_json(message.lidar, topic, BadLog), topic, BadLog)

    def _take_transforms(self, transforms: list[Any]) -> None:
        fixed = []
        for t in transforms:
            parent, child = t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/")
            if parent == ODOM:
                moved = self.moves.setdefault(child, _Odometry(child))
                moved.add(_seconds(t.header.stamp), t.transform.translation, t.transform.rotation)
            elif parent != MAP:
                fixed.append(t)
        if fixed:
            self.frames.add(SimpleNamespace(transforms=fixed))


def read_mcap(path: Path) -> RobotLog:
    """Read a recording: the LaserScan topic with most messages, and Odometry, or else tf from odom on.

    What a recording that was cut off holds is read; the log's warnings say so.

    Raises:
        BadLog: If it is no such recording, or has no scan with odometry.
    """
    content = _read(path)
    end = "".join(f" ({warning})" for warning in content.warnings)
    if not content.scans:
        raise BadLog(f"{path} holds no {SCAN}: a recording of a planar lidar would be right{end}")
    odometry = max((content.odometry or content.moves).values(), key=lambda o: len(o.stamps), default=None)
    if odometry is None or not odometry.stamps:
        raise BadLog(f"{path} holds neither {ODOMETRY} nor a tf from {ODOM} on: SLAM needs odometry{end}")
    content.warnings += [f"{n} poses of odometry left out: {cause}" for cause, n in odometry.refused.items()]
    return _log_of(path, content, odometry)


def _read(path: Path) -> _Content:
    files = sorted(path.glob("*.mcap"), key=_natural) if path.is_dir() else [path]
    if not files:
        raise BadLog(f"{path} holds no .mcap file: the directory of a rosbag2 in MCAP would be right")
    content, refused = _Content(), Counter[str]()
    for file in files:
        log = LogFile(file)
        for message in log.messages():
            if message.type_name not in (SCAN, ODOMETRY, TF, MISSION_TYPE):
                continue
            try:
                content.take(message.topic, message.type_name, decode(message.data, message.type_name))
            except (BadMessage, Refused) as error:
                refused[f"{shown(message.topic)}: {error}"] += 1
        if log.damage is not None:
            content.warnings.append(f"{file.name} is read only in part: {log.damage}")
    content.warnings += [f"{n} messages left out: {cause}" for cause, n in refused.items()]
    return content


def _natural(path: Path) -> list[Any]:
    """Key by which the second file of a recording comes before the tenth."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


def _seconds(stamp: Any) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def _scan_of(message: Any) -> _Scan:
    ranges = np.asarray(message.ranges, np.float64)
    return _Scan(
        _seconds(message.header.stamp),
        message.header.frame_id.lstrip("/"),
        (len(ranges), float(message.angle_min), float(message.angle_increment)),
        (float(message.range_min), float(message.range_max)),
        ranges,
    )


def _log_of(path: Path, content: _Content, odometry: _Odometry) -> RobotLog:
    scans = max(content.scans.values(), key=len)
    stamps, poses = np.array(odometry.stamps), np.array(odometry.poses)
    geometry, _ = Counter(scan.geometry for scan in scans).most_common(1)[0]
    skipped: Counter[str] = Counter()
    kept: list[_Scan] = []
    for scan in scans:
        after = min(int(np.searchsorted(stamps, scan.stamp)), len(stamps) - 1)
        gap = min(abs(stamps[after] - scan.stamp), abs(stamps[max(after - 1, 0)] - scan.stamp))
        if scan.geometry != geometry:
            skipped["another size"] += 1
        elif not len(scan.ranges) or np.isnan(scan.ranges).mean() > 0.5:
            skipped["more than half of the ranges NaN"] += 1
        elif kept and scan.stamp < kept[-1].stamp:
            skipped["time runs backwards"] += 1
        elif gap > LONGEST_GAP:
            skipped["no odometry"] += 1
        else:
            kept.append(scan)
    check_use(path, len(kept), skipped)
    lidar = _lidar_of(path, content, kept[0], odometry.child)
    times = np.array([scan.stamp for scan in kept])
    columns = poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2])
    moved = np.column_stack([np.interp(times, stamps, column) for column in columns])
    ranges = np.array([scan.ranges for scan in kept], np.float32)
    return RobotLog(lidar, times, ranges, moved, dict(skipped), tuple(content.warnings))


def _lidar_of(path: Path, content: _Content, scan: _Scan, child: str) -> LidarSpec:
    """The lidar of a scan, where tf says, or else the log of a mission, that it stands."""
    bases = (child,) if child else BASES
    try:
        found = next((mount for base in bases if (mount := content.frames.mount(base, scan.frame))), None)
    except Refused as error:
        raise BadLog(f"{path}: {error}; a lidar that scans a level plane would be right") from error
    (number, first, pitch), (low, high) = scan.geometry, scan.limits
    if found is None and content.lidar is not None:
        said = content.lidar
        found = LidarMount(said.mount, is_inverted=said.pitch * pitch < 0.0)
    elif found is None and scan.frame not in bases:
        content.warnings.append(
            f"nothing tells where the lidar ({shown(scan.frame)}) stands on the robot ({shown(child or BASES[0])}): "
            "it is taken to stand in its middle"
        )
    found = found or LidarMount(STANDING, is_inverted=False)
    sign = -1.0 if found.is_inverted else 1.0
    try:
        return LidarSpec(
            num_beams=number,
            min_range=max(low, 0.0),
            max_range=high,
            angle_min=sign * first,
            angle_increment=sign * pitch,
            mount=found.base_from_lidar,
        )
    except BadArgument as error:
        raise BadLog(f"{path}: its scans are of no lidar: {error}") from error
