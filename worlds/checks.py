"""Checks of a world beyond its format: a free start and goal, movers in free places, a way to the goal."""

import math
from collections.abc import Sequence
from itertools import pairwise

from vuca_nav.errors import BadWorld
from worlds.arrays import pack_shapes
from worlds.clearance import ClearanceField, clearance_at, clearance_field, distance_to_wide_ways
from worlds.scenes.parts.population import MOVER_WAY, WAY_MARGIN
from worlds.shortest_path import shortest_path_length
from worlds.world import Box, Mover, Patrol, RandomWalk, Shape, World

MAX_EXTENT = 200.0
"""Greatest extent of the bounds along x and along y [m], for which the grids of paths and movers are made."""
MIN_HEIGHT = 0.05
"""Least height of an obstacle's or mover's top above the floor [m]. A robot's collision hull ends above the floor,
TIAGo's at 0.023 m: it would pass over anything lower without a contact."""
_HALF_DIAGONAL = 0.71
"""Half the diagonal of a unit cell, rounded up."""
_ROUNDING = 1e-6
"""Slack for numbers that a scene file has rounded [m]."""
START_MARGIN = 0.1
"""Least distance between the robot and a mover when an episode begins [m]."""


def check_world(world: World, source: str = "") -> None:
    """Refuse a world whose start, goal or movers cannot be where they are put.

    Args:
        world: Any world.
        source: Name that begins each message, such as the file's.

    Raises:
        BadWorld: Empty or too large bounds; an obstacle too low for a contact; start or goal inside an obstacle or out
            of bounds; a mover that starts in an obstacle, does not fit into its own radius, patrols through a wall, or
            walks at random outside ways of 2.2 m width.
    """
    where = f"{source}: " if source else ""
    x0, y0, x1, y1 = world.bounds
    for low, high, axis in ((x0, x1, "x"), (y0, y1, "y")):
        if high <= low:
            raise BadWorld(f"{where}bounds.{axis}_max: {high:g} is not greater than {axis}_min, which is {low:g}")
        if high - low > MAX_EXTENT:
            raise BadWorld(
                f"{where}bounds.{axis}_max: {high - low:g} m from {axis}_min; {MAX_EXTENT:g} m or less would be right"
            )
    for i, obstacle in enumerate(world.obstacles):
        _check_height((obstacle.shape,), f"obstacles[{i}]", where)
    for i, mover in enumerate(world.movers):
        _check_height([part.shape for part in mover.parts], f"movers[{i}]", where)
    _check_place(world, "start", world.start[:2], 0.0, where)
    _check_place(world, "goal", world.goal, 0.0, where)
    if not world.movers:
        return
    field = clearance_field(world.obstacles, world.bounds)
    away = distance_to_wide_ways(field, MOVER_WAY)
    for i, mover in enumerate(world.movers):
        _check_mover(world, i, mover, field, where)
        limit = MOVER_WAY / 2 - mover.radius - WAY_MARGIN
        if isinstance(mover.motion, RandomWalk) and away[field.cell(*mover.start[:2])] > limit:
            raise BadWorld(
                f"{where}movers[{i}].start: random walkers keep to ways of {MOVER_WAY:g} m and more, and "
                f"({mover.start.x:g}, {mover.start.y:g}) is not in one; a wider place, or a patrol, would be right"
            )


def check_task(world: World, footprint_radius: float, source: str = "") -> float:
    """Refuse a world in which a body of this size cannot stand at the start, or cannot get to the goal.

    Args:
        world: Any world.
        footprint_radius: Radius of the circle about the footprint [m].
        source: Name that begins each message.

    Returns:
        Length of the shortest way around the static obstacles alone [m].

    Raises:
        BadWorld: Start or goal is too near to an obstacle or to the bounds, a mover is where the robot starts, or no
            way joins start and goal, even without the moving obstacles.
    """
    where = f"{source}: " if source else ""
    _check_place(world, "start", world.start[:2], footprint_radius, where)
    _check_place(world, "goal", world.goal, footprint_radius, where)
    for i, mover in enumerate(world.movers):
        gap = math.dist(mover.start[:2], world.start[:2]) - mover.radius - footprint_radius
        if gap < START_MARGIN:
            raise BadWorld(
                f"{where}start: movers[{i}] (a {mover.kind}) begins at ({mover.start.x:g}, {mover.start.y:g}), "
                f"{gap:.2f} m from the body; {START_MARGIN:g} m or more between them would be right"
            )
    length = shortest_path_length(world, footprint_radius)
    if not math.isfinite(length):
        raise BadWorld(
            f"{where}goal: no way leads from the start to ({world.goal[0]:g}, {world.goal[1]:g}) for a body of "
            f"radius {footprint_radius:g} m; a wider passage or another goal would be right"
        )
    return length


