"""Which network is joined, by the command line and the environment."""

import os
from collections.abc import Callable
from typing import Literal, NamedTuple

from vuca_nav.deploy.transport.interface import Transport
from vuca_nav.deploy.transport.names import RosArguments
from vuca_nav.deploy.transport.network import network_of
from vuca_nav.errors import BadArgument

Kind = Literal["dds", "zenoh"]
"""Kinds of transports: DDS, of rmw_cyclonedds and rmw_fastrtps; Zenoh, of rmw_zenoh."""


class Network(NamedTuple):
    """A network that can be joined."""

    where: str
    """What it is, for a message."""
    warning: str | None
    """What the user should know about who can reach the robot."""
    join: Callable[[], Transport]


def network_by(kind: Kind, domain: int | None, interface: str | None, ros: RosArguments) -> Network:
    """The network that is asked for.

    Args:
        kind: Its transport.
        domain: ROS domain; None: ROS_DOMAIN_ID, or 0.
        interface: Network interface, for DDS.
        ros: Name, namespace and remappings of the node.

    Raises:
        BadArgument: If an argument or a variable is not understood, or they do not go together.
        UnknownName: If this machine has no such interface.
    """
    if kind == "zenoh":
        if interface is not None:
            raise BadArgument("--interface is of DDS; with --transport zenoh name a file by ZENOH_SESSION_CONFIG_URI")
        number = network_of(domain, None, {"ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "")}).domain
        from vuca_nav.deploy.transport.zenoh import CONFIG_VARIABLE, ROUTER, ZenohTransport

        own = os.environ.get(CONFIG_VARIABLE)
        warning = "whoever reaches the same Zenoh router can read the topics and send goals, scans and odometry"
        return Network(f"ROS domain {number} by Zenoh, {own or ROUTER}", warning, lambda: ZenohTransport(number, ros))
    from vuca_nav.deploy.transport.dds import DdsTransport

    found = network_of(domain, interface)
    where = "this machine alone" if found.interface is None else found.interface
    return Network(f"ROS domain {found.domain} on {where}", found.warning, lambda: DdsTransport(found, ros))
