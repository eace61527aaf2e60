"""A mission in lockstep over Zenoh: the same commands as over DDS."""

import json
import socket
from pathlib import Path

import pytest
import zenoh

from tests.vuca_nav.deploy.node.robot_side import RobotSide, node
from vuca_nav.deploy.node.loop import NodeConfig
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.interface import Transport
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.deploy.transport.zenoh import CONFIG_VARIABLE, ZenohTransport
from vuca_nav.geometry import distance
from vuca_nav.types import VelocityCommand

DOMAIN = 106
GOAL = (5.0, 3.0)


def mission(ours: Transport, theirs: Transport) -> list[VelocityCommand]:
    """Drive to the goal; all commands."""
    with ours, theirs:
        made, robot = node(ours, NodeConfig(lockstep=True, use_sim_time=True)), RobotSide(theirs)
        robot.wait_for()
        robot.place()
        robot.drive(made, 1)
        robot.send_goal(*GOAL)
        commands = []
        while distance(robot.pose, GOAL) > 0.1 and len(commands) < 400:
            commands += robot.drive(made, 1)
        assert distance(robot.pose, GOAL) <= 0.1
        assert made.outputs.publishers_of_commands == 1
        made.outputs.farewell(made.now())
        return commands


@pytest.fixture
def environment(tmp_path: Path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        place = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    common = {"scouting": {"multicast": {"enabled": False}}, "timestamping": {"enabled": True}}
    router = {"mode": "router", "listen": {"endpoints": [place]}, **common}
    session = {"mode": "peer", "connect": {"endpoints": [place]}, "listen": {"endpoints": ["tcp/127.0.0.1:0"]}}
    (tmp_path / "session.json5").write_text(json.dumps(session | common))
    with zenoh.open(zenoh.Config.from_json5(json.dumps(router))):
        yield {CONFIG_VARIABLE: str(tmp_path / "session.json5")}


def test_a_mission_over_zenoh_has_the_commands_of_one_over_dds(environment: dict[str, str]) -> None:
    by_zenoh = mission(*(ZenohTransport(DOMAIN, environment=environment) for _ in range(2)))
    by_dds = mission(*(DdsTransport(NetworkConfig(DOMAIN)) for _ in range(2)))
    assert len(by_zenoh) > 50
    assert by_zenoh == by_dds
