"""``vuca deploy``: arguments in, an exit code out."""

import json
import select
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import tyro

from vuca_nav.cli import optional, parse, show
from vuca_nav.errors import BadArgument
from vuca_nav.telemetry.options import ViewArguments

_SWITCH = 0.0005
"""Longest time for which the log's thread holds up the loop [s]; Python's default is 5 ms."""


@dataclass(frozen=True, kw_only=True)
class DeployArguments(ViewArguments):
    """Drive a robot: run the stack of a bundle behind ROS 2 topics, without ROS.

    Listens to scan, odom, imu, tf_static, goal_pose, initialpose, emergency_stop and to the action navigate_to_pose;
    publishes cmd_vel, map, plan, tracks, tf and diagnostics. The robot stands until there is a goal and all has been
    healthy for a second. What ROS users put behind --ros-args goes here, too:

      vuca deploy go2-bundle --interface eth0 --log run.mcap --ros-args -r __ns:=/go2 -r scan:=/go2/front_scan

    Put the robot on blocks first: docs/deployment.md leads from there to the first metre. With the simulator in its
    place: vuca bridge.
    """

    bundle: tyro.conf.Positional[Path]
    """Folder that vuca export wrote."""
    log: Annotated[Path | None, optional("FILE.mcap")] = None
    """Keep what is heard, said and done, for vuca replay, Foxglove and ros2 bag."""
    lockstep: bool = False
    """Answer each pair of scan and odometry with one stamp, however long it takes: for vuca bridge --lockstep. It wants
    a topic clock, which a real robot does not have."""
    twist: bool = False
    """Publish cmd_vel as Twist, Nav2's up to Jazzy, instead of TwistStamped."""
    base: Literal["ros", "unitree"] = "ros"
    """What the base speaks: cmd_vel and odom of ROS, or requests and states of a Unitree Go2 (untried on hardware)."""
    transport: Literal["dds", "zenoh"] = "dds"
    """What the network speaks: DDS, as rmw_cyclonedds and rmw_fastrtps do, or Zenoh, as rmw_zenoh does (untried beside
    it; its extra is zenoh)."""
    speed: Annotated[float, tyro.conf.arg(metavar="SHARE")] = 1.0
    """Share of the body's greatest velocities that commands may have, 0.5 for the first time on the floor."""
    domain: Annotated[int | None, optional("N")] = None
    """ROS domain; by default that of ROS_DOMAIN_ID, or 0."""
    interface: Annotated[str | None, optional("NAME")] = None
    """Network interface, eth0 for example; by default this machine alone is reached."""
    json: bool = False
    """End with one JSON object on stdout: ticks, their times, messages refused."""


