"""Limits of velocity and acceleration, and the commands that the body has not answered yet."""

from collections import deque
from typing import NamedTuple

from vuca_nav.types import STOP, BodySpec, VelocityCommand


class Given(NamedTuple):
    """A command that went to the body."""

    time: float
    """When [s]."""
    command: VelocityCommand


class CommandLimits:
    """Keeps commands within what the body can do, and remembers those that it has been given.

    The limit of acceleration is taken from the velocity that the body has reached if it answers as its limits say, not
    from the last command: a command that dips for a tick does not start again from there. A command may fall to zero at
    once: the body brakes as hard as it can.

    Args:
        body: The body that is commanded.

    Attributes:
        reached: Velocity of the body once it has answered all commands.
    """

    def __init__(self, body: BodySpec):
        self._body = body
        self._accelerations = (body.max_a_x, body.max_a_y, body.max_a_w)
        self._given: deque[Given] = deque()
        self.reached = STOP

    def reset(self) -> None:
        """Forget all commands; the body stands."""
        self._given.clear()
        self.reached = STOP

    def clamp(self, wanted: VelocityCommand, dt: float) -> VelocityCommand:
        """The command nearest to the wanted one, axis by axis, that the body can answer within a step.

        Args:
            wanted: A command of finite numbers.
            dt: Time until the next command [s].
        """
        body = self._body
        within = VelocityCommand(
            min(max(wanted.v_x, body.min_v_x), body.max_v_x),
            min(max(wanted.v_y, -body.max_v_y), body.max_v_y),
            min(max(wanted.w_z, -body.max_w_z), body.max_w_z),
        )
        return VelocityCommand(
            *(_slew(v, v0, a * dt) for v, v0, a in zip(within, self.reached, self._accelerations, strict=True))
        )

    def add(self, command: VelocityCommand, time: float, dt: float) -> None:
        """Take in the command that goes to the body.

        Args:
            command: The command.
            time: When [s].
            dt: Time for which it is held [s].
        """
        self.reached = VelocityCommand(
            *(
                v0 + min(max(v - v0, -a * dt), a * dt)
                for v, v0, a in zip(command, self.reached, self._accelerations, strict=True)
            )
        )
        self._given.append(Given(time, command))

    def unanswered(self, since: float) -> list[Given]:
        """The commands that are still to be answered at a time, the first of them already being answered then [s]."""
        given, begins = self._given, since - self._body.delay
        while len(given) > 1 and given[1].time <= begins:
            given.popleft()
        return list(given)


def _slew(wanted: float, reached: float, step: float) -> float:
    """The wanted velocity, no farther beyond the one reached than a step; towards zero it may fall at once."""
    if reached > 0.0:
        return min(max(wanted, min(-step + reached, 0.0)), reached + step)
    if reached < 0.0:
        return max(min(wanted, max(step + reached, 0.0)), reached - step)
    return min(max(wanted, -step), step)
