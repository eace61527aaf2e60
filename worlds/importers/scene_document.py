"""A world as the document of a scene file, and back: mappings, lists, texts and numbers."""

from typing import Any

from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import Pose2
from worlds.motion.keyframes import place_of
from worlds.wall_grid import Rectangle, WallGrid
from worlds.world import (
    Box,
    Cylinder,
    Keyframes,
    Motion,
    Mover,
    MoverPart,
    Obstacle,
    Patrol,
    RandomWalk,
    Shape,
    SocialForce,
    UserMotion,
    Way,
    World,
    walls_of,
)

FORMAT = "vuca-scene-1"

# -- reading -------------------------------------------------------------------------------------------------------


def _point_from(d: dict) -> tuple[float, float]:
    return float(d["x"]), float(d["y"])


def _pose_from(d: dict) -> Pose2:
    return Pose2(float(d["x"]), float(d["y"]), float(d["yaw"]))


def _shape_from(d: dict) -> Shape:
    numbers = {key: float(value) for key, value in d.items() if key != "type"}
    return Box(**numbers) if d["type"] == "box" else Cylinder(**numbers)


def _motion_from(d: dict) -> Motion:
    if d["type"] == "random_walk":
        return RandomWalk(float(d["speed"]), int(d["seed"]))
    if d["type"] == "keyframes":
        phase = d.get("phase", 0.0)
        return Keyframes(
            tuple(float(t) for t, _, _ in d["keyframes"]),
            tuple((float(x), float(y)) for _, x, y in d["keyframes"]),
            None if d.get("period") is None else float(d["period"]),
            d.get("jumps", False),
            d.get("vanishes", False),
            None if phase == "random" else float(phase),
            float(d.get("pace", 1.0)),
        )
    if d["type"] == "user":
        options = {k: v if isinstance(v, str | bool) else float(v) for k, v in d.get("options", {}).items()}
        return UserMotion(d["class"], tuple(options.items()), float(d["speed"]))
    kind = Patrol if d["type"] == "patrol" else SocialForce
    return kind(float(d["speed"]), tuple(_point_from(point) for point in d["waypoints"]))


def _mover_from(d: dict) -> Mover:
    parts = tuple(MoverPart(_shape_from(p["shape"]), float(p.get("swing", 0.0))) for p in d["parts"])
    motion = _motion_from(d["motion"])
    start = place_of(motion)[0] if isinstance(motion, Keyframes) and "start" not in d else _pose_from(d["start"])
    return Mover(d["kind"], parts, float(d["radius"]), start, motion, d.get("sighted"))


def _box_from(b: dict) -> tuple[float, float, float, float]:
    return float(b["x_min"]), float(b["y_min"]), float(b["x_max"]), float(b["y_max"])


def _grid_from(d: dict) -> WallGrid:
    return WallGrid(
        _pose_from(d["origin"]),
        float(d["resolution"]),
        (int(d["columns"]), int(d["rows"])),
        _rectangles_from(d["walls"]),
        _rectangles_from(d.get("unknown", ())),
        float(d["height"]),
    )


def _rectangles_from(rectangles: Any) -> tuple[Rectangle, ...]:
    return tuple((int(a), int(b), int(c), int(d)) for a, b, c, d in rectangles)


def world_from(d: dict) -> World:
    """The world of a document that is as the schema wants it."""
    grid = _grid_from(d["map"]) if "map" in d else None
    own = tuple(Obstacle(o["kind"], _shape_from(o["shape"]), o.get("outer", False)) for o in d["obstacles"])
    return World(
        d["name"],
        int(d["seed"]),
        _box_from(d["bounds"]),
        own if grid is None else (*own, *walls_of(grid)),
        tuple(_mover_from(m) for m in d["movers"]),
        _pose_from(d["start"]),
        _point_from(d["goal"]),
        tuple(Way(way["name"], _box_from(way["box"])) for way in d.get("ways", ())),
        d.get("open_borders", False),
        float(d.get("tolerance", GOAL_TOLERANCE)),
        float(d["time_limit"]) if "time_limit" in d else None,
        d.get("clock") == "motion",
        grid,
    )


