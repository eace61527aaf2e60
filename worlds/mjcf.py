"""A world as an MJCF model: the floor, static obstacles as geoms, and a mocap body for each part of a mover.

Collision bits: a body's geoms carry ``contype`` bits of the geoms they may touch, the world's geoms the matching
``conaffinity``, so no geom of the world is ever tested against another one of the world.
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math

from worlds.simulator import import_simulator
from worlds.world import Cylinder, Shape, World

import_simulator()

from dm_control.mjcf import Element as Element  # noqa: E402  for the modules that build bodies
from dm_control.mjcf import RootElement as RootElement  # noqa: E402
from dm_control.mjcf import from_xml_string as from_xml_string  # noqa: E402

TOUCHES_FLOOR = 1
"""``contype`` bit of a body's geom that may touch the floor."""
TOUCHES_SCENE = 2
"""``contype`` bit of a body's geom that may touch obstacles and movers."""
FLOOR = "floor"
_COLOURS = {
    "wall": (0.75, 0.76, 0.78, 1.0),
    "block": (0.45, 0.52, 0.60, 1.0),
    "shelf": (0.60, 0.45, 0.30, 1.0),
    "pillar": (0.62, 0.62, 0.60, 1.0),
    "low": (0.85, 0.70, 0.20, 1.0),
}
_MOVER_COLOUR = (0.80, 0.35, 0.25, 1.0)
_LEAST_NORMAL = 2.2250738585072014e-308
"""Least normal number of double precision."""


def obstacle_name(index: int, kind: str) -> str:
    """Name of the geom of ``world.obstacles[index]``."""
    return f"{kind}_{index}"


def part_name(mover: int, part: int, kind: str) -> str:
    """Name of the mocap body, and of its geom, of one part of ``world.movers[mover]``."""
    return f"{kind}_{mover}_part_{part}"


def build_arena(world: World) -> RootElement:
    """The scene alone; attach a robot with ``arena.attach(robot).add("freejoint")``.

    Mocap bodies stand in the order of movers and their parts, at the movers' start poses; a body's origin is its
    shape's centre.
    """
    arena = RootElement(model=world.name)
    arena.worldbody.add("light", pos=(0, 0, 20), dir=(0, 0, -1), directional="true")
    arena.worldbody.add(
        "geom",
        name=FLOOR,
        type="plane",
        size=(0.0, 0.0, 1.0),  # endless
        contype=0,
        conaffinity=TOUCHES_FLOOR,
        rgba=(0.9, 0.9, 0.88, 1.0),
    )
    # A body of their own: the world body holds the endless floor, next to which nothing can be culled.
    scene = arena.worldbody.add("body", name="obstacles")
    for index, obstacle in enumerate(world.obstacles):
        shape = obstacle.shape
        scene.add(
            "geom",
            name=obstacle_name(index, obstacle.kind),
            pos=_centre(shape),
            euler=(0.0, 0.0, _written(_yaw(shape))),
            rgba=_COLOURS[obstacle.kind],
            **_geometry(shape),
        )
    for m, mover in enumerate(world.movers):
        c, s = math.cos(mover.start.yaw), math.sin(mover.start.yaw)
        for p, part in enumerate(mover.parts):
            name = part_name(m, p, mover.kind)
            x, y, z = _centre(part.shape)
            body = arena.worldbody.add(
                "body",
                name=name,
                mocap="true",
                pos=(_written(mover.start.x + c * x - s * y), _written(mover.start.y + s * x + c * y), z),
                euler=(0.0, 0.0, _written(mover.start.yaw + _yaw(part.shape))),
            )
            body.add("geom", name=name, rgba=_MOVER_COLOUR, **_geometry(part.shape))
    arena.compiler.angle = "radian"
    return arena


def _centre(shape: Shape) -> tuple[float, float, float]:
    return _written(shape.x), _written(shape.y), shape.base + shape.height / 2.0


def _written(number: float) -> float:
    """The number as MuJoCo reads it: one below the least normal float is an error to it, and here 0."""
    return number if abs(number) >= _LEAST_NORMAL else 0.0


def _yaw(shape: Shape) -> float:
    return 0.0 if isinstance(shape, Cylinder) else shape.yaw


def _geometry(shape: Shape) -> dict:
    masks = {"contype": 0, "conaffinity": TOUCHES_SCENE}
    if isinstance(shape, Cylinder):
        return {"type": "cylinder", "size": (shape.radius, shape.height / 2.0), **masks}
    return {"type": "box", "size": (shape.length / 2.0, shape.width / 2.0, shape.height / 2.0), **masks}
