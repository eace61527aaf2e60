"""Checks of a world beyond its format: a free start and goal, movers in free places, a way to the goal."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from vuca_nav.errors import BadWorld
from vuca_nav.footprint import ROOM, cover_by_discs, half_way, size_of
from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import FloatArray
from worlds.arrays import pack_shapes
from worlds.clearance import ClearanceField, clearance_at, clearance_field, distance_to_wide_ways
from worlds.motion.keyframes import place_of
from worlds.scenes.parts.population import MOVER_WAY, WAY_MARGIN
from worlds.shortest_path import shortest_path_length
from worlds.widest_way import widest_way
from worlds.world import (
    MAX_MOVER_SPEED,
    TALLEST,
    Box,
    Keyframes,
    Mover,
    Patrol,
    RandomWalk,
    Shape,
    UserMotion,
    World,
)

MAX_EXTENT = 200.0
"""Greatest extent of the bounds along x and along y [m], for which the grids of paths and movers are made."""
MIN_HEIGHT = 0.05
"""Least height of an obstacle's or mover's top above the floor [m]. A robot's collision hull ends above the floor,
TIAGo's at 0.023 m: it would pass over anything lower without a contact."""
HEADINGS = 32
"""Number of headings at the start that are tried where a task names none."""
_HALF_DIAGONAL = 0.71
"""Half the diagonal of a unit cell, rounded up."""
_ROUNDING = 1e-6
"""Slack for numbers that a scene file has rounded [m]."""
START_MARGIN = 0.1
"""Least distance between the robot and a mover when an episode begins [m]."""
LEAST_PATROL = 0.1
"""Least length of a patrol [m]: one cell of the movers' grid. What only trembles on the spot is at rest."""
MOST_COVER = 20.0
"""Most that all obstacles together may cover, in areas of the bounds: work on the grids grows with it."""


class BadField(BadWorld):
    """A field of a world that is wrong.

    Args:
        source: Name that begins the message, such as the file's; may be empty.
        field: Path of the field, as in ``movers[3].motion``; empty for the whole file.
        problem: What is wrong, and what would be right.
    """

    def __init__(self, source: str, field: str, problem: str):
        super().__init__(f"{source}{': ' if source else ''}{field or 'the file'}: {problem}")
        self.field = field


def check_world(world: World, source: str = "") -> None:
    """Refuse a world whose start, goal or movers cannot be where they are put.

    Args:
        world: Any world.
        source: Name that begins each message, such as the file's.

    Raises:
        BadField: Empty or too large bounds; an obstacle too low for a contact; obstacles that cover each other many
            times; a map with cells out of it; start or goal inside an obstacle or out of bounds; keyframes that are out
            of order, too fast, or do not fit their period; a mover that starts in an obstacle or in another
            mover, does not fit into its own radius, has waypoints in walls, out of bounds or behind walls, patrols
            on the spot, or walks at random outside ways of 2.2 m width.
    """
    x0, y0, x1, y1 = world.bounds
    for low, high, axis in ((x0, x1, "x"), (y0, y1, "y")):
        field = f"bounds.{axis}_max"
        if high <= low:
            raise BadField(source, field, f"{high:g} is not greater than {axis}_min, which is {low:g}")
        if high - low > MAX_EXTENT:
            raise BadField(source, field, f"{high - low:g} m from {axis}_min; {MAX_EXTENT:g} m or less would be right")
    for i, obstacle in enumerate(world.obstacles):
        _check_height(obstacle.shape.base + obstacle.shape.height, f"obstacles[{i}]", source)
    for i, mover in enumerate(world.movers):
        _check_height(mover.top, f"movers[{i}]", source)
    _check_grid(world, source)
    _check_cover(world, source)
    _check_place(world, "start", world.start[:2], 0.0, MIN_HEIGHT, source)
    _check_place(world, "goal", world.goal, 0.0, MIN_HEIGHT, source)
    for i, mover in enumerate(world.movers):
        _check_parts(mover, f"movers[{i}]", source)
    if all(isinstance(mover.motion, Keyframes) for mover in world.movers):
        return
    field = clearance_field(world.below(world.mover_height), world.bounds, is_open=world.open_borders)
    away = distance_to_wide_ways(field, MOVER_WAY)
    for i, mover in enumerate(world.movers):
        if isinstance(mover.motion, Keyframes):
            continue
        _check_mover(world, i, field, source)
        limit = MOVER_WAY / 2 - mover.radius - WAY_MARGIN
        if isinstance(mover.motion, RandomWalk) and away[field.cell(*mover.start[:2])] > limit:
            raise BadField(
                source,
                f"movers[{i}].start",
                f"random walkers keep to ways of {MOVER_WAY:g} m and more, and ({mover.start.x:g}, {mover.start.y:g}) "
                "is not in one; a wider place, or a patrol, would be right",
            )
    _check_apart(world.movers, source)


