"""The plan stage: a path to the target and the waypoint on it (Zhang et al., Section III-C, waypoint planning)."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from vuca_nav.geometry import transform_points
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.target import Target
from vuca_nav.planning.waypoints import farthest_free_waypoint
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2


@dataclass(frozen=True, slots=True)
class Plan:
    """The path to the target and the next waypoint."""

    path_in_map: FloatArray
    """(n, 2) path from the robot's place at planning to its target [m]; empty before there is one."""
    waypoint_in_map: tuple[float, float]
    """[m]"""
    is_final: bool = False
    """Whether the waypoint is the goal itself."""
    clearances: FloatArray = field(default_factory=lambda: np.empty(0))
    """(n,) distance of each point of the path to the nearest obstacle, capped [m]; (0,) where no map was asked."""

    def narrowest(self, place: tuple[float, float], reach: float) -> float:
        """Least clearance of the path about a place [m]; ``inf`` where no path is known there.

        Args:
            place: The place in the map [m].
            reach: Distance from it within which the path counts [m].
        """
        path, clearances = self.path_in_map, self.clearances
        if not len(clearances):
            return math.inf
        near = np.hypot(path[:, 0] - place[0], path[:, 1] - place[1]) <= reach
        return float(clearances[near].min()) if near.any() else math.inf

    def moved(self, map_correction: Pose2) -> "Plan":
        """The plan after the map has moved."""
        (waypoint,) = transform_points(map_correction, np.array([self.waypoint_in_map])).tolist()
        return replace(
            self, path_in_map=transform_points(map_correction, self.path_in_map), waypoint_in_map=tuple(waypoint)
        )


def no_plan(start: Pose2) -> Plan:
    """The plan before anything is planned: stay."""
    return Plan(np.empty((0, 2)), (start.x, start.y))


def straight_plan(map_from_base: Pose2, goal: tuple[float, float]) -> Plan:
    """The plan of a robot that heads for its goal, whatever is on the way.

    Args:
        map_from_base: Pose of the robot.
        goal: The goal in the map [m].
    """
    return Plan(np.array([map_from_base[:2], goal]), goal, is_final=True)


class Planner:
    """Plans paths.

    Args:
        telemetry: Receives the plan.
    """

    def __init__(self, telemetry: Telemetry = Telemetry()):
        self.telemetry = telemetry

    def update(self, target: Target | None, paths: PathField, last: Plan) -> Plan:
        """Plan the path to the target, and the farthest waypoint on it.

        Args:
            target: A target that paths reach; None if the explorer found none.
            paths: Paths from the robot.
            last: The plan so far. It is kept where the target cannot be reached: most likely a mover bars the way.
        """
        telemetry = self.telemetry
        if target is None:
            telemetry.event("nothing can be reached: keeping the last path", "WARN")
            plan = last
        else:
            path = paths.path_to(*target.approach)
            waypoint = farthest_free_waypoint(paths.costmap, path, paths.start)
            is_final = target.is_goal and waypoint == target.approach
            plan = Plan(path, waypoint, is_final, paths.costmap.clearances_at(path))
        telemetry.path(plan.path_in_map)
        telemetry.waypoint(plan.waypoint_in_map)
        return plan
