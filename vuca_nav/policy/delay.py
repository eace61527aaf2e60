"""Commands that a body has been given and has not answered yet (``BodySpec.delay``)."""

import math
from collections import deque

from vuca_nav.types import STOP, BodySpec, Pose2, VelocityCommand


class CommandDelay:
    """Remembers commands, as the body's limits of acceleration let them through.

    Args:
        body: The body that is commanded.
        rate: Rate of commands [Hz].

    Attributes:
        last: Velocity of the body once it has answered all commands.
    """

    def __init__(self, body: BodySpec, rate: float):
        self._body, self._dt = body, 1.0 / rate
        self._queue: deque[VelocityCommand] = deque(maxlen=round(body.delay * rate))
        self.last = STOP

    def reset(self) -> None:
        """Forget all commands; the body stands."""
        self.last = STOP
        self._queue.clear()

    def add(self, command: VelocityCommand) -> None:
        """Take in a command."""
        body, last, dt = self._body, self.last, self._dt
        self.last = VelocityCommand(
            last.v_x + max(-body.max_a_x * dt, min(command.v_x - last.v_x, body.max_a_x * dt)),
            last.v_y + max(-body.max_a_y * dt, min(command.v_y - last.v_y, body.max_a_y * dt)),
            last.w_z + max(-body.max_a_w * dt, min(command.w_z - last.w_z, body.max_a_w * dt)),
        )
        self._queue.append(self.last)

    def pose(self) -> Pose2:
        """Pose of the body, in the present base_link, when it answers a command that is given now."""
        x = y = yaw = 0.0
        for asked in self._queue:
            middle = yaw + 0.5 * asked.w_z * self._dt
            x += (asked.v_x * math.cos(middle) - asked.v_y * math.sin(middle)) * self._dt
            y += (asked.v_x * math.sin(middle) + asked.v_y * math.cos(middle)) * self._dt
            yaw += asked.w_z * self._dt
        return Pose2(x, y, yaw)
