"""Tasks apart from worlds: start, goal, tolerance and time limit, several a world; ``vuca eval --tasks``.

A file of tasks is YAML or JSON (docs/your-own-map.md); a folder of worlds is a task for each of them, its own. Public
lists of maps in JSON with ``third_party_tasks`` and ``auto_tasks`` are read by ``eval.tasks.lists``.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eval.suites import Task
from eval.tasks.job import NamedTask, path_of
from vuca_nav.data_files import read_json, shown
from vuca_nav.errors import BadArgument, BadWorld
from vuca_nav.yaml_file import read_yaml
from worlds.checks import BadField
from worlds.importers.barn import optimal_length
from worlds.importers.fields import Fields
from worlds.importers.sources import KINDS, SCENE_SUFFIXES, kind_of

FORMAT = "vuca-tasks-1"
MOST_TASKS = 10_000
_DEFAULTS = ("tolerance", "time_limit", "unknown", "obstacles")
"""Fields that the whole file may state for all its tasks."""
_FIELDS = ("name", "world", "start", "goal", "optimal_length", *_DEFAULTS)


def read_tasks(source: Path) -> tuple[NamedTask, ...]:
    """Read the tasks of a file, or of a folder of worlds.

    Raises:
        BadWorld: The file is broken, names a world that is not there, or has a task twice; the folder has no worlds.
    """
    if source.is_dir():
        tasks = tuple(_of_folder(source))
        if not tasks:
            raise BadWorld(f"{source}: no worlds in this folder; .world, .json, .yaml or .csv files would be right")
    elif source.suffix.lower() in SCENE_SUFFIXES:
        document = read_yaml(source, BadWorld)
        try:
            tasks = tuple(_of_file(source, document.value))
        except BadField as error:
            line = document.line_of(error.field)
            raise BadWorld(f"{error} (line {line})" if line else str(error)) from None
    else:
        content = read_json(source, BadWorld)
        if isinstance(content, list):
            from eval.tasks.lists import tasks_of_list

            tasks = tasks_of_list(source, content)
        else:
            tasks = tuple(_of_file(source, content))
    seen: dict[Task, str] = {}
    for each in tasks:
        if each.task in seen:
            raise BadWorld(f"{source}: the tasks {shown(seen[each.task])} and {shown(each.name)} are the same")
        seen[each.task] = each.name
    return tasks


# -- files ---------------------------------------------------------------------------------------------------------


def _of_folder(folder: Path) -> Iterator[NamedTask]:
    """A task for each world in a folder and beneath; of an SDF world beside its JSON the latter, which says more."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    for path in files:
        kind = _world_kind(path)
        if kind is None or (path.suffix.lower() in (".world", ".sdf") and path.with_suffix(".json") in files):
            continue
        world = str(path) if kind == "scene" else f"{kind}:{path}"
        try:
            optimum = _optimum(world)
        except BadWorld:
            optimum = None  # a broken world is a row that says so
        yield NamedTask(str(path.relative_to(folder).with_suffix("")), Task(world), optimum)


def _world_kind(path: Path) -> str | None:
    """Kind of a world's file, None of another file."""
    try:
        kind = kind_of(path)
        if path.suffix.lower() == ".json":
            content = read_json(path, BadWorld)
            return kind if isinstance(content, dict) and {"start", "goal"} <= content.keys() else None
        if kind == "scene":
            content = read_yaml(path, BadWorld).value
            return kind if isinstance(content, dict) and "bounds" in content else None
    except BadArgument:
        return None
    except BadWorld:
        return kind  # a broken world is a row that says so
    return kind


