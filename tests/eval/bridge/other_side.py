"""The other side of a robot's topics, in the same process: a stack that answers each scan."""

import numpy as np

from eval.bridge.messages import (
    nanoseconds_of,
    odometry_transform,
)
from vuca_nav.deploy.messages import header_message, twist_message
from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transport.interface import LATCHED, Qos
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.geometry import compose, inverse
from vuca_nav.types import Odometry, Pose2, Scan, Twist2
from vuca_nav.wire import seconds, up_of, yaw_of

STAMPED = "geometry_msgs/msg/TwistStamped"


class OtherSide:
    """Answers each scan with a command of its stamp.

    Args:
        network: The network.
        decide: ``(scan, odometry) -> command``, with times of the mission; None: nobody answers.
        stack: A ``Stack`` instead, which is given start and goal.
    """

    def __init__(self, network, decide=None, stack=None):
        transport = network.join()
        self.decide, self.stack = decide, stack
        self.scans = transport.subscribe("scan", "sensor_msgs/msg/LaserScan")
        self.odoms = transport.subscribe("odom", "nav_msgs/msg/Odometry")
        self.clocks = transport.subscribe("/clock", "rosgraph_msgs/msg/Clock")
        self.places = transport.subscribe("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")
        self.goals = transport.subscribe("goal_pose", "geometry_msgs/msg/PoseStamped")
        self.maps = transport.subscribe("map", "nav_msgs/msg/OccupancyGrid", LATCHED)
        self.commands = transport.advertise("cmd_vel", STAMPED)
        self.tf = transport.advertise("/tf", "tf2_msgs/msg/TFMessage", Qos(depth=100))
        self.start, self.goal, self.began = Pose2(0.0, 0.0, 0.0), None, 0
        self.heard = []
        self.odometry = Odometry(0.0, self.start, Twist2(0.0, 0.0, 0.0))
        self.scans.notify = self.act

    def act(self):
        for received in self.places.take():
            self.start = planar(received.message.pose.pose)
        for received in self.goals.take():
            self.goal = received.message.pose.position.x, received.message.pose.position.y
            self.began = nanoseconds_of(received.message.header.stamp)
            if self.stack is not None:
                self.stack.reset(self.start, self.goal)
        for received in self.odoms.take():
            pose, twist = received.message.pose.pose, received.message.twist.twist
            stamp = seconds(nanoseconds_of(received.message.header.stamp) - self.began)
            velocity = Twist2(twist.linear.x, twist.linear.y, twist.angular.z)
            self.odometry = Odometry(stamp, planar(pose), velocity, up_of(turn_of(pose)))
        for received in self.scans.take():
            stamp = nanoseconds_of(received.message.header.stamp)
            scan = Scan(seconds(stamp - self.began), received.message.ranges.astype(np.float64))
            self.heard.append((stamp, scan, self.odometry))
            self.answer(stamp, scan)

    def answer(self, stamp, scan):
        decide = self.decide if self.stack is None else self.stack.step
        if decide is None:
            return
        command = decide(scan, self.odometry)
        if self.stack is not None:
            map_from_odom = compose(self.stack.map_from_base, inverse(self.odometry.odom_from_base))
            self.publish_transform(map_from_odom, stamp)
        self.send(command, stamp)

    def publish_transform(self, map_from_odom, stamp):
        frames = Frames(odom="map", base="odom")
        self.tf.publish(odometry_transform(Odometry(0.0, map_from_odom, Twist2(0.0, 0.0, 0.0)), stamp, frames))

    def send(self, command, stamp):
        self.commands.publish(new(STAMPED, header=header_message(stamp, "base_link"), twist=twist_message(command)))


def planar(pose):
    return Pose2(pose.position.x, pose.position.y, yaw_of(turn_of(pose)))


def turn_of(pose):
    turn = pose.orientation
    return turn.x, turn.y, turn.z, turn.w
