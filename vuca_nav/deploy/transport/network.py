"""Where the transport listens: ROS domain, network interface, and the configuration of Cyclone DDS made of them."""

import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from vuca_nav.deploy.transport.ros_types import MOST_BYTES
from vuca_nav.errors import BadArgument, UnknownName

GREATEST_DOMAIN = 232
"""Greatest domain whose ports exist."""
MOST_PARTICIPANTS = 32
"""Greatest number of participants a machine looks for on itself; rmw_cyclonedds's default."""


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """Where the transport listens."""

    domain: int = 0
    """ROS domain: participants of different ones do not see each other."""
    interface: str | None = None
    """Name of the network interface; None: loopback, this machine alone."""
    extra: str | None = None
    """Configuration of Cyclone DDS that is applied after this one (CYCLONEDDS_URI): DDS Security, for example."""

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            BadArgument: If there is no such domain.
            UnknownName: If this machine has no such interface.
        """
        if not 0 <= self.domain <= GREATEST_DOMAIN:
            raise BadArgument(f"the ROS domain must be from 0 to {GREATEST_DOMAIN}, got {self.domain}")
        if self.interface is not None:
            interfaces = [name for _, name in socket.if_nameindex()]
            if self.interface not in interfaces:
                raise UnknownName("network interface", self.interface, interfaces)

    @property
    def warning(self) -> str | None:
        """What the user should know about who can reach the robot; None for loopback."""
        if self.extra is not None:
            return (
                "CYCLONEDDS_URI is set and applied: who can reach the topics is up to it. "
                "Without DDS Security in it, whoever reaches them can drive the robot"
            )
        if self.interface in (None, "lo"):
            return None
        return f"whoever is on the network of {self.interface} can read the topics and send goals, scans and odometry"

    def xml(self) -> str:
        """The configuration for Cyclone DDS: interface, discovery, and the greatest size of a message."""
        name = "lo" if self.interface is None else self.interface
        # Multicast on loopback stays on this machine; some implementations send in no other way. The peer finds those
        # who have none.
        own = (
            '<CycloneDDS><Domain id="any"><General><Interfaces>'
            f'<NetworkInterface name={quoteattr(name)} multicast="true"/></Interfaces>'
            "<AllowMulticast>true</AllowMulticast></General>"
            "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{MOST_PARTICIPANTS}</MaxAutoParticipantIndex>"
            '<Peers><Peer address="localhost"/></Peers></Discovery>'
            f"<Internal><MaxSampleSize>{MOST_BYTES} B</MaxSampleSize></Internal>"
            "</Domain></CycloneDDS>"
        )
        return own if self.extra is None else f"{own},{self.extra}"


def network_of(
    domain: int | None = None, interface: str | None = None, environment: Mapping[str, str] = os.environ
) -> NetworkConfig:
    """Where to listen by the command line and the environment variables of ROS 2.

    Args:
        domain: ROS domain; None: ROS_DOMAIN_ID, or 0.
        interface: Network interface; None: loopback, unless the environment asks for more.
        environment: Environment variables.

    Raises:
        BadArgument: If a variable is not understood, or contradicts the interface.
        UnknownName: If this machine has no such interface.
    """
    if domain is None:
        text = environment.get("ROS_DOMAIN_ID", "").strip() or "0"
        if not text.isdecimal():
            raise BadArgument(f"ROS_DOMAIN_ID must be a number from 0 to {GREATEST_DOMAIN}, got {text!r}")
        domain = int(text)
    if environment.get("ROS_LOCALHOST_ONLY", "0").strip() == "1":
        reach, variable = "LOCALHOST", "ROS_LOCALHOST_ONLY=1"
    else:
        reach = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").strip().upper()
        variable = f"ROS_AUTOMATIC_DISCOVERY_RANGE={reach}"
    if reach not in ("", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT"):
        raise BadArgument(f"{variable}: must be LOCALHOST or SUBNET here (with OFF, no robot would be found)")
    if reach == "LOCALHOST" and interface not in (None, "lo"):
        raise BadArgument(f"{variable} contradicts --interface {interface}: leave out one of them")
    if reach == "SUBNET" and interface is None:
        raise BadArgument(f"{variable}: name the network interface, as in --interface eth0; one, not all of them")
    return NetworkConfig(domain, interface, environment.get("CYCLONEDDS_URI") or None)
