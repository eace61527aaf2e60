"""Moving obstacles of a scene: their shapes, and the places where they start."""

import math
from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from scipy import ndimage

from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds.clearance import ClearanceField, distance_to_wide_ways
from worlds.scenes.parts.generation import Layout, reachable_cells, solvable_layout, stream, uniform
from worlds.world import Box, Cylinder, Mover, MoverKind, MoverPart, RandomWalk, World

MOVER_WAY = 2.2
"""Width of the narrowest ways that moving obstacles enter [m]."""
WAY_MARGIN = 0.08
"""Distance between a mover and the edge of its ways [m]; more than half the diagonal of a 0.1 m cell (0.071 m)."""
START_DISTANCE = 2.0
"""Least distance between a mover and the robot at the start [m]."""
LARGEST_FOOTPRINT = 0.5
"""Circumscribed radius of the largest body that the worlds are made for [m]. Movers keep off the start for this one,
whatever the robot, so that every robot meets the same movers."""
SMALLEST_WAY = 5.0
"""Least extent of the ways that movers start in [m]: in a shorter one they would only turn on the spot."""
MOVER_GAP = 0.3
"""Least gap between two movers at the start [m]."""
REACH_MARGIN = 0.25
"""Movers start where a disc narrower than ``MOVER_WAY`` by this on each side can get from the robot's start [m]."""
LARGEST_MOVER = 0.35
"""Radius of the largest moving obstacle below [m]."""

Body = tuple[tuple[MoverPart, ...], float]
"""Parts and the radius of the circle that holds them."""


def cylinder_body(rng: Generator, radius: tuple[float, float] = (0.18, LARGEST_MOVER)) -> Body:
    """Draw a barrel, a bin or a small round robot."""
    r = uniform(rng, *radius)
    return (MoverPart(Cylinder(0.0, 0.0, r, uniform(rng, 0.6, 1.7))),), r


def box_body(rng: Generator, length: tuple[float, float] = (0.35, 0.55)) -> Body:
    """Draw a crate on hidden wheels."""
    a, b = uniform(rng, *length), uniform(rng, 0.3, 0.42)
    return (MoverPart(Box(0.0, 0.0, a, b, 0.0, uniform(rng, 0.6, 1.4))),), math.hypot(a, b) / 2


def cart_body(rng: Generator) -> Body:
    """Draw a platform with a load in front and a handle behind; a lidar sees the platform's skirt."""
    a, b, deck = uniform(rng, 0.48, 0.56), uniform(rng, 0.36, 0.40), uniform(rng, 0.36, 0.42)
    parts = (
        MoverPart(Box(0.0, 0.0, a, b, 0.0, deck)),
        MoverPart(Box(round(a / 2 - 0.17, 4), 0.0, 0.3, round(b - 0.06, 4), 0.0, uniform(rng, 0.3, 0.7), base=deck)),
        MoverPart(Box(round(0.02 - a / 2, 4), 0.0, 0.04, round(b - 0.08, 4), 0.0, 0.6, base=deck)),
    )
    return parts, math.hypot(a, b) / 2


def legs_body(rng: Generator) -> Body:
    """Draw a pair of walking legs that swing against each other."""
    r, apart, swing = uniform(rng, 0.07, 0.09), uniform(rng, 0.09, 0.12), uniform(rng, 0.14, 0.2)
    parts = (
        MoverPart(Cylinder(0.0, apart, r, 0.85), swing),
        MoverPart(Cylinder(0.0, -apart, r, 0.85), -swing),
    )
    return parts, math.hypot(swing, apart) + r


def person_body(rng: Generator) -> Body:
    """Draw a person: a lidar sees the legs, and the robot can touch legs and trunk."""
    legs, _ = legs_body(rng)
    trunk = uniform(rng, 0.17, 0.2)
    swing, apart, r = abs(legs[0].swing), legs[0].shape.y, legs[0].shape.radius  # type: ignore[union-attr]
    return (*legs, MoverPart(Cylinder(0.0, 0.0, trunk, 0.85, base=0.85))), max(math.hypot(swing, apart) + r, trunk)


