"""Two participants on loopback, and one of an implementation of RTPS that is not ours."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy
from cyclonedds.qos import Qos as DdsQos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.dds_types import idl_struct
from vuca_nav.deploy.transport.interface import LATCHED, SENSOR, Qos
from vuca_nav.deploy.transport.names import RosArguments, parse_ros_arguments
from vuca_nav.deploy.transport.network import NetworkConfig, network_of
from vuca_nav.deploy.transport.ros_types import BadMessage, decode, encode, new, type_hash
from vuca_nav.errors import BadArgument, UnknownName

DOMAIN = 101
"""Not one that robots use by default."""


@pytest.fixture
def transport() -> Iterator[DdsTransport]:
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        yield transport


@pytest.fixture
def other() -> Iterator[DdsTransport]:
    with DdsTransport(NetworkConfig(DOMAIN), RosArguments(node="other")) as transport:
        yield transport


def eventually(holds: Callable[[], object], seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(holds())


def scan(n: int = 360) -> object:
    header = new("std_msgs/msg/Header", stamp=new("builtin_interfaces/msg/Time", sec=3, nanosec=7), frame_id="laser")
    return new(
        "sensor_msgs/msg/LaserScan",
        header=header,
        angle_min=-3.0,
        angle_increment=0.01,
        range_max=12.0,
        ranges=np.linspace(0.1, 9.0, n, dtype=np.float32),
    )


def test_a_message_arrives_as_it_was_published(transport: DdsTransport, other: DdsTransport) -> None:
    publisher = transport.advertise("scan", "sensor_msgs/msg/LaserScan", SENSOR)
    subscriber = other.subscribe("/scan", "sensor_msgs/msg/LaserScan", SENSOR)
    assert eventually(lambda: publisher.subscribers == 1 and subscriber.publishers == 1)
    data = publisher.publish(scan())
    assert other.wait(2.0)
    (received,) = subscriber.take()
    assert received.data == data
    assert received.message.header.stamp.nanosec == 7
    assert received.message.header.frame_id == "laser"
    np.testing.assert_array_equal(received.message.ranges, np.linspace(0.1, 9.0, 360, dtype=np.float32))
    assert not other.wait(0.0)
    assert subscriber.take() == []


def test_a_late_subscriber_gets_a_latched_message(transport: DdsTransport, other: DdsTransport) -> None:
    publisher = transport.advertise("map", "std_msgs/msg/Bool", LATCHED)
    publisher.publish(new("std_msgs/msg/Bool", data=True))
    subscriber = other.subscribe("map", "std_msgs/msg/Bool", LATCHED)
    assert other.wait(5.0)
    assert [received.message.data for received in subscriber.take()] == [True]


def test_only_the_newest_command_waits(transport: DdsTransport, other: DdsTransport) -> None:
    publisher = transport.advertise("cmd_vel", "geometry_msgs/msg/Twist", Qos(depth=1))
    subscriber = other.subscribe("cmd_vel", "geometry_msgs/msg/Twist", Qos(depth=1))
    assert eventually(lambda: publisher.subscribers == 1)
    for speed in (0.1, 0.2, 0.3):
        publisher.publish(new("geometry_msgs/msg/Twist", linear=new("geometry_msgs/msg/Vector3", x=speed)))
    assert publisher.flush(2.0)
    assert [received.message.linear.x for received in subscriber.take()] == [0.3]


def test_a_second_publisher_is_found_and_seen_to_go(transport: DdsTransport) -> None:
    own = transport.advertise("cmd_vel", "geometry_msgs/msg/Twist")
    assert eventually(lambda: len(transport.publishers("cmd_vel")) == 1)
    with DdsTransport(NetworkConfig(DOMAIN)) as second:
        publisher = second.advertise("cmd_vel", "geometry_msgs/msg/TwistStamped")
        assert eventually(lambda: len(transport.publishers("cmd_vel")) == 2)
        (foreign,) = [endpoint for endpoint in transport.publishers("cmd_vel") if not endpoint.is_own]
        assert foreign.type_name == "geometry_msgs/msg/TwistStamped"
        assert foreign.type_hash == type_hash("geometry_msgs/msg/TwistStamped")
        assert publisher.subscribers == own.subscribers == 0
    assert eventually(lambda: len(transport.publishers("cmd_vel")) == 1)


def test_it_tells_which_node_has_its_endpoints() -> None:
    kind = "rmw_dds_common/msg/ParticipantEntitiesInfo"
    with DdsTransport(NetworkConfig(DOMAIN), RosArguments(node="other", namespace="/robot1")) as transport:
        publisher = transport.advertise("scan", "sensor_msgs/msg/LaserScan")
        participant = DomainParticipant(DOMAIN)
        topic = Topic(participant, "ros_discovery_info", idl_struct(kind))
        reader = DataReader(
            participant, topic, DdsQos(Policy.Reliability.Reliable(0), Policy.Durability.TransientLocal)
        )
        told = []
        assert eventually(lambda: told.extend(reader.take(1)) or told)
        (node,) = told[0].node_entities_info_seq
        assert (node.node_namespace, node.node_name) == ("/robot1", "other")
        assert len(node.writer_gid_seq) == 1
        assert publisher.subscribers == 0


def test_another_type_is_not_heard(transport: DdsTransport, other: DdsTransport) -> None:
    subscriber = transport.subscribe("scan", "sensor_msgs/msg/LaserScan", SENSOR)
    publisher = other.advertise("scan", "sensor_msgs/msg/Imu", SENSOR)
    assert eventually(lambda: len(transport.publishers("scan")) == 1)
    time.sleep(0.3)
    assert subscriber.publishers == 0
    assert publisher.subscribers == 0


def test_a_service_answers_its_caller_alone(transport: DdsTransport, other: DdsTransport) -> None:
    kind = "nav2_msgs/action/NavigateToPose_SendGoal"
    service = transport.serve("go/_action/send_goal", kind)
    clients = [other.client("go/_action/send_goal", kind) for _ in range(2)]
    assert eventually(lambda: all(client.is_served for client in clients))
    request = new(f"{kind}_Request")
    request.goal.behavior_tree = "tree"
    number = clients[0].call(request)
    requests = []
    assert eventually(lambda: requests.extend(service.take()) or requests)
    assert requests[0].message.goal.behavior_tree == "tree"
    service.reply(requests[0], new(f"{kind}_Response", accepted=True))
    answers = []
    assert eventually(lambda: answers.extend(clients[0].take()) or answers)
    assert answers[0][0] == number
    assert answers[0][1].accepted
    assert clients[1].take() == []


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "not a message"),
        (b"\x00\x01\x00\x00", "not a message"),
        (b"\x00\x07" + bytes(80), "not a message"),  # XCDR2
        (b"\x00\x01\x00\x00" + b"\xff" * 200, "not a message"),  # lengths of 4 GB
        (bytes(2 << 20), "larger"),
    ],
)
def test_bytes_that_are_no_scan_are_refused(data: bytes, reason: str) -> None:
    with pytest.raises(BadMessage, match=reason):
        decode(data, "sensor_msgs/msg/LaserScan")


def test_encoding_and_decoding_give_the_same_message() -> None:
    message = new("nav_msgs/msg/Odometry", child_frame_id="base_link")
    message.pose.covariance[7] = 0.25
    copy = decode(encode(message, "nav_msgs/msg/Odometry"), "nav_msgs/msg/Odometry")
    assert copy.child_frame_id == "base_link"
    np.testing.assert_array_equal(copy.pose.covariance, message.pose.covariance)


def test_names_follow_namespace_and_remapping() -> None:
    words = [
        "-r",
        "__ns:=/robot1",
        "-r",
        "scan:=/front/scan",
        "-r",
        "cmd_vel:=twist",
        "-r",
        "other:odom:=x",
        "-p",
        "use_sim_time:=true",
    ]
    ros = parse_ros_arguments(words, "vuca_deploy")
    assert ros.use_sim_time
    assert ros.full_name("scan") == "/front/scan"
    assert ros.full_name("cmd_vel") == "/robot1/twist"
    assert ros.full_name("odom") == "/robot1/odom"
    assert ros.full_name("/tf") == "/tf"
    assert ros.full_name("~/stop") == "/robot1/vuca_deploy/stop"


@pytest.mark.parametrize(
    "words", [["-r", "scan"], ["-r", "a b:=c"], ["-p", "speed:=2"], ["--remap"], ["-x", "a:=b"], ["-r", "__ns:=a-b"]]
)
def test_bad_ros_arguments_are_named(words: list[str]) -> None:
    with pytest.raises(BadArgument, match="--ros-args"):
        parse_ros_arguments(words, "node")


def test_the_network_is_that_of_the_ros_variables() -> None:
    assert network_of(environment={}) == NetworkConfig(0, None)
    assert network_of(environment={"ROS_DOMAIN_ID": "7"}).domain == 7
    assert network_of(3, environment={"ROS_DOMAIN_ID": "7"}).domain == 3
    with pytest.raises(BadArgument, match="ROS_DOMAIN_ID"):
        network_of(environment={"ROS_DOMAIN_ID": "seven"})
    with pytest.raises(BadArgument, match="232"):
        network_of(233, environment={})
    with pytest.raises(UnknownName, match="network interface"):
        network_of(0, "nonesuch0", environment={})
    with pytest.raises(BadArgument, match="ROS_LOCALHOST_ONLY"):
        network_of(0, "eth0", environment={"ROS_LOCALHOST_ONLY": "1"})
    assert network_of(environment={}).warning is None
    assert "CYCLONEDDS_URI" in (network_of(environment={"CYCLONEDDS_URI": "<x/>"}).warning or "")
