"""A robot in an empty hall behind its ROS 2 topics, and a node that drives it, in one process."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.vuca_nav.deploy.bundles import ABOUT, body
from tests.vuca_nav.rooms import LIDAR, REST, ranges_to_boxes, room
from vuca_nav.build import StackConfig
from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.manifest import Manifest
from vuca_nav.deploy.messages import header_message, pose_message, pose_stamped_message, time_message
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.node.loop import Node, NodeConfig
from vuca_nav.deploy.robot_file import robot_file_of
from vuca_nav.deploy.transport.interface import LATCHED, RELIABLE, SENSOR, Transport
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.geometry import compose
from vuca_nav.policy.dynamic_window import DynamicWindowConfig
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, STOP, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand
from vuca_nav.wire import quaternion_of, round_odometry, round_scan, seconds, tick_nanoseconds, tilt_of

HALL = room(12.0, 9.0)
START = Pose2(2.0, 2.0, 0.0)
BEGINS = 1_000_000_000
"""Stamp of the first reading [ns]."""


def bundle(lidar: LidarSpec = LIDAR) -> Bundle:
    """A box on a dynamic window, as if it had been read from a bundle."""
    config = StackConfig(window=DynamicWindowConfig())
    manifest = Manifest(**{**dict.fromkeys(Manifest.__annotations__), **ABOUT})  # type: ignore[arg-type]
    return Bundle(Path("nowhere"), manifest, robot_file_of(body(), lidar), config)


def node(transport: Transport, config: NodeConfig, lidar: LidarSpec = LIDAR) -> Node:
    """A node of that bundle."""
    return Node(bundle(lidar), transport, config, Telemetry(), NodeLog())


class RobotSide:
    """The robot's drivers, and the robot: a disc without inertia."""

    def __init__(self, transport: Transport, lidar: LidarSpec = LIDAR):
        self.transport, self.lidar = transport, lidar
        self.clock = transport.advertise("/clock", "rosgraph_msgs/msg/Clock")
        self.scan = transport.advertise("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        self.odom = transport.advertise("odom", "nav_msgs/msg/Odometry")
        self.goal = transport.advertise("goal_pose", "geometry_msgs/msg/PoseStamped")
        self.start = transport.advertise("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")
        self.stop = transport.advertise("emergency_stop", "std_msgs/msg/Bool")
        self.release = transport.advertise("emergency_stop/release", "std_msgs/msg/Bool")
        self.commands = transport.subscribe("cmd_vel", "geometry_msgs/msg/TwistStamped", RELIABLE)
        self.map = transport.subscribe("map", "nav_msgs/msg/OccupancyGrid", LATCHED)
        self.tf = transport.subscribe("/tf", "tf2_msgs/msg/TFMessage")
        self.diagnostics = transport.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        self.pose, self.odom_from_base, self.twist, self.tick = START, STANDING, REST, 0

    def wait_for(self) -> None:
        """Wait until the node has been found, and has found this."""
        publishers = (self.scan, self.odom, self.goal, self.start, self.stop, self.release)
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            if all(p.subscribers for p in publishers) and self.commands.publishers and self.map.publishers:
                return
            time.sleep(0.01)
        raise AssertionError("not found")

    @property
    def stamp(self) -> int:
        """Stamp of the readings now [ns]."""
        return BEGINS + tick_nanoseconds(self.tick, 30)

    def readings(self) -> tuple[Scan, Odometry]:
        """Scan and odometry now, as messages carry them, their times counted from the first."""
        now = seconds(self.stamp - BEGINS)
        scan = round_scan(Scan(now, ranges_to_boxes(HALL, self.pose, self.lidar)))
        return scan, round_odometry(Odometry(now, self.odom_from_base, self.twist))

    def sense(self, change: Callable[[Any], None] = lambda _: None) -> None:
        """Publish time and readings."""
        scan, odometry = self.readings()
        self.clock.publish(new("rosgraph_msgs/msg/Clock", clock=time_message(self.stamp)))
        message = new("nav_msgs/msg/Odometry", header=header_message(self.stamp, "odom"), child_frame_id="base_link")
        message.pose.pose = pose_message(odometry.odom_from_base)
        x, y, z, w = quaternion_of(*tilt_of(odometry.up), odometry.odom_from_base.yaw)
        message.pose.pose.orientation = new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
        message.twist.twist.linear.x, message.twist.twist.angular.z = odometry.twist.v_x, odometry.twist.w_z
        self.odom.publish(message)
        message = new(
            "sensor_msgs/msg/LaserScan",
            header=header_message(self.stamp, "laser"),
            angle_min=self.lidar.angle_min,
            angle_increment=self.lidar.pitch,
            range_min=self.lidar.min_range,
            range_max=self.lidar.max_range,
            ranges=scan.ranges.astype(np.float32),
        )
        change(message)
        self.scan.publish(message)

    def move(self, command: VelocityCommand) -> None:
        """Move for a tick as it is told."""
        dt = 1.0 / 30.0
        step = Pose2(command.v_x * dt, 0.0, command.w_z * dt)
        self.pose, self.odom_from_base = compose(self.pose, step), compose(self.odom_from_base, step)
        self.twist = Twist2(*command)
        self.tick += 1

    def drive(self, node: Node, ticks: int) -> list[VelocityCommand]:
        """Drive in lockstep; the commands, each with the stamp of its readings."""
        commands = []
        for _ in range(ticks):
            self.sense()
            command, stamp = self.answer(node)
            assert stamp == self.stamp
            commands.append(command)
            self.move(command)
        return commands

    def answer(self, node: Node, seconds: float = 10.0) -> tuple[VelocityCommand, int]:
        """Let the node tick; its command and the command's stamp."""
        end = time.monotonic() + seconds
        while not node.pace.wait():
            assert time.monotonic() < end
        node.tick()
        while not (received := self.commands.take()):
            assert time.monotonic() < end
            self.transport.wait(0.05)
        message = received[-1].message
        twist, stamp = message.twist, message.header.stamp
        command = VelocityCommand(twist.linear.x, twist.linear.y, twist.angular.z)
        return command, stamp.sec * 1_000_000_000 + stamp.nanosec

    def place(self, start: Pose2 = START) -> None:
        """Say where the robot is."""
        message = new("geometry_msgs/msg/PoseWithCovarianceStamped", header=header_message(self.stamp, "map"))
        message.pose.pose = pose_message(start)
        self.start.publish(message)

    def send_goal(self, x: float, y: float, frame: str = "map") -> None:
        """Publish a goal."""
        self.goal.publish(pose_stamped_message(Pose2(x, y, 0.0), self.stamp, frame))


def still(commands: list[VelocityCommand]) -> bool:
    """Whether all commands are zero."""
    return all(command == STOP for command in commands)
