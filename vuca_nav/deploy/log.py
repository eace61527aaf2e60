"""The log of a mission: what a robot heard and said, as MCAP that Foxglove and ``ros2 bag`` open.

Messages are kept as they came and went, with their ROS 2 definitions. Two topics of the project's own make a replay
exact: ``/vuca/mission`` tells when the stack began or took another goal, ``/vuca/tick`` which scan and which odometry
each of its steps saw, and its command, before the safety layer had its say.

A thread writes (``vuca_nav.deploy.log_writer``), and memory stays bounded: a chunk is compressed and written when it is
full, and what is written survives the end of the process, however it comes.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from vuca_nav.cli import undisturbed
from vuca_nav.deploy.log_writer import Entry, LogWriter
from vuca_nav.deploy.manifest import Manifest
from vuca_nav.deploy.transport.ros_types import encode, new
from vuca_nav.plain import to_plain
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, VelocityCommand
from vuca_nav.wire import NANOSECONDS

FORMAT = "vuca-log-1"
MISSION, MISSION_TYPE = "/vuca/mission", "vuca_msgs/msg/Mission"
TICK, TICK_TYPE = "/vuca/tick", "vuca_msgs/msg/Tick"
PATIENCE = 10.0
"""Longest wait for the disk at the end of a log [s]."""


class MissionLog:
    """Writes the log of a mission.

    A disk must not stop a robot, nor hold it up: what cannot be written is left out, and ``failure`` says why. Messages
    are numbered, so that one that is missing is noticed by who reads them.

    Args:
        path: File of the log; it must not exist yet.
        manifest: Manifest of the bundle that drives.

    Raises:
        BadArgument: If there is something at ``path``, or it cannot be written.
    """

    def __init__(self, path: Path, manifest: Manifest):
        self._numbers: dict[str, int] = {}
        about = {"format": FORMAT, "bundle": manifest.digest, "robot": manifest.robot, "method": manifest.method}
        self._writer = LogWriter(path, about)

    @property
    def failure(self) -> str | None:
        """Why the log is not whole; None while it is."""
        return self._writer.failure

    def received(self, topic: str, type_name: str, data: bytes, log_time: int, sent: int | None = None) -> int:
        """Keep a message that came.

        Args:
            topic: Full ROS name of its topic.
            type_name: ROS name of its type.
            data: The message, CDR with its header.
            log_time: When it was taken [ns].
            sent: When it was published, if that is known [ns].

        Returns:
            Its number on the topic, from 0 on.
        """
        return self._add(topic, type_name, data, log_time, log_time if sent is None else sent)

    def sent(self, topic: str, type_name: str, data: bytes, log_time: int) -> int:
        """Keep a message that was published; as ``received``."""
        return self._add(topic, type_name, data, log_time, log_time)

    def began(self, start: Pose2, goal: tuple[float, float] | None, lidar: LidarSpec, log_time: int) -> None:
        """Keep that the stack was reset.

        Args:
            start: Pose of the robot in the map.
            goal: Goal in the map [m], if there is one.
            lidar: The lidar that the stack was built for.
            log_time: The time [ns].
        """
        fields = {"is_reset": True, "start": _numbers(start), "lidar": json.dumps(to_plain(lidar))}
        self._say_mission(fields, goal, log_time)

    def heads_for(self, goal: tuple[float, float] | None, log_time: int) -> None:
        """Keep that the stack took another goal, or none.

        Args:
            goal: Goal in the map [m]; None to stand.
            log_time: The time [ns].
        """
        self._say_mission({"is_reset": False}, goal, log_time)

    def ticked(self, scan: Scan, number: int, odometry: Odometry, command: VelocityCommand, log_time: int) -> None:
        """Keep a step of the stack.

        Args:
            scan: The scan that it saw.
            number: Number of the message that the scan came by, as ``received`` returned it.
            odometry: The odometry that it saw.
            command: Its answer.
            log_time: The time [ns].
        """
        seen = [odometry.stamp, *odometry.odom_from_base, *odometry.twist, *odometry.up]
        message = new(
            TICK_TYPE, stamp=_time(log_time), scan=number, scan_stamp=scan.stamp, odometry=_numbers(seen),
            command=_numbers(command),
        )  # fmt: skip
        self._add(TICK, TICK_TYPE, encode(message, TICK_TYPE), log_time, log_time)

    def flush(self, timeout: float) -> bool:
        """Wait until all is written, at most ``timeout`` [s]; whether it is."""
        return self._writer.flush(timeout)

    def close(self) -> None:
        """Write what is left, and the index; a second call does nothing. A log without a message is not kept.

        Requests to end are ignored meanwhile: a second Ctrl-C does not cut the log.
        """
        with undisturbed():
            self._writer.close(PATIENCE)

    def __enter__(self) -> "MissionLog":
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """End by ``close``."""
        self.close()

    def _say_mission(self, fields: dict[str, Any], goal: tuple[float, float] | None, log_time: int) -> None:
        known = {} if goal is None else {"goal": _numbers(goal)}
        message = new(MISSION_TYPE, **fields, **known, has_goal=goal is not None, stamp=_time(log_time))
        self._add(MISSION, MISSION_TYPE, encode(message, MISSION_TYPE), log_time, log_time)

    def _add(self, topic: str, type_name: str, data: bytes, log_time: int, publish_time: int) -> int:
        number = self._numbers.get(topic, 0)
        self._numbers[topic] = number + 1
        entry = Entry(topic, type_name, data, log_time, publish_time, number)
        self._writer.add(entry, always=topic == MISSION)  # that one is missing would show at the next one only
        return number


def _time(nanoseconds: int) -> Any:
    return new("builtin_interfaces/msg/Time", sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def _numbers(values: Any) -> Any:
    return np.array(values, np.float64)
