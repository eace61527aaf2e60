"""Furniture of a factory: machines, shelves and tanks between the lanes, pillars and pallets in the corridors."""

from dataclasses import dataclass

from numpy.random import Generator

from worlds.scenes.parts.generation import LOW_HEIGHT, pillar, rectangle, uniform
from worlds.scenes.parts.lanes import HALF, HALL, MIDDLE_WALL, SETBACK
from worlds.scenes.parts.lattice import Junction, Lattice
from worlds.world import Cylinder, Obstacle

MAX_CORRIDOR = 3.0
"""Greatest width of a corridor [m]."""
MIN_PASSAGE = 1.85
"""Least width that pillars and low obstacles leave of a corridor [m]: its least width of 1.8, and a margin."""
THIN_WALL = 0.15
"""Thickness of a partition across a lane [m]."""


@dataclass(frozen=True, slots=True)
class Rect:
    """An axis-aligned rectangle."""

    x0: float
    y0: float
    x1: float
    y1: float


def blocks(rng: Generator, plan: Lattice) -> list[Obstacle]:
    """Draw machines and shelves between the lanes, with fronts that stand back a little from some lanes."""
    obstacles: list[Obstacle] = []
    for i in range(len(plan.x.halves) - 1):
        for j in range(len(plan.y.halves) - 1):
            same_half = plan.x.halves[i] == plan.x.halves[i + 1] and plan.y.halves[j] == plan.y.halves[j + 1]
            if not same_half or plan.quarter((i, j)) > plan.region:
                continue
            (x0, x1), (y0, y1) = plan.x.gap(i), plan.y.gap(j)
            back = [
                uniform(rng, 0.0, min(SETBACK, (MAX_CORRIDOR - width) / 2))
                for width in (plan.x.width(i), plan.y.width(j), plan.x.width(i + 1), plan.y.width(j + 1))
            ]
            obstacles += _fill(rng, Rect(x0 + back[0], y0 + back[1], x1 - back[2], y1 - back[3]))
    return obstacles


def _fill(rng: Generator, rect: Rect) -> list[Obstacle]:
    """Draw one machine, tank or pair of shelves that fills a rectangle without a gap."""
    x0, y0, x1, y1 = rect.x0, rect.y0, rect.x1, rect.y1
    style = rng.random()
    if style < 0.35:  # two shelf rows back to back, along the longer side
        height = uniform(rng, 1.8, 2.4)
        if x1 - x0 > y1 - y0:
            y = (y0 + y1) / 2
            return [rectangle("shelf", x0, y0, x1, y, height), rectangle("shelf", x0, y, x1, y1, height)]
        x = (x0 + x1) / 2
        return [rectangle("shelf", x0, y0, x, y1, height), rectangle("shelf", x, y0, x1, y1, height)]
    if style < 0.5:  # a tank in its basin
        radius = round(min(x1 - x0, y1 - y0) / 2 - 0.2, 3)
        basin = rectangle("block", x0, y0, x1, y1, uniform(rng, 0.5, 0.8))
        tank = Cylinder(round((x0 + x1) / 2, 3), round((y0 + y1) / 2, 3), radius, uniform(rng, 1.8, 2.4))
        return [basin, Obstacle("block", tank)]
    if style < 0.75:  # a machine and its feeder
        share = uniform(rng, 0.3, 0.7)
        tall, short = uniform(rng, 1.6, 2.2), uniform(rng, 0.9, 1.3)
        if x1 - x0 > y1 - y0:
            x = x0 + share * (x1 - x0)
            return [rectangle("block", x0, y0, x, y1, tall), rectangle("block", x, y0, x1, y1, short)]
        y = y0 + share * (y1 - y0)
        return [rectangle("block", x0, y0, x1, y, tall), rectangle("block", x0, y, x1, y1, short)]
    return [rectangle("block", x0, y0, x1, y1, uniform(rng, 1.2, 2.2))]


def _section_rect(plan: Lattice, a: Junction, b: Junction) -> Rect:
    """The part of a lane between two neighbouring junctions."""
    (i, j), (i2, _) = min(a, b), max(a, b)
    if i != i2:
        (x0, x1), (y0, y1) = plan.x.gap(i), plan.y.intervals[j]
    else:
        (x0, x1), (y0, y1) = plan.x.intervals[i], plan.y.gap(j)
    return Rect(x0, y0, x1, y1)