def _check_height(shapes: Sequence[Shape], name: str, where: str) -> None:
    """Refuse shapes whose top is too low for a contact."""
    top = max(shape.base + shape.height for shape in shapes)
    if top < MIN_HEIGHT:
        raise BadWorld(
            f"{where}{name}: its top is {top:g} m above the floor, below the hull of a body; "
            f"{MIN_HEIGHT:g} m or more would be right"
        )


def _check_place(world: World, name: str, point: tuple[float, float], radius: float, where: str) -> None:
    """Refuse a point out of bounds, or nearer than ``radius`` to them or to an obstacle."""
    (x0, y0, x1, y1), (x, y) = world.bounds, point
    if not (x0 <= x <= x1 and y0 <= y <= y1):
        raise BadWorld(
            f"{where}{name}: ({x:g}, {y:g}) is out of bounds; x from {x0:g} to {x1:g} and y from {y0:g} to {y1:g} "
            "would be right"
        )
    to_bounds = min(x - x0, x1 - x, y - y0, y1 - y)
    if to_bounds < radius:
        raise BadWorld(
            f"{where}{name}: ({x:g}, {y:g}) is {to_bounds:.2f} m from the bounds; {radius:g} m around it must be free"
        )
    distance, which = clearance_at(pack_shapes([o.shape for o in world.obstacles]), x, y)
    if distance > radius or which < 0:
        return
    obstacle = f"obstacles[{which}] (a {world.obstacles[which].kind})"
    if distance == 0.0:
        raise BadWorld(f"{where}{name}: ({x:g}, {y:g}) is inside {obstacle}; a free place would be right")
    raise BadWorld(
        f"{where}{name}: ({x:g}, {y:g}) is {distance:.2f} m from {obstacle}; {radius:g} m around it must be free"
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


def _check_mover(world: World, i: int, mover: Mover, field: ClearanceField, where: str) -> None:
    reach = max(part_reach(part.shape, part.swing) for part in mover.parts)
    if mover.radius < reach - _ROUNDING:
        raise BadWorld(
            f"{where}movers[{i}].radius: {mover.radius:g} does not hold the parts; {reach:.3f} or more would be right"
        )
    _check_place(world, f"movers[{i}].start", mover.start[:2], mover.radius, where)
    if isinstance(mover.motion, RandomWalk):
        return
    waypoints = mover.motion.waypoints
    if isinstance(mover.motion, Patrol) and math.dist(waypoints[0], mover.start[:2]) > _ROUNDING:
        raise BadWorld(
            f"{where}movers[{i}].motion.waypoints[0]: a patrol starts at its first waypoint; "
            f"({mover.start.x:g}, {mover.start.y:g}) would be right, which is its start"
        )
    for k, (a, b) in enumerate(pairwise(waypoints), start=1):
        steps = math.ceil(math.dist(a, b) / (0.5 * field.resolution))
        for n in range(steps + 1):
            share = n / max(steps, 1)
            x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            # The field is exact at the cell's centre, which is at most half a diagonal from the point.
            if field.distance[field.cell(x, y)] + _HALF_DIAGONAL * field.resolution < mover.radius:
                raise BadWorld(
                    f"{where}movers[{i}].motion.waypoints[{k}]: on the straight way there the mover hits an "
                    f"obstacle at ({x:.2f}, {y:.2f}); free straight ways would be right"
                )
