"""Scenes as files: ``scene.yaml``, after the JSON schema beside this module; docs/scene-format.md describes it."""

import json
import math
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import yaml
from jsonschema.exceptions import ValidationError, best_match

from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds.checks import check_world
from worlds.world import (
    Box,
    Cylinder,
    Motion,
    Mover,
    MoverPart,
    Obstacle,
    Patrol,
    RandomWalk,
    Shape,
    SocialForce,
    Way,
    World,
)

FORMAT = "vuca-scene-1"
SCHEMA_FILE = Path(__file__).with_name("scene.schema.json")
TYPE_NAMES = {
    "object": "a mapping",
    "array": "a list",
    "number": "a number",
    "integer": "an integer",
    "string": "a text",
    "boolean": "true or false",
}


def load_scene(path: str | Path) -> World:
    """The world that a scene file describes.

    Args:
        path: Path of a YAML file after ``scene.schema.json``.

    Raises:
        BadWorld: No such file, broken YAML, a field that is not as the schema wants it, or a world that fails
            :func:`worlds.checks.check_world`; the message names the file and the field.
    """
    document = _read(path)
    for where, number in _numbers(document):
        if not math.isfinite(number):
            raise BadWorld(f"{path}: {where}: {number} is not a finite number")
    error = best_match(_validator().iter_errors(document), key=_relevance)
    if error is not None:
        raise BadWorld(f"{path}: {_explain(error)}")
    world = _world_from(document)
    check_world(world, str(path))
    return world


def save_scene(world: World, path: str | Path) -> None:
    """Write a world so that :func:`load_scene` gives an equal one back.

    Args:
        world: Any world.
        path: Path of the file; an existing one is replaced.

    Raises:
        BadWorld: The file cannot be written.
    """
    text = yaml.safe_dump(_document_of(world), sort_keys=False, default_flow_style=None, width=110)
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadWorld(
            f"{path}: cannot be written: {error.strerror}; a path in a writable folder would be right"
        ) from error


# -- reading -------------------------------------------------------------------------------------------------------


_SafeLoader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_SafeLoader):
    """YAML's safe types, every key once: of two equal ones PyYAML silently takes the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Construct a mapping as the base does, but raise ConstructorError for a repeated key."""
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key {key.value!r} a second time; once would be right", key.start_mark
                    )
                seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)


def _read(path: str | Path) -> Any:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise BadWorld(f"{path}: {error.strerror}; the path of a scene file would be right") from error
    except UnicodeDecodeError as error:
        raise BadWorld(f"{path}: not a text in UTF-8 (byte {error.start})") from error
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None) or str(error)
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise BadWorld(f"{path}: {place}not YAML: {problem}") from error


@cache
def _validator() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(json.loads(SCHEMA_FILE.read_text(encoding="utf-8")))


def _numbers(value: Any, where: str = "") -> Iterator[tuple[str, float]]:
    """All floats of a document, each with its path."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _numbers(item, f"{where}.{key}" if where else str(key))
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from _numbers(item, f"{where}[{i}]")
    elif isinstance(value, float):
        yield where, value


def _relevance(error: ValidationError) -> tuple:
    """The first field in the order of the file wins, so that errors are mended from the top."""
    return tuple(-part if isinstance(part, int) else 0 for part in error.absolute_path)


def _explain(error: ValidationError) -> str:
    """The field's path, what is wrong and what would be right."""
    where = ""
    for part in error.absolute_path:
        where += f"[{part}]" if isinstance(part, int) else f".{part}" if where else str(part)
    where = where or "the file"
    rule, wanted = error.validator, error.validator_value
    schema: Any = error.schema
    if rule == "type":
        return f"{where}: {error.instance!r:.60} is not {TYPE_NAMES.get(str(wanted), wanted)}"
    if rule == "required":
        instance: Any = error.instance
        missing = [name for name in wanted if name not in instance]  # type: ignore[union-attr]
        return f"{where}: {', '.join(missing)} missing"
    if rule == "additionalProperties":
        known = list(schema["properties"])
        unknown = [str(name) for name in error.instance if name not in known]  # type: ignore[union-attr]
        return f"{where}: unknown field {', '.join(unknown)}; its fields are {', '.join(known)}"
    if rule == "enum":
        return f"{where}: {error.instance!r:.60} is not one of {', '.join(map(str, wanted))}"  # type: ignore[arg-type]
    if rule == "const":
        return f"{where}: {error.instance!r:.60} should be {wanted!r}"
    return f"{where}: {error.message}"


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
    kind = Patrol if d["type"] == "patrol" else SocialForce
    return kind(float(d["speed"]), tuple(_point_from(point) for point in d["waypoints"]))


def _mover_from(d: dict) -> Mover:
    parts = tuple(MoverPart(_shape_from(p["shape"]), float(p.get("swing", 0.0))) for p in d["parts"])
    motion, start = _motion_from(d["motion"]), _pose_from(d["start"])
    return Mover(d["kind"], parts, float(d["radius"]), start, motion, d.get("sighted"))


def _box_from(b: dict) -> tuple[float, float, float, float]:
    return float(b["x_min"]), float(b["y_min"]), float(b["x_max"]), float(b["y_max"])


def _world_from(d: dict) -> World:
    return World(
        d["name"],
        int(d["seed"]),
        _box_from(d["bounds"]),
        tuple(Obstacle(o["kind"], _shape_from(o["shape"]), o.get("outer", False)) for o in d["obstacles"]),
        tuple(_mover_from(m) for m in d["movers"]),
        _pose_from(d["start"]),
        _point_from(d["goal"]),
        tuple(Way(way["name"], _box_from(way["box"])) for way in d.get("ways", ())),
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


def _document_of(world: World) -> dict:
    ways = {"ways": [{"name": way.name, "box": _box(way.box)} for way in world.ways]} if world.ways else {}
    return {
        "format": FORMAT,
        "name": world.name,
        "seed": int(world.seed),
        "bounds": _box(world.bounds),
        "start": _pose(world.start),
        "goal": _point(world.goal),
        "obstacles": [_obstacle(o) for o in world.obstacles],
        "movers": [
            {
                "kind": m.kind,
                "radius": float(m.radius),
                "start": _pose(m.start),
                "motion": _motion(m.motion),
                "parts": [_part(part) for part in m.parts],
                **({} if m.sighted is None else {"sighted": m.sighted}),
            }
            for m in world.movers
        ],
        **ways,
    }
