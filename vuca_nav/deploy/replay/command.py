"""``vuca replay``: the stack of a bundle over a log.

A log of ``vuca deploy`` says what every step of the stack saw: the replay gives the same commands to the bit, or says
where they first differ. Any other rosbag2 log with a scan and odometry drives the stack as well, a tick a scan, in the
open loop: the robot went where it went, and the commands are what the stack would have said.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from vuca_nav.cli import optional, parse, show
from vuca_nav.errors import BadArgument

if TYPE_CHECKING:
    from vuca_nav.deploy.bundle import Bundle
    from vuca_nav.deploy.replay.exact import Replayed
    from vuca_nav.deploy.replay.log_file import LogFile
    from vuca_nav.deploy.replay.open_loop import OpenLoop
    from vuca_nav.telemetry.interface import Telemetry

MOST_LINES = 60
"""Greatest number of lines of commands that are shown."""


@dataclass(frozen=True)
class ReplayArguments:
    """Replay a log with a bundle: the same commands to the bit, or what the stack would have said."""

    bundle: tyro.conf.Positional[Path]
    """Folder of vuca export."""
    log: tyro.conf.Positional[Path]
    """MCAP file of vuca deploy, or of ros2 bag record with a scan and odometry."""
    goal: Annotated[tuple[float, float] | None, optional("X Y")] = None
    """Goal in the map [m], for a log without one."""
    scan: Annotated[str | None, optional("TOPIC")] = None
    """Topic of the scan, where a log of others has several."""
    odometry: Annotated[str | None, optional("TOPIC")] = None
    """Topic of the odometry, where a log of others has several."""
    record: Annotated[Path | None, optional("FILE.rrd")] = None
    """Record the replay for the Rerun viewer."""
    json: bool = False
    """End with one JSON object on stdout."""


def replay(argv: list[str]) -> int:
    """Replay a log with a bundle: the same commands to the bit, or what the stack would have said."""
    arguments = parse(ReplayArguments, "replay", argv)
    from vuca_nav.deploy.bundle import load_bundle
    from vuca_nav.deploy.replay.exact import Replayed, replay_log
    from vuca_nav.deploy.replay.log_file import LogFile
    from vuca_nav.progress import CountedProgress

    bundle = load_bundle(arguments.bundle)
    is_own = _is_of_deploy(arguments.log)
    if is_own and (arguments.goal or arguments.scan or arguments.odometry):
        raise BadArgument(
            "--goal, --scan and --odometry go with logs of others; a log of vuca deploy says these itself"
        )
    telemetry = _telemetry(arguments, bundle)
    try:
        with CountedProgress(sys.stderr, "bytes replayed", LogFile(arguments.log).size) as progress:
            log = LogFile(arguments.log, progress)
            if is_own:
                result = replay_log(bundle, log, telemetry)
            else:
                result = _open_loop(arguments, bundle, log, telemetry)
    finally:
        telemetry.close()
    if isinstance(result, Replayed):
        show(_told(result))
        row = {**result._asdict(), "first": result.first and result.first._asdict()}
    else:
        show(_told_open_loop(result))
        row = {**result._asdict(), "said": [said._asdict() for said in result.said]}
    if arguments.json:
        show(json.dumps({"exact": is_own, **row}, allow_nan=False))
    return 1 if isinstance(result, Replayed) and result.equal < result.ticks else 0


def _open_loop(arguments: ReplayArguments, bundle: Bundle, log: LogFile, telemetry: Telemetry) -> OpenLoop:
    """The stack over a log of somebody else's."""
    from vuca_nav.deploy.replay.log_file import LogFile
    from vuca_nav.deploy.replay.open_loop import OpenLoopRun, find_topics

    if arguments.goal is not None and not all(map(math.isfinite, arguments.goal)):
        raise BadArgument(f"--goal {arguments.goal[0]} {arguments.goal[1]}: two finite numbers would be right")
    topics = find_topics(bundle, LogFile(arguments.log), arguments.scan, arguments.odometry)
    return OpenLoopRun(bundle, topics, arguments.goal, telemetry).run(log)


def _is_of_deploy(path: Path) -> bool:
    """Whether a log is one of ``vuca deploy``: its metadata come before its first message."""
    from vuca_nav.deploy.log_writer import METADATA
    from vuca_nav.deploy.replay.log_file import LogFile

    log = LogFile(path)
    next(log.messages(), None)
    return METADATA in log.metadata


def _telemetry(arguments: ReplayArguments, bundle: Bundle) -> Telemetry:
    if arguments.record is None:
        from vuca_nav.telemetry.interface import Telemetry

        return Telemetry()
    from vuca_nav.telemetry.rerun.recorder import RerunTelemetry

    title = f"{bundle.manifest.robot}, {bundle.manifest.method}, replay of {arguments.log.name}"
    return RerunTelemetry.record(arguments.record, title=title)


def _told(result: Replayed) -> str:
    """The result for a terminal."""
    lines = [f"{result.equal:,} of {result.ticks:,} commands equal to the bit, in {result.missions} missions"]
    if result.first is not None:
        tick, log_time, logged, replayed = result.first
        lines.append(
            f"  first difference at tick {tick} ({log_time * 1e-9:.3f} s): logged {logged}, replayed {replayed}"
        )
    if result.left_out:
        lines.append(f"  {result.left_out:,} ticks left out: before a mission, or after something that the log lacks")
    if result.damage:
        lines.append(f"  the log is not whole: {result.damage}")
    return "\n".join(lines)


def _told_open_loop(result: OpenLoop) -> str:
    """The result of a log of somebody else's, for a terminal."""
    x, y, yaw = result.end
    lines = [
        f"no log of vuca deploy: the stack in the open loop over {result.duration:.1f} s, {result.scans:,} scans of "
        f"{result.num_beams} beams, {result.ticks:,} ticks",
        f"  {result.path_length:.2f} m by its own estimate, to ({x:.2f}, {y:.2f}), yaw {yaw:.2f}",
    ]
    if result.goal is None:
        lines.append("  no goal in the log and none by --goal: it stands and maps")
    for reason, count in sorted(result.refused.items()):
        lines.append(f"  {count:,} messages refused: {reason}")
    if result.damage:
        lines.append(f"  the log is not whole: {result.damage}")
    lines.append("    time    said v_x   v_y   w_z   driven v_x   v_y   w_z")
    every = -(-len(result.said) // MOST_LINES)
    for time, said, driven in result.said[::every]:
        cells = (" ".join(f"{value:5.2f}" for value in values) for values in (said, driven))
        lines.append(f"{time:8.1f}       {'        '.join(cells)}")
    return "\n".join(lines)
