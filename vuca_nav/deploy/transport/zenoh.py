"""The transport on Zenoh: what rmw_zenoh speaks since Jazzy, by its sources (github.com/ros2/rmw_zenoh).

Sessions find each other by a router, ``ros2 run rmw_zenoh_cpp rmw_zenohd`` or ``python -m
vuca_nav.deploy.transport.zenoh_router``. Not tried beside rmw_zenoh itself.
"""

import itertools
import json
import os
import struct
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from typing import Any

import zenoh
from zenoh.ext import (
    CacheConfig,
    HistoryConfig,
    MissDetectionConfig,
    RecoveryConfig,
    declare_advanced_publisher,
    declare_advanced_subscriber,
)

from vuca_nav.deploy.transport.interface import (
    RELIABLE,
    SERVICES,
    Client,
    Endpoint,
    NetworkError,
    Publisher,
    Qos,
    Received,
    Refusals,
    Request,
    Service,
    Subscriber,
    Transport,
    check_type,
)
from vuca_nav.deploy.transport.names import UNCHANGED, RosArguments, dds_type, ros_type
from vuca_nav.deploy.transport.ros_types import BadMessage, decode, encode, type_hash
from vuca_nav.deploy.transport.zenoh_format import (
    ADMIN,
    GID,
    KIND,
    PARTS,
    TOPIC,
    Attached,
    attached,
    gid_of,
    mangled,
    qos_text,
)

ROUTER = "tcp/localhost:7447"
"""Where rmw_zenoh's sessions look for their router."""
CONFIG_VARIABLE = "ZENOH_SESSION_CONFIG_URI"
"""Environment variable of rmw_zenoh: a file with a session's configuration."""
HEARTBEAT = 0.5
"""Period in which a latched publisher tells its last number [s], as rmw_zenoh's does."""
_LONGEST_CALL = 3600.0
"""Time after which a request is given up [s]: the result of an action takes as long as the drive."""
_MOST_REQUESTS = 200
"""Greatest number of requests that wait for their replies; the oldest is then left without one."""
_MOST_TOKENS = 4096
"""Greatest number of tokens that are remembered, so that announcements cannot fill the memory."""


