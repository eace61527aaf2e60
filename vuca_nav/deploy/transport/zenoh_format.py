"""What rmw_zenoh puts into keys, tokens and attachments since Jazzy, by its sources (github.com/ros2/rmw_zenoh).

- A topic's key is ``<domain>/<topic>/<type on DDS>/<type hash>``, its messages CDR. A service is a queryable.
- With each message, request and reply goes an attachment: number, time, and the publisher's identity.
- Each node, publisher, subscriber, service and client declares a liveliness token,
  ``@ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<name>/<topic>/<type>/<hash>/<qos>``.
- Whoever is latched (transient local) has a cache, which late subscribers ask.
"""

import hashlib
import struct
from typing import Any, NamedTuple

from vuca_nav.deploy.transport.interface import Qos
from vuca_nav.deploy.transport.ros_types import BadMessage

ADMIN, KIND, TOPIC, PARTS = "@ros2_lv", 5, 9, 13
"""Of a token: its first part, the places of its kind and its topic, and the number of its parts."""
GID = 16
"""Size of an identity [bytes]."""
_DEFAULT_DEPTH = 42
"""Depth that tokens leave out."""
_ATTACHMENT = struct.Struct("<qqB16s")
"""Number, time [ns], length of the identity, identity: 33 bytes, as Zenoh serialises them."""


class Attached(NamedTuple):
    """What goes with a message."""

    number: int
    time: int
    """When it was published [ns]."""
    gid: bytes

    def encoded(self) -> bytes:
        """The attachment."""
        return _ATTACHMENT.pack(self.number, self.time, GID, self.gid)


def attached(thing: Any) -> Attached:
    """The attachment of a sample or query.

    Raises:
        BadMessage: If there is none, or it is none of rmw_zenoh.
    """
    data = b"" if thing.attachment is None else thing.attachment.to_bytes()
    if len(data) != _ATTACHMENT.size or data[16] != GID:
        raise BadMessage("without the attachment of rmw_zenoh")
    number, sent, _, gid = _ATTACHMENT.unpack(data)
    return Attached(number, sent, gid)


def gid_of(token: str) -> bytes:
    """Identity of an entity, from its token: 16 bytes. rmw_zenoh has another hash, and asks for none in particular."""
    return hashlib.blake2b(token.encode(), digest_size=GID).digest()


def qos_text(qos: Qos) -> str:
    """A quality of service as a token gives it: what is rmw_zenoh's default is left out."""
    reliability, durability = "" if qos.reliable else "2", "1" if qos.transient_local else ""
    depth = "" if qos.depth == _DEFAULT_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"


def mangled(name: str) -> str:
    """A name as one part of a key."""
    return name.replace("/", "%")
