"""What the node hears: the latest of each topic, checked; goals and poses once."""

import time
from typing import Any

from vuca_nav.deploy.messages import (
    Refused,
    SensedOdometry,
    SensedScan,
    lidar_of,
    pose_of,
    scan_of,
    stamp_of,
    vertical_of_imu,
)
from vuca_nav.deploy.node.base import Base
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.robot_file import RobotFile
from vuca_nav.deploy.transforms import StaticTransforms
from vuca_nav.deploy.transport.interface import RELIABLE, SENSOR, STATIC_TRANSFORMS, Qos, Transport
from vuca_nav.types import LidarSpec, Pose2

EMERGENCY_STOP, RELEASE = "emergency_stop", "emergency_stop/release"
"""Topics of the emergency stop, std_msgs/Bool: true on the first stops and latches, true on the second releases."""
IMU_AGE = 0.1
"""Longest time for which an IMU's vertical holds [s]; without one the odometry's orientation shows it."""
_ODOMETRY = Qos(reliable=False, depth=10)
_ANY = Qos(reliable=False)
"""Hears publishers of both kinds; a message that is lost is not sent again."""


class Inputs:
    """The node's subscriptions, and what came last on them.

    Args:
        transport: The network.
        robot: Frames, topics and lidar of the robot.
        base: Its base.
        log: Keeps what comes.
        use_sim_time: Whether time is that of ``/clock``.

    Attributes:
        lidar: The lidar that the scans are of; None before the first.
        scan: The latest scan.
        scan_received: When it came, by ``time.monotonic`` [s].
        scan_number: Its number in the log.
        odometry: The latest odometry, with its time of arrival in ``odometry_received``.
        clock: Time of ``/clock`` [ns]; None before there is one.
        is_stopped: Whether an emergency stop came that was not released.
    """

    def __init__(self, transport: Transport, robot: RobotFile, base: Base, log: NodeLog, use_sim_time: bool):
        self._transport, self._robot, self._base, self._log = transport, robot, base, log
        self.lidar: LidarSpec | None = None
        self.scan: SensedScan | None = None
        self.odometry: SensedOdometry | None = None
        self.scan_received = self.odometry_received = float("-inf")
        self.scan_number = 0
        self.clock: int | None = None
        self.is_stopped = False
        self._first: Any = None
        self._new_odometry: SensedOdometry | None = None
        self._up: tuple[float, float, float] | None = None
        self._up_received = float("-inf")
        self._goal: Pose2 | None = None
        self._start: tuple[Pose2, int] | None = None
        self._static = StaticTransforms()
        topics = robot.topics
        listen = [  # readings first: what was sent before a reading is then there with it, an IMU's before odometry too
            (topics.scan, "sensor_msgs/msg/LaserScan", SENSOR, self._take_scan),
            (base.odometry_topic, base.odometry_type, _ODOMETRY, self._take_odometry),
            (topics.imu, "sensor_msgs/msg/Imu", SENSOR, self._take_imu),
            ("/tf_static", "tf2_msgs/msg/TFMessage", STATIC_TRANSFORMS, self._take_transforms),
            (topics.initial_pose, "geometry_msgs/msg/PoseWithCovarianceStamped", RELIABLE, self._take_start),
            (topics.goal, "geometry_msgs/msg/PoseStamped", RELIABLE, self._take_goal),
            (EMERGENCY_STOP, "std_msgs/msg/Bool", RELIABLE, self._take_stop),  # twice: a stop must not be lost on a
            (EMERGENCY_STOP, "std_msgs/msg/Bool", _ANY, self._take_stop),  # bad network, nor a best-effort publisher's
            (RELEASE, "std_msgs/msg/Bool", _ANY, self._take_release),  # once: a second one could undo a later stop
        ]
        if use_sim_time:
            listen.insert(0, ("/clock", "rosgraph_msgs/msg/Clock", SENSOR, self._take_clock))
        self._subscriptions = [
            (transport.full_name(topic), type_name, transport.subscribe(topic, type_name, qos), take)
            for topic, type_name, qos, take in listen
        ]

    def take(self) -> None:
        """Take in all that has come."""
        for topic, type_name, subscriber, use in self._subscriptions:
            for received in subscriber.take():
                number = self._log.received(topic, type_name, received.data, time.time_ns(), received.sent)
                try:
                    use(received.message, number)
                except Refused as error:
                    self._transport.refusals.add(topic, str(error))
        if self._new_odometry is not None:
            up = self._up if self.odometry_received - self._up_received < IMU_AGE else None
            self.odometry = self._new_odometry if up is None else self._new_odometry._replace(up=up)
            self._new_odometry = None

    def take_goal(self) -> Pose2 | None:
        """The goal that has come since the last call, if one has."""
        goal, self._goal = self._goal, None
        return goal

    def take_start(self) -> tuple[Pose2, int] | None:
        """The initial pose that has come since the last call, if one has, and its stamp [ns]."""
        start, self._start = self._start, None
        return start

    def forget_before(self, time: int) -> None:
        """Forget readings of before a time [ns]."""
        if self.scan is not None and self.scan.stamp < time:
            self.scan = None
        if self.odometry is not None and self.odometry.stamp < time:
            self.odometry = None

    def _take_clock(self, message: Any, _: int) -> None:
        self.clock = stamp_of(message.clock, may_be_zero=True)

    def _take_scan(self, message: Any, number: int) -> None:
        if self._first is None:
            self._accept_first(message)
        self.scan = scan_of(message, self._first)
        self.scan_received, self.scan_number = time.monotonic(), number

    def _accept_first(self, message: Any) -> None:
        """See what lidar the scans are of: as the bundle says, but for what the message and tf_static say."""
        stamp_of(message.header.stamp)
        self._take_static()
        self.lidar, self._first = self._lidar_of(message), message

    def _lidar_of(self, message: Any) -> LidarSpec:
        """The lidar of a scan, as far as is known now."""
        robot = self._robot
        mount = self._static.mount(robot.frames.base, message.header.frame_id.lstrip("/"))
        if mount is None:
            return lidar_of(message, robot.lidar)
        return lidar_of(message, robot.lidar, mount.base_from_lidar, is_inverted=mount.is_inverted)

    def _take_static(self) -> None:
        """Take in the static transforms now: they are latched, and the first scan needs them."""
        for topic, type_name, subscriber, use in self._subscriptions:
            if use == self._take_transforms:
                for received in subscriber.take():
                    self._log.received(topic, type_name, received.data, time.time_ns(), received.sent)
                    self._static.add(received.message)

    def _take_transforms(self, message: Any, _: int) -> None:
        self._static.add(message)
        if self._first is None:
            return
        try:
            lidar = self._lidar_of(self._first)
        except Refused:  # as the next scan will be
            lidar = None
        if lidar != self.lidar:  # the first scan came before it was known where the lidar stands
            self._first = self.scan = None

    def _take_imu(self, message: Any, _: int) -> None:
        self._up = vertical_of_imu(message, self._robot.frames)
        self._up_received = time.monotonic()

    def _take_odometry(self, message: Any, _: int) -> None:
        self._new_odometry = self._base.odometry(message, None)
        self.odometry_received = time.monotonic()

    def _take_start(self, message: Any, _: int) -> None:
        pose = pose_of(message.header, message.pose.pose, self._robot.frames.map)
        self._start = pose, stamp_of(message.header.stamp, may_be_zero=True)

    def _take_goal(self, message: Any, _: int) -> None:
        self._goal = pose_of(message.header, message.pose, self._robot.frames.map)

    def _take_stop(self, message: Any, _: int) -> None:
        self.is_stopped |= bool(message.data)

    def _take_release(self, message: Any, _: int) -> None:
        if message.data:
            self.is_stopped = False