class ZenohTransport(Transport):
    """A session in a ROS 2 network on Zenoh.

    Args:
        domain: ROS domain: sessions of different ones do not see each other's topics.
        ros: Name, namespace and remappings of the node.
        environment: Environment variables; ``ZENOH_SESSION_CONFIG_URI`` names a configuration of one's own.

    Raises:
        NetworkError: If there is no router, or the configuration cannot be used.
    """

    def __init__(self, domain: int, ros: RosArguments = UNCHANGED, environment: Mapping[str, str] = os.environ):
        self.ros, self.refusals, self._domain = ros, Refusals(), domain
        own = environment.get(CONFIG_VARIABLE)
        try:
            config = zenoh.Config.from_json5(json.dumps(_CONFIG)) if not own else zenoh.Config.from_file(own)
            self.session = zenoh.open(config)
        except zenoh.ZError as error:
            where = f"{CONFIG_VARIABLE}={own}" if own else f"a Zenoh router at {ROUTER}"
            raise NetworkError(
                f"cannot join by {where}: {error}. Start ros2 run rmw_zenoh_cpp rmw_zenohd, or python -m "
                "vuca_nav.deploy.transport.zenoh_router"
            ) from None
        self._id = str(self.session.zid())
        self._arrival = threading.Event()
        self._inboxes: list[deque[Any]] = []
        self._entities = itertools.count(1)
        self._kept: list[Any] = []  # what is declared lasts as long as it is held
        self._tokens: OrderedDict[str, list[str]] = OrderedDict()
        self._token("NN")
        graph = self.session.liveliness().declare_subscriber(f"{ADMIN}/{domain}/**", self._note, history=True)
        self._kept.append(graph)

    def full_name(self, name: str) -> str:
        """The full ROS name of a name of this node."""
        return self.ros.full_name(name)

    def advertise(self, topic: str, type_name: str, qos: Qos = RELIABLE) -> "ZenohPublisher":
        """Announce a topic and return its publisher."""
        check_type(type_name)
        key = self._key(topic, type_name)
        reliability = zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT
        options: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.DROP, "reliability": reliability}
        if qos.transient_local:
            options |= {"cache": CacheConfig(qos.depth), "publisher_detection": True}
            if qos.reliable:
                detection = MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT)
                options["sample_miss_detection"] = detection
        publisher = declare_advanced_publisher(self.session, key, **options)
        self._kept.append(publisher)
        token = self._token("MP", topic, type_name, qos)
        return ZenohPublisher(publisher, type_name, gid_of(token), lambda: self._count("MS", topic, type_name))

    def subscribe(self, topic: str, type_name: str, qos: Qos = RELIABLE) -> "ZenohSubscriber":
        """Subscribe to a topic."""
        check_type(type_name)
        inbox = self._inbox(qos.depth)
        options: dict[str, Any] = {}
        if qos.transient_local:
            options = {
                "history": HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
                "subscriber_detection": True,
            }
            if qos.reliable:
                options["recovery"] = RecoveryConfig(periodic_queries=None, heartbeat=True)
        take = self._taker(inbox)
        self._kept.append(declare_advanced_subscriber(self.session, self._key(topic, type_name), take, **options))
        self._token("MS", topic, type_name, qos)
        name = self.full_name(topic)
        return ZenohSubscriber(inbox, name, type_name, self.refusals, lambda: self._count("MP", topic, type_name))

    def serve(self, name: str, type_name: str) -> "ZenohService":
        """Serve a service."""
        inbox, key = self._inbox(SERVICES.depth), self._key(name, type_name)
        self._kept.append(self.session.declare_queryable(key, self._taker(inbox), complete=True))
        self._token("SS", name, type_name, SERVICES)
        return ZenohService(inbox, key, self.full_name(name), type_name, self.refusals)

    def client(self, name: str, type_name: str) -> "ZenohClient":
        """Make a client of a service."""
        gid, inbox = gid_of(self._token("SC", name, type_name, SERVICES)), self._inbox(SERVICES.depth)
        key, take = self._key(name, type_name), self._taker(inbox)

        def ask(data: bytes, attachment: bytes) -> None:
            self.session.get(
                key, take, target=zenoh.QueryTarget.ALL_COMPLETE, consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_LONGEST_CALL, payload=data, attachment=attachment,
            )  # fmt: skip

        served: Callable[[], int] = lambda: self._count("SS", name, type_name)  # noqa: E731
        return ZenohClient(ask, inbox, self.full_name(name), type_name, gid, (self.refusals, served))

    def wait(self, timeout: float) -> bool:
        """Wait until something waits to be taken, at most ``timeout`` [s]; whether something does."""
        self._arrival.clear()
        if any(self._inboxes):
            return True
        self._arrival.wait(max(0.0, timeout))
        return any(self._inboxes)

    def publishers(self, topic: str) -> tuple[Endpoint, ...]:
        """All publishers of a topic that have been found."""
        name = mangled(self.full_name(topic))
        return tuple(
            Endpoint(key, parts[TOPIC].replace("%", "/"), ros_type(parts[TOPIC + 1]), parts[TOPIC + 2],
                     parts[2] == self._id)
            for key, parts in list(self._tokens.items()) if parts[KIND] == "MP" and parts[TOPIC] == name
        )  # fmt: skip

    def close(self) -> None:
        """Leave the network."""
        self.session.close()

    def _key(self, name: str, type_name: str) -> str:
        """Key of a topic or service."""
        topic = self.full_name(name).strip("/")
        return f"{self._domain}/{topic}/{dds_type(type_name)}/{type_hash(type_name)}"

    def _token(self, kind: str, name: str | None = None, type_name: str = "", qos: Qos = RELIABLE) -> str:
        """Declare the token of an entity; its key."""
        number = 0 if name is None else next(self._entities)
        ros = self.ros
        parts = [ADMIN, self._domain, self._id, 0, number, kind, "%", mangled(ros.namespace), mangled(ros.node)]
        if name is not None:
            parts += [mangled(self.full_name(name)), dds_type(type_name), type_hash(type_name), qos_text(qos)]
        key = "/".join(map(str, parts))
        self._kept.append(self.session.liveliness().declare_token(key))
        return key

    def _note(self, sample: zenoh.Sample) -> None:
        """Note that an entity has come or gone."""
        key = str(sample.key_expr)
        parts = key.split("/")
        if sample.kind == zenoh.SampleKind.DELETE:
            self._tokens.pop(key, None)
        elif len(parts) == PARTS and len(self._tokens) < _MOST_TOKENS:
            self._tokens[key] = parts

    def _count(self, kind: str, name: str, type_name: str) -> int:
        """Number of entities of a kind for a topic or service of a type."""
        wanted = [mangled(self.full_name(name)), dds_type(type_name), type_hash(type_name)]
        tokens = list(self._tokens.values())
        return sum(parts[KIND] == kind and parts[TOPIC : TOPIC + 3] == wanted for parts in tokens)

    def _inbox(self, depth: int) -> deque[Any]:
        inbox: deque[Any] = deque(maxlen=depth)
        self._inboxes.append(inbox)
        return inbox

    def _taker(self, inbox: deque[Any]) -> Callable[[Any], None]:
        """What Zenoh calls, from a thread of its own, for each thing that comes."""

        def take(thing: Any) -> None:
            inbox.append(thing)
            self._arrival.set()

        return take


