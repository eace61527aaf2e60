"""What drives a robot through a mission: the interface that every method has, whatever is inside."""

from abc import ABC, abstractmethod

from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import Odometry, Pose2, Scan, VelocityCommand


class Stack(ABC):
    """A navigation stack: scans and odometry in, velocity commands out."""

    map_from_base: Pose2
    """Its estimate of the robot's pose."""
    finding: str | None = None
    """What it has found out about its goal, if that cannot be reached."""
    tolerance: float = GOAL_TOLERANCE
    """Distance from the goal within which the mission counts it as reached [m]; set before ``reset``."""

    def stops_within(self, configured: float) -> float:
        """Estimated distance from the goal at which to stop [m].

        Args:
            configured: The same for a mission of ``GOAL_TOLERANCE``: what is left of that for SLAM's error is left of
                any tolerance, but at most half of it.
        """
        return max(configured + (self.tolerance - GOAL_TOLERANCE), min(configured, 0.5 * self.tolerance))

    @property
    def grid(self) -> OccupancyGrid | None:
        """Its map as it is now; None for a stack that keeps none."""
        return None

    @abstractmethod
    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Begin a mission.

        Args:
            start: ``map_from_base`` now; it defines the map's frame.
            goal: Goal in the map [m].
            prior_map: A map known beforehand, if there is one.
        """

    @abstractmethod
    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """One tick, at the lidar's rate.

        Args:
            scan: The lidar's latest scan.
            odometry: The body's odometry at the same time.

        Returns:
            The command to hold until the next tick.
        """
