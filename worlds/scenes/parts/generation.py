"""Common parts of the generators: random streams, building blocks, and the check that a layout can be solved."""

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy import ndimage

from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds.arrays import pack_shapes
from worlds.clearance import ClearanceField, clearance_at, clearance_field
from worlds.world import Box, Cylinder, Mover, Obstacle, ObstacleKind, World

WALL_HEIGHT = 2.0
"""Height of walls and pillars [m]."""
WALL_THICKNESS = 0.2
"""Thickness of outer walls [m]."""
LOW_HEIGHT = (0.4, 0.7)
"""Range of the heights of low obstacles [m]: above any body's planar lidar, below a person's hip."""
MARGIN = 0.1
"""Inflation of the footprint that a solvable layout leaves space for [m]: the rule of task, planner and training."""
TASK_CLEARANCE = 0.6
"""Least clearance of start and goal [m]."""
MAX_DRAWS = 400
"""Number of draws before a seed is given up; for a factory one draw in two to one in twelve gives a layout."""
MAX_LAYOUTS = 20
"""Number of unsolvable layouts before a seed is given up."""


@dataclass(frozen=True, slots=True)
class Layout:
    """A world without its movers."""

    bounds: tuple[float, float, float, float]
    obstacles: tuple[Obstacle, ...]
    start: Pose2
    goal: tuple[float, float]

    def world(self, name: str, seed: int, movers: tuple[Mover, ...] = ()) -> World:
        """The world of this layout with its movers."""
        return World(name, seed, self.bounds, self.obstacles, movers, self.start, self.goal)


def stream(name: str, seed: int, *keys: int) -> Generator:
    """The random stream of one purpose in one world: independent of every other and of the Python process."""
    return np.random.default_rng(np.random.SeedSequence((seed, zlib.crc32(name.encode()), *keys)))


def uniform(rng: Generator, low: float, high: float) -> float:
    """A float to the millimetre, so that scene files stay readable."""
    return round(float(rng.uniform(low, high)), 3)


def rectangle(kind: ObstacleKind, x0: float, y0: float, x1: float, y1: float, height: float = WALL_HEIGHT) -> Obstacle:
    """An axis-aligned box from its corners."""
    return Obstacle(
        kind,
        Box(round((x0 + x1) / 2, 4), round((y0 + y1) / 2, 4), round(x1 - x0, 4), round(y1 - y0, 4), 0.0, height),
    )


def outer_wall(x0: float, y0: float, x1: float, y1: float) -> Obstacle:
    """A wall of the enclosure."""
    return Obstacle("wall", rectangle("wall", x0, y0, x1, y1).shape, outer=True)


def pillar(x: float, y: float, radius: float, height: float = WALL_HEIGHT) -> Obstacle:
    """A round column."""
    return Obstacle("pillar", Cylinder(round(x, 4), round(y, 4), radius, height))


def outer_walls(bounds: tuple[float, float, float, float]) -> tuple[Obstacle, ...]:
    """Four walls just inside the bounds."""
    x0, y0, x1, y1 = bounds
    t = WALL_THICKNESS
    return (
        outer_wall(x0, y0, x1, y0 + t),
        outer_wall(x0, y1 - t, x1, y1),
        outer_wall(x0, y0 + t, x0 + t, y1 - t),
        outer_wall(x1 - t, y0 + t, x1, y1 - t),
    )


def reachable_cells(field: ClearanceField, start: tuple[float, float], radius: float) -> np.ndarray:
    """Cells (rows, columns) that a disc at ``start`` can be moved to among the static obstacles."""
    labels, _ = ndimage.label(field.distance >= radius)  # type: ignore[misc]
    label = labels[field.cell(*start)]
    return (labels == label) & (label > 0)


def is_solvable(layout: Layout, field: ClearanceField, footprint_radius: float) -> bool:
    """Whether start and goal have enough clearance, and the inflated footprint gets from one to the other."""
    shapes = pack_shapes([obstacle.shape for obstacle in layout.obstacles])
    wanted = max(TASK_CLEARANCE, footprint_radius + MARGIN)
    for x, y in (layout.start[:2], layout.goal):
        if len(shapes) and clearance_at(shapes, x, y)[0] < wanted:
            return False
    reached = reachable_cells(field, layout.start[:2], footprint_radius + MARGIN)
    return bool(reached[field.cell(*layout.goal)])


def solvable_layout(
    name: str,
    seed: int,
    footprint_radius: float,
    draw: Callable[[Generator], Layout | None],
    *keys: int,
) -> tuple[Layout, ClearanceField]:
    """The first layout of this seed's sequence that can be solved, with its clearance.

    Args:
        name: The world's name; part of the seed.
        seed: Seed of the world.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
        draw: Draws a layout from a random stream, or None if the draw failed.
        keys: Further parts of the seed.

    Raises:
        BadWorld: No layout among the first attempts lets such a body through.
    """
    refused = 0
    for attempt in range(MAX_DRAWS):
        layout = draw(stream(name, seed, *keys, attempt))
        if layout is None:
            continue
        field = clearance_field(layout.obstacles, layout.bounds)
        if is_solvable(layout, field, footprint_radius):
            return layout, field
        refused += 1
        if refused == MAX_LAYOUTS:
            break
    raise BadWorld(
        f"{name}, seed {seed}: none of {refused} layouts lets a body of radius {footprint_radius:g} m "
        f"through with {MARGIN:g} m to spare; a smaller body or another seed would be right"
    )


def heading(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Direction from one point to another [rad]."""
    return math.atan2(b[1] - a[1], b[0] - a[0])