def _of_file(source: Path, content: Any) -> Iterator[NamedTask]:
    top = Fields(str(source), content)
    if top.text("format") != FORMAT:
        raise top.error("format", f"{shown(top.text('format'))} should be {FORMAT}")
    top.only(("format", "name", "tasks", *_DEFAULTS))
    every = top.mappings("tasks", MOST_TASKS)
    if not every:
        raise top.error("tasks", "none; a list of tasks would be right")
    for entry in every:
        entry.only(_FIELDS)
        worlds = _worlds(source, entry)
        for world in worlds:
            name = entry.text("name") if "name" in entry else path_of(world).stem
            start = _pose(entry)
            goal = _point(entry, "goal") if "goal" in entry else None
            if start is not None and start[2] is None and goal is None:
                raise entry.error("start", "yaw missing; it is towards the goal only where the task has one")
            given = {
                "start": start,
                "goal": goal,
                "tolerance": _number((entry, top), "tolerance", 100.0),
                "time_limit": _number((entry, top), "time_limit", 1e5),
                "unknown": _word((entry, top), "unknown"),
                "obstacles": _people(source, (entry, top)),
            }
            # What the world's file states is the length of its own way.
            stated = None if start or goal else _optimum(world)
            optimum = entry.number("optimal_length", 1e-3) if "optimal_length" in entry else stated
            yield NamedTask(name, Task(world, **given), optimum)


def _worlds(source: Path, entry: Fields) -> list[str]:
    """The worlds that an entry names, by paths beneath the file's folder; ``*`` stands for any part of a name."""
    text = entry.text("world")
    kind, colon, path = text.partition(":")
    prefix = f"{kind}:" if colon and kind in KINDS and kind != "scene" else ""
    if not prefix:
        path = text
        if not text.endswith(SCENE_SUFFIXES):
            from worlds.registry import WORLDS

            if text in WORLDS:
                return [text]
            raise entry.error("world", f"{shown(text)} is neither a world's name nor a file as barn:FILE or map:FILE")
    return [f"{prefix}{found}" for found in _beneath(source, entry, "world", path)]


def _beneath(source: Path, entry: Fields, field: str, path: str) -> list[Path]:
    folder = source.parent
    if Path(path).is_absolute() or ".." in Path(path).parts:
        raise entry.error(field, f"{shown(path)} leads out of the file's folder; a path in it would be right")
    try:
        found = sorted(folder.glob(path)) if "*" in path else [folder / path]
    except (ValueError, OSError) as error:
        raise entry.error(field, f"{shown(path)} is no path") from error
    if not found or not all(each.is_file() for each in found):
        raise entry.error(field, f"there is no {shown(path)} in {folder}")
    return found


def _people(source: Path, places: tuple[Fields, ...]) -> str | None:
    for place in places:
        if "obstacles" in place:
            kind, _, path = place.text("obstacles").partition(":")
            if kind != "tracks":
                raise place.error("obstacles", f"{shown(place.text('obstacles'))}: tracks:FILE would be right")
            return f"tracks:{_beneath(source, place, 'obstacles', path)[0]}"
    return None


def _number(places: tuple[Fields, ...], name: str, most: float) -> float | None:
    return next((place.number(name, 1e-6, most) for place in places if name in place), None)


def _word(places: tuple[Fields, ...], name: str) -> str | None:
    for place in places:
        if name in place:
            if place.text(name) not in ("solid", "free", "unknown"):
                raise place.error(name, f"{shown(place.text(name))} is not one of solid, free, unknown")
            return place.text(name)
    return None


def _pose(entry: Fields) -> tuple[float, float, float | None] | None:
    if "start" not in entry:
        return None
    place = entry.mapping("start")
    place.only(("x", "y", "yaw"))
    return place.number("x"), place.number("y"), place.number("yaw") if "yaw" in place else None


def _point(entry: Fields, name: str) -> tuple[float, float]:
    place = entry.mapping(name)
    place.only(("x", "y"))
    return place.number("x"), place.number("y")


def _optimum(world: str) -> float | None:
    """Length of the optimal way that a benchmark's file states [m]."""
    kind, _, path = world.partition(":")
    return optimal_length(path) if kind in ("barn", "dynabarn") and path.endswith(".json") else None
