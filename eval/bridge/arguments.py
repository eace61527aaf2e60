"""The arguments of ``vuca bridge``: fields are flags, their docstrings the help."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from eval.arguments import SceneArguments
from vuca_nav.cli import optional


@dataclass(frozen=True)
class BridgeArguments(SceneArguments):
    """Put the simulator behind a robot's ROS 2 topics, and judge what drives it.

    Publishes scan, odom, imu, tf, tf_static, clock, initialpose and goal_pose, and carries out cmd_vel. Behind it goes
    vuca deploy, Nav2, or any other stack; docs/bridge.md has an example of each.
    """

    robot: str = "tiago"
    """A robot's name (see vuca list robots)."""
    trust: bool = False
    """Run the Python that a robot of your own names, or a world."""
    seeds: Annotated[str | None, optional("A:B")] = None
    """Missions with the seeds A to B - 1, one after the other, instead of --seed."""
    episodes: Annotated[int | None, optional("N")] = None
    """N missions, with the seeds from --seed on."""
    name: Annotated[str, tyro.conf.arg(name="as", metavar="NAME")] = "remote"
    """The method's name in the rows and tables: what it is that drives."""
    out: Annotated[Path | None, optional("DIR")] = None
    """Keep the rows in this directory, as vuca eval does; the same command goes on where it was."""
    lockstep: bool = False
    """Wait for the command that answers each scan, by its stamp; the rows then repeat to the bit."""
    real_time_factor: Annotated[float, tyro.conf.arg(metavar="X")] = 1.0
    """Simulated time over wall time, without --lockstep."""
    timeout: Annotated[float, tyro.conf.arg(metavar="S")] = 30.0
    """How long to wait for a stack to appear, and in lockstep for each command [s]."""
    warm_up: Annotated[float, tyro.conf.arg(metavar="S")] = 0.0
    """Simulated time before each mission in which nothing moves and the first readings repeat, for a stack that needs
    them to start; Nav2 takes 10 [s]."""
    cmd_vel: Literal["stamped", "plain"] = "stamped"
    """Type of cmd_vel: TwistStamped, or Twist, Nav2's up to Jazzy."""
    action: bool = False
    """Send the goal by the action navigate_to_pose instead of the topic goal_pose."""
    transport: Literal["dds", "zenoh"] = "dds"
    """What the network speaks: DDS, as rmw_cyclonedds and rmw_fastrtps do, or Zenoh, as rmw_zenoh does (untried beside
    it)."""
    domain: Annotated[int | None, optional("N")] = None
    """ROS domain; by default that of ROS_DOMAIN_ID, or 0."""
    interface: Annotated[str | None, optional("NAME")] = None
    """Network interface, eth0 for example; by default this machine alone is reached."""
    json: bool = False
    """End with one JSON object on stdout: the row, or with several missions or --out the summary."""
