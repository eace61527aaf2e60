"""Worlds that a user brings: scene files and other people's formats, by the name that ``--world`` takes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from vuca_nav.errors import BadArgument, BadWorld
from vuca_nav.types import Pose2
from worlds.importers.barn import load_barn, load_dynabarn
from worlds.importers.fields import FARTHEST, SMALLEST
from worlds.importers.map_lists import load_walkers
from worlds.importers.scene_file import load_scene
from worlds.importers.tracks import RADIUS, load_people, load_tracks
from worlds.world import World

SCENE_SUFFIXES = (".yaml", ".yml")
MOST_TOLERANCE, MOST_TIME, MOST_RADIUS = 100.0, 1e5, 100.0
"""Greatest tolerance [m] and time limit [s], as in scene files, and radius of recorded people [m]."""


@dataclass(frozen=True, slots=True)
class Bringing:
    """How a world is brought in, and what is changed of it. Numbers of None are left as the world has them."""

    start: tuple[float, float, float] | None = None
    """x [m], y [m], yaw [rad]."""
    goal: tuple[float, float] | None = None
    """[m]"""
    tolerance: float | None = None
    """Distance from the goal within which it counts as reached [m]."""
    time_limit: float | None = None
    """Time limit of the mission [s]."""
    unknown: str = "solid"
    """What a map's unknown cells are: solid, free or unknown."""
    obstacles: str | None = None
    """``tracks:FILE``: people who walk in it besides; ``keyframes:FILE#TASK``: those of a list of maps."""
    radius: float = RADIUS
    """Radius of recorded people [m]."""
    trust: bool = False
    """Whether motions of the user's own may be run."""

    def __post_init__(self):
        ranges = (
            ("tolerance", self.tolerance, MOST_TOLERANCE, "m"),
            ("time-limit", self.time_limit, MOST_TIME, "s"),
            ("radius", self.radius, MOST_RADIUS, "m"),
        )
        for name, value, most, unit in ranges:
            if value is not None and not SMALLEST <= value <= most:
                raise BadArgument(f"--{name} {value:g}: above 0, up to {most:g} {unit} would be right")
        for name, numbers in (("start", self.start), ("goal", self.goal)):
            if numbers is not None and not all(abs(number) <= FARTHEST for number in numbers):
                raise BadArgument(
                    f"--{name} {' '.join(f'{n:g}' for n in numbers)}: numbers up to {FARTHEST:g} are right"
                )


AS_IT_IS = Bringing()


def _scene(path: str, bringing: Bringing) -> World:
    if _names_an_image(Path(path)):
        raise BadWorld(f"{path}: it names an image, as an occupancy map does; map:{path} would be right")
    return load_scene(path, trust=bringing.trust)


def _map(path: str, bringing: Bringing) -> World:
    from worlds.importers.occupancy_map import Task, load_map

    task = None
    if bringing.start is not None and bringing.goal is not None:
        task = Task(Pose2(*bringing.start), bringing.goal)
    return load_map(path, bringing.unknown, task)


KINDS: dict[str, Callable[[str, Bringing], World]] = {
    "map": _map,
    "barn": lambda path, _: load_barn(path),
    "dynabarn": lambda path, _: load_dynabarn(path),
    "tracks": lambda path, bringing: load_tracks(path, bringing.radius),
    "scene": _scene,
}
"""Loaders by the word before the colon."""


def is_brought(name: str) -> bool:
    """Whether a world's name is that of a file."""
    return name.partition(":")[0] in KINDS or name.endswith(SCENE_SUFFIXES)


def load_world(name: str, bringing: Bringing = AS_IT_IS) -> World:
    """Load a world by its name.

    Args:
        name: A path that ends in .yaml or .yml, or one of ``KINDS``, a colon and a path.
        bringing: How it is brought in.

    Raises:
        BadWorld: The file is broken, or not of its kind.
        UnknownName: ``bringing`` has another word for unknown cells.
    """
    kind, colon, path = name.partition(":")
    if colon and kind in KINDS:
        return KINDS[kind](path, bringing)
    return _scene(name, bringing)


def kind_of(path: Path) -> str:
    """The kind of a file by its suffix, one of ``KINDS``; a YAML file is a map if it names an image.

    Raises:
        BadArgument: The suffix says nothing.
    """
    suffix = path.suffix.lower()
    if suffix in SCENE_SUFFIXES:
        return "map" if _names_an_image(path) else "scene"
    if suffix in (".world", ".sdf"):
        return "barn"
    if suffix == ".json":
        return "dynabarn" if "dynabarn" in path.name.lower() else "barn"
    if suffix == ".csv":
        return "tracks"
    raise BadArgument(f"{path}: its name does not tell what it is; {', '.join(f'{kind}:FILE' for kind in KINDS)} do")


def _names_an_image(path: Path) -> bool:
    if not path.is_file():  # a pipe would be waited for; the reader of scenes says what is wrong
        return False
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            return any(line.startswith("image") for line in file.read(100_000).splitlines())
    except OSError:
        return False


def with_people(world: World, bringing: Bringing) -> World:
    """The world with the people of ``bringing.obstacles`` in it.

    Raises:
        BadArgument: It is not ``tracks:FILE``.
        BadWorld: The file is broken.
    """
    if bringing.obstacles is None:
        return world
    kind, colon, path = bringing.obstacles.partition(":")
    if colon and kind == "tracks":
        people = load_people(path, bringing.radius)
    elif colon and kind == "keyframes" and "#" in path:
        file, _, task = path.rpartition("#")
        people = load_walkers(Path(file), task, bringing.radius)
    else:
        raise BadArgument(f"--obstacles {bringing.obstacles}: tracks:FILE would be right")
    return replace(world, movers=(*world.movers, *people))


def with_task(world: World, bringing: Bringing) -> World:
    """The world with the start, goal, tolerance and time limit of ``bringing``."""
    given = {
        "start": None if bringing.start is None else Pose2(*bringing.start),
        "goal": bringing.goal,
        "tolerance": bringing.tolerance,
        "time_limit": bringing.time_limit,
    }
    return replace(world, **{name: value for name, value in given.items() if value is not None})
