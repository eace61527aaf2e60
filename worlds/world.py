"""Frozen descriptions of a world: obstacles, movers, start and goal. They neither move nor render.

All shapes are upright and extruded. Positions are in the world frame unless a name says otherwise.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import Pose2
from worlds.wall_grid import WallGrid

ObstacleKind = Literal["wall", "block", "shelf", "pillar", "low"]
MoverKind = Literal["cylinder", "box", "cart", "legs", "person"]
TALLEST = 2.0
"""Height of the tallest body and of the tallest moving obstacle that are reckoned with where none is given [m]."""
MAX_MOVER_SPEED = 5.0
"""Greatest speed of a mover [m/s], as in scene files; the simulation finds every contact of bodies that close in at no
more than 6 m/s."""
OBSTACLE_KINDS: tuple[ObstacleKind, ...] = ("wall", "block", "shelf", "pillar", "low")
MOVER_KINDS: tuple[MoverKind, ...] = ("cylinder", "box", "cart", "legs", "person")


@dataclass(frozen=True, slots=True)
class Box:
    """A cuboid standing on ``base``."""

    x: float
    """Centre [m]."""
    y: float
    length: float
    """Extent along its own x axis [m]."""
    width: float
    """Extent along its own y axis [m]."""
    yaw: float
    """[rad]"""
    height: float
    """[m]"""
    base: float = 0.0
    """Height of the lower face above the floor [m]."""


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder standing on ``base``."""

    x: float
    """Centre [m]."""
    y: float
    radius: float
    """[m]"""
    height: float
    """[m]"""
    base: float = 0.0
    """Height of the lower face above the floor [m]."""


Shape = Box | Cylinder


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A static obstacle."""

    kind: ObstacleKind
    shape: Shape
    outer: bool = False
    """Whether it belongs to the enclosure, which stays when the corridors are taken away."""


@dataclass(frozen=True, slots=True)
class MoverPart:
    """A rigid piece of a mover.

    A part with a swing moves back and forth along the mover's x axis as the mover walks:
    ``x = shape.x + swing * sin(2 pi * distance_walked / STRIDE)``, so a pair of legs has opposite swings.
    """

    shape: Shape
    """Shape in the mover's frame."""
    swing: float = 0.0
    """Amplitude, signed [m]."""


STRIDE = 1.3
"""Distance walked in one gait cycle (two steps) of a person [m]; a person of 1.7 m takes steps of about 0.65 m."""


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """Straight motion at constant speed that turns to a random heading before an obstacle or a narrow way.

    A blind one does not react to the robot.
    """

    speed: float
    """[m/s]"""
    seed: int
    """Seed of this mover's own stream of headings."""


@dataclass(frozen=True, slots=True)
class Patrol:
    """Motion back and forth along a polyline at constant speed. A blind one does not react to the robot."""

    speed: float
    """[m/s]"""
    waypoints: tuple[tuple[float, float], ...]
    """Corners of the polyline; the first is the start [m]."""


@dataclass(frozen=True, slots=True)
class SocialForce:
    """A pedestrian (Helbing and Molnar 1995) that avoids walls and other movers, and the robot unless it is blind."""

    speed: float
    """Desired speed [m/s]."""
    waypoints: tuple[tuple[float, float], ...]
    """Waypoints, visited in turn, over and over [m]."""


@dataclass(frozen=True, slots=True)
class Keyframes:
    """Motion by places at times, straight on between them, as it was recorded or written down: it reacts to nothing.

    Before the first time and after the last one the mover stands there, or is not there at all.
    """

    times: tuple[float, ...]
    """Strictly increasing times by the motion's own clock [s]."""
    points: tuple[tuple[float, float], ...]
    """Place at each of them [m]."""
    period: float | None = None
    """Time after which it begins again, counted from the first time [s]; None: it goes through once."""
    jumps: bool = False
    """Whether it jumps back to the first place when the period is over; otherwise, unless it vanishes, it goes there
    straight on from the last place, in the time that the period leaves."""
    vanishes: bool = False
    """Whether it is there only from the first time to the last."""
    phase: float | None = 0.0
    """Reading of its clock when the episode begins [s]; None: drawn from the episode's seed, the same for all movers of
    a world, so that they keep time with each other."""
    pace: float = 1.0
    """Rate of its clock: the factor on its speeds."""

    @property
    def speed(self) -> float:
        """Greatest speed on any leg [m/s]."""
        times, points = self.course
        legs = zip(pairwise(times), pairwise(points), strict=True)
        return self.pace * max((math.dist(p, q) / (b - a) for (a, b), (p, q) in legs), default=0.0)

    @property
    def course(self) -> tuple[tuple[float, ...], tuple[tuple[float, float], ...]]:
        """Times and places, the way back to the first place included, unless it jumps or is gone meanwhile."""
        if self.period is None or self.jumps or self.vanishes or self.times[0] + self.period <= self.times[-1]:
            return self.times, self.points
        return (*self.times, self.times[0] + self.period), (*self.points, self.points[0])


