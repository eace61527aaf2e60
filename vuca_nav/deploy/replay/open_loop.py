"""The stack of a bundle over a log of somebody else's: any rosbag2 MCAP file with a scan and odometry.

The robot went where it went: the loop is open, and the commands are what the stack would have said. It ticks at its own
rate by the stamps of the scans; between two scans of a slower lidar it goes on by odometry, as it does on a robot.
"""

import math
from collections import Counter, deque
from dataclasses import replace
from typing import Any, NamedTuple

from vuca_nav.data_files import shown
from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.messages import (
    Refused,
    SensedOdometry,
    SensedScan,
    lidar_of,
    odometry_of,
    pose_of,
    scan_of,
    vertical_of_imu,
)
from vuca_nav.deploy.replay.log_file import LogFile, LoggedMessage
from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transforms import StaticTransforms
from vuca_nav.deploy.transport.ros_types import BadMessage, decode
from vuca_nav.errors import BadArgument, BadLog
from vuca_nav.geometry import distance
from vuca_nav.navigator import Navigator
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, Pose2, Twist2, VelocityCommand
from vuca_nav.wire import NANOSECONDS, seconds

SCAN, ODOMETRY, IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
GOAL, TRANSFORMS = "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
START = "geometry_msgs/msg/PoseWithCovarianceStamped"
LONGEST_GAP = 1.0
"""Longest time between two scans that is ticked through [s]; after a longer one the stack goes on where they do."""
EARLIEST = 0.2
"""Share of the period by which a scan may come before or after a tick and still be the tick's: jitter."""
MOST_REASONS = 100
"""Greatest number of kinds of refused messages that are told apart."""


class Said(NamedTuple):
    """A command, beside what the robot did at that time."""

    time: float
    """[s] since the first scan."""
    command: VelocityCommand
    """[m/s, m/s, rad/s]"""
    driven: Twist2
    """Velocity by the log's odometry."""


class OpenLoop(NamedTuple):
    """The result of a replay in the open loop."""

    ticks: int
    scans: int
    odometry: int
    duration: float
    """[s]"""
    num_beams: int
    mount: list[float]
    """Pose of the lidar in base_link."""
    goal: list[float] | None
    path_length: float
    """Length of the path by the stack's estimate [m]."""
    end: list[float]
    """Estimated pose at the end."""
    refused: dict[str, int]
    """Number of messages that were refused, by topic and reason."""
    said: list[Said]
    """The command once a second."""
    damage: str | None


class Topics(NamedTuple):
    """What a log has."""

    scan: str
    odometry: str
    transforms: StaticTransforms


def find_topics(bundle: Bundle, log: LogFile, scan: str | None, odometry: str | None) -> Topics:
    """Find the scan and the odometry of a log, and its static transforms, in a first pass over it.

    Args:
        bundle: The bundle, whose names are looked for first.
        log: The log.
        scan: Topic of the scan, if it is given.
        odometry: Topic of the odometry, if it is given.

    Raises:
        BadLog: If there is none, or several that could be it.
    """
    found: dict[str, Counter[str]] = {SCAN: Counter(), ODOMETRY: Counter()}
    others: Counter[str] = Counter()
    transforms = StaticTransforms()
    for message in log.messages():
        if message.type_name in found:
            found[message.type_name][message.topic] += 1
        elif len(others) < MOST_REASONS:
            others[message.type_name] += 1
        if message.type_name == TRANSFORMS and message.topic.rpartition("/")[2] == "tf_static":
            try:
                transforms.add(decode(message.data, TRANSFORMS))
            except (BadMessage, Refused):
                continue
    names = bundle.robot.topics
    return Topics(
        _chosen("--scan", scan, found[SCAN], names.scan, SCAN, others),
        _chosen("--odometry", odometry, found[ODOMETRY], names.odom, ODOMETRY, others),
        transforms,
    )


def _chosen(
    option: str, given: str | None, found: Counter[str], usual: str, type_name: str, others: Counter[str]
) -> str:  # fmt: skip
    """The topic of a type that is given, or the usual one, or the only one."""
    listed = shown(", ".join(sorted(found)), 300)
    if given is not None:
        if given not in found:
            raise BadLog(
                f"{option} {shown(given)}: the log has no {type_name} of that name (it has: {listed or 'none'})"
            )
        return given
    if not found:
        has = shown(", ".join(sorted(others)), 300) or "nothing of ROS 2"
        raise BadLog(f"the log has no {type_name}, which the stack needs (it has: {has})")
    named = [topic for topic in found if topic.rpartition("/")[2] == usual]
    if len(found) > 1 and len(named) != 1:
        raise BadLog(f"the log has several {type_name}: {listed}; give one of them by {option}")
    return named[0] if named else next(iter(found))


