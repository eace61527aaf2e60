"""The topics as software that is not ours sees them: rosless has an implementation of RTPS and CDR of its own."""

import time
from collections.abc import Callable

import numpy as np
import pytest

from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.interface import SENSOR
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.deploy.transport.ros_types import decode, encode, fields_of, new

rosless = pytest.importorskip("rosless")
DOMAIN = 102


def eventually(holds: Callable[[], object], seconds: float = 15.0) -> bool:
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.05)
    return bool(holds())


def test_it_finds_our_topics_and_services_and_reads_our_scan() -> None:
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        publisher = transport.advertise("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        service = transport.serve("navigate_to_pose/_action/cancel_goal", "action_msgs/srv/CancelGoal")
        node = rosless.Node(domain=DOMAIN)
        subscription = node.subscribe("/scan", "sensor_msgs/msg/LaserScan")
        assert eventually(lambda: publisher.subscribers == 1)

        def found() -> bool:
            graph = node.graph()
            topics = {(topic.name, topic.type_name) for topic in graph.topics}
            services = {(topic.name, topic.type_name) for topic in graph.services}
            return ("/scan", "sensor_msgs/msg/LaserScan") in topics and (
                "/navigate_to_pose/_action/cancel_goalRequest",
                "action_msgs/srv/CancelGoal_Request",
            ) in services

        assert eventually(found)
        ranges = np.linspace(0.5, 9.0, 271, dtype=np.float32)
        for _ in range(20):  # best effort
            publisher.publish(new("sensor_msgs/msg/LaserScan", ranges=ranges, angle_min=-2.35))
            time.sleep(0.01)
        message = subscription.read()
        np.testing.assert_array_equal(np.asarray(message.ranges, np.float32), ranges)
        assert service.take() == []


def test_we_hear_its_scan() -> None:
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        subscriber = transport.subscribe("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        publisher = rosless.Node(domain=DOMAIN).advertise(
            "/scan", "sensor_msgs/msg/LaserScan", reliability="best_effort"
        )
        assert eventually(lambda: publisher.subscriber_count == 1 and subscriber.publishers == 1)
        received = []

        def heard() -> bool:
            publisher.send(rosless.Message("sensor_msgs/msg/LaserScan", ranges=[1.5, 2.5], range_max=4.0))
            transport.wait(0.2)
            received.extend(subscriber.take())
            return bool(received)

        assert eventually(heard)
        assert received[0].message.ranges.tolist() == [1.5, 2.5]
        assert received[0].message.range_max == 4.0


@pytest.mark.parametrize(
    "type_name",
    [
        "sensor_msgs/msg/LaserScan",
        "sensor_msgs/msg/Imu",
        "nav_msgs/msg/Odometry",
        "nav_msgs/msg/OccupancyGrid",
        "nav_msgs/msg/Path",
        "geometry_msgs/msg/TwistStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "tf2_msgs/msg/TFMessage",
        "diagnostic_msgs/msg/DiagnosticArray",
        "visualization_msgs/msg/MarkerArray",
        "rosgraph_msgs/msg/Clock",
    ],
)
def test_its_encoding_of_an_empty_message_is_ours(type_name: str) -> None:
    if type_name not in rosless.type_names():
        pytest.skip("not in its catalogue")
    theirs = bytes(rosless.encode(type_name, rosless.Message(type_name)))
    ours = encode(new(type_name), type_name)
    assert ours.rstrip(b"\0")[4:] == theirs.rstrip(b"\0")[4:]
    assert decode(theirs, type_name).__class__ is new(type_name).__class__
    assert [name for name, _ in fields_of(type_name)] == [field.name for field in rosless.lookup(type_name).fields]