# -- writing -------------------------------------------------------------------------------------------------------


def _point(point: tuple[float, float]) -> dict:
    return {"x": float(point[0]), "y": float(point[1])}


def _pose(pose: Pose2) -> dict:
    return {"x": float(pose.x), "y": float(pose.y), "yaw": float(pose.yaw)}


def _shape(shape: Shape) -> dict:
    d: dict[str, Any] = {"type": "box" if isinstance(shape, Box) else "cylinder"}
    names = Box.__dataclass_fields__ if isinstance(shape, Box) else Cylinder.__dataclass_fields__
    d |= {name: float(getattr(shape, name)) for name in names}
    if shape.base == 0.0:
        del d["base"]
    return d


def _obstacle(obstacle: Obstacle) -> dict:
    d = {"kind": obstacle.kind, "shape": _shape(obstacle.shape)}
    return {**d, "outer": True} if obstacle.outer else d


def _motion(motion: Motion) -> dict:
    if isinstance(motion, RandomWalk):
        return {"type": "random_walk", "speed": float(motion.speed), "seed": int(motion.seed)}
    if isinstance(motion, Keyframes):
        frames = [[float(t), float(x), float(y)] for t, (x, y) in zip(motion.times, motion.points, strict=True)]
        return {
            "type": "keyframes",
            "keyframes": frames,
            **({} if motion.period is None else {"period": float(motion.period)}),
            **({"jumps": True} if motion.jumps else {}),
            **({"vanishes": True} if motion.vanishes else {}),
            "phase": "random" if motion.phase is None else float(motion.phase),
            "pace": float(motion.pace),
        }
    if isinstance(motion, UserMotion):
        return {"type": "user", "class": motion.name, "speed": float(motion.speed), "options": dict(motion.options)}
    return {
        "type": "patrol" if isinstance(motion, Patrol) else "social_force",
        "speed": float(motion.speed),
        "waypoints": [_point(point) for point in motion.waypoints],
    }


def _part(part: MoverPart) -> dict:
    swing = {"swing": float(part.swing)} if part.swing else {}
    return {"shape": _shape(part.shape), **swing}


def _box(box: tuple[float, float, float, float]) -> dict:
    return dict(zip(("x_min", "y_min", "x_max", "y_max"), map(float, box)))


def _map(grid: WallGrid) -> dict:
    return {
        "origin": _pose(Pose2(*grid.origin)),
        "resolution": float(grid.resolution),
        "columns": grid.size[0],
        "rows": grid.size[1],
        "height": float(grid.height),
        "walls": [list(wall) for wall in grid.walls],
        **({"unknown": [list(cells) for cells in grid.unknown]} if grid.unknown else {}),
    }


def _mover(mover: Mover) -> dict:
    return {
        "kind": mover.kind,
        "radius": float(mover.radius),
        "start": _pose(mover.start),
        "motion": _motion(mover.motion),
        "parts": [_part(part) for part in mover.parts],
        **({} if mover.sighted is None else {"sighted": mover.sighted}),
    }


def document_of(world: World) -> dict[str, Any]:
    """The document of a world; walls of a map as its rectangles."""
    grid, own = world.grid, world.obstacles
    if grid is not None:
        own = own[: len(own) - len(grid.walls)]
        if world.obstacles[len(own) :] != walls_of(grid):  # somebody has changed them
            grid, own = None, world.obstacles
    return {
        "format": FORMAT,
        "name": world.name,
        "seed": int(world.seed),
        "bounds": _box(world.bounds),
        "start": _pose(world.start),
        "goal": _point(world.goal),
        **({} if world.tolerance == GOAL_TOLERANCE else {"tolerance": float(world.tolerance)}),
        **({} if world.time_limit is None else {"time_limit": float(world.time_limit)}),
        **({"clock": "motion"} if world.starts_on_motion else {}),
        **({"open_borders": True} if world.open_borders else {}),
        **({} if grid is None else {"map": _map(grid)}),
        "obstacles": [_obstacle(o) for o in own],
        "movers": [_mover(m) for m in world.movers],
        **({"ways": [{"name": way.name, "box": _box(way.box)} for way in world.ways]} if world.ways else {}),
    }
