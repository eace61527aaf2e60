"""The two training scenes of Zhang et al., Fig. 3a: static obstacles to drive around, moving obstacles to avoid."""

import math

from numpy.random import Generator

from vuca_nav.types import Pose2
from worlds.scenes.parts.generation import Layout, heading, outer_walls, solvable_layout
from worlds.scenes.parts.population import ground_with_movers
from worlds.scenes.parts.scatter import Ground, partition, roadblock
from worlds.world import World

STATIC, DYNAMIC = "static", "dynamic"
SIDE = 16.0
"""Side of both scenes [m]. The paper gives none: a lidar of 12 m sees most of this one, and an episode is short."""
WALLS, ROADBLOCKS = 9, 9
"""Numbers of obstacles in the static scene: "massive walls and roadblocks" in Zhang et al."""
MOVERS = 20
MOST_MOVERS = 40
MOVER_SPEEDS = (0.2, 1.0)
"""Range of the moving obstacles' speeds in the dynamic scene [m/s]: up to the robot's own maximum."""
GAP = 1.1
"""Least gap between two static obstacles, and to the walls [m]."""
KEEP_FREE = 1.0
"""Radius around start and goal without obstacles [m]."""
INSET = 1.2
"""Least distance of start and goal from the bounds [m]."""
SHORTEST_TASK = 8.0
"""Least distance from start to goal [m]."""


def static(seed: int, footprint_radius: float) -> World:
    """Generate walls and roadblocks without moving obstacles.

    Args:
        seed: Seed of the world.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    layout, _ = solvable_layout(STATIC, seed, footprint_radius, lambda rng: _layout(rng, WALLS, ROADBLOCKS))
    return layout.world(STATIC, seed)


def dynamic(seed: int, movers: int, footprint_radius: float) -> World:
    """Generate open ground with moving obstacles of many shapes that walk at random.

    Args:
        seed: Seed of the world.
        movers: Number of moving obstacles.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    return ground_with_movers(DYNAMIC, seed, footprint_radius, lambda rng: _layout(rng, 0, 0), movers, MOVER_SPEEDS)


def _layout(rng: Generator, walls: int, roadblocks: int) -> Layout | None:
    bounds = (0.0, 0.0, SIDE, SIDE)
    inner = Ground((INSET, INSET, SIDE - INSET, SIDE - INSET), 0.0, [])
    start, goal = inner.random_point(rng), inner.random_point(rng)
    if math.dist(start, goal) < SHORTEST_TASK:
        return None
    ground = Ground(bounds, GAP, [(*start, KEEP_FREE), (*goal, KEEP_FREE)])
    for make, wanted in ((partition, walls), (roadblock, walls + roadblocks)):
        for _ in range(200):
            if len(ground.pieces) >= wanted:
                break
            ground.add(make(rng, *ground.random_point(rng)))
        else:
            if len(ground.pieces) < wanted:
                return None
    facing = Pose2(*start, round(heading(start, goal), 4))
    return Layout(bounds, (*outer_walls(bounds), *ground.pieces), facing, goal)
