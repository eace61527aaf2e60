"""The lower layer's interface: from what the robot sees and where it should go to a velocity command."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from vuca_nav.types import NOBODY, FloatArray, Pose2, Scan, Twist2, VelocityCommand

STANDING = Pose2(0.0, 0.0, 0.0)
"""No motion."""


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
    motion: Pose2 = STANDING
    """The base's displacement since the last tick by odometry, in its frame of then."""


class LocalPolicy(ABC):
    """Called at the lidar's rate."""

    @abstractmethod
    def reset(self) -> None:
        """Forget the last episode."""

    def look(self, observation: LocalObservation) -> None:  # noqa: B027  (a hook)
        """Called at every tick, before it is decided where to go; the waypoint is the last tick's.

        A policy that remembers what it saw, or is asked about it by the explorer, takes it in here.
        """

    def walkers(self) -> FloatArray:
        """What is known to move, (k, 3) x, y of the centre in base_link and radius [m].

        By the time that the robot gets there it is elsewhere: it is left out of the map, and of what paths go round.
        """
        return NOBODY

    @abstractmethod
    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The velocity command for the next tick, within the body's limits."""
