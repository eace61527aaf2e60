"""The factory: corridors between machines and shelves, blind alleys towards the goal, and 10 movers a quarter."""

from numpy.random import Generator

from vuca_nav.errors import BadArgument
from vuca_nav.types import Pose2
from worlds.scenes.parts.furnishing import blocks, closed_sections, furniture
from worlds.scenes.parts.generation import Layout, heading, outer_wall, rectangle, solvable_layout, stream
from worlds.scenes.parts.lanes import HALF, HALL, MIDDLE_WALL
from worlds.scenes.parts.lattice import Lattice, draw_lattice
from worlds.scenes.parts.population import random_movers
from worlds.world import Mover, Obstacle, World

NAME = "factory"
MOVERS_A_QUARTER = 10
MOST_A_QUARTER = 20
MOVER_SPEEDS = (0.2, 0.8)
"""Range of the moving obstacles' speeds [m/s]."""
QUARTER_BOUNDS = {
    1: (0.0, 0.0, HALF, HALF),
    2: (HALF, 0.0, HALL, HALF),
    3: (HALF, HALF, HALL, HALL),
    4: (0.0, HALF, HALF, HALL),
}
"""x_min, y_min, x_max, y_max of each quarter [m]."""
REGION_SIZE = {1: (HALF, HALF), 2: (HALL, HALF), 3: (HALL, HALL), 4: (HALL, HALL)}
"""Extent of the rectangle that holds a region's quarters [m]."""


def factory(seed: int, region: int, footprint_radius: float, movers: int | None = None) -> World:
    """Generate a region of the factory: its first ``region`` quarters, closed off from the others.

    Args:
        seed: Seed of the world.
        region: 1 to 4; the start is in the first quarter's near corner, the goal in the last one's far corner.
        footprint_radius: Radius of the circle about the footprint that must get through [m].
        movers: Number of moving obstacles, spread evenly over the quarters; 10 a quarter if left out.

    Raises:
        BadArgument: More movers than the region takes.
        BadWorld: No solvable layout, or no place for so many movers.
    """
    most = MOST_A_QUARTER * region
    wanted = MOVERS_A_QUARTER * region if movers is None else movers
    if wanted > most:
        raise BadArgument(f"--movers {wanted}: {NAME} takes 0 to {most} with --region {region}")
    layout, field = solvable_layout(NAME, seed, footprint_radius, lambda rng: _layout(rng, region), region)
    placed: tuple[Mover, ...] = ()
    for quarter in range(1, region + 1):
        count = wanted // region + (quarter <= wanted % region)
        placed += random_movers(
            stream(NAME, seed, region, 1000 + quarter), layout, field, count,
            ("cylinder", "cart", "legs"), MOVER_SPEEDS, within=QUARTER_BOUNDS[quarter], taken=placed,
        )  # fmt: skip
    return layout.world(NAME, seed, placed)


def factory_lattice(seed: int, region: int, footprint_radius: float = 0.35) -> Lattice:
    """The plan that :func:`factory` builds for the same arguments."""
    plans: list[Lattice] = []

    def draw(rng: Generator) -> Layout | None:
        plan = draw_lattice(rng, region)
        if plan is None:
            return None
        plans.append(plan)
        return _build(rng, plan)

    solvable_layout(NAME, seed, footprint_radius, draw, region)
    return plans[-1]


def _layout(rng: Generator, region: int) -> Layout | None:
    plan = draw_lattice(rng, region)
    return None if plan is None else _build(rng, plan)


def _build(rng: Generator, plan: Lattice) -> Layout:
    obstacles = [
        *_enclosure(plan.region),
        *_inner_walls(plan),
        *blocks(rng, plan),
        *closed_sections(rng, plan),
        *furniture(rng, plan),
    ]
    start, goal = plan.point(plan.start), plan.point(plan.goal)
    facing = next(b for b in ((1, 0), (0, 1)) if frozenset((plan.start, b)) in plan.open_sections)
    return Layout(
        (0.0, 0.0, *REGION_SIZE[plan.region]),
        tuple(obstacles),
        Pose2(round(start[0], 3), round(start[1], 3), heading(start, plan.point(facing))),
        (round(goal[0], 3), round(goal[1], 3)),
    )


def _enclosure(region: int) -> tuple[Obstacle, ...]:
    """The walls around the quarters that are built; half of a wall between quarters counts to each of them."""
    t, mid = MIDDLE_WALL, MIDDLE_WALL / 2
    if region == 3:
        return (
            outer_wall(0, 0, HALL, t),
            outer_wall(HALL - t, t, HALL, HALL - t),
            outer_wall(0, t, t, HALF + mid),
            outer_wall(t, HALF - mid, HALF + mid, HALF + mid),
            outer_wall(HALF - mid, HALF + mid, HALF + mid, HALL),
            outer_wall(HALF + mid, HALL - t, HALL, HALL),
        )
    right, top = REGION_SIZE[region]
    return (
        outer_wall(0, 0, right, t),
        outer_wall(0, t, t, top),
        outer_wall(right - (t if right == HALL else mid), t, right, top),
        outer_wall(t, top - (t if top == HALL else mid), right, top),
    )


def _inner_walls(plan: Lattice) -> list[Obstacle]:
    """Walls between the quarters that are built, with a door wherever a section crosses."""
    mid = MIDDLE_WALL / 2
    walls: list[Obstacle] = []
    left, below = plan.x.halves.index(1) - 1, plan.y.halves.index(1) - 1

    def add(doors: list[tuple[float, float]], low: float, high: float, vertical: bool) -> None:
        at = low
        for a, b in [*sorted(doors), (high, high)]:
            if a > at:
                walls.append(
                    rectangle("wall", HALF - mid, at, HALF + mid, a)
                    if vertical
                    else rectangle("wall", at, HALF - mid, a, HALF + mid)
                )
            at = b

    for half, quarters in ((0, (1, 2)), (1, (3, 4))):
        if max(quarters) <= plan.region:
            doors = [
                plan.y.intervals[j]
                for j, h in enumerate(plan.y.halves)
                if h == half and frozenset(((left, j), (left + 1, j))) in plan.open_sections
            ]
            low, high = (MIDDLE_WALL, HALF - mid) if half == 0 else (HALF + mid, HALL - MIDDLE_WALL)
            add(doors, low, high, vertical=True)
    for half, quarters in ((0, (1, 4)), (1, (2, 3))):
        if max(quarters) <= plan.region:
            doors = [
                plan.x.intervals[i]
                for i, h in enumerate(plan.x.halves)
                if h == half and frozenset(((i, below), (i, below + 1))) in plan.open_sections
            ]
            low, high = (MIDDLE_WALL, HALF) if half == 0 else (HALF, HALL - MIDDLE_WALL)
            add(doors, low, high, vertical=False)
    return walls
