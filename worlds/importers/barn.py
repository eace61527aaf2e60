"""Worlds of BARN and DynaBARN: Gazebo SDF, or JSON that says the same.

Perille et al., "Benchmarking Metric Ground Navigation" (2020); Nair et al., "DynaBARN: Benchmarking Metric Ground
Navigation in Dynamic Environments" (2022). Cylinders are centred on the floor: half their height stands above it.
"""

import math
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from vuca_nav.data_files import read_json, read_xml, shown
from vuca_nav.errors import BadWorld
from vuca_nav.geometry import wrap_angle
from vuca_nav.types import Pose2
from worlds.checks import check_world
from worlds.importers.fields import FARTHEST, LONGEST, Fields, is_size, world_name
from worlds.motion.keyframes import place_of
from worlds.world import Box, Cylinder, Keyframes, Mover, MoverPart, Obstacle, Shape, World

START, GOAL = Pose2(-2.25, 3.0, 1.57), (-2.25, 13.0)
"""Start and goal of every BARN world; the world files do not hold them."""
TOLERANCE, TIME_LIMIT = 1.0, 100.0
"""Distance from the goal within which it counts as reached [m], and time limit [s], of the BARN challenge."""
MARGIN = 2.0
"""Distance of the bounds from everything [m]; they are open."""
MOST_SHAPES, MOST_MOVERS, MOST_KEYFRAMES = 10_000, 1000, 10_000


