"""A Unitree Go2's topics, against a stand-in that speaks them."""

import json
import math
import time

import numpy as np
import pytest

from tests.vuca_nav.deploy.node.robot_side import bundle
from vuca_nav.deploy.messages import Refused, header_message
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.node.loop import Node, NodeConfig
from vuca_nav.deploy.node.unitree import MOVE, STOP_MOVE, UnitreeBase
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.interface import SENSOR
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.deploy.transport.ros_types import decode, encode, new
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, VelocityCommand

DOMAIN = 105
STATE = "unitree_go/msg/SportModeState"


def state(x: float, yaw: float) -> object:
    message = new(STATE, yaw_speed=0.5)
    message.position = np.array([x, 0.0, 0.3], np.float32)
    message.imu_state.quaternion = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)], np.float32)
    return message


def test_commands_are_requests_of_the_sport_service() -> None:
    base = UnitreeBase()
    message = decode(
        encode(base.command_message(VelocityCommand(0.5, -0.1, 0.3), 7), base.command_type), base.command_type
    )
    assert message.header.identity.api_id == MOVE
    assert json.loads(message.parameter) == {"x": 0.5, "y": -0.1, "z": 0.3}
    stop = base.command_message(STOP, 8)
    assert (stop.header.identity.api_id, stop.parameter, stop.header.identity.id) == (STOP_MOVE, "", 2)


def test_its_state_is_odometry() -> None:
    base = UnitreeBase()
    base.odometry(state(1.0, math.pi / 2), None)
    time.sleep(0.1)
    sensed = base.odometry(state(1.05, math.pi / 2), None)
    assert sensed.odom_from_base == pytest.approx((1.05, 0.0, math.pi / 2), abs=1e-6)
    assert -0.6 < sensed.twist.v_y < -0.2  # along x of odom is to its right
    assert abs(sensed.twist.v_x) < 1e-3
    assert sensed.twist.w_z == 0.5
    with pytest.raises(Refused, match="position"):
        base.odometry(state(math.nan, 0.0), None)
    broken = new(STATE)
    with pytest.raises(Refused, match="rotation"):
        base.odometry(broken, None)


@pytest.mark.slow  # in real time: a machine with other work needs many tries for a healthy second
def test_a_stand_in_is_driven_to_a_goal() -> None:
    with DdsTransport(NetworkConfig(DOMAIN)) as ours, DdsTransport(NetworkConfig(DOMAIN)) as theirs:
        made = Node(bundle(), ours, NodeConfig(base="unitree"), Telemetry(), NodeLog())
        states = theirs.advertise("/sportmodestate", STATE, SENSOR)
        scans = theirs.advertise("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        goal = theirs.advertise("goal_pose", "geometry_msgs/msg/PoseStamped")
        requests = theirs.subscribe("/api/sport/request", "unitree_api/msg/Request")
        end = time.monotonic() + 10.0
        while not (states.subscribers and scans.subscribers and goal.subscribers and requests.publishers):
            assert time.monotonic() < end
            time.sleep(0.01)
        target = new("geometry_msgs/msg/PoseStamped", header=header_message(1, "map"))
        target.pose.position.x, target.pose.orientation.w = 3.0, 1.0
        goal.publish(target)
        asked = []
        end, due = time.monotonic() + 60.0, time.monotonic()
        while time.monotonic() < end and MOVE not in asked:
            if time.monotonic() >= due:
                due += 1.0 / 30.0
                states.publish(state(1e-6 * len(asked), 0.0))
                scan = new(
                    "sensor_msgs/msg/LaserScan", header=header_message(time.time_ns(), "laser"), angle_min=-math.pi,
                    angle_increment=2.0 * math.pi / 360, range_min=0.1, range_max=12.0,
                    ranges=np.full(360, 6.0, np.float32) + 1e-3 * (len(asked) % 7),
                )  # fmt: skip
                scans.publish(scan)
            if made.pace.wait():
                made.tick()
            asked += [received.message.header.identity.api_id for received in requests.take()]
        assert asked[0] == STOP_MOVE
        assert asked[-1] == MOVE
