"""The crossing: open ground that movers cross from all sides without seeing the robot, after CrowdNav++.

Liu et al., "Intention aware robot crowd navigation with attention-based interaction graph" (ICRA 2023); sizes of its
published configuration with randomised people, https://github.com/Shuijing725/CrowdNav_Prediction_AttnGraph. Its
people walk by ORCA and react to each other alone; here they do so by the social force model (``worlds.motion.crowd``).
The walls are this project's: a lidar needs something to stand on.
"""

import math

from numpy.random import Generator

from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds.scenes.parts.generation import Layout, heading, outer_walls, solvable_layout, stream, uniform
from worlds.scenes.parts.population import LARGEST_FOOTPRINT, cylinder_body
from worlds.world import Mover, SocialForce, World

NAME = "crossing"
SIDE = 23.0
"""Side of the ground [m]: the largest mover at its outermost start is 0.3 m off the walls."""
ARENA = 6.0
"""Half the side of the square that start and goal are drawn in [m]."""
SHORTEST_TASK = 8.0
"""Least distance from start to goal [m]."""
MOVERS, MOST_MOVERS = 20, 40
CIRCLE = 6.0 * math.sqrt(2.0)
"""Radius of the circle that the movers cross [m]."""
SPREAD = 2.0
"""Greatest offset of a mover's start from the circle, along x and along y [m]."""
RADII = (0.3, 0.5)
"""Range of the movers' radii [m]."""
SPEEDS = (0.5, 1.5)
"""Range of the movers' desired speeds [m/s]: 0.5 to 1.5 times the robot's own."""
GAP = 0.25
"""Least gap between a mover at its start and others, the robot and its goal [m]."""
FURTHER_GOALS = 6
"""Number of points on the circle that a mover visits after the one across; then it begins again."""
NEARBY = 0.5
"""Greatest offset of such a point from the circle, along x and along y, for a speed of 1 m/s [m]."""
TRIES = 2000
"""Number of places tried for a mover; 40 movers need fewer than 50 each."""

Point = tuple[float, float]


def crossing(seed: int, movers: int, footprint_radius: float) -> World:
    """Generate open ground to be crossed among movers that avoid each other, and not the robot.

    Args:
        seed: Seed of the world.
        movers: Number of moving obstacles.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    layout, _ = solvable_layout(NAME, seed, footprint_radius, _layout)
    return layout.world(NAME, seed, _crowd(stream(NAME, seed, 1000), layout, movers))


def _layout(rng: Generator) -> Layout | None:
    bounds, middle = (0.0, 0.0, SIDE, SIDE), SIDE / 2.0
    start, goal = ((middle + uniform(rng, -ARENA, ARENA), middle + uniform(rng, -ARENA, ARENA)) for _ in range(2))
    if math.dist(start, goal) < SHORTEST_TASK:
        return None
    facing = Pose2(*start, round(heading(start, goal), 4))
    return Layout(bounds, outer_walls(bounds), facing, goal)


def _crowd(rng: Generator, layout: Layout, count: int) -> tuple[Mover, ...]:
    middle = SIDE / 2.0
    kept_free = [(*layout.start[:2], LARGEST_FOOTPRINT), (*layout.goal, LARGEST_FOOTPRINT)]
    movers: list[Mover] = []
    for i in range(count):
        parts, radius = cylinder_body(rng, RADII)
        speed = uniform(rng, *SPEEDS)
        taken = [*kept_free, *((m.start.x, m.start.y, m.radius) for m in movers)]
        for _ in range(TRIES):
            x, y = _on_circle(rng, 0.0, SPREAD)
            if all(math.dist((x, y), other[:2]) >= radius + other[2] + GAP for other in taken):
                break
        else:
            raise BadWorld(f"{NAME}: no free place for mover {i + 1} of {count}; fewer movers would be right")
        across = (round(2.0 * middle - x, 3), round(2.0 * middle - y, 3))
        further = [_on_circle(rng, -NEARBY * speed, NEARBY * speed) for _ in range(FURTHER_GOALS)]
        start = Pose2(x, y, round(heading((x, y), across), 4))
        # Waypoints are visited in turn from the second on: the first is the start.
        motion = SocialForce(speed, ((x, y), across, *further))
        movers.append(Mover("cylinder", parts, radius, start, motion, sighted=False))
    return tuple(movers)


def _on_circle(rng: Generator, low: float, high: float) -> Point:
    """A point on the circle, and an offset from it."""
    angle, middle = rng.uniform(0.0, 2.0 * math.pi), SIDE / 2.0
    x = middle + CIRCLE * math.cos(angle) + rng.uniform(low, high)
    y = middle + CIRCLE * math.sin(angle) + rng.uniform(low, high)
    return round(x, 3), round(y, 3)
