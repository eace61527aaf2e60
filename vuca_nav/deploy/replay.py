"""``vuca replay``: the stack of a bundle over a log.

A log of ``vuca deploy`` says what every step of the stack saw: the replay gives the same commands to the bit, or says
where they first differ. Any other rosbag2 log with a scan and odometry drives the stack as well, a tick a scan, in the
open loop: the robot went where it went, and the commands are what the stack would have said.
"""

import json
import sys
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import tyro

from vuca_nav.cli import parse, show
from vuca_nav.data_files import parse_json, shown
from vuca_nav.deploy.bundle import Bundle, load_bundle
from vuca_nav.deploy.log import FORMAT, METADATA, MISSION, MISSION_TYPE, TICK, TICK_TYPE
from vuca_nav.deploy.log_file import LogFile, LoggedMessage
from vuca_nav.deploy.open_loop import OpenLoop, OpenLoopRun, find_topics
from vuca_nav.deploy.transport.ros_types import BadMessage, decode
from vuca_nav.errors import BadArgument, BadBundle, BadLog
from vuca_nav.navigator import Navigator
from vuca_nav.plain import from_plain
from vuca_nav.progress import CountedProgress
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
MOST_LINES = 60
"""Greatest number of lines of commands that are shown."""
KEPT_SCANS = 64
"""Number of the last scans that a tick may refer to: two seconds at 30 Hz."""


@dataclass(frozen=True)
class ReplayArguments:
    """Replay a log with a bundle: the same commands to the bit, or what the stack would have said."""

    bundle: tyro.conf.Positional[Path]
    """Folder of vuca export."""
    log: tyro.conf.Positional[Path]
    """MCAP file of vuca deploy, or of ros2 bag record with a scan and odometry."""
    goal: Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="X Y", help_behavior_hint="")] = None
    """Goal in the map [m], for a log without one."""
    scan: Annotated[str | None, tyro.conf.arg(metavar="TOPIC", help_behavior_hint="")] = None
    """Topic of the scan, where a log of others has several."""
    odometry: Annotated[str | None, tyro.conf.arg(metavar="TOPIC", help_behavior_hint="")] = None
    """Topic of the odometry, where a log of others has several."""
    record: Annotated[Path | None, tyro.conf.arg(metavar="FILE.rrd", help_behavior_hint="")] = None
    """Record the replay for the Rerun viewer."""
    json: bool = False
    """End with one JSON object on stdout."""


class Difference(NamedTuple):
    """The first step whose command is not the logged one."""

    tick: int
    log_time: int
    """[ns]"""
    logged: list[float]
    replayed: list[float]


class Replayed(NamedTuple):
    """The result of a replay of a log of ``vuca deploy``."""

    ticks: int
    equal: int
    """Number of commands that are equal to the bit."""
    first: Difference | None
    missions: int
    left_out: int
    """Ticks that cannot be replayed: before a mission, or whose scan the log lacks."""
    damage: str | None
    """Why the log ends early; None if it does not."""


def replay(argv: list[str]) -> int:
    """Replay a log with a bundle: the same commands to the bit, or what the stack would have said."""
    arguments = parse(ReplayArguments, "replay", argv)
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
    if arguments.goal is not None and not np.isfinite(arguments.goal).all():
        raise BadArgument(f"--goal {arguments.goal[0]} {arguments.goal[1]}: two finite numbers would be right")
    topics = find_topics(bundle, LogFile(arguments.log), arguments.scan, arguments.odometry)
    return OpenLoopRun(bundle, topics, arguments.goal, telemetry).run(log)


def replay_log(bundle: Bundle, log: LogFile, telemetry: Telemetry = Telemetry()) -> Replayed:
    """Replay a log of ``vuca deploy``.

    Args:
        bundle: The bundle that drove.
        log: The log.
        telemetry: Receives what the stages report.

    Raises:
        BadLog: If the log is of another bundle, or holds no tick that can be replayed.
    """
    run = _Run(bundle, telemetry)
    checked = False
    for message in log.messages():
        if not checked:
            _check_bundle(bundle, log)
            checked = True
        run.take(message)
    if run.ticks == 0:
        damage = f": {log.damage}" if log.damage else ""
        raise BadLog(f"the log holds no tick that can be replayed{damage}")
    return Replayed(run.ticks, run.equal, run.first, run.missions, run.left_out, log.damage)


