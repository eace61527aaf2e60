"""What the node says: commands first, the rest where there is time for it."""

import time
from typing import Any

from vuca_nav.deploy.messages import (
    map_message,
    path_message,
    status_message,
    time_message,
    tracks_message,
    transform_message,
)
from vuca_nav.deploy.node.base import Base
from vuca_nav.deploy.node.log import NodeLog
from vuca_nav.deploy.robot_file import RobotFile
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.transport.interface import COMMAND, LATCHED, RELIABLE, Publisher, Qos, Transport
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.navigator import Navigator
from vuca_nav.types import STOP, Pose2, VelocityCommand

MAP_PERIOD = 1.0
"""Least time between two maps [s]."""
_TRACKS_TICKS, _DIAGNOSTICS_PERIOD = 3, 0.5
_TRANSFORMS = Qos(depth=100)
_FAREWELLS = 3
"""Number of zero commands at the end: a subscriber of best effort may lose one."""


class Outputs:
    """The node's publishers.

    Args:
        transport: The network.
        robot: Frames and topics of the robot.
        base: Its base.
        log: Keeps what is said.
    """

    def __init__(self, transport: Transport, robot: RobotFile, base: Base, log: NodeLog):
        self._transport, self._frames, self._base, self._log = transport, robot.frames, base, log
        self._channels: dict[str, tuple[str, str, Publisher]] = {}
        topics = robot.topics
        for name, topic, type_name, qos in (
            ("command", base.command_topic, base.command_type, COMMAND),
            ("map", topics.map, "nav_msgs/msg/OccupancyGrid", LATCHED),
            ("plan", topics.plan, "nav_msgs/msg/Path", RELIABLE),
            ("tracks", topics.tracks, "visualization_msgs/msg/MarkerArray", RELIABLE),
            ("tf", "/tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS),
            ("diagnostics", "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", RELIABLE),
        ):
            publisher = transport.advertise(topic, type_name, qos)
            self._channels[name] = transport.full_name(topic), type_name, publisher
        self._plan: object = None
        self._map_shown = self._told = float("-inf")
        self._action = ""
        self._ticks = 0

    @property
    def publishers_of_commands(self) -> int:
        """Number of publishers of the command's topic that are known, with this one; 1 where others are welcome."""
        if not self._base.commands_are_ours:
            return 1
        return sum(not endpoint.is_own for endpoint in self._transport.publishers(self._base.command_topic)) + 1

    def command(self, command: VelocityCommand, stamp: int) -> None:
        """Publish a command.

        Args:
            command: The command.
            stamp: Stamp of the newest reading that it answers [ns].
        """
        self._publish("command", self._base.command_message(command, stamp))

    def farewell(self, stamp: int) -> None:
        """Publish zero commands, and see that they arrive."""
        for _ in range(_FAREWELLS):
            self.command(STOP, stamp)
        self._channels["command"][2].flush(0.2)

    def show(self, navigator: Navigator, map_from_odom: Pose2, stamp: int) -> None:
        """Publish what the stack believes: transform, plan, map, tracks."""
        frames = self._frames
        self._publish("tf", transform_message(map_from_odom, stamp, frames.map, frames.odom))
        if navigator.plan is not self._plan:
            self._plan = navigator.plan
            self._publish("plan", path_message(navigator.plan.path_in_map, stamp, frames))
        if self._ticks % _TRACKS_TICKS == 0 and navigator.percept is not None:
            self._publish("tracks", tracks_message(navigator.percept.tracks, stamp, frames))
        self._ticks += 1
        now = time.monotonic()
        if now - self._map_shown >= MAP_PERIOD:
            self._map_shown = now
            self._publish("map", map_message(navigator.slam.navigation_grid, stamp, frames))

    def diagnose(self, safety: SafetyLayer, loop: tuple[tuple[str, str], ...], stamp: int) -> None:
        """Publish diagnostics: at once if the safety layer's action has changed, twice a second otherwise.

        Args:
            safety: The safety layer.
            loop: Key-value pairs of the loop.
            stamp: The time [ns].
        """
        state, now = safety.state, time.monotonic()
        reason = state.reasons[0].name if state.reasons else ""
        if now - self._told < _DIAGNOSTICS_PERIOD and (state.action + reason) == self._action:
            return
        self._told, self._action = now, state.action + reason
        refusals = self._transport.refusals
        refused = tuple((f"{topic}: {reason}", str(count)) for (topic, reason), count in refusals.counts.items())
        message = new("diagnostic_msgs/msg/DiagnosticArray")
        message.header.stamp = time_message(stamp)
        message.status = [
            status_message(int(state.level), "vuca: safety", state.message, safety.values()),
            status_message(1 if refused else 0, "vuca: messages", f"{refusals.total} refused", refused),
            status_message(0, "vuca: loop", "running", loop),
        ]
        self._publish("diagnostics", message)

    def _publish(self, name: str, message: Any) -> None:
        topic, type_name, publisher = self._channels[name]
        data = publisher.publish(message)
        self._log.sent(topic, type_name, data, time.time_ns())