def check_task(
    world: World,
    footprint: FloatArray,
    source: str = "",
    height: float = TALLEST,
    tolerance: float = GOAL_TOLERANCE,
) -> float:
    """Refuse a world in which a body cannot stand at the start, or cannot get to the goal.

    What is passable: ways as wide as the footprint and 0.10 m (``vuca_nav.footprint.half_way``).

    Args:
        world: Any world.
        footprint: Convex outline of the body in base_link (n, 2) [m].
        source: Name that begins each message.
        height: Height of the body [m]; what hangs above it is not in its way.
        tolerance: Distance from the goal at which it counts as reached [m].

    Returns:
        Length of the shortest way around the static obstacles alone [m].

    Raises:
        BadWorld: The body does not fit at the start, a mover is where it starts, or no way joins the start and a place
            within the tolerance of the goal, even without the moving obstacles.
    """
    x, y, yaw = world.start
    discs = cover_by_discs(footprint)
    for along, aside, radius in discs.tolist():
        point = x + along * math.cos(yaw) - aside * math.sin(yaw), y + along * math.sin(yaw) + aside * math.cos(yaw)
        _check_place(world, "start", point, radius, height, source)
    _check_place(world, "goal", world.goal, 0.0, height, source)
    for i, mover in enumerate(world.movers):
        place, there = place_of(mover.motion) if isinstance(mover.motion, Keyframes) else (mover.start, True)
        gap = math.dist(place[:2], world.start[:2]) - mover.radius - size_of(discs)
        if gap < START_MARGIN and mover.base < height and there:
            raise BadField(
                source,
                "start",
                f"movers[{i}] (a {mover.kind}) begins at ({place.x:g}, {place.y:g}), "
                f"{gap:.2f} m from the body; {START_MARGIN:g} m or more between them would be right",
            )
    half = half_way(footprint)
    length = shortest_path_length(world, half, height, tolerance)
    if not math.isfinite(length):
        neck = widest_way(world, half, tolerance, height)
        found = "all ways are walled up; a passage or another goal would be right"
        if neck is not None:
            found = f"the widest is {neck.width:.2f} m wide at ({neck.place[0]:.2f}, {neck.place[1]:.2f})"
        raise BadField(
            source,
            "goal",
            f"no way leads from the start to ({world.goal[0]:g}, {world.goal[1]:g}) that is {2.0 * half:.2f} m wide, "
            f"as wide as the body and 0.10 m: {found}",
        )
    return length


def fitting_heading(world: World, footprint: FloatArray, height: float = TALLEST) -> float:
    """The heading at the start, of those in which the body fits there, that is nearest to the goal's direction [rad].

    One with 2 ``ROOM`` around the body goes before one with less: a quadruped sways as it stands up. Where it fits in
    none, it is the goal's direction itself: ``check_task`` then says what it meets.

    Args:
        world: Any world.
        footprint: Convex outline of the body in base_link (n, 2) [m].
        height: Height of the body [m]; what hangs above it is not in its way.
    """
    (x, y, _), discs = world.start, cover_by_discs(footprint)
    shapes = pack_shapes([obstacle.shape for obstacle in world.obstacles if obstacle.shape.base < height])
    x0, y0, x1, y1 = (-math.inf, -math.inf, math.inf, math.inf) if world.open_borders else world.bounds
    towards = math.atan2(world.goal[1] - y, world.goal[0] - x)
    for room in (2.0 * ROOM, ROOM, 0.5 * ROOM, 0.0):
        for k in range(HEADINGS):
            yaw = towards + (k + 1) // 2 * (-1) ** k * 2.0 * math.pi / HEADINGS
            for along, aside, radius in discs.tolist():
                u = x + along * math.cos(yaw) - aside * math.sin(yaw)
                v = y + along * math.sin(yaw) + aside * math.cos(yaw)
                distance, which = clearance_at(shapes, u, v)
                least = radius + room
                if min(u - x0, x1 - u, v - y0, y1 - v) < least or (which >= 0 and distance <= least):
                    break
            else:
                return yaw
    return towards


def _check_height(top: float, field: str, source: str) -> None:
    """Refuse a thing whose top is too low for a contact."""
    if top < MIN_HEIGHT:
        raise BadField(
            source,
            field,
            f"its top is {top:g} m above the floor, below the hull of a body; {MIN_HEIGHT:g} m or more would be right",
        )