@dataclass(frozen=True, slots=True)
class UserMotion:
    """Motion by a class of the user's own, see ``worlds.motion.user_motion``."""

    name: str
    """``module:Class``"""
    options: tuple[tuple[str, float | str | bool], ...] = ()
    """Arguments of the class, by their names."""
    speed: float = MAX_MOVER_SPEED
    """Greatest speed; a faster one is cut down to it [m/s]."""
    seed: int = 0
    """Seed of the episode, for the class to draw from."""


Motion = RandomWalk | Patrol | SocialForce | Keyframes | UserMotion


def at_speed(motion: Motion, factor: float) -> Motion:
    """The motion with its speeds times a factor."""
    if isinstance(motion, Keyframes):
        return replace(motion, pace=factor * motion.pace)
    return replace(motion, speed=factor * motion.speed)


@dataclass(frozen=True, slots=True)
class Mover:
    """A moving obstacle."""

    kind: MoverKind
    parts: tuple[MoverPart, ...]
    radius: float
    """Radius of the circle about its origin that holds every part at every swing [m]."""
    start: Pose2
    motion: Motion
    sighted: bool | None = None
    """Whether it sees the robot and gives way to it; None: a pedestrian does, all others do not. Keyframes go by
    themselves: False or None."""

    @property
    def sees_robot(self) -> bool:
        """Whether it gives way to the robot."""
        return isinstance(self.motion, SocialForce) if self.sighted is None else self.sighted

    @property
    def may_vanish(self) -> bool:
        """Whether there may be times at which it is not there."""
        return isinstance(self.motion, UserMotion) or (isinstance(self.motion, Keyframes) and self.motion.vanishes)

    @property
    def top(self) -> float:
        """Height of its highest point above the floor [m]."""
        return max((part.shape.base + part.shape.height for part in self.parts), default=TALLEST)

    @property
    def base(self) -> float:
        """Height of its lowest point above the floor [m]."""
        return min((part.shape.base for part in self.parts), default=0.0)


@dataclass(frozen=True, slots=True)
class Way:
    """A part of one of several ways to the goal: the way that is taken shows how a planner weighs them."""

    name: str
    box: tuple[float, float, float, float]
    """x_min, y_min, x_max, y_max [m]; a robot that enters it has taken this way."""


@dataclass(frozen=True, slots=True)
class World:
    """A scene with its task."""

    name: str
    seed: int
    bounds: tuple[float, float, float, float]
    """x_min, y_min, x_max, y_max [m]."""
    obstacles: tuple[Obstacle, ...]
    movers: tuple[Mover, ...]
    start: Pose2
    goal: tuple[float, float]
    """[m]"""
    ways: tuple[Way, ...] = ()
    """Parts of the alternative ways to the goal, in worlds that record which one a planner takes."""
    open_borders: bool = False
    """Whether the bounds are no barrier: space beyond them is free, and movers may come in through them."""
    tolerance: float = GOAL_TOLERANCE
    """Distance from the goal within which it counts as reached [m]."""
    time_limit: float | None = None
    """Time limit of the mission [s]; None: by the length of the shortest way."""
    starts_on_motion: bool = False
    """Whether the time limit counts from the moment at which the robot has moved 0.1 m, as in BARN."""
    grid: WallGrid | None = None
    """The occupancy map that the last ``len(grid.walls)`` obstacles come from, if they do."""

    def below(self, height: float) -> tuple[Obstacle, ...]:
        """The obstacles that are in the way of a thing of this height [m]: those that do not hang above it."""
        return tuple(obstacle for obstacle in self.obstacles if obstacle.shape.base < height)

    @property
    def mover_height(self) -> float:
        """Height of the highest point of any mover [m]; 0 if there are none."""
        return max((mover.top for mover in self.movers), default=0.0)

    def way_of(self, pose: Pose2) -> str | None:
        """Name of the way that a pose is on, None if it is on none."""
        for way in self.ways:
            x_min, y_min, x_max, y_max = way.box
            if x_min <= pose.x <= x_max and y_min <= pose.y <= y_max:
                return way.name
        return None


def walls_of(grid: WallGrid) -> tuple[Obstacle, ...]:
    """The walls of an occupancy map, a box for each of its rectangles."""
    yaw, side = grid.origin[2], grid.resolution
    return tuple(
        Obstacle("wall", Box(*grid.centre(wall), wall[2] * side, wall[3] * side, yaw, grid.height))
        for wall in grid.walls
    )
