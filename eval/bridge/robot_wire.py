"""A robot's side of its ROS 2 topics: sensors out, velocity commands in, and what a mission begins with."""

import time
import uuid
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from eval.bridge.messages import (
    clock_message,
    command_of,
    imu_message,
    initial_pose_message,
    mount_transform,
    nanoseconds_of,
    odometry_message,
    odometry_transform,
    scan_message,
    transform_of,
)
from robots.bodies.body import Body
from vuca_nav.deploy.messages import map_message, pose_stamped_message
from vuca_nav.deploy.robot_file import Frames, Topics
from vuca_nav.deploy.transport.interface import LATCHED, Publisher, Qos, Transport
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.errors import VucaError
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.types import Odometry, Pose2, Scan, VelocityCommand

_TRANSFORMS = Qos(depth=100)
_ACTION = "nav2_msgs/action/NavigateToPose"
_SEND_GOAL = "navigate_to_pose/_action/send_goal"


@dataclass(frozen=True, slots=True)
class WireConfig:
    """How the robot's topics look."""

    stamped: bool = True
    """Whether commands are TwistStamped; otherwise Twist, which cannot say which scan it answers."""
    action: bool = False
    """Whether goals are sent by the action navigate_to_pose; otherwise on the topic for goals."""
    frames: Frames = field(default_factory=Frames)
    topics: Topics = field(default_factory=Topics)


class Readings(NamedTuple):
    """What the sensors say at a tick."""

    scan: Scan | None
    """A new scan; None if there is none at this time."""
    odometry: Odometry | None
    """The odometry; None if it is silent."""
    scan_stamp: int
    """When the scan was taken [ns]."""
    odometry_stamp: int
    """When the odometry was measured [ns]."""
    clock: int
    """The time now [ns]."""


class Command(NamedTuple):
    """A velocity command that arrived."""

    velocity: VelocityCommand
    stamp: int
    """Its stamp [ns]; 0 where it has none."""
    sent: int
    """When it was published, by the publisher's wall clock [ns]."""
    received: float
    """When it was taken, by the wire's clock [s]."""
    publisher: int
    """Number of its publisher."""


class GoalRefused(VucaError):
    """The stack does not take the goal."""


