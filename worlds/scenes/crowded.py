"""The two scenes that many robots are trained in together, after Long et al.: a circle, and a hall of mixed ground.

Long et al., "Towards optimally decentralized multi-robot collision avoidance via deep reinforcement learning"; sizes
as in its public reproduction, https://github.com/Acmece/rl-collision-avoidance. Nothing moves in them but robots.
"""

import math

from numpy.random import Generator

from vuca_nav.types import Pose2
from worlds.scenes.parts.generation import Layout, outer_walls, rectangle, solvable_layout
from worlds.scenes.parts.scatter import Ground, partition, roadblock
from worlds.world import Obstacle, World

CIRCLE, HALL = "circle", "hall"
CIRCLE_RADIUS = 9.0
"""Radius of the circle that starts and goals lie in [m]: the reproduction's."""
_CIRCLE_SIDE = 20.0
"""Side of the walled square around the circle [m]: the reproduction's."""
_HALL_SIDE = 32.0
"""Side of the hall [m]. The reproduction's is 40 m, a good part of it solid; this leaves a robot about as much room."""
_GAP = 1.6
"""Least gap between two obstacles [m]: two robots of the largest footprint pass each other but for a hand's breadth."""
_INSET = 2.0
"""Distance of the aisles from the sides of their quarter [m]."""
_AISLE = 3.0
"""Distance of the aisles' walls from each other [m]."""
_WALL = 0.15
"""Thickness of the aisles' walls [m]."""
ROADBLOCKS, PARTITIONS = 14, 8


def circle(seed: int, footprint_radius: float) -> World:
    """Generate the circle: a walled square of open ground.

    Args:
        seed: Seed of the world; all circles are alike.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    bounds, middle = (0.0, 0.0, _CIRCLE_SIDE, _CIRCLE_SIDE), _CIRCLE_SIDE / 2.0
    across = (middle - CIRCLE_RADIUS, middle), (middle + CIRCLE_RADIUS, middle)
    only = Layout(bounds, outer_walls(bounds), Pose2(*across[0], 0.0), across[1])
    layout, _ = solvable_layout(CIRCLE, seed, footprint_radius, lambda _: only)
    return layout.world(CIRCLE, seed)


def hall(seed: int, footprint_radius: float) -> World:
    """Generate the hall: a quarter each of open ground, roadblocks, free-standing walls and aisles.

    Args:
        seed: Seed of the world.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    layout, _ = solvable_layout(HALL, seed, footprint_radius, _hall)
    return layout.world(HALL, seed)


def _hall(rng: Generator) -> Layout | None:
    bounds, half = (0.0, 0.0, _HALL_SIDE, _HALL_SIDE), _HALL_SIDE / 2.0
    blocks, walls = Ground((half, 0.0, _HALL_SIDE, half), _GAP, []), Ground((0.0, half, half, _HALL_SIDE), _GAP, [])
    for ground, make, wanted in ((blocks, roadblock, ROADBLOCKS), (walls, partition, PARTITIONS)):
        for _ in range(400):
            if len(ground.pieces) == wanted:
                break
            ground.add(make(rng, *ground.random_point(rng)))
        else:
            return None
    start, goal = Pose2(half / 2.0, half / 2.0, math.pi / 4.0), (half + 1.0, half + 1.0)
    return Layout(bounds, (*outer_walls(bounds), *blocks.pieces, *walls.pieces, *_aisles(half)), start, goal)


def _aisles(half: float) -> list[Obstacle]:
    """Parallel walls in the upper right quarter."""
    first, last = half + _INSET, 2.0 * half - _INSET
    count = int((last - first) / _AISLE) + 1
    return [
        rectangle("wall", first + k * _AISLE, first, first + k * _AISLE + _WALL, last - _INSET) for k in range(count)
    ]