def deploy(argv: list[str]) -> int:
    """Drive a robot: run the stack of a bundle behind ROS 2 topics, without ROS."""
    from vuca_nav.deploy.transport.names import parse_ros_arguments, split_ros_arguments

    own, ros_words = split_ros_arguments(argv)
    arguments = parse(DeployArguments, "deploy", own)
    arguments.check_view()
    ros = parse_ros_arguments(ros_words, "vuca_deploy")

    from vuca_nav.deploy.bundle import load_bundle
    from vuca_nav.deploy.node.log import NodeLog
    from vuca_nav.deploy.node.loop import Node, NodeConfig
    from vuca_nav.deploy.node.warm_up import warm_up
    from vuca_nav.deploy.transport.joining import network_by
    from vuca_nav.telemetry.interface import Telemetry

    network = network_by(arguments.transport, arguments.domain, arguments.interface, ros)
    bundle = load_bundle(arguments.bundle)
    if arguments.lockstep and arguments.twist:
        raise BadArgument("--lockstep needs cmd_vel with stamps: leave --twist out")
    if arguments.base == "unitree" and arguments.transport != "dds":
        raise BadArgument("--base unitree speaks DDS, as the robot does: leave --transport out")
    if arguments.base == "unitree" and (arguments.lockstep or arguments.twist or ros.use_sim_time):
        raise BadArgument(
            "--base unitree has neither cmd_vel nor a simulator's time: leave out --lockstep, --twist and use_sim_time"
        )
    config = NodeConfig(
        lockstep=arguments.lockstep,
        use_sim_time=ros.use_sim_time or arguments.lockstep,
        stamped=not arguments.twist,
        base=arguments.base,
        speed=arguments.speed,
    )
    log = NodeLog() if arguments.log is None else _open_log(arguments.log, bundle)
    telemetry = None
    try:
        telemetry = arguments.open_view(f"vuca deploy {arguments.bundle}") or Telemetry()
        began = time.monotonic()
        print("compiling, and driving the bundle's recorded steps once ...", file=sys.stderr)
        warm_up(bundle)
        print(f"ready after {time.monotonic() - began:.1f} s", file=sys.stderr)
        if network.warning is not None:
            print(f"warning: {network.warning}", file=sys.stderr)
        print(f"{network.where}, namespace {ros.namespace}", file=sys.stderr)
        with network.join() as transport:
            node = Node(bundle, transport, config, telemetry, log)
            line = StatusLine(sys.stderr)
            node.after_tick = lambda: line(node.status)
            try:
                node.run()
            finally:
                line.end()
                _summarise(node, transport.refusals, arguments.json)
    finally:
        log.close()
        if log.failure is not None:
            print(f"warning: {log.failure}", file=sys.stderr)
        close = getattr(telemetry, "close", None)
        if close is not None:
            close()
    return 0


class StatusLine:
    """A line about what the robot does: in place on a terminal, otherwise every ten seconds.

    The loop must not wait for whoever reads it: while a terminal stands still, or a pipe is full, lines are left out.

    Args:
        stream: Stream to write to.
    """

    def __init__(self, stream: TextIO):
        self._stream, self._in_place = stream, stream.isatty()
        self._interval = 0.2 if self._in_place else 10.0
        self._last, self._written = -float("inf"), False

    def __call__(self, status: Any) -> None:
        """Write the line if it is due.

        Args:
            status: Called for the line.
        """
        now = time.monotonic()
        if now - self._last < self._interval:
            return
        self._last = now
        if not _takes_text(self._stream):
            return
        self._written = True
        text = status()
        self._stream.write(f"\r{text[:118]:<118}" if self._in_place else f"{text}\n")
        self._stream.flush()

    def end(self) -> None:
        """End the terminal's line."""
        if self._in_place and self._written:
            self._stream.write("\n")


def _takes_text(stream: TextIO) -> bool:
    """Whether a line can be written without waiting for the stream's reader."""
    try:
        return bool(select.select([], [stream.fileno()], [], 0.0)[1])
    except (OSError, ValueError):  # a stream without a descriptor
        return True


def _open_log(path: Path, bundle: Any) -> Any:
    from vuca_nav.deploy.log import MissionLog

    sys.setswitchinterval(_SWITCH)
    return MissionLog(path, bundle.manifest)


def _summarise(node: Any, refusals: Any, as_json: bool) -> None:
    """Say what became of the run."""
    times = node.times()
    names = ("compute", "latency", "period")
    refused = {f"{topic}: {reason}": count for (topic, reason), count in sorted(refusals.counts.items())}
    row: dict[str, Any] = {"ticks": times.ticks}
    for name, (median, high) in zip(names, times[1:], strict=True):
        row[f"{name}_median"], row[f"{name}_p99_9"] = (None if value != value else value for value in (median, high))
    row |= {"refused": refused, "log_failure": node.log_failure}
    if times.ticks:
        parts = [f"{name} {1e3 * median:.1f} ms (99.9 %: {1e3 * high:.1f})" for name, (median, high) in
                 zip(names, times[1:], strict=True) if median == median]  # fmt: skip
        print(f"{times.ticks:,} ticks; {', '.join(parts)}; {refusals.total} messages refused", file=sys.stderr)
    if as_json:
        show(json.dumps(row))