BODIES: dict[MoverKind, Callable[[Generator], Body]] = {
    "cylinder": cylinder_body,
    "box": box_body,
    "cart": cart_body,
    "legs": legs_body,
    "person": person_body,
}


def random_movers(
    rng: Generator,
    layout: Layout,
    field: ClearanceField,
    count: int,
    kinds: tuple[MoverKind, ...],
    speeds: tuple[float, float],
    within: tuple[float, float, float, float] | None = None,
    taken: tuple[Mover, ...] = (),
) -> tuple[Mover, ...]:
    """Place movers that walk at random, each in a wide way that the robot can reach, and 2 m off the robot.

    Args:
        rng: Source of randomness.
        layout: The scene.
        field: Clearance in the scene.
        count: Number of movers.
        kinds: Kinds of the movers, taken in turn.
        speeds: Slowest and fastest [m/s].
        within: Part of the bounds in which movers start.
        taken: Movers already placed, to start apart from.

    Raises:
        BadWorld: The wide ways are too small for so many movers.
    """
    x0, y0, x1, y1 = within or layout.bounds
    away = distance_to_wide_ways(field, MOVER_WAY)
    usable = reachable_cells(field, layout.start[:2], MOVER_WAY / 2 - REACH_MARGIN) & long_ways(away, field.resolution)
    cells = np.argwhere(usable)
    points = field.centres(cells)
    inside = (points[:, 0] > x0) & (points[:, 0] < x1) & (points[:, 1] > y0) & (points[:, 1] < y1)
    away_there, points = away[usable][inside], points[inside]
    movers: list[Mover] = []
    for i in range(count):
        kind = kinds[i % len(kinds)]
        parts, radius = BODIES[kind](rng)
        free = away_there <= MOVER_WAY / 2 - radius - WAY_MARGIN
        keep_off = START_DISTANCE + radius + LARGEST_FOOTPRINT
        free &= np.hypot(points[:, 0] - layout.start.x, points[:, 1] - layout.start.y) >= keep_off
        for other in (*taken, *movers):
            free &= np.hypot(points[:, 0] - other.start.x, points[:, 1] - other.start.y) >= (
                radius + other.radius + MOVER_GAP
            )
        choices = np.flatnonzero(free)
        if len(choices) == 0:
            raise BadWorld(
                f"no place for mover {i + 1} of {count}: ways of {MOVER_WAY:g} m and more, away from the start, "
                "are full; fewer movers would be right"
            )
        x, y = points[rng.choice(choices)]
        movers.append(
            Mover(
                kind,
                parts,
                math.ceil(radius * 1e4) / 1e4,
                Pose2(round(float(x), 4), round(float(y), 4), uniform(rng, -math.pi, math.pi)),
                RandomWalk(uniform(rng, *speeds), int(rng.integers(2**31))),
            )
        )
    return tuple(movers)


def ground_with_movers(
    name: str,
    seed: int,
    footprint_radius: float,
    draw: Callable[[Generator], Layout | None],
    movers: int,
    speeds: tuple[float, float],
) -> World:
    """Generate open ground with moving obstacles of every shape all over it.

    Args:
        name: The world's name; part of the seed.
        seed: Seed of the world.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
        draw: Draws a layout from a random stream, or None if the draw failed.
        movers: Number of moving obstacles.
        speeds: Slowest and fastest [m/s].
    """
    layout, field = solvable_layout(name, seed, footprint_radius, draw)
    kinds: tuple[MoverKind, ...] = ("cylinder", "box", "legs", "cart")
    return layout.world(name, seed, random_movers(stream(name, seed, 1000), layout, field, movers, kinds, speeds))


def long_ways(away: np.ndarray, resolution: float) -> np.ndarray:
    """Cells of the wide ways (rows, columns) whose connected part has at least the extent ``SMALLEST_WAY``."""
    found = ndimage.label(away <= MOVER_WAY / 2 - LARGEST_MOVER - WAY_MARGIN)
    labels: np.ndarray = found[0]  # type: ignore[index]
    long = np.zeros(labels.max() + 1, np.bool_)
    for i, extent in enumerate(ndimage.find_objects(labels), start=1):
        sides = [(s.stop - s.start) * resolution for s in extent]
        long[i] = math.hypot(*sides) >= SMALLEST_WAY
    return long[labels]