def _check_cover(world: World, source: str) -> None:
    """Refuse obstacles that lie many layers deep over the whole place."""
    x0, y0, x1, y1 = world.bounds
    shapes = pack_shapes([obstacle.shape for obstacle in world.obstacles])
    c, s = np.abs(np.cos(shapes.yaw)), np.abs(np.sin(shapes.yaw))
    reach = np.stack([c * shapes.half[:, 0] + s * shapes.half[:, 1], s * shapes.half[:, 0] + c * shapes.half[:, 1]], 1)
    sides = np.minimum(shapes.centre + reach, (x1, y1)) - np.maximum(shapes.centre - reach, (x0, y0))
    cover = sides.clip(0.0).prod(axis=1).sum() / ((x1 - x0) * (y1 - y0))
    if cover > MOST_COVER:
        raise BadField(
            source,
            "obstacles",
            f"together they cover the bounds {cover:.0f} times; {MOST_COVER:g} times or less would be right",
        )


def _check_place(
    world: World, field: str, point: tuple[float, float], radius: float, height: float, source: str
) -> None:
    """Refuse a point out of bounds, or nearer than ``radius`` to them or to an obstacle below ``height``.

    Movers may be out of open bounds, start and goal may not.
    """
    (x0, y0, x1, y1), (x, y) = world.bounds, point
    if not (world.open_borders and field.startswith("movers")) and not (x0 <= x <= x1 and y0 <= y <= y1):
        raise BadField(
            source,
            field,
            f"({x:g}, {y:g}) is out of bounds; x from {x0:g} to {x1:g} and y from {y0:g} to {y1:g} would be right",
        )
    to_bounds = math.inf if world.open_borders else min(x - x0, x1 - x, y - y0, y1 - y)
    if to_bounds < radius:
        raise BadField(
            source, field, f"({x:g}, {y:g}) is {to_bounds:.2f} m from the bounds; {radius:g} m around it must be free"
        )
    low = [i for i, obstacle in enumerate(world.obstacles) if obstacle.shape.base < height]
    distance, which = clearance_at(pack_shapes([world.obstacles[i].shape for i in low]), x, y)
    if distance > radius or which < 0:
        return
    obstacle = f"obstacles[{low[which]}] (a {world.obstacles[low[which]].kind})"
    if distance == 0.0:
        raise BadField(source, field, f"({x:g}, {y:g}) is inside {obstacle}; a free place would be right")
    raise BadField(
        source, field, f"({x:g}, {y:g}) is {distance:.2f} m from {obstacle}; {radius:g} m around it must be free"
    )


def part_reach(shape: Shape, swing: float) -> float:
    """Radius of the circle about the mover's origin that holds a part at every swing [m]."""
    if not isinstance(shape, Box):
        return math.hypot(abs(shape.x) + abs(swing), shape.y) + shape.radius
    c, s = math.cos(shape.yaw), math.sin(shape.yaw)
    reach = 0.0
    for u in (shape.length / 2, -shape.length / 2):
        for v in (shape.width / 2, -shape.width / 2):
            x, y = shape.x + c * u - s * v, shape.y + s * u + c * v
            reach = max(reach, math.hypot(abs(x) + abs(swing), y))
    return reach


def _check_parts(mover: Mover, name: str, source: str) -> None:
    """Refuse a mover that does not fit into its radius, and keyframes that cannot be followed."""
    reach = max(part_reach(part.shape, part.swing) for part in mover.parts)
    if mover.radius < reach - _ROUNDING:
        raise BadField(
            source, f"{name}.radius", f"{mover.radius:g} does not hold the parts; {reach:.3f} or more would be right"
        )
    motion = mover.motion
    if not isinstance(motion, Keyframes):
        return
    if mover.sighted:
        raise BadField(source, f"{name}.sighted", "keyframes give way to nobody; false, or leaving it out, is right")
    for k, (before, after) in enumerate(pairwise(motion.times), start=1):
        if after <= before:
            raise BadField(
                source,
                f"{name}.motion.keyframes[{k}]",
                f"its time, {after:g} s, is not after {before:g} s before it; times in order would be right",
            )
    span = motion.times[-1] - motion.times[0]
    if motion.period is not None and motion.period < span - _ROUNDING:
        raise BadField(
            source,
            f"{name}.motion.period",
            f"{motion.period:g} s is shorter than the keyframes, which take {span:g} s; that or more would be right",
        )
    at_once = motion.period is not None and motion.period <= span and not (motion.jumps or motion.vanishes)
    if at_once and math.dist(motion.points[0], motion.points[-1]) > _ROUNDING:
        raise BadField(
            source,
            f"{name}.motion.period",
            f"no time is left to go back to the first place; jumps: true, or more than {span:g} s, would be right",
        )
    if motion.speed > MAX_MOVER_SPEED + _ROUNDING:
        raise BadField(
            source,
            f"{name}.motion.keyframes",
            f"it moves at {motion.speed:.1f} m/s; {MAX_MOVER_SPEED:g} m/s or less would be right",
        )


