"""The lower layer's interface: from the percept and the waypoint to a velocity command."""

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

from vuca_nav.perception.percept import Percept
from vuca_nav.types import VelocityCommand


class LocalGoal(NamedTuple):
    """The waypoint that a local policy heads for at a tick."""

    point_in_base: tuple[float, float]
    """The waypoint [m]."""
    is_final: bool
    """Whether it is the goal itself, at which to slow down and stop."""
    is_narrow: bool = False
    """Whether the way to it is narrow about the robot: narrower than any that networks are trained on."""
    room: float = math.inf
    """Least room that the way to it leaves at either side of the body about the robot [m]."""


class LocalPolicy(ABC):
    """Local controller that is asked for a command once a tick.

    Attributes:
        rate: Rate of the ticks that it is made for [Hz]; None if any will do.
    """

    rate: float | None = None

    @abstractmethod
    def reset(self) -> None:
        """Forget the last mission."""

    @abstractmethod
    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The velocity command for the next tick, within the body's limits.

        Args:
            percept: The percept of this tick.
            goal: The waypoint; None if the body has to stand, and ``STOP`` is the answer.
        """
