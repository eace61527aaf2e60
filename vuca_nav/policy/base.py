"""The lower layer's interface: from what the robot sees and where it should go to a velocity command."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from vuca_nav.types import Scan, Twist2, VelocityCommand


@dataclass(frozen=True, slots=True)
class LocalObservation:
    """Everything a local policy may look at."""

    scan: Scan
    waypoint_in_base: tuple[float, float]
    """[m]"""
    is_final: bool
    """Whether the waypoint is the goal itself, so that one should slow down and stop there."""
    twist: Twist2
    """Measured velocity of the body."""


class LocalPolicy(ABC):
    """Called at the lidar's rate."""

    @abstractmethod
    def reset(self) -> None:
        """Forget the last episode."""

    @abstractmethod
    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The velocity command for the next tick, within the body's limits."""
