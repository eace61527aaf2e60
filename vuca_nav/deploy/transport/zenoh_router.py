"""``python -m vuca_nav.deploy.transport.zenoh_router``: a Zenoh router, where no ROS brings one."""

import json
import threading
from dataclasses import dataclass

from vuca_nav.cli import run_module


@dataclass(frozen=True)
class RouterArguments:
    """Route Zenoh until it is ended, for vuca deploy and vuca bridge --transport zenoh where no ROS brings a router."""

    listen: str = "tcp/localhost:7447"
    """Where it listens: this machine alone, by default."""


def run(arguments: RouterArguments) -> None:
    """Route until an interrupt."""
    import zenoh

    from vuca_nav.deploy.transport.interface import NetworkError

    multicast = {"multicast": {"enabled": False}, "gossip": {"enabled": True}}
    config = {"mode": "router", "listen": {"endpoints": [arguments.listen]}, "scouting": multicast}
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        raise NetworkError(f"cannot listen at {arguments.listen}: {error}") from None
    with session:
        threading.Event().wait()


if __name__ == "__main__":
    run_module("zenoh_router", run, RouterArguments)
