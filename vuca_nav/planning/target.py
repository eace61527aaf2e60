"""What the explorer chooses and the planner leads to."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Target:
    """What the robot heads for: P_exploration, or the goal."""

    point: tuple[float, float]
    """The goal or the boundary cell, in the map [m]."""
    approach: tuple[float, float]
    """Where to drive to for it, in the map [m]."""
    is_goal: bool