def _sections(plan: Lattice) -> list[tuple[Junction, Junction]]:
    """All sections inside the quarters that are built, open or not."""
    pairs = []
    for i in range(len(plan.x.halves)):
        for j in range(len(plan.y.halves)):
            for a, b in ((i + 1, j), (i, j + 1)):
                if a >= len(plan.x.halves) or b >= len(plan.y.halves):
                    continue
                if plan.quarter((i, j)) == plan.quarter((a, b)) <= plan.region:
                    pairs.append(((i, j), (a, b)))
    return pairs


def _lane_frame(rect: Rect, along_x: bool) -> Rect:
    """The rectangle with x along its lane; its own inverse."""
    return rect if along_x else Rect(rect.y0, rect.x0, rect.y1, rect.x1)


def closed_sections(rng: Generator, plan: Lattice) -> list[Obstacle]:
    """Close the sections that are not open: by a machine that fills the section, or by a partition across it."""
    obstacles: list[Obstacle] = []
    for a, b in _sections(plan):
        if frozenset((a, b)) in plan.open_sections:
            continue
        along_x = a[0] != b[0]
        lane = _lane_frame(_section_rect(plan, a, b), along_x)
        low, high = _into_blocks(lane.y0, lane.y1)
        lane = Rect(lane.x0, low, lane.x1, high)
        if rng.random() < 0.6:
            obstacles += _fill(rng, _lane_frame(lane, along_x))
            continue
        at = lane.x0 + uniform(rng, 0.3, 0.7) * (lane.x1 - lane.x0)
        wall = _lane_frame(Rect(at - THIN_WALL / 2, lane.y0, at + THIN_WALL / 2, lane.y1), along_x)
        obstacles.append(rectangle("wall", wall.x0, wall.y0, wall.x1, wall.y1))
    return obstacles


def _into_blocks(low: float, high: float) -> tuple[float, float]:
    """A lane's sides, pushed into the blocks there, whose fronts may stand back; not into the hall's walls."""
    walls = (MIDDLE_WALL, HALF - MIDDLE_WALL / 2, HALF + MIDDLE_WALL / 2, HALL - MIDDLE_WALL)
    touches_low = any(abs(low - wall) < 0.01 for wall in walls)
    touches_high = any(abs(high - wall) < 0.01 for wall in walls)
    push = SETBACK + 0.05
    return (low if touches_low else low - push), (high if touches_high else high + push)


def furniture(rng: Generator, plan: Lattice) -> list[Obstacle]:
    """Draw pillars and pallets along one side of the wider corridors."""
    obstacles: list[Obstacle] = []
    for a, b in _sections(plan):
        if frozenset((a, b)) not in plan.open_sections:
            continue
        along_x = a[0] != b[0]
        lane = _lane_frame(_section_rect(plan, a, b), along_x)
        spare = lane.y1 - lane.y0 - MIN_PASSAGE
        what, share, low_side = rng.random(), uniform(rng, 0.2, 0.8), rng.random() < 0.5
        if what < 0.18 and spare >= 0.3:
            radius = uniform(rng, 0.15, min(0.2, spare / 2))
            x = lane.x0 + share * (lane.x1 - lane.x0)
            y = lane.y0 + radius if low_side else lane.y1 - radius
            obstacles.append(pillar(*((x, y) if along_x else (y, x)), radius))
        elif what < 0.32 and spare >= 0.4:
            depth, half = uniform(rng, 0.4, min(0.8, spare)), uniform(rng, 0.3, 0.6)
            x = lane.x0 + half + share * (lane.x1 - lane.x0 - 2 * half)
            low, high = _into_blocks(lane.y0, lane.y1)
            pallet = (
                Rect(x - half, low, x + half, lane.y0 + depth)
                if low_side
                else Rect(x - half, lane.y1 - depth, x + half, high)
            )
            pallet = _lane_frame(pallet, along_x)
            obstacles.append(rectangle("low", pallet.x0, pallet.y0, pallet.x1, pallet.y1, uniform(rng, *LOW_HEIGHT)))
    return obstacles
