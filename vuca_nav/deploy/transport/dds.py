"""The transport on DDS, by Cyclone DDS: what rmw_cyclonedds and rmw_fastrtps speak.

Topics are those of both. Services, and so actions, carry their request's number in the message, as rmw_cyclonedds has
it; rmw_fastrtps has it in a header of RTPS that Cyclone DDS does not offer.
"""

import struct
import uuid
from typing import Any

import numpy as np
from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy
from cyclonedds.qos import Qos as DdsQos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from vuca_nav.deploy.transport.dds_types import dds_topic, idl_struct, ros_topic
from vuca_nav.deploy.transport.interface import (
    LATCHED,
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
from vuca_nav.deploy.transport.names import UNCHANGED, RosArguments, ros_type
from vuca_nav.deploy.transport.network import MOST_PARTICIPANTS, NetworkConfig
from vuca_nav.deploy.transport.ros_types import WRAPPED, BadMessage, decode, encode, new, type_hash
from vuca_nav.errors import BadArgument

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_NS = 1_000_000_000
_BLOCKING = _NS // 10
"""Longest time for which a full reliable writer holds its caller [ns]; DDS's default."""
_ENCLAVE = b"enclave=/;"
"""What ROS participants announce of their security enclave."""
_GRAPH_TOPIC, _GRAPH_TYPE = "ros_discovery_info", "rmw_dds_common/msg/ParticipantEntitiesInfo"
"""Where nodes tell which endpoints are theirs."""
_MOST_ENDPOINTS = 4096
"""Greatest number of foreign publishers that are remembered, so that announcements cannot fill the memory."""


class DdsTransport(Transport):
    """A participant in a ROS 2 network on DDS.

    Args:
        network: Where it listens.
        ros: Name, namespace and remappings of the node.

    Raises:
        NetworkError: If the network cannot be joined.
    """

    def __init__(self, network: NetworkConfig, ros: RosArguments = UNCHANGED):
        self.network = network
        self.ros = ros
        self.refusals = Refusals()
        try:
            self._domain: Domain | None = Domain(network.domain, network.xml())
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:  # this process is in the domain already
                raise NetworkError(_why(network, error)) from None
            self._domain = None
        try:
            self._participant = DomainParticipant(network.domain, DdsQos(Policy.Userdata(_ENCLAVE)))
        except DDSException as error:
            raise NetworkError(_why(network, error)) from None
        self._topics: dict[str, tuple[str, Topic[Any]]] = {}
        self._waits = WaitSet(self._participant)
        self._discovered = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._news = ReadCondition(self._discovered, ViewState.Any | SampleState.NotRead | InstanceState.Any)
        self._endpoints: dict[uuid.UUID, Endpoint] = {}
        self._own_key = self._participant.get_guid()
        self._services = 0
        self._gids: dict[str, list[Any]] = {"reader": [], "writer": []}
        self._nodes = self._writer(_GRAPH_TOPIC, _GRAPH_TYPE, LATCHED, _hash_data(_GRAPH_TYPE))
        self._announce()

    def full_name(self, name: str) -> str:
        """The full ROS name of a name of this node."""
        return self.ros.full_name(name)

    def advertise(self, topic: str, type_name: str, qos: Qos = RELIABLE) -> "DdsPublisher":
        """Announce a topic and return its publisher."""
        check_type(type_name)
        name = self.full_name(topic)
        writer = self._writer(dds_topic(name), type_name, qos, _hash_data(type_name))
        return DdsPublisher(writer, type_name)

    def subscribe(self, topic: str, type_name: str, qos: Qos = RELIABLE) -> "DdsSubscriber":
        """Subscribe to a topic."""
        check_type(type_name)
        name = self.full_name(topic)
        reader = self._reader(dds_topic(name), type_name, qos, _hash_data(type_name))
        return DdsSubscriber(reader, name, type_name, self.refusals, qos.depth)

    def serve(self, name: str, type_name: str) -> "DdsService":
        """Serve a service."""
        reader, writer = self._pair(name, type_name, is_server=True)
        subscriber = DdsSubscriber(reader, self.full_name(name), f"{type_name}_Request{WRAPPED}", self.refusals, 10)
        return DdsService(subscriber, DdsPublisher(writer, f"{type_name}_Response{WRAPPED}"))

    def client(self, name: str, type_name: str) -> "DdsClient":
        """Make a client of a service."""
        reader, writer = self._pair(name, type_name, is_server=False)
        subscriber = DdsSubscriber(reader, self.full_name(name), f"{type_name}_Response{WRAPPED}", self.refusals, 10)
        return DdsClient(subscriber, DdsPublisher(writer, f"{type_name}_Request{WRAPPED}"))

    def wait(self, timeout: float) -> bool:
        """Wait until something waits to be taken, at most ``timeout`` [s]; whether something does."""
        return self._waits.wait(max(0, round(timeout * _NS))) > 0

    def publishers(self, topic: str) -> tuple[Endpoint, ...]:
        """All publishers of a topic that have been found."""
        while samples := self._discovered.take(64, self._news):
            for sample in samples:
                if sample.sample_info.instance_state != InstanceState.Alive:
                    self._endpoints.pop(sample.key, None)
                elif len(self._endpoints) < _MOST_ENDPOINTS:
                    self._endpoints[sample.key] = self._endpoint(sample)
        name = self.full_name(topic)
        return tuple(endpoint for endpoint in self._endpoints.values() if endpoint.topic == name)

    def close(self) -> None:
        """Leave the network."""
        # Cyclone DDS's Python deletes an entity with its last reference, which somebody may still hold.
        self._participant.__del__()
        if self._domain is not None:
            self._domain.__del__()

    def _endpoint(self, sample: Any) -> Endpoint:
        userdata = next((policy.data for policy in sample.qos if isinstance(policy, Policy.Userdata)), b"")
        values = dict(pair.split(b"=", 1) for pair in userdata.split(b";") if b"=" in pair)
        return Endpoint(
            key=str(sample.key),
            topic=ros_topic(sample.topic_name),
            type_name=ros_type(sample.type_name),
            type_hash=values.get(b"typehash", b"").decode("ascii", "replace"),
            is_own=sample.participant_key == self._own_key,
        )

    def _topic(self, name: str, type_name: str) -> Topic[Any]:
        """The DDS topic, one for all its endpoints."""
        if name not in self._topics:
            self._topics[name] = type_name, Topic(self._participant, name, idl_struct(type_name))
        used, topic = self._topics[name]
        if used != type_name:
            raise BadArgument(f"the topic {ros_topic(name)} cannot have both types {used} and {type_name}")
        return topic

    def _writer(self, name: str, type_name: str, qos: Qos, userdata: bytes) -> DataWriter[Any]:
        writer = DataWriter(self._participant, self._topic(name, type_name), _dds_qos(qos, userdata))
        if name != _GRAPH_TOPIC:
            self._gids["writer"].append(_gid(writer))
            self._announce()
        return writer

    def _reader(self, name: str, type_name: str, qos: Qos, userdata: bytes) -> DataReader[Any]:
        reader = DataReader(self._participant, self._topic(name, type_name), _dds_qos(qos, userdata))
        self._waits.attach(ReadCondition(reader, _ANY))
        self._gids["reader"].append(_gid(reader))
        self._announce()
        return reader

    def _announce(self) -> None:
        """Tell which node has these endpoints: by it ``ros2 node list`` shows the node."""
        node = new(
            "rmw_dds_common/msg/NodeEntitiesInfo",
            node_namespace=self.ros.namespace,
            node_name=self.ros.node,
            reader_gid_seq=self._gids["reader"],
            writer_gid_seq=self._gids["writer"],
        )
        info = new(_GRAPH_TYPE, gid=_gid(self._participant), node_entities_info_seq=[node])
        ddspy_write(self._nodes._ref, encode(info, _GRAPH_TYPE))

    def _pair(self, name: str, type_name: str, is_server: bool) -> tuple[DataReader[Any], DataWriter[Any]]:
        """Reader and writer of one end of a service. A number in their user data tells that they belong together."""
        self._services += 1
        number = self._own_key.bytes[:12] + struct.pack(">I", self._services)
        own = "serviceid" if is_server else "clientid"
        text = ".".join(f"{byte:2x}" if index == 0 else f"{byte:x}" for index, byte in enumerate(number))
        userdata = f"{own}={text};".encode() + _hash_data(type_name)
        full = self.full_name(name)
        requests = dds_topic(full, "rq", "Request"), f"{type_name}_Request{WRAPPED}"
        replies = dds_topic(full, "rr", "Reply"), f"{type_name}_Response{WRAPPED}"
        heard, said = (requests, replies) if is_server else (replies, requests)
        return self._reader(*heard, SERVICES, userdata), self._writer(*said, SERVICES, userdata)


class DdsPublisher(Publisher):
    """A DDS writer of encoded messages."""

    def __init__(self, writer: DataWriter[Any], type_name: str):
        self._writer = writer
        self._type_name = type_name

    def publish(self, message: Any) -> bytes:
        """Publish a message; returns it as it was sent."""
        data = encode(message, self._type_name)
        result = ddspy_write(self._writer._ref, data)
        if result < 0:
            raise NetworkError(f"cannot publish {len(data)} bytes of {self._type_name}: {DDSException(result)}")
        return data

    @property
    def subscribers(self) -> int:
        """Number of subscribers that it reaches now."""
        return len(self._writer.get_matched_subscriptions())

    def flush(self, timeout: float) -> bool:
        """Wait until every reliable subscriber has what was published; whether all have."""
        # Not DataWriter.wait_for_acks, which ends in an AttributeError when the time is over.
        wait_for_acks: Any = self._writer._wait_for_acks
        return wait_for_acks(self._writer._ref, round(timeout * _NS)) == 0


class DdsSubscriber(Subscriber):
    """A DDS reader of messages that are decoded as they are taken."""

    def __init__(self, reader: DataReader[Any], topic: str, type_name: str, refusals: Refusals, depth: int):
        self._reader = reader
        self._topic = topic
        self._type_name = type_name
        self._refusals = refusals
        self._depth = depth

    def take(self) -> list[Received]:
        """What has arrived since the last call, oldest first."""
        samples = ddspy_take(self._reader._ref, _ANY, self._depth)
        if isinstance(samples, int):
            raise NetworkError(f"cannot read {self._topic}: {DDSException(samples)}")
        received = []
        for data, info in samples:
            if not info.valid_data:
                continue  # tells that a publisher has gone
            try:
                message = decode(data, self._type_name)
            except BadMessage as error:
                self._refusals.add(self._topic, str(error))
            else:
                received.append(Received(message, data, info.publication_handle, info.source_timestamp))
        return received

    @property
    def publishers(self) -> int:
        """Number of publishers that it hears now."""
        return len(self._reader.get_matched_publications())


_HEADER = struct.Struct("<Qq")
"""Number of the client's writer, number of the request."""


class DdsService(Service):
    """The server's end of a service."""

    def __init__(self, requests: DdsSubscriber, replies: DdsPublisher):
        self._requests = requests
        self._replies = replies

    def take(self) -> list[Request]:
        """The requests that have arrived since the last call."""
        return [
            Request(received.message.message, _HEADER.pack(received.message.guid, received.message.seq))
            for received in self._requests.take()
        ]

    def reply(self, request: Request, response: Any) -> None:
        """Answer a request."""
        guid, number = _HEADER.unpack(request.reply_to)
        self._replies.publish(new(self._replies._type_name, guid=guid, seq=number, message=response))


class DdsClient(Client):
    """The client's end of a service."""

    def __init__(self, replies: DdsSubscriber, requests: DdsPublisher):
        self._replies = replies
        self._requests = requests
        self._guid = requests._writer.get_instance_handle() & (1 << 64) - 1
        self._number = 0

    def call(self, request: Any) -> int:
        """Send a request and return its number."""
        self._number += 1
        self._requests.publish(new(self._requests._type_name, guid=self._guid, seq=self._number, message=request))
        return self._number

    def take(self) -> list[tuple[int, Any]]:
        """The responses that have arrived, each with the number of its request."""
        return [
            (received.message.seq, received.message.message)
            for received in self._replies.take()
            if received.message.guid == self._guid
        ]

    @property
    def is_served(self) -> bool:
        """Whether a server has been found."""
        return self._requests.subscribers > 0 and self._replies.publishers > 0


def _gid(entity: Any) -> Any:
    """Identifier of an endpoint or participant as ROS has it."""
    return new("rmw_dds_common/msg/Gid", data=np.frombuffer(entity.get_guid().bytes, np.uint8))


def _hash_data(type_name: str) -> bytes:
    """What ROS endpoints announce of their type since Iron."""
    return f"typehash={type_hash(type_name)};".encode()


def _dds_qos(qos: Qos, userdata: bytes) -> DdsQos:
    reliability = Policy.Reliability.Reliable(_BLOCKING) if qos.reliable else Policy.Reliability.BestEffort
    durability = Policy.Durability.TransientLocal if qos.transient_local else Policy.Durability.Volatile
    return DdsQos(
        reliability,
        durability,
        Policy.History.KeepLast(qos.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
        Policy.Userdata(userdata),
    )


def _why(network: NetworkConfig, error: DDSException) -> str:
    where = network.interface or "loopback"
    if network.extra is not None:
        look = "look at CYCLONEDDS_URI, whose faults stand above; DDS Security is not in the wheels of Cyclone DDS"
    else:
        look = f"is the interface up, and has this machine fewer than {MOST_PARTICIPANTS} participants in it?"
    return f"cannot join ROS domain {network.domain} on {where}: {error} ({look})"
