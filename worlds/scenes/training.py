"""The paper's two training scenes (its Fig. 3a): one for going straight, one for avoiding what moves."""

import math

from numpy.random import Generator

from vuca_nav.types import Pose2
from worlds.scenes.generation import Layout, heading, outer_walls, solvable_layout
from worlds.scenes.population import walked_ground
from worlds.scenes.scatter import Ground, partition, roadblock
from worlds.world import World

STATIC, DYNAMIC = "static", "dynamic"
SIDE = 16.0
"""[m]; the paper gives no size: a lidar of 12 m sees most of it, and an episode is short."""
WALLS, ROADBLOCKS = 9, 9
"""Of the static scene: "massive walls and roadblocks"."""
MOVERS = 20
MOST_MOVERS = 40
MOVER_SPEEDS = (0.2, 1.0)
"""Of the dynamic scene [m/s]; up to the robot's own maximum."""
GAP = 1.1
"""Least way between two static things, and to the walls [m]."""
KEEP_FREE = 1.0
"""Around start and goal [m]."""
SHORTEST_TASK = 8.0
"""From start to goal [m]."""


def static(seed: int, footprint_radius: float) -> World:
    """Walls and roadblocks; nothing moves.

    Args:
        seed: Seed of the world.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    layout, _ = solvable_layout(STATIC, seed, footprint_radius, lambda rng: _layout(rng, WALLS, ROADBLOCKS))
    return layout.world(STATIC, seed)


def dynamic(seed: int, movers: int, footprint_radius: float) -> World:
    """Open ground on which many shapes walk at random.

    Args:
        seed: Seed of the world.
        movers: Number of moving obstacles.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    return walked_ground(DYNAMIC, seed, footprint_radius, lambda rng: _layout(rng, 0, 0), movers, MOVER_SPEEDS)


def _layout(rng: Generator, walls: int, roadblocks: int) -> Layout | None:
    bounds = (0.0, 0.0, SIDE, SIDE)
    inner = Ground((1.2, 1.2, SIDE - 1.2, SIDE - 1.2), 0.0, [])
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
