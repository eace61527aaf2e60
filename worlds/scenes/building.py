"""The building: a lobby, a corridor with rooms on both sides, doors, and a crowd of pedestrians between them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds.clearance import ClearanceField
from worlds.scenes.parts.generation import (
    LOW_HEIGHT,
    Layout,
    heading,
    outer_walls,
    pillar,
    rectangle,
    solvable_layout,
    stream,
    uniform,
)
from worlds.scenes.parts.population import LARGEST_FOOTPRINT, START_DISTANCE, person_body
from worlds.world import Mover, Obstacle, SocialForce, World

NAME = "building"
PEOPLE = 20
MOST_PEOPLE = 40
LENGTH, DEPTH = 32.0, 20.0
"""Extent along x and along y [m]."""
OUTER, INNER = 0.2, 0.15
"""Thickness of outer and of inner walls [m]."""
WALKING_SPEED = (0.5, 1.2)
"""Range of the pedestrians' speeds, indoors and in a crowd [m/s]."""
DOOR = (1.0, 1.4)
"""Range of the clear width of a room's door [m]."""
WALK_CLEARANCE = 0.42
"""Least distance of furniture from the lines that pedestrians walk on [m]: a pedestrian's 0.33 m and a margin."""
PERSON_GAP, WALL_GAP = 0.2, 0.1
"""Least gaps between two pedestrians at the start, and between one and an obstacle [m]."""
PLACES_TRIED = 200
"""Number of places tried for each pedestrian before the building counts as full; 40 need fewer than six each."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Room:
    """A room beside the corridor."""

    x0: float
    y0: float
    x1: float
    y1: float
    door: Point
    """Middle of its doorway."""
    outside: Point
    """Point in the corridor in front of the door."""

    @property
    def middle(self) -> Point:
        """Middle of the room, where pedestrians go."""
        return round((self.x0 + self.x1) / 2, 3), round((self.y0 + self.y1) / 2, 3)


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A building before it is furnished."""

    rooms: tuple[Room, ...]
    lobby_spots: tuple[Point, ...]
    entrance: Point
    """Point in the lobby where the corridor begins."""
    walls: tuple[Obstacle, ...]
    start: Point
    goal_room: int


def building(seed: int, movers: int, footprint_radius: float) -> World:
    """Generate a mission from the lobby to a far room, through pedestrians that avoid walls, each other and the robot.

    Args:
        seed: Seed of the world.
        movers: Number of pedestrians.
        footprint_radius: Radius of the circle about the footprint that must get through [m].

    Raises:
        BadWorld: No solvable layout, or not enough space for so many pedestrians.
    """
    plans: list[FloorPlan] = []

    def draw(rng: Generator) -> Layout:
        plans.append(_floor_plan(rng))
        return _furnish(rng, plans[-1])

    layout, field = solvable_layout(NAME, seed, footprint_radius, draw)
    return layout.world(NAME, seed, _crowd(stream(NAME, seed, 1000), plans[-1], layout, field, movers))


def _floor_plan(rng: Generator) -> FloorPlan:
    lobby = uniform(rng, 6.5, 8.5)
    width = uniform(rng, 2.2, 3.0)
    low = uniform(rng, 7.2, 10.4)
    high = round(low + width, 3)
    t = INNER / 2
    rooms: list[Room] = []
    walls: list[Obstacle] = []
    for y0, y1, inner, outside in (
        (OUTER, low, low, low + width * 0.35),
        (high, DEPTH - OUTER, high, high - width * 0.35),
    ):
        count = int(rng.integers(3, 6))
        shares = rng.uniform(0.8, 1.2, count)
        edges = lobby + np.concatenate([[0.0], np.cumsum(shares / shares.sum())]) * (LENGTH - OUTER - lobby)
        walls.append(rectangle("wall", lobby - t, y0, lobby + t, y1))
        at = lobby
        for k in range(count):
            x0, x1 = round(float(edges[k]), 3), round(float(edges[k + 1]), 3)
            if k:
                walls.append(rectangle("wall", x0 - t, y0, x0 + t, y1))
            door = uniform(rng, *DOOR)
            middle = uniform(rng, x0 + 0.5 + door / 2, x1 - 0.5 - door / 2)
            walls.append(rectangle("wall", at, inner - t, middle - door / 2, inner + t))
            at = middle + door / 2
            rooms.append(Room(x0, y0, x1, y1, (middle, inner), (middle, round(outside, 3))))
        walls.append(rectangle("wall", at, inner - t, LENGTH - OUTER, inner + t))
    spots = [(uniform(rng, 1.5, lobby - 1.5), uniform(rng, 2.0, DEPTH - 2.0)) for _ in range(6)]
    entrance = (round(lobby - 0.8, 3), round((low + high) / 2, 3))
    start = (uniform(rng, 1.2, 2.0), 1.4 if rng.random() < 0.5 else DEPTH - 1.4)
    far = [k for k, room in enumerate(rooms) if room.x1 > LENGTH - 1.0]
    return FloorPlan(tuple(rooms), tuple(spots), entrance, tuple(walls), start, far[rng.integers(len(far))])


def _lines(plan: FloorPlan) -> list[tuple[Point, Point]]:
    """Lines that pedestrians walk on, besides the corridor."""
    lines = [(spot, plan.entrance) for spot in plan.lobby_spots] + [(plan.start, plan.entrance)]
    for room in plan.rooms:
        lines += [(room.middle, room.door), (room.door, room.outside)]
    return lines


