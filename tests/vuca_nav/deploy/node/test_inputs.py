import math

import pytest

from eval.bridge.messages import imu_message, odometry_message
from tests.vuca_nav.deploy.bundles import body
from tests.vuca_nav.deploy.loopback import Network
from tests.vuca_nav.rooms import LIDAR
from vuca_nav.deploy.node.base import RosBase
from vuca_nav.deploy.node.inputs import Inputs
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.robot_file import Frames, robot_file_of
from vuca_nav.types import Odometry, Pose2, Twist2
from vuca_nav.wire import round_odometry


@pytest.mark.parametrize("overtaken", ["scan", "odom", "imu"])
def test_odometry_has_the_vertical_that_was_sent_before_it_whenever_messages_are_taken(overtaken):
    network = Network()
    robot = network.join()
    imu, odom = robot.advertise("imu", "sensor_msgs/msg/Imu"), robot.advertise("odom", "nav_msgs/msg/Odometry")
    described = robot_file_of(body(), LIDAR)
    base = RosBase(described, stamped=True)
    inputs = Inputs(network.join(), described, base, NodeLog(), use_sim_time=False)
    leaning = []

    def sense(lean):
        up = (-math.sin(lean), 0.0, math.cos(lean))
        odometry = round_odometry(Odometry(0.0, Pose2(lean, 0.0, 0.0), Twist2(0.0, 0.0, 0.0), up))
        leaning.append(odometry.up)
        imu.publish(imu_message(odometry, 10 + len(leaning), Frames()))
        level = Odometry(0.0, odometry.odom_from_base, odometry.twist)
        odom.publish(odometry_message(level, 10 + len(leaning), Frames()))

    sense(0.1)
    inputs.take()
    assert inputs.odometry is not None
    assert inputs.odometry.up == leaning[0]
    (subscriber,) = [s for s in network.subscribers if s.topic == f"/{overtaken}"]
    take = subscriber.take

    def take_and_let_more_come():
        taken = take()
        subscriber.take = take
        sense(0.2)
        return taken

    subscriber.take = take_and_let_more_come
    for _ in range(2):
        inputs.take()
        assert inputs.odometry.up == leaning[inputs.odometry.stamp - 11]
    assert inputs.odometry.stamp == 12
