"""The lower layer's interface: from what the robot sees and where it should go to a velocity command."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from vuca_nav.types import NOBODY, FloatArray, Pose2, Scan, Twist2, VelocityCommand

STANDING = Pose2(0.0, 0.0, 0.0)
"""No motion."""
MOST_PERIODS = 2.5
"""Between two scans; after a longer gap what was seen before it is forgotten. A single lost scan is no gap."""
MOST_INVALID = 0.5
"""Share of a scan's beams that may be NaN (REP-117: a fault, not an empty beam) before the robot stops."""


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

    @property
    def is_trustworthy(self) -> bool:
        """Not if more than half of the scan is NaN, or the waypoint, velocity or motion is not a finite number."""
        invalid = int(np.count_nonzero(np.isnan(self.scan.ranges)))
        numbers = sum(self.waypoint_in_base) + sum(self.twist) + sum(self.motion)
        return invalid <= MOST_INVALID * len(self.scan.ranges) and math.isfinite(numbers)


def is_gap(before: float, now: float, rate: float) -> bool:
    """Whether a scan comes so long after the last one, or before it, that what was seen is no longer so.

    Args:
        before: Stamp of the last scan [s].
        now: Stamp of this one [s].
        rate: At which scans should come [Hz].
    """
    return not 0.0 < now - before < MOST_PERIODS / rate


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

    def stopped(self) -> None:  # noqa: B027  (a hook)
        """Called in place of ``command`` at a tick at which the body is told to stand without asking the policy."""

    @abstractmethod
    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The velocity command for the next tick, within the body's limits."""
