"""The double branch: a short, crowded way to the goal, and a longer, empty one."""

from dataclasses import replace

from numpy.random import Generator

from vuca_nav.types import Pose2
from worlds.scenes.parts.generation import Layout, heading, outer_walls, rectangle, solvable_layout, stream, uniform
from worlds.scenes.parts.population import random_movers
from worlds.world import Box, Obstacle, Way, World

NAME = "double_branch"
MOVERS = 8
MOST_MOVERS = 16
MOVER_SPEEDS = (0.2, 0.8)
"""Range of the moving obstacles' speeds [m/s]."""
HALLS = 2.1
"""Width of the ways that join the branches [m]: below 2.2 m, so the crowd stays in its branch."""
WALL = 0.2
"""Thickness of walls [m]."""


def double_branch(seed: int, movers: int, footprint_radius: float) -> World:
    """Generate a block with a way round either side; the movers keep to the shorter one, whose ends are narrow.

    Args:
        seed: Seed of the world; it also decides on which side the short branch is.
        movers: Number of moving obstacles, all in the short branch.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
    """
    layout, field = solvable_layout(NAME, seed, footprint_radius, _layout)
    x0, y0, x1, y1 = layout.bounds
    middle = (x0 + x1) / 2
    short_side = (x0, y0, middle, y1) if layout.goal[0] < middle else (middle, y0, x1, y1)
    moving = random_movers(
        stream(NAME, seed, 1000), layout, field, movers, ("legs", "cylinder", "cart"), MOVER_SPEEDS, within=short_side
    )
    return replace(layout.world(NAME, seed, moving), ways=_ways(layout, short_side))


def _ways(layout: Layout, short_side: tuple[float, float, float, float]) -> tuple[Way, Way]:
    """The boxes beside the block, on the crowded and on the quiet side."""
    block = next(obstacle.shape for obstacle in layout.obstacles if obstacle.kind == "block")
    assert isinstance(block, Box)
    x0, _y0, x1, _y1 = layout.bounds
    low, high = block.y - 0.5 * block.width, block.y + 0.5 * block.width
    left, right = block.x - 0.5 * block.length, block.x + 0.5 * block.length
    sides = Way("short", (x0, low, left, high)), Way("quiet", (right, low, x1, high))
    if short_side[0] == x0:
        return sides
    return Way("short", sides[1].box), Way("quiet", sides[0].box)


def _layout(rng: Generator) -> Layout:
    width, depth = uniform(rng, 19.0, 23.0), uniform(rng, 16.0, 20.0)
    crowded, empty = uniform(rng, 3.2, 3.8), uniform(rng, 2.4, 3.0)
    start_x, goal_x = uniform(rng, 0.42, 0.5) * width, uniform(rng, 0.2, 0.32) * width
    mirrored = rng.random() < 0.5
    low, high = WALL + HALLS, depth - WALL - HALLS
    left, right = WALL + crowded, width - WALL - empty
    door = uniform(rng, 1.9, 2.1)
    pieces = [
        ("block", left, low, right, high),
        # The ends of the short branch: walls that leave a doorway at its inner side.
        ("wall", WALL, low, left - door, low + WALL),
        ("wall", WALL, high - WALL, left - door, high),
    ]

    def across(x: float) -> float:
        return round(width - x if mirrored else x, 4)

    interior: list[Obstacle] = []
    for kind, x0, y0, x1, y1 in pieces:
        a, b = sorted((across(x0), across(x1)))
        interior.append(rectangle(kind, a, y0, b, y1))  # type: ignore[arg-type]
    bounds = (0.0, 0.0, width, depth)
    start = across(start_x), round(WALL + HALLS / 2, 3)
    goal = across(goal_x), round(depth - WALL - HALLS / 2, 3)
    facing = Pose2(*start, round(heading(start, (across(0.0), start[1])), 4))
    return Layout(bounds, (*outer_walls(bounds), *interior), facing, goal)
