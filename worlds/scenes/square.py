"""The square: an open plaza with roadblocks and fast moving obstacles."""

import math

from numpy.random import Generator

from vuca_nav.types import Pose2
from worlds.scenes.parts.generation import Layout, heading, outer_walls, uniform
from worlds.scenes.parts.population import ground_with_movers
from worlds.scenes.parts.scatter import Ground, roadblock
from worlds.world import World

NAME = "square"
SIDE = 24.0
"""Side of the plaza [m]."""
ROADBLOCKS = 10
BARRED = 2
"""Number of roadblocks on the straight way to the goal."""
MOVERS = 24
MOST_MOVERS = 40
MOVER_SPEEDS = (0.2, 2.0)
"""Range of the moving obstacles' speeds [m/s]: up to twice the robot's maximum of 1.0 m/s (Zhang et al., Section
IV-A)."""
CORNER = 2.0
"""Greatest distance along x and y of start and goal from their corners, which are ``INSET`` inside the walls [m]."""
INSET = 1.2
"""Least distance of start and goal from the bounds [m]."""
GAP = 1.4
"""Least way between two roadblocks, and to the walls [m]."""
KEEP_FREE = 1.5
"""Radius around start and goal without roadblocks [m]."""


def square(seed: int, movers: int, footprint_radius: float) -> World:
    """Generate a plaza to be crossed from one corner to the opposite one among its moving obstacles.

    Args:
        seed: Seed of the world.
        movers: Number of moving obstacles.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    return ground_with_movers(NAME, seed, footprint_radius, _layout, movers, MOVER_SPEEDS)


def _layout(rng: Generator) -> Layout | None:
    bounds = (0.0, 0.0, SIDE, SIDE)
    start = INSET + uniform(rng, 0.0, CORNER), INSET + uniform(rng, 0.0, CORNER)
    goal = SIDE - INSET - uniform(rng, 0.0, CORNER), SIDE - INSET - uniform(rng, 0.0, CORNER)
    if rng.random() < 0.5:  # the other diagonal
        start, goal = (start[0], SIDE - start[1]), (goal[0], SIDE - goal[1])
    start, goal = (round(start[0], 3), round(start[1], 3)), (round(goal[0], 3), round(goal[1], 3))
    ground = Ground(bounds, GAP, [(*start, KEEP_FREE), (*goal, KEEP_FREE)])
    for _ in range(40 * ROADBLOCKS):
        if len(ground.pieces) < BARRED:
            share, aside = rng.uniform(0.2, 0.8), rng.uniform(-0.2, 0.2)
            length = math.dist(start, goal)
            dx, dy = (goal[0] - start[0]) / length, (goal[1] - start[1]) / length
            x = round(start[0] + share * (goal[0] - start[0]) - aside * dy, 3)
            y = round(start[1] + share * (goal[1] - start[1]) + aside * dx, 3)
        else:
            x, y = ground.random_point(rng)
        ground.add(roadblock(rng, x, y))
        if len(ground.pieces) == ROADBLOCKS:
            facing = Pose2(*start, round(heading(start, goal), 4))
            return Layout(bounds, (*outer_walls(bounds), *ground.pieces), facing, goal)
    return None
