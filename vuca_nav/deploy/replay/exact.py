"""The stack of a bundle over a log of ``vuca deploy``, step by step as it drove: the same commands to the bit."""

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from vuca_nav.data_files import parse_json, shown
from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.log import FORMAT, MISSION, MISSION_TYPE, TICK, TICK_TYPE
from vuca_nav.deploy.log_writer import METADATA
from vuca_nav.deploy.replay.log_file import LogFile, LoggedMessage
from vuca_nav.deploy.transport.ros_types import BadMessage, decode
from vuca_nav.errors import BadArgument, BadBundle, BadLog
from vuca_nav.navigator import Navigator
from vuca_nav.plain import from_plain
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
KEPT_SCANS = 64
"""Number of the last scans that a tick may refer to: two seconds at 30 Hz."""


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
    """Ticks that cannot be replayed: before a mission, or in one after something that the log lacks."""
    damage: str | None
    """Why the log ends early; None if it does not."""


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
        self._lacks, self._next = False, 0

    def take(self, message: LoggedMessage) -> None:
        """Take in the next message of the log."""
        if message.type_name == SCAN_TYPE:
            self._scans.append(message)
        elif (message.topic, message.type_name) == (MISSION, MISSION_TYPE):
            self._begin(_decoded(message))
        elif (message.topic, message.type_name) == (TICK, TICK_TYPE):
            # After a step that the disk was too slow for, the stack is in another state than it was.
            self._lacks |= message.number != self._next
            self._next = message.number + 1
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
            self._lacks = False
        except (BadArgument, BadBundle) as error:
            raise BadLog(f"{MISSION}: {error}") from error
        self.missions += 1

    def _tick(self, tick: Any, log_time: int) -> None:
        """A step of the stack, again."""
        ranges = self._ranges(tick.scan)
        self._lacks |= ranges is None
        if self._navigator is None or self._lacks:
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