def load_barn(path: str | Path) -> World:
    """A world of BARN, from its ``.world`` file or from JSON; both give the same.

    Raises:
        BadWorld: The file cannot be read, has something that is not an upright box or cylinder, or wrong numbers.
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        return _from_json(path)
    shapes = _sdf_shapes(path)
    if not shapes:
        raise BadWorld(f"{path}: no obstacles; a world of BARN has cylinders")
    return _checked(path, tuple(_obstacle(shape) for shape in shapes), (), _Task(START, GOAL, TOLERANCE, TIME_LIMIT))


def load_dynabarn(path: str | Path) -> World:
    """A world of DynaBARN, from JSON: cylinders move by keyframes and jump back to the first one.

    Places between keyframes are on straight lines, which gives the speeds that the authors drew. The phase is drawn
    from the episode's seed.

    Raises:
        BadWorld: As by :func:`load_barn`, or nothing moves.
    """
    world = _from_json(Path(path))
    if not world.movers:
        raise BadWorld(f"{path}: moving: nothing moves; a world of DynaBARN has moving cylinders")
    return world


def optimal_length(path: str | Path) -> float | None:
    """Length of the optimal way that a world's JSON states [m]; None if it states none.

    Raises:
        BadWorld: The file cannot be read, or the number is out of range.
    """
    return _stated_length(Fields(str(path), read_json(path, BadWorld)))


def _stated_length(top: Fields) -> float | None:
    for name in ("optimal_path_length_m", "straight_line_m"):
        if name in top:
            return top.number(name, 1e-3)
    return None


class _Task(NamedTuple):
    start: Pose2
    goal: tuple[float, float]
    tolerance: float
    time_limit: float


def _from_json(path: Path) -> World:
    top = Fields(str(path), read_json(path, BadWorld))
    x, y, yaw = top.numbers("start", 3)
    goal = top.numbers("goal", 2)
    shapes: list[Shape] = []
    for k, (cx, cy, radius, height) in enumerate(top.rows("cylinders", 4, MOST_SHAPES)):
        if not is_size(radius, height / 2.0):
            raise top.error(f"cylinders[{k}]", "radius and height above 0, up to 1000 m, would be right")
        shapes.append(Cylinder(cx, cy, radius, height / 2.0))
    for k, (cx, cy, turn, length, width, height) in enumerate(top.rows("boxes", 6, MOST_SHAPES)):
        if not is_size(length, width, height):
            raise top.error(f"boxes[{k}]", "sizes above 0, up to 1000 m, would be right")
        shapes.append(Box(cx, cy, length, width, turn, height))
    movers = tuple(_mover(moving) for moving in top.mappings("moving", MOST_MOVERS))
    if not shapes and not movers:
        raise BadWorld(f"{path}: no obstacles; cylinders, boxes or moving would be right")
    tolerance = top.number("goal_tolerance_m", 1e-3, 100.0) if "goal_tolerance_m" in top else TOLERANCE
    limit = top.number("timeout_s", 1.0, 1e5) if "timeout_s" in top else TIME_LIMIT
    _stated_length(top)  # whoever scores by it must not find it broken
    task = _Task(Pose2(x, y, yaw if abs(yaw) <= math.pi else wrap_angle(yaw)), (goal[0], goal[1]), tolerance, limit)
    return _checked(path, tuple(_obstacle(shape) for shape in shapes), movers, task)


def _mover(moving: Fields) -> Mover:
    """A moving cylinder."""
    if moving.text("shape") != "cylinder":
        raise moving.error("shape", f"{shown(moving.text('shape'))} is not a cylinder")
    radius, height = moving.number("radius", 1e-3, 100.0), moving.number("height", 1e-3, 100.0)
    rows = moving.rows("keyframes", 3, MOST_KEYFRAMES, LONGEST)
    if not rows:
        raise moving.error("keyframes", "none; [time, x, y] would be right")
    loops = moving.flag("loop") if "loop" in moving else True
    motion = Keyframes(
        tuple(t for t, _, _ in rows),
        tuple((x, y) for _, x, y in rows),
        period=moving.number("period_s", 1e-3, LONGEST) if loops else None,
        jumps=loops,
        phase=None if loops else 0.0,
    )
    parts = (MoverPart(Cylinder(0.0, 0.0, radius, height)),)
    return Mover("cylinder", parts, radius, place_of(motion)[0], motion)


def _obstacle(shape: Shape) -> Obstacle:
    return Obstacle("pillar" if isinstance(shape, Cylinder) else "wall", shape)


def _checked(path: Path, obstacles: tuple[Obstacle, ...], movers: tuple[Mover, ...], task: "_Task") -> World:
    """The world with bounds about everything, checked."""
    start, goal, tolerance, limit = task
    reaches = [(*start[:2], 0.0, 0.0), (*goal, 0.0, 0.0)]
    reaches += [(*p, m.radius, m.radius) for m in movers if isinstance(m.motion, Keyframes) for p in m.motion.points]
    for shape in (obstacle.shape for obstacle in obstacles):
        if isinstance(shape, Cylinder):
            reaches.append((shape.x, shape.y, shape.radius, shape.radius))
        else:
            c, s = abs(math.cos(shape.yaw)) / 2.0, abs(math.sin(shape.yaw)) / 2.0
            half = c * shape.length + s * shape.width, s * shape.length + c * shape.width
            reaches.append((shape.x, shape.y, *half))
    bounds = (
        min(x - reach for x, _, reach, _ in reaches) - MARGIN,
        min(y - reach for _, y, _, reach in reaches) - MARGIN,
        max(x + reach for x, _, reach, _ in reaches) + MARGIN,
        max(y + reach for _, y, _, reach in reaches) + MARGIN,
    )
    world = World(
        world_name(path), 0, bounds, obstacles, movers, start, goal,
        open_borders=True, tolerance=tolerance, time_limit=limit, starts_on_motion=True,
    )  # fmt: skip
    check_world(world, str(path))
    return world


# -- SDF -----------------------------------------------------------------------------------------------------------


def _sdf_shapes(path: Path) -> list[Shape]:
    """The shapes of all collisions in an SDF world, but for the floor."""
    root = read_xml(path, BadWorld)
    world = root.find("world")
    if root.tag != "sdf" or world is None:
        raise BadWorld(f"{path}: the root element is <{shown(root.tag)}>; <sdf> with a <world> would be right")
    for tag, why in (
        ("include", "it names another file; a world that holds its models itself would be right"),
        ("actor", "it moves by an animation; JSON with keyframes, and dynabarn:, would be right"),
        ("population", "it draws models at random; a world that holds its models itself would be right"),
        ("insertions", "it adds models while it runs; a world that holds its models itself would be right"),
        ("deletions", "it takes models away while it runs; a world without them would be right"),
    ):
        if next(root.iter(tag), None) is not None:
            raise BadWorld(f"{path}: <{tag}>: {why}")
    moved = {model.get("name"): model for model in world.iterfind("state/model")}
    shapes: list[Shape] = []
    names: set[str | None] = set()
    for model in world.iterfind("model"):
        where = f"{path}: model {shown(repr(model.get('name', '')))}"
        if next(model.iter("plugin"), None) is not None or model.find("model") is not None:
            raise BadWorld(f"{where}: it has a plugin or a model within; plain links would be right")
        if model.get("name") in names:
            raise BadWorld(f"{where}: a second model of this name; a name for each would be right")
        names.add(model.get("name"))
        state = moved.get(model.get("name"))
        if state is not None:
            scale = state.find("scale")
            if scale is not None and any(number != 1.0 for number in _numbers(scale, 3, where)):
                raise BadWorld(f"{where}: its state scales it; shapes of the right size would be right")
        placed = None if state is None else state.find("pose")
        pose = _pose(model.find("pose") if placed is None else placed, where)
        found = 0
        for link in model.iterfind("link"):
            for collision in link.iterfind("collision"):
                place = _add(_add(pose, _pose(link.find("pose"), where)), _pose(collision.find("pose"), where))
                shapes += _shape(collision, place, where)
                found += 1
        if not found and next(model.iter("visual"), None) is not None:
            raise BadWorld(f"{where}: it is seen but has no collision; a collision would be right")
        if len(shapes) > MOST_SHAPES:
            raise BadWorld(f"{path}: more than {MOST_SHAPES} collisions; fewer would be right")
    return shapes


class _Pose(NamedTuple):
    x: float
    y: float
    z: float
    yaw: float


def _add(a: _Pose, b: _Pose) -> _Pose:
    """Pose b, given in the frame of a."""
    c, s = math.cos(a.yaw), math.sin(a.yaw)
    return _Pose(a.x + c * b.x - s * b.y, a.y + s * b.x + c * b.y, a.z + b.z, a.yaw + b.yaw)


def _pose(element: Element | None, where: str) -> _Pose:
    if element is None:
        return _Pose(0.0, 0.0, 0.0, 0.0)
    if element.get("frame") or element.get("relative_to"):
        raise BadWorld(f"{where}: a pose relative to another frame; one in its parent's would be right")
    if (
        element.get("degrees", "false") not in ("false", "0")
        or element.get("rotation_format", "euler_rpy") != "euler_rpy"
    ):
        raise BadWorld(f"{where}: a pose in degrees or of a quaternion; roll, pitch and yaw in radians would be right")
    x, y, z, roll, pitch, yaw = _numbers(element, 6, where)
    if abs(roll) > 1e-6 or abs(pitch) > 1e-6:
        raise BadWorld(f"{where}: it leans (roll {roll:g}, pitch {pitch:g}); an upright shape would be right")
    return _Pose(x, y, z, yaw)


def _shape(collision: Element, pose: _Pose, where: str) -> list[Shape]:
    """The shape of a collision above the floor; none of a plane, which is the floor."""
    geometry = collision.find("geometry")
    kind = None if geometry is None or not len(geometry) else geometry[0]
    if kind is None:
        raise BadWorld(f"{where}: a collision without a geometry; a cylinder or a box would be right")
    if kind.tag == "plane":
        return []
    if kind.tag == "cylinder":
        radius, height = _size(kind, "radius", where), _size(kind, "length", where)
    elif kind.tag == "box":
        length, width, height = _numbers(kind.find("size"), 3, where)
        if not is_size(length, width, height):
            raise BadWorld(f"{where}: a box of {length:g} x {width:g} x {height:g} m; sizes above 0 would be right")
    else:
        raise BadWorld(f"{where}: a collision is a <{shown(kind.tag)}>; a cylinder or a box would be right")
    base, top = max(pose.z - height / 2.0, 0.0), pose.z + height / 2.0
    if not is_size(top - base):
        return []  # all of it is below the floor
    if kind.tag == "cylinder":
        return [Cylinder(pose.x, pose.y, radius, top - base, base)]
    return [Box(pose.x, pose.y, length, width, wrap_angle(pose.yaw), top - base, base)]


def _size(element: Element, tag: str, where: str) -> float:
    (value,) = _numbers(element.find(tag), 1, where)
    if not is_size(value):
        raise BadWorld(f"{where}: {tag} {value:g}; a size above 0 would be right")
    return value


def _numbers(element: Element | None, count: int, where: str) -> list[float]:
    words = [] if element is None else (element.text or "").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(abs(number) <= FARTHEST for number in numbers):
        name = "a size" if element is None else f"<{shown(element.tag)}>"
        raise BadWorld(f"{where}: {name} is {shown(repr(' '.join(words)))}; {count} finite numbers would be right")
    return numbers