class RobotWire:
    """Publishes what a robot's drivers publish, and hears what they hear.

    Args:
        transport: The robot's node in the ROS 2 network.
        body: The robot.
        config: How its topics look.
        clock: The steady clock that tells when commands arrive [s].

    Attributes:
        clock: That clock.
        map_from_odom: The last transform of map to odom that arrived with its stamp [ns]; None before.
        refused: Number of messages that were not believed, by topic.
        scan_sent: When the last scan was published, by the wall clock [ns].
    """

    def __init__(
        self,
        transport: Transport,
        body: Body,
        config: WireConfig = WireConfig(),
        clock: Callable[[], float] = time.perf_counter,
    ):
        self._transport, self._body, self._frames = transport, body, config.frames
        self._stamped, topics = config.stamped, config.topics
        self.clock = clock
        self.map_from_odom: tuple[int, Pose2] | None = None
        self.refused: Counter[str] = Counter()
        self.scan_sent = 0
        advertise = transport.advertise

        self._clock = advertise("/clock", "rosgraph_msgs/msg/Clock")
        self._tf = advertise("/tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS)
        self._tf_static = advertise("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED)
        self._scan = advertise(topics.scan, "sensor_msgs/msg/LaserScan")
        self._odom = advertise(topics.odom, "nav_msgs/msg/Odometry")
        self._imu = advertise(topics.imu, "sensor_msgs/msg/Imu")
        self._initial_pose = advertise(topics.initial_pose, "geometry_msgs/msg/PoseWithCovarianceStamped")
        self._goal = advertise(topics.goal, "geometry_msgs/msg/PoseStamped")
        self._action = transport.client(_SEND_GOAL, f"{_ACTION}_SendGoal") if config.action else None
        self._map_topic = topics.map
        self._map: Publisher | None = None  # only where the map is known: others publish it otherwise
        twist = "geometry_msgs/msg/TwistStamped" if config.stamped else "geometry_msgs/msg/Twist"
        self._commands = transport.subscribe(topics.cmd_vel, twist, Qos(depth=100))
        self._transforms = transport.subscribe("/tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS)
        self._tf_static.publish(mount_transform(body.lidar, body.lidar.height - body.base_height, 0, self._frames))

    def missing(self) -> list[str]:
        """What the other side still lacks to drive the robot, as phrases for a message."""
        heard = {"scan": self._scan, "odom": self._odom} | ({"goal_pose": self._goal} if self._action is None else {})
        lacks = [f"nobody subscribes to {topic}" for topic, publisher in heard.items() if not publisher.subscribers]
        if self._action is not None and not self._action.is_served:
            lacks.append("nobody serves the action navigate_to_pose")
        if not self._commands.publishers:
            lacks.append(f"nobody publishes cmd_vel as {'TwistStamped' if self._stamped else 'Twist'}")
        return lacks

    def tell_time(self, stamp: int) -> None:
        """Publish the simulated time [ns]."""
        self._clock.publish(clock_message(stamp))

    def sense(self, readings: Readings) -> None:
        """Publish what the sensors say.

        The scan comes last: whoever acts on it has the odometry of the same time.
        """
        scan, odometry, stamp = readings.scan, readings.odometry, readings.odometry_stamp
        if odometry is not None:
            self._tf.publish(odometry_transform(odometry, stamp, self._frames))
            self._imu.publish(imu_message(odometry, stamp, self._frames))
            self._odom.publish(odometry_message(odometry, stamp, self._frames))
        if scan is not None:
            self.scan_sent = time.time_ns()
            self._scan.publish(scan_message(scan, readings.scan_stamp, self._body.lidar, self._frames))

    def place(self, start: Pose2, stamp: int) -> None:
        """Publish the robot's pose in the map, as a user gives it in RViz."""
        self._initial_pose.publish(initial_pose_message(start, stamp, self._frames))

    def send_goal(self, goal: tuple[float, float], stamp: int) -> None:
        """Send a goal in the map [m]."""
        pose = pose_stamped_message(Pose2(*goal, 0.0), stamp, self._frames.map)
        if self._action is None:
            self._goal.publish(pose)
            return
        identity = new("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(uuid.uuid4().bytes, np.uint8))
        request = new(f"{_ACTION}_SendGoal_Request", goal_id=identity, goal=new(f"{_ACTION}_Goal", pose=pose))
        self._action.call(request)

    def publish_map(self, grid: OccupancyGrid, stamp: int) -> None:
        """Publish the map, as a map server does."""
        if self._map is None:
            self._map = self._transport.advertise(self._map_topic, "nav_msgs/msg/OccupancyGrid", LATCHED)
        self._map.publish(map_message(grid, stamp, self._frames))

    def wait(self, timeout: float) -> None:
        """Wait until something arrives, at most so long [s]."""
        self._transport.wait(timeout)

    def take(self) -> list[Command]:
        """The commands that have arrived since the last call, oldest first; takes in transforms as well.

        Raises:
            GoalRefused: If the action's server has refused a goal.
        """
        for _, response in () if self._action is None else self._action.take():
            if not response.accepted:
                raise GoalRefused("the server of navigate_to_pose has refused the goal; its log says why")
        for received in self._transforms.take():
            found = transform_of(received.message, self._frames.map, self._frames.odom)
            if found is not None:
                self.map_from_odom = found
        commands = []
        for received in self._commands.take():
            message: Any = received.message
            velocity = command_of(message.twist if self._stamped else message)
            if velocity is None:
                self.refused["cmd_vel"] += 1
                continue
            stamp = nanoseconds_of(message.header.stamp) if self._stamped else 0
            commands.append(Command(velocity, stamp, received.sent, self.clock(), received.publisher))
        return commands