def _distance_to_line(point: Point, line: tuple[Point, Point]) -> float:
    (ax, ay), (bx, by) = line
    dx, dy = bx - ax, by - ay
    share = ((point[0] - ax) * dx + (point[1] - ay) * dy) / max(dx * dx + dy * dy, 1e-9)
    share = min(max(share, 0.0), 1.0)
    return math.hypot(point[0] - ax - share * dx, point[1] - ay - share * dy)


def _furnish(rng: Generator, plan: FloorPlan) -> Layout:
    """Add shelves along the walls, tables, and columns in the lobby, away from the lines that pedestrians walk on."""
    lines = _lines(plan)
    pieces = list(plan.walls)

    def put(obstacle: Obstacle, reach: float) -> None:
        centre = obstacle.shape.x, obstacle.shape.y
        if all(_distance_to_line(centre, line) >= reach + WALK_CLEARANCE for line in lines):
            pieces.append(obstacle)

    for room in plan.rooms:
        back = room.y0 if room.door[1] > room.y0 + 1.0 else room.y1
        inward = 1.0 if back == room.y0 else -1.0
        x = room.x0 + 0.3
        while x + 1.2 < room.x1 - 0.3:
            length = uniform(rng, 0.9, 1.2)
            if rng.random() < 0.55:
                y0, y1 = sorted((back, back + inward * 0.4))
                put(rectangle("shelf", x, y0, x + length, y1, 1.9), 0.65)
            x += length
        for _ in range(4):
            length, depth = uniform(rng, 1.0, 1.6), uniform(rng, 0.6, 0.8)
            cx = uniform(rng, room.x0 + 1.0, room.x1 - 1.0)
            cy = uniform(rng, min(room.y0 + 1.9, room.y1 - 1.9), max(room.y0 + 1.9, room.y1 - 1.9))
            reach = math.hypot(length, depth) / 2
            near = [p for p in pieces if math.dist((p.shape.x, p.shape.y), (cx, cy)) < reach + 1.6]
            if not any(piece.kind == "low" for piece in near):
                table = rectangle("low", cx - length / 2, cy - depth / 2, cx + length / 2, cy + depth / 2,
                                  uniform(rng, 0.55, LOW_HEIGHT[1]))  # fmt: skip
                put(table, reach)
    lobby = plan.entrance[0] + 0.8
    for y in (5.0, 10.0, 15.0):
        put(pillar(round(lobby / 2, 3), y + uniform(rng, -0.8, 0.8), 0.25), 0.25)
    desk = uniform(rng, 4.0, DEPTH - 4.0)
    put(rectangle("block", 1.0, desk - 1.2, 1.7, desk + 1.2, 1.1), 1.3)
    bounds = (0.0, 0.0, LENGTH, DEPTH)
    start = Pose2(*plan.start, round(heading(plan.start, plan.entrance), 4))
    return Layout(bounds, (*outer_walls(bounds), *pieces), start, plan.rooms[plan.goal_room].middle)


def _route(rng: Generator, plan: FloorPlan) -> list[Point]:
    """Draw a pedestrian's route from one place to another and back: a closed polyline through free space."""
    ways: list[list[Point]] = []
    places = rng.permutation(len(plan.rooms) + len(plan.lobby_spots))[:2]
    for k in places:
        if k < len(plan.rooms):
            room = plan.rooms[k]
            beside = (round(room.middle[0] + uniform(rng, -0.2, 0.2), 3), room.middle[1])
            ways.append([beside, room.door, room.outside])
        else:
            ways.append([plan.lobby_spots[k - len(plan.rooms)], plan.entrance])
    there = ways[0] + ways[1][::-1]
    route = [there[0]]
    for point in [*there[1:], *there[-2:0:-1]]:
        if point != route[-1]:
            route.append(point)
    return route


def _crowd(rng: Generator, plan: FloorPlan, layout: Layout, field: ClearanceField, count: int) -> tuple[Mover, ...]:
    people: list[Mover] = []
    tries = 0
    while len(people) < count:
        tries += 1
        if tries > PLACES_TRIED * count:
            raise BadWorld(
                f"{NAME}: no free place for person {len(people) + 1} of {count} in {tries - 1} tries; "
                "fewer movers would be right"
            )
        parts, radius = person_body(rng)
        radius = math.ceil(radius * 1e4) / 1e4
        route = _route(rng, plan)
        k = int(rng.integers(len(route)))
        route = route[k:] + route[:k]
        share = rng.uniform(0.0, 0.9)
        x = round(route[0][0] + share * (route[1][0] - route[0][0]), 3)
        y = round(route[0][1] + share * (route[1][1] - route[0][1]), 3)
        if math.dist((x, y), layout.start[:2]) < START_DISTANCE + radius + LARGEST_FOOTPRINT:
            continue
        if any(math.dist((x, y), p.start[:2]) < radius + p.radius + PERSON_GAP for p in people):
            continue
        if field.distance[field.cell(x, y)] < radius + WALL_GAP:
            continue
        start = Pose2(x, y, round(heading((x, y), route[1]), 4))
        speed = uniform(rng, *WALKING_SPEED)
        people.append(Mover("person", parts, radius, start, SocialForce(speed, tuple(route))))
    return tuple(people)
