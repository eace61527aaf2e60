"""Messages that no driver sends: malformed, too large, of another type."""

import socket
import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from cyclonedds._clayer import ddspy_write
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic

from vuca_nav.deploy.transport.dds_types import dds_topic, idl_struct
from vuca_nav.deploy.transport.network import MOST_PARTICIPANTS
from vuca_nav.deploy.transport.ros_types import encode, new

SCAN = "sensor_msgs/msg/LaserScan"
_HEADER = b"\x00\x01\x00\x00"
"""CDR, little-endian."""
_PORT_BASE, _PORTS_OF_A_DOMAIN, _USER_UNICAST = 7400, 250, 11
"""Where participants listen for data: port 7411 + 250 a domain + 2 a participant (OMG RTPS 2.3, 9.6.1)."""
_LARGEST_PACKET = 60_000
"""Size from which on a message is sent in fragments [bytes]."""
_HUGE = 500_000
"""Ranges of a scan that is too large: 2 MB, five times what a scan may have."""


class RawPublisher:
    """Publishes bytes, whatever they are, as messages of a type.

    Cyclone DDS refuses to write what is not of the type, so that small messages go out in RTPS packets made here, under
    the name of a writer that it has announced.

    Args:
        domain: ROS domain, in which this process has a transport already, on loopback.
        topic: Full ROS name of the topic.
        type_name: ROS name of the type that is announced.
    """

    def __init__(self, domain: int, topic: str, type_name: str):
        self._participant = DomainParticipant(domain)
        self._topic: Topic[Any] = Topic(self._participant, dds_topic(topic), idl_struct(type_name))
        qos = Qos(
            Policy.Reliability.Reliable(0),
            Policy.History.KeepLast(5),
            Policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False),
        )
        self._writer: DataWriter[Any] = DataWriter(self._participant, self._topic, qos)
        self._guid = self._writer.get_guid().bytes
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        first = _PORT_BASE + _PORTS_OF_A_DOMAIN * domain + _USER_UNICAST
        self._ports = range(first, first + 2 * MOST_PARTICIPANTS, 2)
        self._number = 0

    def publish(self, data: bytes) -> None:
        """Publish bytes."""
        if len(data) > _LARGEST_PACKET:
            ddspy_write(self._writer._ref, data)  # in fragments; such a message is of its type
            return
        self._number += 1
        packet = _packet(self._guid, self._number, data)
        for port in self._ports:
            self._socket.sendto(packet, ("127.0.0.1", port))

    def close(self) -> None:
        """Leave the network."""
        self._socket.close()
        self._participant.__del__()


def _packet(writer: bytes, number: int, data: bytes) -> bytes:
    """An RTPS packet with one DATA submessage (OMG RTPS 2.3, 8.3.7.2 and 9.4.5.3).

    Args:
        writer: GUID of the writer.
        number: Sequence number.
        data: Serialised payload, its header included.
    """
    body = struct.pack("<HH4s4siI", 0, 16, b"", writer[12:], number >> 32, number & 0xFFFFFFFF) + data
    body += bytes(-len(body) % 4)
    return b"RTPS\x02\x01\x01\x10" + writer[:12] + struct.pack("<BBH", 0x15, 0x05, len(body)) + body


def truncated(rng: np.random.Generator) -> bytes:
    """A scan that ends too soon."""
    data = encode(new(SCAN, ranges=np.ones(360, np.float32)), SCAN)
    return data[: int(rng.integers(4, len(data) - 4))]


def noise(rng: np.random.Generator) -> bytes:
    """Random bytes."""
    return _HEADER + rng.bytes(int(rng.integers(1, 2000)))


def false_length(rng: np.random.Generator) -> bytes:
    """A scan whose frame says that it has up to four billion letters."""
    data = bytearray(encode(new(SCAN, ranges=np.ones(360, np.float32)), SCAN))
    data[12:16] = struct.pack("<I", int(rng.integers(2**16, 2**32)))
    return bytes(data)


def too_large(_rng: np.random.Generator) -> bytes:
    """A scan that is larger than any scan."""
    return encode(new(SCAN, ranges=np.ones(_HUGE, np.float32)), SCAN)


def another_type(_rng: np.random.Generator) -> bytes:
    """A text, to be announced as one."""
    return encode(new("std_msgs/msg/String", data="scan"), "std_msgs/msg/String")


KINDS: Mapping[str, tuple[str, Callable[[np.random.Generator], bytes]]] = {
    "truncated": (SCAN, truncated),
    "noise": (SCAN, noise),
    "false length": (SCAN, false_length),
    "too large": (SCAN, too_large),
    "another type": ("std_msgs/msg/String", another_type),
}
"""Kinds of messages: the type that is announced, and what makes the bytes."""
