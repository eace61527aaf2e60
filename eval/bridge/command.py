"""The command ``vuca bridge``."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import TYPE_CHECKING

from eval.arguments import SceneArguments
from eval.bridge.arguments import BridgeArguments
from vuca_nav.cli import parse, show
from vuca_nav.errors import BadArgument

if TYPE_CHECKING:
    from eval.bridge.session import FindStack
    from eval.episode import EpisodeConfig


def bridge(argv: list[str]) -> int:
    """Put the simulator behind a robot's ROS 2 topics: vuca deploy, Nav2 or another stack drives it and is judged."""
    from vuca_nav.deploy.transport.names import parse_ros_arguments, split_ros_arguments

    own, ros_words = split_ros_arguments(argv)
    arguments = parse(BridgeArguments, "bridge", own)
    _check(arguments)
    from eval.bridge.remote_stack import PaceConfig, RemoteStack
    from eval.bridge.robot_wire import RobotWire, WireConfig
    from eval.bridge.session import make_pace, wait_for_stack
    from robots.registry import make_body
    from vuca_nav.deploy.transport.joining import network_by

    ros = parse_ros_arguments(ros_words, "vuca_bridge")
    configs = _missions(arguments)
    body = make_body(arguments.robot, trust=arguments.trust)
    network = network_by(arguments.transport, arguments.domain, arguments.interface, ros)
    if network.warning:
        print(f"vuca bridge: {network.warning}", file=sys.stderr)
    pace = PaceConfig(arguments.lockstep, arguments.real_time_factor, arguments.timeout)

    @contextmanager
    def find_stack() -> Iterator[RemoteStack]:
        with network.join() as transport:
            wire = RobotWire(transport, body, WireConfig(arguments.cmd_vel == "stamped", arguments.action))
            wait_for_stack(wire, arguments.timeout)
            yield RemoteStack(wire, make_pace(pace), arguments.warm_up)

    return _drive(arguments, configs, find_stack, shlex.join(["vuca", "bridge", *argv]))


def _drive(arguments: BridgeArguments, configs: list[EpisodeConfig], find_stack: FindStack, command: str) -> int:
    """Run the missions and print what became of them."""
    from eval.analysis.summary import table
    from eval.bridge.session import BridgedEpisode, drive_all
    from eval.progress import ProgressLine, result_table

    if arguments.out is not None:
        settings = {"lockstep": arguments.lockstep, "warm_up": arguments.warm_up}
        settings |= {} if arguments.lockstep else {"real_time_factor": arguments.real_time_factor}
        evaluation = drive_all(configs, find_stack, arguments.out, command, settings)
        show(table(evaluation.groups, evaluation.total))
        print(f"rows and summary: {arguments.out}", file=sys.stderr)
        if arguments.json:
            show(json.dumps(json.loads((arguments.out / "summary.json").read_text())))
        return 0
    rows = []
    with find_stack() as stack:
        for config in configs:
            with ProgressLine(sys.stderr) as progress:
                rows.append(BridgedEpisode(config, stack).run(progress=progress).row())
            show(result_table(rows[-1]))
    if arguments.json:
        show(json.dumps(rows[0] if len(rows) == 1 else {"rows": rows}, allow_nan=False))
    return 0


def _missions(arguments: BridgeArguments) -> list[EpisodeConfig]:
    """The missions that are asked for."""
    from eval.episode import EpisodeConfig
    from eval.suites import parse_seeds

    scene = {field.name: getattr(arguments, field.name) for field in fields(SceneArguments)}
    first = scene.pop("seed")
    seeds = range(first, first + (arguments.episodes or 1))
    if arguments.seeds is not None:
        seeds = parse_seeds(arguments.seeds)
    rest = {"robot": arguments.robot, "method": arguments.name, "trust": arguments.trust}
    return [EpisodeConfig(**scene, **rest, seed=seed) for seed in seeds]


def _check(arguments: BridgeArguments) -> None:
    """Raise BadArgument for arguments that do not go together, or out of their ranges."""
    if arguments.episodes is not None and arguments.seeds is not None:
        raise BadArgument("--episodes and --seeds exclude each other; give one of them")
    if arguments.episodes is not None and arguments.episodes < 1:
        raise BadArgument(f"--episodes must be 1 or more, got {arguments.episodes}")
    if arguments.lockstep and arguments.real_time_factor != 1.0:
        raise BadArgument("--lockstep goes as fast as it can; leave out --real-time-factor")
    if arguments.lockstep and arguments.cmd_vel == "plain":
        raise BadArgument("--lockstep needs the stamps of commands; leave out --cmd-vel plain")
    if not 0.0 <= arguments.warm_up <= 3600.0:
        raise BadArgument(f"--warm-up must be 0 to 3600 s, got {arguments.warm_up}")
    if not arguments.name or ":" in arguments.name:
        raise BadArgument(f"--as must be a name without a colon, got {arguments.name!r}")
