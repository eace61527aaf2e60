"""Frozen descriptions of a world: obstacles, movers, start and goal. They neither move nor render.

All shapes are upright and extruded. Positions are in the world frame unless a name says otherwise.
"""

from dataclasses import dataclass
from typing import Literal

from vuca_nav.types import Pose2

ObstacleKind = Literal["wall", "block", "shelf", "pillar", "low"]
MoverKind = Literal["cylinder", "box", "cart", "legs", "person"]
TALLEST = 2.0
"""Height of the tallest body and of the tallest moving obstacle that are reckoned with where none is given [m]."""
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


Motion = RandomWalk | Patrol | SocialForce


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
    """Whether it sees the robot and gives way to it; None: a pedestrian does, a walk or a patrol
    does not."""

    @property
    def sees_robot(self) -> bool:
        """Whether it gives way to the robot."""
        return isinstance(self.motion, SocialForce) if self.sighted is None else self.sighted

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
