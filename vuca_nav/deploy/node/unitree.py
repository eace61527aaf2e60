"""A Unitree Go2 as its own computer offers it: velocity requests and sport state. Not tried on hardware.

Go2's services speak DDS with types of their own, under names that ROS 2 maps to ``/api/sport/request`` and
``/sportmodestate``; the types are written here after Unitree's published interface, since its SDK needs a version of
Cyclone DDS that does not go with this one.
"""

import json
import math
import time
from collections import deque
from typing import Any

from vuca_nav.deploy.messages import Refused, SensedOdometry
from vuca_nav.deploy.node.base import Base
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.geometry import between
from vuca_nav.perception.readings import FARTHEST, FASTEST, FASTEST_TURN
from vuca_nav.types import STOP, Pose2, Twist2, VelocityCommand
from vuca_nav.wire import NANOSECONDS, up_of, yaw_of

MOVE, STOP_MOVE = 1008, 1003
"""Numbers of the sport service's functions."""
WINDOW = 80_000_000
"""Time over which positions are compared for the velocity [ns]: the message's own is not said to be in which frame."""
_UNIT = 1e-2


class UnitreeBase(Base):
    """A Go2's sport service. Others publish requests, too: its remote control and its app."""

    command_topic, command_type = "/api/sport/request", "unitree_api/msg/Request"
    odometry_topic, odometry_type = "/sportmodestate", "unitree_go/msg/SportModeState"
    commands_are_ours = False

    def __init__(self) -> None:
        self._number = 0
        self._poses: deque[tuple[int, Pose2]] = deque()

    def command_message(self, command: VelocityCommand, stamp: int) -> Any:
        """A command as a request to move, or to stop. The service wants no stamp; requests are numbered."""
        self._number += 1
        request = new(self.command_type)
        request.header.identity.id = self._number
        request.header.policy.noreply = True
        if command == STOP:
            request.header.identity.api_id = STOP_MOVE
        else:
            request.header.identity.api_id = MOVE
            request.parameter = json.dumps({"x": command.v_x, "y": command.v_y, "z": command.w_z})
        return request

    def odometry(self, message: Any, up: tuple[float, float, float] | None) -> SensedOdometry:
        """The odometry of a SportModeState, with the time of its arrival: the robot's clock is not this machine's."""
        now = time.time_ns()
        w, x, y, z = message.imu_state.quaternion.tolist()
        length = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(length - 1.0) < _UNIT:
            raise Refused("a quaternion is no rotation")
        quaternion = x / length, y / length, z / length, w / length
        place, turn = message.position.tolist(), float(message.yaw_speed)
        if not all(abs(value) < FARTHEST for value in place):
            raise Refused("a position is not finite, or too far out")
        if not abs(turn) < FASTEST_TURN:
            raise Refused("a velocity is not finite, or no body's")
        pose = Pose2(place[0], place[1], yaw_of(quaternion))
        v_x, v_y = self._velocity(now, pose)
        return SensedOdometry(now, pose, Twist2(v_x, v_y, turn), up_of(quaternion) if up is None else up)

    def _velocity(self, now: int, pose: Pose2) -> tuple[float, float]:
        """Mean velocity over the window in the body's frame [m/s]."""
        poses = self._poses
        poses.append((now, pose))
        while len(poses) > 2 and poses[1][0] <= now - WINDOW:
            poses.popleft()
        began, before = poses[0]
        elapsed = (now - began) / NANOSECONDS
        if elapsed <= 0.0:
            return 0.0, 0.0
        motion = between(before, pose)
        c, s = math.cos(motion.yaw), math.sin(motion.yaw)
        v_x, v_y = (c * motion.x + s * motion.y) / elapsed, (-s * motion.x + c * motion.y) / elapsed
        if math.hypot(v_x, v_y) > FASTEST:  # the position was set anew
            poses.clear()
            return 0.0, 0.0
        return v_x, v_y
