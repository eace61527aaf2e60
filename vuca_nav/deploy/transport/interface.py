"""Interface of a transport: publishers, subscribers and services of ROS 2 under their ROS names.

Names are ROS names ("scan", "/tf"), types are ROS types ("sensor_msgs/msg/LaserScan"), messages are the dataclasses of
``vuca_nav.deploy.transport.ros_types``. What arrives is taken, not called back: the loop decides when.
"""

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

from vuca_nav.deploy.transport.ros_types import known
from vuca_nav.errors import BadArgument, VucaError


@dataclass(frozen=True, slots=True)
class Qos:
    """The quality of service that ROS 2 users set: reliability, durability, depth of the history."""

    reliable: bool = True
    transient_local: bool = False
    """Whether a late subscriber still gets the last messages."""
    depth: int = 10


RELIABLE = Qos()
"""What most publishers and subscribers of ROS 2 have."""
SENSOR = Qos(reliable=False, depth=5)
"""Sensor data (rmw's sensor_data profile)."""
COMMAND = Qos(depth=1)
"""Velocity commands: the newest counts."""
LATCHED = Qos(transient_local=True, depth=1)
"""Maps, static transforms, an action's status."""
STATIC_TRANSFORMS = Qos(transient_local=True, depth=100)
"""Subscribers of tf_static: each broadcaster's last message is wanted."""


SERVICES = Qos(depth=10)
"""Requests and replies of services (rmw's profile of them)."""


class NetworkError(VucaError):
    """The network cannot be joined, or does not take a message."""


class Received(NamedTuple):
    """A message that arrived."""

    message: Any
    """The decoded message. Its arrays are views of ``data`` and cannot be written."""
    data: bytes
    """The message as it came, CDR with its header: what a log keeps."""
    publisher: int
    """Number of the publisher, unique while it lives."""
    sent: int
    """Time at which it was published, by the publisher's wall clock [ns]."""


class Request(NamedTuple):
    """A service request that waits for its reply."""

    message: Any
    reply_to: bytes
    """What ``Service.reply`` needs to address the reply."""


class Endpoint(NamedTuple):
    """A publisher somewhere on the network."""

    key: str
    """Unique identifier."""
    topic: str
    """ROS name of the topic."""
    type_name: str
    """ROS name of the type."""
    type_hash: str
    """RIHS01 hash of the type; empty if the publisher announces none."""
    is_own: bool
    """Whether it belongs to this transport."""


@dataclass(slots=True)
class Refusals:
    """Messages that were refused whole, counted by topic and reason. Reasons are fixed sentences, so memory is too."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, topic: str, reason: str) -> None:
        """Count one refused message.

        Args:
            topic: ROS name of the topic.
            reason: Why it was refused: a sentence without values of the message.
        """
        self.counts[topic, reason] += 1

    @property
    def total(self) -> int:
        """Number of refused messages."""
        return self.counts.total()


class Publisher(ABC):
    """Publishes messages on one topic."""

    @abstractmethod
    def publish(self, message: Any) -> bytes:
        """Publish a message.

        Args:
            message: Of the type that was advertised.

        Returns:
            The message as it was sent, CDR with its header.
        """

    @property
    @abstractmethod
    def subscribers(self) -> int:
        """Number of subscribers that it reaches now."""

    @abstractmethod
    def flush(self, timeout: float) -> bool:
        """Wait until every reliable subscriber has what was published, at most ``timeout`` [s]; whether all have."""


class Subscriber(ABC):
    """Receives the messages of one topic."""

    @abstractmethod
    def take(self) -> list[Received]:
        """What has arrived since the last call, oldest first; what cannot be decoded is counted among the refusals."""

    @property
    @abstractmethod
    def publishers(self) -> int:
        """Number of publishers that it hears now."""


class Service(ABC):
    """Serves one service."""

    @abstractmethod
    def take(self) -> list[Request]:
        """The requests that have arrived since the last call."""

    @abstractmethod
    def reply(self, request: Request, response: Any) -> None:
        """Answer a request."""


class Client(ABC):
    """Calls one service; for tests and tools."""

    @abstractmethod
    def call(self, request: Any) -> int:
        """Send a request and return its number. Call it once ``is_served`` holds: nothing repeats a lost request."""

    @abstractmethod
    def take(self) -> list[tuple[int, Any]]:
        """The responses that have arrived, each with the number of its request."""

    @property
    @abstractmethod
    def is_served(self) -> bool:
        """Whether a server has been found."""


class Transport(ABC):
    """One participant in a ROS 2 network."""

    refusals: Refusals
    """What was refused on all topics."""

    @abstractmethod
    def advertise(self, topic: str, type_name: str, qos: Qos = RELIABLE) -> Publisher:
        """Announce a topic and return its publisher."""

    @abstractmethod
    def subscribe(self, topic: str, type_name: str, qos: Qos = RELIABLE) -> Subscriber:
        """Subscribe to a topic."""

    @abstractmethod
    def serve(self, name: str, type_name: str) -> Service:
        """Serve a service of the type, "action_msgs/srv/CancelGoal" for example."""

    @abstractmethod
    def client(self, name: str, type_name: str) -> Client:
        """Make a client of a service."""

    @abstractmethod
    def wait(self, timeout: float) -> bool:
        """Wait until something waits to be taken, at most ``timeout`` [s]; whether something does."""

    @abstractmethod
    def publishers(self, topic: str) -> tuple[Endpoint, ...]:
        """All publishers of a topic that have been found, of any type, this transport's own too.

        It goes through what discovery has found since the last call: ask it a few times a second, not every tick.
        """

    @abstractmethod
    def full_name(self, name: str) -> str:
        """The full ROS name of a name of this node: namespace and remappings applied."""

    @abstractmethod
    def close(self) -> None:
        """Leave the network. What was published and not flushed may be lost."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def check_type(type_name: str) -> None:
    """See that a message type is known.

    Raises:
        BadArgument: If it is not.
    """
    if not known(type_name):
        raise BadArgument(f"unknown message type {type_name!r}; names look like sensor_msgs/msg/LaserScan")
