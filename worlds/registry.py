"""The registry of worlds: generators by their names."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from vuca_nav.errors import BadArgument, UnknownName
from worlds.checks import check_task
from worlds.importers.scene_file import load_scene
from worlds.scenes import building, double_branch, factory, square, training
from worlds.world import World

DIFFICULTIES = {
    "V": "volatile: things move",
    "U": "uncertain: no map is given",
    "C": "complex: corridors and dead ends",
    "A": "ambiguous: pose and ranges are noisy",
}
"""Difficulties that ``without`` switches off, in their order; V and C are the world's, U and A the robot's."""
TRAINING_SEED = 1_000_000
"""Policies are trained in worlds of this seed and those above it, and tested in worlds of seeds below."""
SCENE_SUFFIXES = (".yaml", ".yml")
CORRIDOR_KINDS = ("wall", "block", "shelf")


@dataclass(frozen=True, slots=True)
class WorldKind:
    """A generator and its option."""

    generate: Callable[..., World]
    """Function of seed, footprint_radius and the option that returns a world."""
    description: str
    option: str = ""
    """Name of the one option it takes: "region", "movers" or none."""
    default: int = 0
    lowest: int = 0
    highest: int = 0

    def __str__(self) -> str:
        """The description, with the option's range."""
        if not self.option:
            return self.description
        return f"{self.description} (--{self.option} {self.lowest} to {self.highest}, default {self.default})"


WORLDS: dict[str, WorldKind] = {
    "factory": WorldKind(
        factory.factory, "40 x 40 m of corridors, machines, shelves and blind alleys, 10 movers a quarter",
        "region", 4, 1, 4,
    ),
    "square": WorldKind(
        square.square, "24 x 24 m open plaza with 10 roadblocks and fast movers",
        "movers", square.MOVERS, 0, square.MOST_MOVERS,
    ),
    "double_branch": WorldKind(
        double_branch.double_branch, "two ways to the goal: the short one crowded, the long one empty",
        "movers", double_branch.MOVERS, 0, double_branch.MOST_MOVERS,
    ),
    "building": WorldKind(
        building.building, "lobby, corridor, rooms and doors, with a crowd that avoids people and the robot",
        "movers", building.PEOPLE, 0, building.MOST_PEOPLE,
    ),
    "static": WorldKind(training.static, "the paper's training scene of walls and roadblocks"),
    "dynamic": WorldKind(
        training.dynamic, "the paper's training scene of many shapes walking at random",
        "movers", training.MOVERS, 0, training.MOST_MOVERS,
    ),
}  # fmt: skip
"""All generated worlds; ``str`` of a value is its description in one line."""


def make_world(
    name: str,
    seed: int,
    *,
    region: int | None = None,
    movers: int | None = None,
    without: str = "",
    footprint_radius: float = 0.35,
) -> World:
    """Make a world by name, or from a scene file.

    Args:
        name: One of ``WORLDS``, or a path that ends in .yaml or .yml.
        seed: Non-negative; the same seed gives the same world. A scene file does not depend on it.
        region: Region of the factory, 1 to 4.
        movers: Number of moving obstacles, for the worlds that take it.
        without: Difficulties to switch off, letters of "VUCA". V: nothing moves. C: walls, blocks and shelves
            are gone, but for the outer ones. U and A are for the robot and change nothing here.
        footprint_radius: Radius of the circle about the footprint that must be able to reach the goal [m].

    Raises:
        UnknownName: No such world.
        BadArgument: An option out of its range, or one that this world does not take.
        BadWorld: A broken scene file, or no solvable layout for this body.
    """
    without = ordered_difficulties(without)
    _check(seed, movers, without, footprint_radius)
    options = {"region": region, "movers": movers}
    is_scene = name.endswith(SCENE_SUFFIXES)
    if is_scene:
        _refuse(name, options, "")
        world = load_scene(name)
    elif name in WORLDS:
        kind = WORLDS[name]
        _refuse(name, options, kind.option)
        chosen = {}
        if kind.option:
            given = options[kind.option]
            value = kind.default if given is None else given
            if not kind.lowest <= value <= kind.highest:
                raise BadArgument(f"--{kind.option} {value}: {name} takes {kind.lowest} to {kind.highest}")
            chosen[kind.option] = value
        world = kind.generate(seed=seed, footprint_radius=footprint_radius, **chosen)
    else:
        raise UnknownName("world", name, WORLDS)
    if "V" in without:
        world = replace(world, movers=())
    if "C" in without:
        world = replace(world, obstacles=tuple(o for o in world.obstacles if o.outer or o.kind not in CORRIDOR_KINDS))
    if is_scene:
        check_task(world, footprint_radius, name)
    return world


def ordered_difficulties(without: str) -> str:
    """Sort letters of difficulties into the order of ``DIFFICULTIES``, each once.

    Raises:
        BadArgument: A letter is not one of them.
    """
    unknown = [letter for letter in without if letter not in DIFFICULTIES]
    if unknown:
        known = ", ".join(f"{letter} ({text})" for letter, text in DIFFICULTIES.items())
        raise BadArgument(f"--without {without}: unknown difficulty {unknown[0]!r}; there are {known}")
    return "".join(letter for letter in DIFFICULTIES if letter in without)


def _check(seed: int, movers: int | None, without: str, footprint_radius: float) -> None:
    if seed < 0:
        raise BadArgument(f"--seed {seed}: a seed is 0 or more")
    if movers is not None and "V" in without:
        raise BadArgument(f"--movers {movers} does not go with --without V, which leaves all of them out; give one")
    if not 0.0 < footprint_radius < 5.0:
        raise BadArgument(f"footprint radius {footprint_radius:g} m: one between 0 and 5 m would be right")


def _refuse(name: str, options: dict[str, int | None], taken: str) -> None:
    for option, value in options.items():
        if value is not None and option != taken:
            takers = [world for world, kind in WORLDS.items() if kind.option == option]
            raise BadArgument(f"--{option}: {name} does not take it (only {', '.join(takers)})")
