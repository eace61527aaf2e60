"""The log of a mission: what a robot heard and said, as MCAP that Foxglove and ``ros2 bag`` open.

Messages are kept as they came and went, with their ROS 2 definitions. Two topics of the project's own make a replay
exact: ``/vuca/mission`` tells when the stack began or took another goal, ``/vuca/tick`` which scan and which odometry
each of its steps saw, and its command, before the safety layer had its say.

Memory stays bounded: a chunk of ``CHUNK`` bytes is compressed and written when it is full, and what is written
survives the end of the process, however it comes.
"""

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from vuca_nav.deploy.manifest import Manifest
from vuca_nav.deploy.transport.ros_types import definition_of, encode, new, type_hash
from vuca_nav.errors import BadArgument
from vuca_nav.plain import to_plain
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, VelocityCommand
from vuca_nav.wire import NANOSECONDS

FORMAT = "vuca-log-1"
METADATA = "vuca"
"""Name of the metadata record that says which bundle drove."""
MISSION, MISSION_TYPE = "/vuca/mission", "vuca_msgs/msg/Mission"
TICK, TICK_TYPE = "/vuca/tick", "vuca_msgs/msg/Tick"
CHUNK = 128 * 2**10
"""Size of a chunk before it is compressed [bytes]: a second or two of a mission, the most that a kill loses."""


class MissionLog:
    """Writes the log of a mission.

    A full disk must not stop a robot: what cannot be written is left out from then on, and ``failure`` says why.

    Args:
        path: File of the log; it must not exist yet.
        manifest: Manifest of the bundle that drives.

    Raises:
        BadArgument: If there is something at ``path``, or it cannot be written.
    """

    def __init__(self, path: Path, manifest: Manifest):
        from mcap.writer import CompressionType, Writer

        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(path, "xb")  # noqa: SIM115
        except FileExistsError:
            raise BadArgument(f"--log {path} exists; a log is never written over: give another name") from None
        except OSError as error:
            raise BadArgument(f"--log {path} cannot be written: {error.strerror}") from error
        self._path = path
        self.failure: str | None = None
        """Why the log is not whole; None while it is."""
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._numbers: dict[str, int] = {}
        self._writer = Writer(self._file, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        about = {"format": FORMAT, "bundle": manifest.digest, "robot": manifest.robot, "method": manifest.method}
        self._guarded(self._begin, about)

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
        self._guarded(self._file.flush)

    def close(self) -> None:
        """Write what is left, and the index; a second call does nothing. A log without a message is not kept."""
        if not self._file.closed:
            self._guarded(self._writer.finish)
            with contextlib.suppress(OSError):  # of the last bytes, on a disk that is full
                self._file.close()
            if not self._numbers:  # ended before the first: the same command can be given again
                with contextlib.suppress(OSError):
                    self._path.unlink()

    def __enter__(self) -> "MissionLog":
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """End by ``close``."""
        self.close()

    def _begin(self, about: dict[str, str]) -> None:
        self._writer.start(profile="ros2", library="vuca-nav")
        self._writer.add_metadata(METADATA, about)
        self._file.flush()

    def _say_mission(self, fields: dict[str, Any], goal: tuple[float, float] | None, log_time: int) -> None:
        known = {} if goal is None else {"goal": _numbers(goal)}
        message = new(MISSION_TYPE, **fields, **known, has_goal=goal is not None, stamp=_time(log_time))
        self._add(MISSION, MISSION_TYPE, encode(message, MISSION_TYPE), log_time, log_time)

    def _add(self, topic: str, type_name: str, data: bytes, log_time: int, publish_time: int) -> int:
        number = self._numbers.get(topic, 0)
        self._numbers[topic] = number + 1
        self._guarded(self._write, topic, type_name, data, (log_time, publish_time, number))
        return number

    def _write(self, topic: str, type_name: str, data: bytes, when: tuple[int, int, int]) -> None:
        if topic not in self._channels:
            if type_name not in self._schemas:
                definition = definition_of(type_name).encode()
                self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition)
            told = {"offered_qos_profiles": "", "topic_type_hash": type_hash(type_name)}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[type_name], told)
        log_time, publish_time, number = when
        self._writer.add_message(self._channels[topic], log_time, data, publish_time, number)

    def _guarded(self, work: Any, *arguments: Any) -> None:
        """Do some writing, unless some has failed before."""
        if self.failure is not None:
            return
        try:
            work(*arguments)
        except OSError as error:
            self.failure = f"the log cannot be written any more: {error.strerror}"


def _time(nanoseconds: int) -> Any:
    return new("builtin_interfaces/msg/Time", sec=nanoseconds // NANOSECONDS, nanosec=nanoseconds % NANOSECONDS)


def _numbers(values: Any) -> Any:
    return np.array(values, np.float64)
