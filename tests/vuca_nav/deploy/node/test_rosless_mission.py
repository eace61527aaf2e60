"""A mission whose readings, goal and commands cross by software that is not ours: rosless."""

import math
import threading
import time
from typing import Any

import numpy as np
import pytest

from tests.vuca_nav.deploy.node.robot_side import HALL, bundle
from tests.vuca_nav.rooms import LIDAR, ranges_to_boxes
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.node.loop import Node, NodeConfig
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.geometry import compose, distance
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, Pose2

rosless = pytest.importorskip("rosless")
DOMAIN = 107
START, GOAL_FROM_START = Pose2(2.0, 2.0, 0.0), Pose2(3.0, 1.0, 0.0)
DT = 1.0 / 30.0


class Robot(threading.Thread):
    """A robot on rosless that does what cmd_vel says, and stops when it is older than 0.2 s."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        node = rosless.Node(domain=DOMAIN)
        self._scan = node.advertise("/scan", "sensor_msgs/msg/LaserScan", reliability="best_effort")
        self._odom = node.advertise("/odom", "nav_msgs/msg/Odometry")
        self._goal = node.advertise("/goal_pose", "geometry_msgs/msg/PoseStamped")
        self._commands = node.subscribe("/cmd_vel", "geometry_msgs/msg/TwistStamped")
        self._command, self._heard = (0.0, 0.0), 0.0
        self.pose, self.odom_from_base, self.is_over = START, STANDING, False
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while not self.is_over:
            message = self._commands.read()
            if message is not None:
                self._command, self._heard = (message.twist.linear.x, message.twist.angular.z), time.monotonic()

    def run(self) -> None:
        due, rng, is_told = time.monotonic(), np.random.default_rng(0), False
        began = due
        while not self.is_over:
            v_x, w_z = self._command if time.monotonic() - self._heard < 0.2 else (0.0, 0.0)
            self._say(v_x, w_z, ranges_to_boxes(HALL, self.pose) + rng.normal(0.0, 0.005, LIDAR.num_beams))
            if not is_told and self._goal.subscriber_count and due - began > 2.0:
                pose = _pose(GOAL_FROM_START)
                self._goal.send(rosless.Message("geometry_msgs/msg/PoseStamped", header=_header("map"), pose=pose))
                is_told = True
            step = Pose2(v_x * DT, 0.0, w_z * DT)
            self.pose, self.odom_from_base = compose(self.pose, step), compose(self.odom_from_base, step)
            due += DT
            time.sleep(max(due - time.monotonic(), 0.0))

    def _say(self, v_x: float, w_z: float, ranges: np.ndarray) -> None:
        twist = _message("Twist", linear=_message("Vector3", x=v_x), angular=_message("Vector3", z=w_z))
        odometry = rosless.Message(
            "nav_msgs/msg/Odometry",
            header=_header("odom"),
            child_frame_id="base_link",
            pose=_message("PoseWithCovariance", pose=_pose(self.odom_from_base)),
            twist=_message("TwistWithCovariance", twist=twist),
        )
        self._odom.send(odometry)
        scan = rosless.Message(
            "sensor_msgs/msg/LaserScan",
            header=_header("laser"),
            angle_min=-math.pi,
            angle_increment=2.0 * math.pi / LIDAR.num_beams,
            range_min=LIDAR.min_range,
            range_max=LIDAR.max_range,
            ranges=ranges.tolist(),
        )
        self._scan.send(scan)


def _message(name: str, **fields: Any) -> Any:
    return rosless.Message(f"geometry_msgs/msg/{name}", **fields)


def _pose(pose: Pose2) -> Any:
    turn = _message("Quaternion", z=math.sin(0.5 * pose.yaw), w=math.cos(0.5 * pose.yaw))
    return _message("Pose", position=_message("Point", x=pose.x, y=pose.y), orientation=turn)


def _header(frame: str) -> Any:
    now = time.time_ns()
    stamp = rosless.Message("builtin_interfaces/msg/Time", sec=now // 10**9, nanosec=now % 10**9)
    return rosless.Message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


@pytest.mark.slow
def test_a_robot_on_rosless_is_driven_to_its_goal() -> None:
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        made = Node(bundle(), transport, NodeConfig(), Telemetry(), NodeLog())
        robot = Robot()
        robot.start()
        goal = compose(START, GOAL_FROM_START)
        end = time.monotonic() + 90.0
        while distance(robot.pose, goal) > 0.1 and time.monotonic() < end:
            if made.pace.wait():
                made.tick()
        robot.is_over = True
        assert distance(robot.pose, goal) < 0.1
        assert transport.refusals.total == 0
