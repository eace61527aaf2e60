"""The transport on Zenoh: keys, tokens and attachments as rmw_zenoh has them, and what the interface promises."""

import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from vuca_nav.deploy.transport.interface import COMMAND, LATCHED, SENSOR, NetworkError, Qos
from vuca_nav.deploy.transport.names import RosArguments
from vuca_nav.deploy.transport.ros_types import decode, encode, new
from vuca_nav.deploy.transport.zenoh import CONFIG_VARIABLE, ZenohTransport
from vuca_nav.deploy.transport.zenoh_format import qos_text

TWIST, BOOL = "geometry_msgs/msg/Twist", "std_msgs/msg/Bool"
TWIST_KEY = "geometry_msgs::msg::dds_::Twist_/RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
SERVICE = "action_msgs/srv/CancelGoal"


def eventually(condition: Callable[[], object], seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def twist(speed: float):
    return new(TWIST, linear=new("geometry_msgs/msg/Vector3", x=speed))


def config(mode: str, **endpoints: list[str]) -> zenoh.Config:
    parts = {name: {"endpoints": places} for name, places in endpoints.items()}
    text = {"mode": mode, "scouting": {"multicast": {"enabled": False}}, "timestamping": {"enabled": True}, **parts}
    return zenoh.Config.from_json5(json.dumps(text))


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        place = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with zenoh.open(config("router", listen=[place])):
        yield place


@pytest.fixture
def environment(router: str, tmp_path: Path) -> dict[str, str]:
    text = {"mode": "peer", "connect": {"endpoints": [router]}, "listen": {"endpoints": ["tcp/127.0.0.1:0"]}}
    text |= {"scouting": {"multicast": {"enabled": False}}, "timestamping": {"enabled": True}}
    (tmp_path / "session.json5").write_text(json.dumps(text))
    return {CONFIG_VARIABLE: str(tmp_path / "session.json5")}


@pytest.fixture
def transport(environment: dict[str, str]) -> Iterator[ZenohTransport]:
    with ZenohTransport(7, environment=environment) as transport:
        yield transport


@pytest.fixture
def other(environment: dict[str, str]) -> Iterator[ZenohTransport]:
    with ZenohTransport(7, RosArguments(node="other", namespace="/b"), environment) as transport:
        yield transport


@pytest.fixture
def stranger(router: str) -> Iterator[zenoh.Session]:
    """A session that knows nothing of this project."""
    with zenoh.open(config("client", connect=[router])) as session:
        yield session


def test_a_message_crosses_and_is_waited_for(transport: ZenohTransport, other: ZenohTransport) -> None:
    publisher, subscriber = transport.advertise("/scan", TWIST), other.subscribe("/scan", TWIST, SENSOR)
    assert eventually(lambda: publisher.subscribers == 1 and subscriber.publishers == 1)
    assert not other.wait(0.0)
    before = time.time_ns()
    data = publisher.publish(twist(0.5))
    assert other.wait(10.0)
    (received,) = subscriber.take()
    assert (received.data, received.message.linear.x) == (data, 0.5)
    assert before <= received.sent <= time.time_ns()
    assert subscriber.take() == []


def test_a_late_subscriber_gets_a_latched_message(transport: ZenohTransport, other: ZenohTransport) -> None:
    transport.advertise("/map", BOOL, LATCHED).publish(new(BOOL, data=True))
    subscriber = other.subscribe("/map", BOOL, LATCHED)
    assert other.wait(10.0)
    assert [received.message.data for received in subscriber.take()] == [True]


def test_only_as_many_wait_as_the_depth_says(transport: ZenohTransport, other: ZenohTransport) -> None:
    publisher, subscriber = transport.advertise("/cmd_vel", TWIST), other.subscribe("/cmd_vel", TWIST, Qos(depth=1))
    last = other.subscribe("/last", TWIST)
    done = transport.advertise("/last", TWIST)
    assert eventually(lambda: publisher.subscribers == 1 and done.subscribers == 1)
    for speed in (0.1, 0.2, 0.3):
        publisher.publish(twist(speed))
    done.publish(twist(0.0))
    assert eventually(last.take)
    assert [received.message.linear.x for received in subscriber.take()] == [0.3]


def test_a_second_publisher_is_found_and_seen_to_go(transport: ZenohTransport, environment: dict[str, str]) -> None:
    transport.advertise("/cmd_vel", TWIST)
    assert eventually(lambda: len(transport.publishers("/cmd_vel")) == 1)
    with ZenohTransport(7, environment=environment) as second:
        second.advertise("/cmd_vel", "geometry_msgs/msg/TwistStamped")
        assert eventually(lambda: len(transport.publishers("/cmd_vel")) == 2)
        (foreign,) = [each for each in transport.publishers("/cmd_vel") if not each.is_own]
        assert (foreign.topic, foreign.type_name) == ("/cmd_vel", "geometry_msgs/msg/TwistStamped")
    assert eventually(lambda: [each.is_own for each in transport.publishers("/cmd_vel")] == [True])


@pytest.mark.parametrize("_again", range(4))
def test_what_is_published_last_arrives_though_its_publisher_leaves_at_once(
    other: ZenohTransport, environment: dict[str, str], _again: int
) -> None:
    """As the zero command of a stack that is ended."""
    subscriber, received = other.subscribe("/cmd_vel", TWIST, Qos(depth=100)), []
    with ZenohTransport(7, environment=environment) as leaving:
        publisher = leaving.advertise("/cmd_vel", TWIST, COMMAND)
        assert eventually(lambda: publisher.publish(twist(0.5)) and other.wait(0.1))
        for _ in range(3):
            publisher.publish(twist(0.0))
        assert publisher.flush(0.2)
    assert eventually(lambda: received.extend(subscriber.take()) or not other.wait(0.2))
    assert [each.message.linear.x for each in received][-3:] == [0.0, 0.0, 0.0]


def test_domains_do_not_see_each_other(transport: ZenohTransport, environment: dict[str, str]) -> None:
    subscriber = transport.subscribe("/a", BOOL)
    with ZenohTransport(8, environment=environment) as elsewhere:
        publisher = elsewhere.advertise("/a", BOOL)
        publisher.publish(new(BOOL, data=True))
        assert not transport.wait(0.3)
        assert (subscriber.publishers, publisher.subscribers) == (0, 0)


def test_a_service_answers_who_asked(transport: ZenohTransport, other: ZenohTransport) -> None:
    service, client = transport.serve("/cancel", SERVICE), other.client("/cancel", SERVICE)
    assert eventually(lambda: client.is_served)
    infos = [new("action_msgs/msg/GoalInfo", stamp=new("builtin_interfaces/msg/Time", sec=sec)) for sec in (3, 4)]
    numbers = [client.call(new(f"{SERVICE}_Request", goal_info=info)) for info in infos]
    requests: list = []
    assert eventually(lambda: requests.extend(service.take()) or len(requests) == 2)
    for request in requests:
        service.reply(request, new(f"{SERVICE}_Response", return_code=request.message.goal_info.stamp.sec))
    answers: list = []
    assert eventually(lambda: answers.extend(client.take()) or len(answers) == 2)
    assert {number: message.return_code for number, message in answers} == dict(zip(numbers, (3, 4), strict=True))


def test_a_stranger_reads_the_key_the_message_and_the_attachment(
    transport: ZenohTransport, stranger: zenoh.Session
) -> None:
    heard = stranger.declare_subscriber("7/**")
    publisher, samples, before = transport.advertise("cmd_vel", TWIST), [], time.time_ns()

    def publish() -> bool:  # the first ones are before the stranger is known
        publisher.publish(twist(0.1))
        time.sleep(0.05)
        samples.extend(iter(heard.try_recv, None))
        return len(samples) >= 2

    assert eventually(publish)
    assert {str(sample.key_expr) for sample in samples} == {f"7/cmd_vel/{TWIST_KEY}"}
    assert {decode(sample.payload.to_bytes(), TWIST).linear.x for sample in samples} == {0.1}
    attachments = [sample.attachment.to_bytes() for sample in samples if sample.attachment is not None]
    assert {len(attachment) for attachment in attachments} == {33}
    (first, *_), (second, *_) = fields = [struct.unpack("<qqB16s", attachment) for attachment in attachments[:2]]
    assert second == first + 1
    assert before <= fields[0][1] <= fields[1][1] <= time.time_ns()
    assert [length for _, _, length, _ in fields] == [16, 16]
    assert fields[0][3] == fields[1][3] != bytes(16)


def test_a_stranger_reads_the_tokens(other: ZenohTransport, stranger: zenoh.Session) -> None:
    other.advertise("cmd_vel", TWIST)
    other.subscribe("/map", BOOL, LATCHED)
    zid = str(other.session.zid())
    wanted = {
        f"@ros2_lv/7/{zid}/0/0/NN/%/%b/other",
        f"@ros2_lv/7/{zid}/0/1/MP/%/%b/other/%b%cmd_vel/{TWIST_KEY}/::,10:,:,:,,",
        f"@ros2_lv/7/{zid}/0/2/MS/%/%b/other/%map/std_msgs::msg::dds_::Bool_/"
        "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9/:1:,1:,:,:,,",
    }

    def tokens() -> set[str]:
        replies = stranger.liveliness().get(f"@ros2_lv/7/{zid}/**", timeout=2.0)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    assert eventually(lambda: tokens() == wanted)


def test_the_quality_of_service_is_told_as_rmw_zenoh_tells_it() -> None:
    assert qos_text(SENSOR) == "2::,5:,:,:,,"
    assert qos_text(LATCHED) == ":1:,1:,:,:,,"
    assert qos_text(Qos(depth=42)) == "::,:,:,:,,"


@pytest.mark.parametrize(
    ("payload", "attachment", "reason"),
    [
        (b"", None, "without the attachment of rmw_zenoh"),
        (encode(twist(1.0), TWIST), b"x" * 33, "without the attachment of rmw_zenoh"),
        (b"\x00\x01", struct.pack("<qqB16s", 1, 1, 16, b"g" * 16), "not a message of its type"),
        (bytes(1 << 20), struct.pack("<qqB16s", 1, 1, 16, b"g" * 16), "larger than a message of its type may be"),
    ],
)
def test_what_is_no_message_is_refused_and_counted(
    transport: ZenohTransport, stranger: zenoh.Session, payload: bytes, attachment: bytes | None, reason: str
) -> None:
    subscriber = transport.subscribe("/cmd_vel", TWIST)

    def put() -> bool:
        stranger.put(f"7/cmd_vel/{TWIST_KEY}", payload, attachment=attachment)
        return transport.wait(0.2)

    assert eventually(put)
    assert subscriber.take() == []
    assert set(transport.refusals.counts) == {("/cmd_vel", reason)}


def test_without_a_router_one_line_says_what_to_start(tmp_path: Path) -> None:
    text = {"mode": "peer", "connect": {"endpoints": ["tcp/127.0.0.1:1"], "timeout_ms": 100, "exit_on_failure": True}}
    (tmp_path / "none.json5").write_text(json.dumps(text | {"scouting": {"multicast": {"enabled": False}}}))
    with pytest.raises(NetworkError, match="zenoh_router"):
        ZenohTransport(7, environment={CONFIG_VARIABLE: str(tmp_path / "none.json5")})
