"""Obstacles scattered over open ground, with gaps wide enough to pass between them."""

import math

from numpy.random import Generator

from worlds.arrays import pack_shapes
from worlds.clearance import clearance_at
from worlds.scenes.parts.generation import LOW_HEIGHT, WALL_HEIGHT, uniform
from worlds.world import Box, Cylinder, Obstacle, Shape


def outline(shape: Shape, spacing: float = 0.25) -> list[tuple[float, float]]:
    """Points around a shape's edge, corners included, at most ``spacing`` apart [m]."""
    if isinstance(shape, Cylinder):
        count = max(math.ceil(2 * math.pi * shape.radius / spacing), 8)
        angles = [2 * math.pi * k / count for k in range(count)]
        return [(shape.x + shape.radius * math.cos(a), shape.y + shape.radius * math.sin(a)) for a in angles]
    c, s = math.cos(shape.yaw), math.sin(shape.yaw)
    along, across = math.ceil(shape.length / spacing), math.ceil(shape.width / spacing)
    local = [((k / along - 0.5) * shape.length, side * shape.width / 2) for k in range(along + 1) for side in (-1, 1)]
    local += [(side * shape.length / 2, (k / across - 0.5) * shape.width) for k in range(1, across) for side in (-1, 1)]
    return [(shape.x + c * u - s * v, shape.y + s * u + c * v) for u, v in local]


def roadblock(rng: Generator, x: float, y: float) -> Obstacle:
    """Draw a barrier, a crate, a planter or a column, at any angle."""
    yaw, what = uniform(rng, -math.pi, math.pi), rng.random()
    if what < 0.4:
        return Obstacle("block", Box(x, y, uniform(rng, 1.4, 2.4), uniform(rng, 0.35, 0.5), yaw, 1.0))
    if what < 0.65:
        side = uniform(rng, 0.8, 1.4)
        return Obstacle("block", Box(x, y, side, uniform(rng, 0.7, 1.2), yaw, uniform(rng, 0.8, 1.6)))
    if what < 0.85:
        return Obstacle("low", Cylinder(x, y, uniform(rng, 0.4, 0.8), uniform(rng, *LOW_HEIGHT)))
    return Obstacle("pillar", Cylinder(x, y, uniform(rng, 0.2, 0.4), WALL_HEIGHT))


def partition(rng: Generator, x: float, y: float) -> Obstacle:
    """Draw a free-standing wall along x or y."""
    yaw = math.pi / 2 if rng.random() < 0.5 else 0.0
    return Obstacle("wall", Box(x, y, uniform(rng, 1.8, 4.2), 0.15, yaw, WALL_HEIGHT))


class Ground:
    """Open ground that is filled piece by piece, every piece at least ``gap`` from all others.

    Args:
        bounds: x_min, y_min, x_max, y_max, walled in [m].
        gap: Least way between two pieces, and to the bounds [m].
        keep_free: Discs x, y, radius that stay free [m].
    """

    def __init__(
        self, bounds: tuple[float, float, float, float], gap: float, keep_free: list[tuple[float, float, float]]
    ):
        self.bounds, self.gap = bounds, gap
        self.keep_free = keep_free
        self.pieces: list[Obstacle] = []
        self._shapes = pack_shapes([])

    def add(self, obstacle: Obstacle) -> bool:
        """Add an obstacle if it fits; returns whether it did."""
        x0, y0, x1, y1 = self.bounds
        alone = pack_shapes([obstacle.shape])
        if any(clearance_at(alone, x, y)[0] < radius for x, y, radius in self.keep_free):
            return False
        for x, y in outline(obstacle.shape):
            if min(x - x0, x1 - x, y - y0, y1 - y) < self.gap or clearance_at(self._shapes, x, y)[0] < self.gap:
                return False
        self.pieces.append(obstacle)
        self._shapes = pack_shapes([piece.shape for piece in self.pieces])
        return True

    def random_point(self, rng: Generator) -> tuple[float, float]:
        """Draw a point anywhere in the bounds."""
        x0, y0, x1, y1 = self.bounds
        return uniform(rng, x0, x1), uniform(rng, y0, y1)