def _check_grid(world: World, source: str) -> None:
    """Refuse rectangles that reach out of their map."""
    grid = world.grid
    if grid is None:
        return
    for name, rectangles in (("walls", grid.walls), ("unknown", grid.unknown)):
        for k, (column, row, columns, rows) in enumerate(rectangles):
            if columns < 1 or rows < 1 or column + columns > grid.size[0] or row + rows > grid.size[1]:
                raise BadField(
                    source,
                    f"map.{name}[{k}]",
                    f"{columns} x {rows} cells from ({column}, {row}) are none of a map of {grid.size[0]} x "
                    f"{grid.size[1]}; one cell or more within it would be right",
                )


def _check_mover(world: World, i: int, field: ClearanceField, source: str) -> None:
    """Refuse a mover that starts in something, or cannot go its way. One by keyframes may go through anything."""
    mover = world.movers[i]
    _check_place(world, f"movers[{i}].start", mover.start[:2], mover.radius, world.mover_height, source)
    if isinstance(mover.motion, RandomWalk | Keyframes | UserMotion):
        return
    name, waypoints = f"movers[{i}].motion.waypoints", mover.motion.waypoints
    for k, point in enumerate(waypoints):
        _check_place(world, f"{name}[{k}]", point, 0.0, world.mover_height, source)
    if isinstance(mover.motion, Patrol):
        if math.dist(waypoints[0], mover.start[:2]) > _ROUNDING:
            raise BadField(
                source,
                f"{name}[0]",
                f"a patrol starts at its first waypoint; ({mover.start.x:g}, {mover.start.y:g}) would be right, "
                "which is its start",
            )
        length = sum(math.dist(a, b) for a, b in pairwise(waypoints))
        if length < LEAST_PATROL:
            raise BadField(
                source,
                name,
                f"a patrol of {length:g} m; two waypoints or more, {LEAST_PATROL:g} m from end to end, would be right",
            )
        legs = list(enumerate(pairwise(waypoints), start=1))
    else:
        first = 1 % len(waypoints)  # a pedestrian starts on its way to the second waypoint, and closes the round
        legs = [(first, (mover.start[:2], waypoints[first])), *enumerate(pairwise(waypoints), start=1)]
        legs.append((0, (waypoints[-1], waypoints[0])))
    for k, (a, b) in legs:
        x, y = _first_hit(a, b, mover.radius, field)
        if math.isfinite(x):
            raise BadField(
                source,
                f"{name}[{k}]",
                f"on the straight way there the mover hits an obstacle at ({x:.2f}, {y:.2f}); free straight ways "
                "would be right",
            )


def _first_hit(
    a: tuple[float, float], b: tuple[float, float], radius: float, field: ClearanceField
) -> tuple[float, float]:
    """The first place between two points where a disc surely overlaps an obstacle [m]; infinite if there is none."""
    steps = math.ceil(math.dist(a, b) / (0.5 * field.resolution))
    share = np.arange(steps + 1)[:, None] / max(steps, 1)
    points = np.array(a) + share * (np.array(b) - np.array(a))
    rows, columns = field.distance.shape
    cells = ((points - field.origin) / field.resolution).astype(int).clip(0, (columns - 1, rows - 1))
    # The field is exact at the cell's centre, which is at most half a diagonal from the point.
    hits = field.distance[cells[:, 1], cells[:, 0]] + _HALF_DIAGONAL * field.resolution < radius
    if not hits.any():
        return math.inf, math.inf
    x, y = points[hits.argmax()].tolist()
    return x, y


def _check_apart(movers: Sequence[Mover], source: str) -> None:
    """Refuse movers that overlap at the start: two that react to each other never come apart again.

    Those by keyframes react to nobody, and may have been recorded so.
    """
    starts = np.array([mover.start[:2] for mover in movers])
    radii = np.array([mover.radius for mover in movers])
    for i in range(1, len(movers)):
        gaps = np.hypot(*(starts[:i] - starts[i]).T) - radii[:i] - radii[i]
        gaps[[isinstance(mover.motion, Keyframes) for mover in movers[:i]]] = math.inf
        j = int(gaps.argmin())
        if gaps[j] < -_ROUNDING and not isinstance(movers[i].motion, Keyframes):
            x, y, _ = movers[j].start
            raise BadField(
                source,
                f"movers[{i}].start",
                f"it overlaps movers[{j}] (a {movers[j].kind}), which starts at ({x:g}, {y:g}); "
                f"{radii[i] + radii[j]:g} m or more from there would be right",
            )
