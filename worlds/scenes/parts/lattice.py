"""A factory's plan as a graph: crossing lanes, their open sections, and the blind alleys.

A hall of 40 x 40 m has lanes along x and along y, in two halves each way. A junction (i, j) is where the i-th lane
along y crosses the j-th lane along x; a section joins two neighbouring junctions; between lanes are blocks.
"""

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.random import Generator

from worlds.scenes.parts.lanes import SETBACK, Lanes, draw_lanes

ALLEY_DEPTH = 5.0
"""Least depth of a blind alley, from its mouth to its end [m]."""

MOUTH_MARGIN = 0.1
"""Distance from the corner of an alley's mouth at which the line to the goal must pass, so as not to graze it [m]."""
ROUTE_TRIES = 12
"""Number of ways through a quarter that are tried before another door."""

Junction = tuple[int, int]
Section = frozenset[Junction]
QUARTER_OF_HALVES = {(0, 0): 1, (1, 0): 2, (1, 1): 3, (0, 1): 4}
"""Counter-clockwise from the lower left, by the half in x and in y."""


@dataclass(frozen=True, slots=True)
class Alley:
    """A blind alley: a dead end towards the goal, which attracts a planner that only heads for the goal."""

    quarter: int
    junctions: tuple[Junction, ...]
    """The junction on the way that it opens from, then its own junctions to the end."""
    depth: float
    """Distance from the mouth straight on to the end [m]."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """The open sections of the first k quarters."""

    x: Lanes
    """Lanes along y."""
    y: Lanes
    """Lanes along x."""
    region: int
    open_sections: frozenset[Section]
    alleys: tuple[Alley, ...]
    start: Junction
    goal: Junction

    def point(self, junction: Junction) -> tuple[float, float]:
        """Centre of a junction [m]."""
        return self.x.centre(junction[0]), self.y.centre(junction[1])

    def quarter(self, junction: Junction) -> int:
        """Number of the quarter that a junction is in, 1 to 4."""
        return QUARTER_OF_HALVES[self.x.halves[junction[0]], self.y.halves[junction[1]]]


def shortest_way(neighbours: dict[Junction, dict[Junction, float]], start: Junction, goal: Junction) -> list[Junction]:
    """The shortest way by Dijkstra's algorithm; empty if there is none."""
    best, before = {start: 0.0}, {start: start}
    queue = [(0.0, start)]
    while queue:
        cost, at = heapq.heappop(queue)
        if at == goal:
            way = [at]
            while way[-1] != start:
                way.append(before[way[-1]])
            return way[::-1]
        if cost > best[at]:
            continue
        for to, length in neighbours.get(at, {}).items():
            if cost + length < best.get(to, math.inf):
                best[to], before[to] = cost + length, at
                heapq.heappush(queue, (cost + length, to))
    return []


