"""move_base's recovery behaviours, one after the other while there is no plan or no progress."""

import math
from typing import Literal

from eval.baselines.move_base.config import Behaviour, RecoveryConfig
from vuca_nav.geometry import distance
from vuca_nav.types import Pose2


class Recovery:
    """Decides when the next behaviour is due.

    Args:
        config: Settings.
    """

    def __init__(self, config: RecoveryConfig):
        self.config = config
        self.reset(0.0, Pose2(0.0, 0.0, 0.0))

    def reset(self, now: float, pose: Pose2) -> None:
        """Begin a goal: all behaviours are still to be tried.

        Args:
            now: Time [s].
            pose: Pose in the map.
        """
        self._next = 0
        self._planned_at = self._moved_at = now
        self._moved_from = pose
        self._turn_left = 0.0

    @property
    def is_turning(self) -> bool:
        """Whether the robot is turning about."""
        return self._turn_left > 0.0

    def turn(self, angle: float, now: float, is_possible: bool) -> None:
        """Count a motion while the robot turns about.

        Args:
            angle: Angle since the last tick [rad].
            now: Time [s].
            is_possible: Whether the robot has room to turn; it gives up otherwise.
        """
        self._turn_left = max(0.0, self._turn_left - abs(angle)) if is_possible else 0.0
        self._planned_at = self._moved_at = now

    def update(self, now: float, pose: Pose2, has_plan: bool) -> Behaviour | Literal["abort"] | None:
        """The behaviour that is due now.

        Args:
            now: Time [s].
            pose: Pose in the map.
            has_plan: Whether the last attempt at a plan succeeded.

        Returns:
            A behaviour; "abort" after the last one, and all are tried again; None if none is due.
        """
        c = self.config
        if has_plan:
            self._planned_at = now
        if distance(pose, self._moved_from) > c.progress_distance:
            self.reset(now, pose)
            return None
        if now - self._planned_at < c.planner_patience and now - self._moved_at < c.progress_time:
            return None
        self._planned_at = self._moved_at = now
        if self._next == len(c.behaviours):
            self._next = 0
            return "abort"
        behaviour = c.behaviours[self._next]
        self._next += 1
        if behaviour == "rotate":
            self._turn_left = 2.0 * math.pi
        return behaviour