class ZenohPublisher(Publisher):
    """A Zenoh publisher of encoded messages."""

    def __init__(self, publisher: Any, type_name: str, gid: bytes, count: Callable[[], int]):
        self._publisher, self._type_name, self._gid, self._count = publisher, type_name, gid, count
        self._number = 0

    def publish(self, message: Any) -> bytes:
        """Publish a message; returns it as it was sent."""
        data = encode(message, self._type_name)
        self._number += 1
        attachment = Attached(self._number, time.time_ns(), self._gid).encoded()
        try:
            self._publisher.put(data, attachment=attachment)
        except zenoh.ZError as error:
            raise NetworkError(f"cannot publish {len(data)} bytes of {self._type_name}: {error}") from None
        return data

    @property
    def subscribers(self) -> int:
        """Number of subscribers that it reaches now."""
        return self._count()

    def flush(self, timeout: float) -> bool:
        """Nothing to wait for: Zenoh hands over what is published, and tells of no arrival."""
        return True


class ZenohSubscriber(Subscriber):
    """A Zenoh subscriber of messages that are decoded as they are taken."""

    def __init__(self, inbox: deque[Any], topic: str, type_name: str, refusals: Refusals, count: Callable[[], int]):
        self._inbox, self._topic, self._type_name = inbox, topic, type_name
        self._refusals, self._count = refusals, count

    def take(self) -> list[Received]:
        """What has arrived since the last call, oldest first."""
        received = []
        for _ in range(len(self._inbox)):
            sample = self._inbox.popleft()
            try:
                about, data = attached(sample), sample.payload.to_bytes()
                message = decode(data, self._type_name)
            except BadMessage as error:
                self._refusals.add(self._topic, str(error))
            else:
                received.append(Received(message, data, int.from_bytes(about.gid[:8], "little"), about.time))
        return received

    @property
    def publishers(self) -> int:
        """Number of publishers that it hears now."""
        return self._count()


class ZenohService(Service):
    """The server's end of a service: a queryable."""

    def __init__(self, inbox: deque[Any], key: str, name: str, type_name: str, refusals: Refusals):
        self._inbox, self._key, self._name, self._type_name, self._refusals = inbox, key, name, type_name, refusals
        self._waiting: OrderedDict[bytes, Any] = OrderedDict()

    def take(self) -> list[Request]:
        """The requests that have arrived since the last call."""
        requests = []
        for _ in range(len(self._inbox)):
            query = self._inbox.popleft()
            try:
                about = attached(query)
                data = b"" if query.payload is None else query.payload.to_bytes()
                message = decode(data, f"{self._type_name}_Request")
            except BadMessage as error:
                self._refusals.add(self._name, str(error))
                query.drop()
                continue
            address = about.gid + struct.pack("<q", about.number)
            self._waiting[address] = query
            if len(self._waiting) > _MOST_REQUESTS:
                self._waiting.popitem(last=False)[1].drop()
            requests.append(Request(message, address))
        return requests

    def reply(self, request: Request, response: Any) -> None:
        """Answer a request; one whose client has waited too long is not."""
        query = self._waiting.pop(request.reply_to, None)
        if query is None:
            return
        (number,) = struct.unpack("<q", request.reply_to[GID:])
        attachment = Attached(number, time.time_ns(), request.reply_to[:GID]).encoded()
        query.reply(self._key, encode(response, f"{self._type_name}_Response"), attachment=attachment)
        query.drop()


class ZenohClient(Client):
    """The client's end of a service."""

    def __init__(
        self,
        ask: Callable[[bytes, bytes], None],
        inbox: deque[Any],
        name: str,
        type_name: str,
        gid: bytes,
        network: tuple[Refusals, Callable[[], int]],
    ):
        self._ask, self._inbox, self._name, self._type_name, self._gid = ask, inbox, name, type_name, gid
        self._refusals, self._served = network
        self._number = 0

    def call(self, request: Any) -> int:
        """Send a request and return its number."""
        self._number += 1
        attachment = Attached(self._number, time.time_ns(), self._gid).encoded()
        self._ask(encode(request, f"{self._type_name}_Request"), attachment)
        return self._number

    def take(self) -> list[tuple[int, Any]]:
        """The responses that have arrived, each with the number of its request."""
        responses = []
        for _ in range(len(self._inbox)):
            sample = self._inbox.popleft().ok
            if sample is None:
                continue  # the server has gone
            try:
                number = attached(sample).number
                responses.append((number, decode(sample.payload.to_bytes(), f"{self._type_name}_Response")))
            except BadMessage as error:
                self._refusals.add(self._name, str(error))
        return responses

    @property
    def is_served(self) -> bool:
        """Whether a server has been found."""
        return self._served() > 0


_CONFIG: dict[str, Any] = {
    "mode": "peer",
    "connect": {"endpoints": [ROUTER], "timeout_ms": 3000, "exit_on_failure": True},
    "listen": {"endpoints": ["tcp/localhost:0"]},
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
    "timestamping": {"enabled": True},  # caches need it
}
"""A session as rmw_zenoh's default is: a peer that finds others by the router, on this machine."""