class OpenLoopRun:
    """A replay in the open loop.

    Args:
        bundle: The bundle.
        topics: Result of ``find_topics``.
        goal: Goal in the map [m]; None for those of the log.
        telemetry: Receives what the stages report.
    """

    def __init__(self, bundle: Bundle, topics: Topics, goal: tuple[float, float] | None, telemetry: Telemetry):
        self._bundle, self._topics, self._goal, self._telemetry = bundle, topics, goal, telemetry
        self._has_own_goal = goal is not None
        self._start = STANDING
        self._period = round(NANOSECONDS / bundle.config.navigator.rate)
        self._early = round(EARLIEST * self._period)
        self._navigator: Navigator | None = None
        self._frames: Frames | None = None
        self._first_scan: Any = None
        self._scan: SensedScan | None = None
        self._up: tuple[float, float, float] | None = None
        self._past: deque[SensedOdometry] = deque(maxlen=1000)
        self._epoch = self._next_tick = 0
        self._refused: Counter[str] = Counter()
        self._ticks = self._scans = self._odometry = 0
        self._length = 0.0
        self._said: list[Said] = []

    def run(self, log: LogFile) -> OpenLoop:
        """Run the stack over the log.

        Raises:
            BadLog: If nothing of it can be used.
        """
        for message in log.messages():
            try:
                self._take(message)
            except (BadMessage, Refused) as error:
                self._refuse(message.topic, str(error))
        if self._navigator is None or self._scan is None:
            why = "; ".join(f"{reason} ({count})" for reason, count in self._refused.most_common(3))
            raise BadLog(f"nothing of the log can be used: {why or 'no scan comes after odometry'}")
        lidar = self._navigator.perception.lidar
        return OpenLoop(
            self._ticks, self._scans, self._odometry, seconds(self._scan.stamp - self._epoch), lidar.num_beams,
            list(lidar.mount), None if self._goal is None else list(self._goal), self._length,
            list(self._navigator.map_from_base), dict(self._refused), self._said, log.damage,
        )  # fmt: skip

    def _take(self, message: LoggedMessage) -> None:
        """Take in the next message."""
        name = message.topic.rpartition("/")[2]
        if message.topic == self._topics.odometry and message.type_name == ODOMETRY:
            self._take_odometry(decode(message.data, ODOMETRY))
        elif message.topic == self._topics.scan and message.type_name == SCAN:
            self._take_scan(decode(message.data, SCAN))
        elif message.type_name == IMU and name == self._bundle.robot.topics.imu and self._frames is not None:
            self._up = vertical_of_imu(decode(message.data, IMU), self._frames)
        elif message.type_name == GOAL and name == self._bundle.robot.topics.goal and not self._has_own_goal:
            goal = decode(message.data, GOAL)
            pose = pose_of(goal.header, goal.pose, self._bundle.robot.frames.map)
            self._goal = pose.x, pose.y
            if self._navigator is not None:
                self._navigator.head_for(self._goal)
        elif message.type_name == START and name == self._bundle.robot.topics.initial_pose:
            start = decode(message.data, START)
            self._start = pose_of(start.header, start.pose.pose, self._bundle.robot.frames.map)
            if self._navigator is not None:
                self._navigator.reset(self._start, self._goal)

    def _take_odometry(self, message: Any) -> None:
        if self._frames is None:
            names = {"odom": message.header.frame_id.lstrip("/"), "base": message.child_frame_id.lstrip("/")}
            try:
                self._frames = replace(self._bundle.robot.frames, **names)
            except BadArgument as error:
                raise Refused("its frames have no names") from error
        sensed = odometry_of(message, self._frames, self._up)
        if self._past and sensed.stamp <= self._past[-1].stamp:
            raise Refused("its stamp does not go on")
        self._past.append(sensed)
        self._odometry += 1

    def _take_scan(self, message: Any) -> None:
        if self._frames is None or not self._past:
            raise Refused("it comes before any odometry")
        if self._navigator is None:
            self._begin(message)
        sensed = scan_of(message, self._first_scan)
        if self._scan is not None and sensed.stamp <= self._scan.stamp:
            raise Refused("its stamp does not go on")
        self._scans += 1
        if self._scan is None or sensed.stamp - self._scan.stamp > LONGEST_GAP * NANOSECONDS:
            self._next_tick = sensed.stamp
        while self._scan is not None and self._next_tick < sensed.stamp - self._early:
            self._tick(self._next_tick, self._scan)
        if self._scan is None:
            self._epoch = sensed.stamp
        self._scan = sensed
        if sensed.stamp >= self._next_tick - self._early:  # else it waits for the next tick
            self._next_tick = sensed.stamp
            self._tick(sensed.stamp, sensed)

    def _begin(self, message: Any) -> None:
        """Build the stack for the lidar of the first scan."""
        assert self._frames is not None
        mount = self._topics.transforms.mount(self._frames.base, message.header.frame_id.lstrip("/"))
        place = None if mount is None else mount.base_from_lidar
        inverted = mount is not None and mount.is_inverted
        lidar = lidar_of(message, self._bundle.lidar, place, is_inverted=inverted)
        self._navigator = self._bundle.navigator(self._telemetry, lidar)
        self._first_scan = message
        self._navigator.reset(self._start, self._goal)

    def _tick(self, stamp: int, scan: SensedScan) -> None:
        """A step of the stack at a time [ns]."""
        navigator = self._navigator
        assert navigator is not None
        sensed = self._past[0]
        while len(self._past) > 1 and self._past[1].stamp <= stamp:
            self._past.popleft()
            sensed = self._past[0]
        odometry = sensed.odometry(self._epoch)
        self._telemetry.time(seconds(stamp - self._epoch))
        before: Pose2 = navigator.map_from_base
        command = navigator.step(scan.scan(self._epoch), odometry)
        step = distance(before, navigator.map_from_base)
        self._length += step if math.isfinite(step) else 0.0
        time = seconds(stamp - self._epoch)
        if not self._said or time >= self._said[-1].time + 1.0:
            self._said.append(Said(time, command, odometry.twist))
        self._ticks += 1
        self._next_tick = stamp + self._period

    def _refuse(self, topic: str, reason: str) -> None:
        key = f"{shown(topic)}: {reason}"
        if key in self._refused or len(self._refused) < MOST_REASONS:
            self._refused[key] += 1
