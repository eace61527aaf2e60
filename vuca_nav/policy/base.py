"""The lower layer's interface: from the percept and the waypoint to a velocity command."""

from abc import ABC, abstractmethod
from typing import NamedTuple

from vuca_nav.perception.percept import Percept
from vuca_nav.types import VelocityCommand


class LocalGoal(NamedTuple):
    """What a local policy heads for at a tick."""

    point_in_base: tuple[float, float]
    """The waypoint [m]."""
    is_final: bool
    """Whether it is the goal itself, so that one should slow down and stop there."""


class LocalPolicy(ABC):
    """Asked at the lidar's rate, once a tick."""

    @abstractmethod
    def reset(self) -> None:
        """Forget the last mission."""

    @abstractmethod
    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The velocity command for the next tick, within the body's limits.

        Args:
            percept: This tick's.
            goal: Where to go; None if the body has to stand, and ``STOP`` is the answer.
        """
