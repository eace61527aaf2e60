"""The square: an open plaza with roadblocks, and fast movers all over it."""

import math

from numpy.random import Generator

from vuca_nav.types import Pose2
from worlds.scenes.generation import Layout, heading, outer_walls, uniform
from worlds.scenes.population import walked_ground
from worlds.scenes.scatter import Ground, roadblock
from worlds.world import World

NAME = "square"
SIDE = 24.0
"""[m]"""
ROADBLOCKS = 10
BARRED = 2
"""Roadblocks that stand on the straight way to the goal."""
MOVERS = 24
MOST_MOVERS = 40
MOVER_SPEEDS = (0.2, 2.0)
"""Up to twice the robot's maximum of 1.0 m/s (Section IV-A of the paper) [m/s]."""
CORNER = 2.0
"""Start and goal are up to this far from their corners' points 1.2 m inside the walls [m]."""
GAP = 1.4
"""Least way between two roadblocks, and to the walls [m]."""
KEEP_FREE = 1.5
"""Around start and goal [m]."""


def square(seed: int, movers: int, footprint_radius: float) -> World:
    """A plaza crossed from one corner to the opposite one, through everything that moves on it.

    Args:
        seed: Seed of the world.
        movers: Number of moving obstacles.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    return walked_ground(NAME, seed, footprint_radius, _layout, movers, MOVER_SPEEDS)


def _layout(rng: Generator) -> Layout | None:
    bounds = (0.0, 0.0, SIDE, SIDE)
    start = 1.2 + uniform(rng, 0.0, CORNER), 1.2 + uniform(rng, 0.0, CORNER)
    goal = SIDE - 1.2 - uniform(rng, 0.0, CORNER), SIDE - 1.2 - uniform(rng, 0.0, CORNER)
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
