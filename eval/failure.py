"""Classes of missions that neither arrived nor ended in a contact."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from robots.bodies.body import Body
from vuca_nav.errors import BadWorld
from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import Pose2
from worlds.reachability import reachable
from worlds.world import World

FailureClass = Literal["fall", "unreachable", "lost", "stuck", "out_of_time"]
FAILURE_CLASSES: tuple[FailureClass, ...] = ("fall", "unreachable", "lost", "stuck", "out_of_time")
LOST = 0.5
"""Error of the estimated position at the end from which on the robot is lost [m]: the goal's tolerance, and most of a
footprint's radius."""
STUCK_RADIUS, STUCK_TIME = 1.0, 30.0
"""A robot that has stayed within this distance of its last place [m] for this long [s] is stuck: it could have gone
thirty times as far."""
TRAIL_PERIOD = 0.5
"""Time between two places that are remembered [s]."""
RESOLUTION = 0.2
"""Side of the cells on which the goal is searched in space and time [m]."""
LONGEST_DETOUR = 1.08
"""Length of a way along eight directions over that of the straight one, at most."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a mission did not arrive."""

    failure_class: FailureClass
    """Its class, the first of ``FAILURE_CLASSES`` that fits."""
    where: tuple[float, float]
    """Where it ended [m]."""
    since: float
    """Time from which on the robot stayed within a metre of that place [s]."""
    slam_error: float
    """Position error of the last estimate [m]."""
    detour: float
    """Length of the way over the shortest one's."""
    mean_speed: float
    """Length of the way over the time [m/s]."""

    def row(self) -> dict[str, Any]:
        """The failure as a row holds it."""
        return {
            "class": self.failure_class,
            "where": list(self.where),
            "since": self.since,
            "slam_error": self.slam_error,
            "detour": self.detour,
            "mean_speed": self.mean_speed,
        }


class Trail:
    """The robot's places, one every half second."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._places: list[tuple[float, float]] = []

    def add(self, time: float, pose: Pose2) -> None:
        """Remember a place if it is time to."""
        if not self._times or time >= self._times[-1] + TRAIL_PERIOD - 1e-9:
            self._times.append(time)
            self._places.append((pose.x, pose.y))

    def since(self, end: Pose2, time: float) -> float:
        """Time since which the robot has stayed within ``STUCK_RADIUS`` of its place at ``time`` [s]."""
        if not self._places:
            return time
        away = np.hypot(*(np.array(self._places) - (end.x, end.y)).T) > STUCK_RADIUS
        elsewhere = np.flatnonzero(away)
        if not len(elsewhere):
            return self._times[0]
        return self._times[elsewhere[-1] + 1] if elsewhere[-1] + 1 < len(self._times) else time


def is_out_of_reach(world: World, body: Body, time_limit: float) -> bool:
    """Whether nothing could have reached the goal in time, all movements of the movers known.

    A disc within the footprint, smaller by the grid's own inflation and as fast as the grid's detours are long, tries:
    it errs on the side of the goal being reachable. Movers that see the robot make way as nobody can foretell: then
    the goal counts as within reach.

    Args:
        world: The world with its task.
        body: The robot.
        time_limit: Time in which the goal has to be reached [s].
    """
    if any(mover.sees_robot for mover in world.movers):
        return False
    edges = np.roll(body.spec.footprint, -1, axis=0) - body.spec.footprint
    across = edges[:, 0] * body.spec.footprint[:, 1] - edges[:, 1] * body.spec.footprint[:, 0]
    inscribed = float(np.min(np.abs(across) / np.hypot(edges[:, 0], edges[:, 1])))
    radius = max(inscribed - RESOLUTION * 0.5**0.5, 0.05)
    speed = LONGEST_DETOUR * body.spec.max_v_x
    # The disc goes all the way to the goal, a mission of a wider tolerance not.
    time_limit += (world.tolerance - GOAL_TOLERANCE) / speed
    try:
        return not reachable(world, radius, speed, time_limit, RESOLUTION).reached
    except BadWorld:  # no cell of that grid is free about the start, as in a spot as tight as the body
        return False


def classify_failure(
    *,
    fallen: bool,
    out_of_reach: bool,
    slam_error: float,
    time: float,
    end: Pose2,
    trail: Trail,
    way: float,
    shortest: float,
) -> Failure:
    """Why a mission ended by a fall or out of time.

    Args:
        fallen: Whether it ended by a fall.
        out_of_reach: Whether the goal was out of reach from the beginning.
        slam_error: Position error of the last estimate [m].
        time: Time at the end [s].
        end: True pose at the end.
        trail: Places on the way.
        way: Length of the path [m].
        shortest: Length of the shortest path [m].
    """  # fmt: skip
    since = trail.since(end, time)
    failure_class: FailureClass = "out_of_time"
    if fallen:
        failure_class = "fall"
    elif out_of_reach:
        failure_class = "unreachable"
    elif slam_error > LOST:
        failure_class = "lost"
    elif time - since >= STUCK_TIME:
        failure_class = "stuck"
    return Failure(
        failure_class,
        where=(end.x, end.y),
        since=since,
        slam_error=slam_error,
        detour=way / shortest if shortest > 0.0 else 0.0,
        mean_speed=way / time if time > 0.0 else 0.0,
    )


def in_words(failure: dict[str, Any]) -> str:
    """The failure of a row in words."""
    x, y = failure["where"]
    return {
        "fall": f"the body fell at ({x:.2f}, {y:.2f})",
        "unreachable": "with all movements known, nothing as fast as the robot could have arrived in time",
        "lost": f"lost: the last estimate was off by {failure['slam_error']:.2f} m, at ({x:.2f}, {y:.2f})",
        "stuck": f"stuck at ({x:.2f}, {y:.2f}) since {failure['since']:.1f} s",
        "out_of_time": f"out of time, at ({x:.2f}, {y:.2f}): {failure['detour']:.1f} times the shortest way at "
        f"{failure['mean_speed']:.2f} m/s on average",
    }[failure["class"]]