class _Run:
    """A replay under way."""

    def __init__(self, bundle: Bundle, telemetry: Telemetry):
        self.ticks = self.equal = self.missions = self.left_out = 0
        self.first: Difference | None = None
        self._bundle, self._telemetry = bundle, telemetry
        self._navigator: Navigator | None = None
        self._lidar: LidarSpec | None = None
        self._scans: deque[LoggedMessage] = deque(maxlen=KEPT_SCANS)
        self._scan: tuple[int, Any] = -1, None

    def take(self, message: LoggedMessage) -> None:
        """Take in the next message of the log."""
        if message.type_name == SCAN_TYPE:
            self._scans.append(message)
        elif (message.topic, message.type_name) == (MISSION, MISSION_TYPE):
            self._begin(_decoded(message))
        elif (message.topic, message.type_name) == (TICK, TICK_TYPE):
            self._tick(_decoded(message), message.log_time)

    def _begin(self, mission: Any) -> None:
        """The stack was reset, or took another goal."""
        goal = (float(mission.goal[0]), float(mission.goal[1])) if mission.has_goal else None
        try:
            if not mission.is_reset:
                if self._navigator is not None:
                    self._navigator.head_for(goal)
                return
            lidar = from_plain(LidarSpec, parse_json(mission.lidar, f"{MISSION}: lidar", BadLog), MISSION, BadLog)
            if self._navigator is None or lidar != self._lidar:
                self._navigator, self._lidar = self._bundle.navigator(self._telemetry, lidar), lidar
            self._navigator.reset(Pose2(*mission.start.tolist()), goal)
        except (BadArgument, BadBundle) as error:
            raise BadLog(f"{MISSION}: {error}") from error
        self.missions += 1

    def _tick(self, tick: Any, log_time: int) -> None:
        """A step of the stack, again."""
        ranges = self._ranges(tick.scan)
        if self._navigator is None or ranges is None:
            self.left_out += 1
            return
        stamp, x, y, yaw, v_x, v_y, w_z, *up = tick.odometry.tolist()
        odometry = Odometry(stamp, Pose2(x, y, yaw), Twist2(v_x, v_y, w_z), (up[0], up[1], up[2]))
        self._telemetry.time(stamp)
        try:
            command = self._navigator.step(Scan(float(tick.scan_stamp), ranges), odometry)
        except BadArgument as error:
            raise BadLog(f"{TICK} {self.ticks}: {error}") from error
        if np.array(command).tobytes() == np.array(tick.command, np.float64).tobytes():
            self.equal += 1
        elif self.first is None:
            self.first = Difference(self.ticks, log_time, _finite(tick.command), _finite(command))
        self.ticks += 1

    def _ranges(self, number: int) -> Any:
        """Ranges of the scan message of that number; None if the log lacks it."""
        if self._scan[0] != number:
            found = next((message for message in reversed(self._scans) if message.number == number), None)
            self._scan = number, None if found is None else _decoded(found).ranges.astype(np.float64)
        return self._scan[1]


def _is_of_deploy(path: Path) -> bool:
    """Whether a log is one of ``vuca deploy``: its metadata come before its first message."""
    log = LogFile(path)
    next(log.messages(), None)
    return METADATA in log.metadata


def _check_bundle(bundle: Bundle, log: LogFile) -> None:
    """Raise BadLog if a log is of another bundle, or of a format that is not read."""
    about = log.metadata.get(METADATA, {})
    if about.get("format") != FORMAT:
        raise BadLog(f"the log's format is {shown(repr(about.get('format')))}, this vuca-nav reads {FORMAT!r}")
    if about.get("bundle") != bundle.manifest.digest:
        raise BadLog(
            f"the log is of another bundle, of {shown(about.get('robot'))} and {shown(about.get('method'))}, digest "
            f"{shown(about.get('bundle'), 64)}; this one has {bundle.manifest.digest}"
        )


def _decoded(message: LoggedMessage) -> Any:
    try:
        return decode(message.data, message.type_name)
    except BadMessage as error:
        raise BadLog(f"{shown(message.topic)} {message.number}: {error}") from error


def _finite(command: Any) -> list[float]:
    """A command as JSON holds it."""
    return [float(value) if np.isfinite(value) else 0.0 for value in command]


def _telemetry(arguments: ReplayArguments, bundle: Bundle) -> Telemetry:
    if arguments.record is None:
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
        lines.append(f"  {result.left_out:,} ticks left out: before a mission, or their scan is not in the log")
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