class LatticeDraw:
    """One attempt at a lattice; the steps of :func:`draw_lattice` share its state."""

    def __init__(self, rng: Generator, region: int):
        self.rng, self.region = rng, region
        self.x, self.y = draw_lanes(rng), draw_lanes(rng)
        self.junctions = [
            (i, j)
            for i in range(len(self.x.halves))
            for j in range(len(self.y.halves))
            if QUARTER_OF_HALVES[self.x.halves[i], self.y.halves[j]] <= region
        ]
        self.start: Junction = (0, 0)
        self.goal: Junction = self._goal()
        self.open: set[Section] = set()
        self.alleys: list[Alley] = []

    def quarter(self, junction: Junction) -> int:
        """Number of the quarter that a junction is in, 1 to 4."""
        return QUARTER_OF_HALVES[self.x.halves[junction[0]], self.y.halves[junction[1]]]

    def point(self, junction: Junction) -> tuple[float, float]:
        """Centre of a junction [m]."""
        return self.x.centre(junction[0]), self.y.centre(junction[1])

    def length(self, a: Junction, b: Junction) -> float:
        """Distance between two junctions' centres [m]."""
        return math.dist(self.point(a), self.point(b))

    def _goal(self) -> Junction:
        """The corner of the last quarter that is farthest from the start."""
        right, top = len(self.x.halves) - 1, len(self.y.halves) - 1
        middle_x, middle_y = self.x.halves.index(1) - 1, self.y.halves.index(1) - 1
        return {1: (middle_x, middle_y), 2: (right, middle_y), 3: (right, top), 4: (0, top)}[self.region]

    def all_sections(self) -> list[tuple[Junction, Junction]]:
        """Pairs of neighbours in one quarter, or in a quarter and the next: the first and the last never touch."""
        built = set(self.junctions)
        pairs = []
        for i, j in self.junctions:
            for other in ((i + 1, j), (i, j + 1)):
                if other in built and abs(self.quarter((i, j)) - self.quarter(other)) <= 1:
                    pairs.append(((i, j), other))
        return pairs

    def graph(self, sections: Iterable[tuple[Junction, Junction]], jitter: float) -> dict:
        """Adjacency with lengths, each stretched at random by up to ``1 + jitter``."""
        neighbours: dict[Junction, dict[Junction, float]] = {}
        for a, b in sections:
            cost = self.length(a, b) * (1.0 + jitter * self.rng.random())
            neighbours.setdefault(a, {})[b] = cost
            neighbours.setdefault(b, {})[a] = cost
        return neighbours

    def exits(self, quarter: int) -> list[tuple[Junction, Junction]]:
        """Exits from a quarter to the next in random order: pairs of the junctions before and behind."""
        pairs = []
        for a, b in self.all_sections():
            before, behind = (a, b) if self.quarter(a) < self.quarter(b) else (b, a)
            if self.quarter(before) == quarter and self.quarter(behind) == quarter + 1:
                pairs.append((before, behind))
        return [pairs[k] for k in self.rng.permutation(len(pairs))]

    def draw_ways(self, entrance: Junction, quarter: int = 1) -> list[Junction]:
        """Draw a winding way with its alleys through each quarter up to the goal; empty if none was found."""
        inside = [p for p in self.all_sections() if self.quarter(p[0]) == self.quarter(p[1]) == quarter]
        last = quarter == self.region
        for before, behind in [(self.goal, self.goal)] if last else self.exits(quarter):
            for _ in range(ROUTE_TRIES):
                way = shortest_way(self.graph(inside, jitter=3.0), entrance, before)
                alleys = self.find_alleys(quarter, way)
                if not alleys:
                    continue
                rest = [] if last else self.draw_ways(behind, quarter + 1)
                if last or rest:
                    self.alleys += alleys
                    return way + rest
                break
        return []

    def faces_goal(self, junction: Junction, step: tuple[int, int]) -> bool:
        """Whether the straight line from a junction to the goal leaves it on the side of this step."""
        (x, y), (goal_x, goal_y) = self.point(junction), self.point(self.goal)
        dx, dy = goal_x - x, goal_y - y
        along = dx * step[0] + dy * step[1]
        across = abs(dx * step[1]) + abs(dy * step[0])
        half_x, half_y = self.x.width(junction[0]) / 2, self.y.width(junction[1]) / 2
        to_mouth, half_mouth = (half_x, half_y) if step[0] else (half_y, half_x)
        return along > to_mouth and across / along * to_mouth <= half_mouth - MOUTH_MARGIN

    def find_alleys(self, quarter: int, route: list[Junction]) -> list[Alley]:
        """Find two or three blind alleys of a quarter, from its route towards the goal; none if they do not fit."""
        built, taken = set(self.junctions), set(route)
        wanted = 2 + int(self.rng.random() < 0.3)
        mouths = [
            (junction, step)
            for junction in route
            for step in ((1, 0), (-1, 0), (0, 1), (0, -1))
            if self.faces_goal(junction, step)
        ]
        found: list[Alley] = []
        for k in self.rng.permutation(len(mouths)):
            junction, (di, dj) = mouths[k]
            way: tuple[Junction, ...] = (junction,)
            ways: list[tuple[Junction, ...]] = []
            while True:
                ahead = (way[-1][0] + di, way[-1][1] + dj)
                if ahead not in built or ahead in taken or self.quarter(ahead) != quarter:
                    break
                way = (*way, ahead)
                if self.depth(way) >= ALLEY_DEPTH + SETBACK:
                    ways.append(way)
            if len(found) < wanted and ways:
                way = ways[0] if self.rng.random() < 0.6 else ways[:2][-1]
                taken |= set(way)
                found.append(Alley(quarter, way, float(self.depth(way))))
        return found if len(found) >= 2 else []

    def open_up(self, way: Iterable[Junction]) -> None:
        """Open the sections along a way."""
        self.open |= {frozenset(pair) for pair in pairwise(way)}

    def depth(self, way: tuple[Junction, ...]) -> float:
        """Straight from the edge of the first junction to the far edge of the last [m]."""
        (i0, j0), (i1, j1) = way[0], way[-1]
        lanes, a, b = (self.x, i0, i1) if i0 != i1 else (self.y, j0, j1)
        low, high = min(a, b), max(a, b)
        if b > a:
            return lanes.intervals[high][1] - lanes.intervals[low][1]
        return lanes.intervals[high][0] - lanes.intervals[low][0]

    def connect_rest(self, route: list[Junction]) -> bool:
        """Join every other junction to the net by a random tree, then add loops; False if one is walled in."""
        blind = {junction for alley in self.alleys for junction in alley.junctions[1:]}
        sections = [p for p in self.all_sections() if p[0] not in blind and p[1] not in blind]
        order = self.rng.permutation(len(sections))
        joined = set(route)
        grown = True
        while grown:
            grown = False
            for k in order:
                a, b = sections[k]
                if (a in joined) != (b in joined):
                    self.open.add(frozenset((a, b)))
                    joined |= {a, b}
                    grown = True
        for a, b in sections:
            chance = 0.3 if self.quarter(a) == self.quarter(b) else 0.15
            if self.rng.random() < chance:
                self.open.add(frozenset((a, b)))
        return len(joined) + len(blind) == len(self.junctions)

    def alleys_on_the_way(self) -> bool:
        """Whether two alleys a quarter open from the shortest way of the finished net."""
        pairs = sorted(tuple(sorted(section)) for section in self.open)
        way = shortest_way(self.graph(pairs, jitter=0.0), self.start, self.goal)  # type: ignore[arg-type]
        counts = np.zeros(5, int)
        for alley in self.alleys:
            counts[alley.quarter] += alley.junctions[0] in way
        return bool((counts[1 : self.region + 1] >= 2).all())


def draw_lattice(rng: Generator, region: int) -> Lattice | None:
    """Draw a random plan of the first ``region`` quarters; None if its alleys do not fit."""
    draw = LatticeDraw(rng, region)
    route = draw.draw_ways(draw.start)
    if not route:
        return None
    for way in (route, *(alley.junctions for alley in draw.alleys)):
        draw.open_up(way)
    if not (draw.connect_rest(route) and draw.alleys_on_the_way()):
        return None
    return Lattice(draw.x, draw.y, region, frozenset(draw.open), tuple(draw.alleys), draw.start, draw.goal)
