"""``vuca import``: other people's maps, benchmarks and recordings as scene files."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from vuca_nav.cli import optional, parse, show
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_file


@dataclass(frozen=True, kw_only=True)
class ImportArguments:
    """Write a map, a benchmark's world or recorded people as a scene file."""

    file: tyro.conf.Positional[str]
    """The file, as map:FILE (map_server), barn:FILE (SDF or JSON), dynabarn:FILE (JSON), tracks:FILE (CSV) or
    scene:FILE; without the word before the colon, its name tells what it is."""
    out: Path
    """The scene file, or - for none: the file is only checked."""
    start: Annotated[tuple[float, float, float] | None, optional("X Y YAW")] = None
    """Start here [m, m, rad]; a map has none of its own, then it is one end of the longest way."""
    goal: Annotated[tuple[float, float] | None, optional("X Y")] = None
    """Go there [m]; a map has none of its own, then it is the other end."""
    tolerance: Annotated[float | None, optional("M")] = None
    """Distance from the goal within which it counts as reached [m]."""
    time_limit: Annotated[float | None, optional("S")] = None
    """Time limit [s]."""
    unknown: Literal["solid", "free", "unknown"] = "solid"
    """What a map's unknown cells are: walls, free floor, or free floor that is unknown to a robot with a map."""
    obstacles: Annotated[str | None, optional("tracks:FILE")] = None
    """Recorded people who walk in it besides."""
    radius: float = 0.25
    """Radius of recorded people [m]."""
    trust: bool = False
    """Run the Python of motions of your own, in a scene file."""
    picture: Annotated[Path | None, optional("FILE.png")] = None
    """Draw it, too: over the map's own cells, if it is one."""
    json: bool = False
    """End with one JSON object on stdout."""


def import_(argv: list[str]) -> int:
    """Write a map, a benchmark's world or recorded people as a scene file."""
    arguments = parse(ImportArguments, "import", argv)
    from worlds.checks import check_world
    from worlds.importers.scene_file import load_scene, save_scene
    from worlds.importers.sources import KINDS, Bringing, kind_of, load_world, with_people, with_task

    name = arguments.file
    if name.partition(":")[0] not in KINDS:
        name = f"{kind_of(Path(name))}:{name}"
    is_dry = str(arguments.out) == "-"
    for option, written in (("--out", None if is_dry else arguments.out), ("--picture", arguments.picture)):
        if written is not None:
            _check_apart(option, written, name, arguments)
            prepare_file(written)
    bringing = Bringing(
        arguments.start, arguments.goal, arguments.tolerance, arguments.time_limit, arguments.unknown,
        arguments.obstacles, arguments.radius, arguments.trust,
    )  # fmt: skip
    _tell(f"reading {name}")
    world = with_task(with_people(load_world(name, bringing), bringing), bringing)
    check_world(world, arguments.file)
    if not is_dry:
        _tell(f"writing {arguments.out}")
        save_scene(world, arguments.out)
        if load_scene(arguments.out, trust=arguments.trust) != world:
            raise AssertionError(f"{arguments.out} is not equal to what was read")
    if arguments.picture is not None:
        from worlds.importers.occupancy_map import read_map
        from worlds.importers.picture import draw

        kind, _, path = name.partition(":")
        draw(world, arguments.picture, read_map(path) if kind == "map" else None)
    x0, y0, x1, y1 = world.bounds
    found = {
        "world": world.name,
        "size": [x1 - x0, y1 - y0],
        "shapes": len(world.obstacles),
        "movers": len(world.movers),
        "start": list(world.start),
        "goal": list(world.goal),
        "tolerance": world.tolerance,
        "time_limit": world.time_limit,
        "open_borders": world.open_borders,
        "out": None if is_dry else str(arguments.out),
    }
    show(
        f"{name}: {x1 - x0:.1f} x {y1 - y0:.1f} m, {len(world.obstacles)} shapes, {len(world.movers)} movers; from "
        f"({world.start.x:g}, {world.start.y:g}) to ({world.goal[0]:g}, {world.goal[1]:g})"
    )
    if arguments.json:
        show(json.dumps(found, allow_nan=False))
    return 0


def _check_apart(option: str, written: Path, name: str, arguments: ImportArguments) -> None:
    """Refuse to write over what is read, unless it is a scene already."""
    from worlds.importers.occupancy_map import image_of

    kind, _, read = name.partition(":")
    sources = [Path((arguments.obstacles or "").partition(":")[2])]
    sources += [] if kind == "scene" and option == "--out" else [Path(read)]
    sources += [image_of(read)] if kind == "map" else []
    if any(source.is_file() and written.exists() and source.samefile(written) for source in sources):
        raise BadArgument(f"{option} {written}: it is the file that is read; another name would be right")


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
