"""The lower layer's interface: from the percept and the waypoint to a velocity command."""

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

from vuca_nav.perception.percept import Percept
from vuca_nav.types import VelocityCommand

FIELD_ERROR = 0.035
"""Room of a way that the distance field's error may take [m]: what is left of a very narrow one is margin."""
LEAST_MARGIN, LEAST_MARGIN_ROUND = 0.025, 0.01
"""Least margins [m]."""


class LocalGoal(NamedTuple):
    """The waypoint that a local policy heads for at a tick."""

    point_in_base: tuple[float, float]
    """The waypoint [m]."""
    is_final: bool
    """Whether it is the goal itself, at which to slow down and stop."""
    is_narrow: bool = False
    """Whether the way to it is narrow about the robot: narrower than any that networks are trained on."""
    room: float = math.inf
    """Least room that the way to it leaves on the map [m]: at either side of the body about the robot, and all round
    the body at the goal."""

    def margin(self, usual: float, is_round: bool) -> float:
        """Inflation of the footprint for static obstacles on a way that leaves little room [m].

        Args:
            usual: Inflation where there is room [m].
            is_round: Whether the body is, and so touches nothing by turning.
        """
        return min(usual, max(self.room - FIELD_ERROR, LEAST_MARGIN_ROUND if is_round else LEAST_MARGIN))


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
