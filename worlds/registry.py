"""The registry of worlds: generators by their names."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vuca_nav.errors import BadArgument, UnknownName
from worlds.importers.sources import AS_IT_IS, Bringing, is_brought, load_world, with_people, with_task
from worlds.motion.phases import drawn
from worlds.scenes import building, crossing, double_branch, factory, square, training
from worlds.scenes.parts.generation import stream
from worlds.world import MAX_MOVER_SPEED, TALLEST, Keyframes, Mover, World, at_speed

DIFFICULTIES = {
    "V": "volatile: things move",
    "U": "uncertain: no map is given",
    "C": "complex: corridors and dead ends",
    "A": "ambiguous: pose and ranges are noisy",
}
"""Difficulties that ``without`` switches off, in their order; V and C are the world's, U and A the robot's."""
TRAINING_SEED = 1_000_000
"""Policies are trained in worlds of this seed and those above it, and tested in worlds of seeds below."""
FASTEST_FACTOR = 2.5
"""Greatest factor on the movers' speeds: the square's fastest then moves at ``MAX_MOVER_SPEED``."""
CORRIDOR_KINDS = ("wall", "block", "shelf")


@dataclass(frozen=True, slots=True)
class Option:
    """A number that one can choose of a world."""

    lowest: int
    highest: int
    default: int | str
    """Its value if left out, or words for how it follows from other options; then the generator is not given any."""


@dataclass(frozen=True, slots=True)
class WorldKind:
    """A generator and its options."""

    generate: Callable[..., World]
    """Function of seed, footprint_radius and the options that returns a world."""
    description: str
    options: Mapping[str, Option] = field(default_factory=dict)
    """The options it takes, "region" and "movers", by their names. One without "movers" has nothing that moves."""

    def __str__(self) -> str:
        """The description, with the options' ranges."""
        if not self.options:
            return self.description
        ranges = (f"--{name} {o.lowest} to {o.highest}, default {o.default}" for name, o in self.options.items())
        return f"{self.description} ({'; '.join(ranges)})"


WORLDS: dict[str, WorldKind] = {
    "factory": WorldKind(
        factory.factory, "40 x 40 m of corridors, machines, shelves and blind alleys, 10 movers a quarter",
        {
            "region": Option(1, 4, 4),
            "movers": Option(0, 4 * factory.MOST_A_QUARTER, f"{factory.MOVERS_A_QUARTER} a quarter"),
        },
    ),
    "square": WorldKind(
        square.square, "24 x 24 m open plaza with 10 roadblocks and fast movers",
        {"movers": Option(0, square.MOST_MOVERS, square.MOVERS)},
    ),
    "double_branch": WorldKind(
        double_branch.double_branch, "two ways to the goal: the short one crowded, the long one empty",
        {"movers": Option(0, double_branch.MOST_MOVERS, double_branch.MOVERS)},
    ),
    "building": WorldKind(
        building.building, "lobby, corridor, rooms and doors, with a crowd that avoids people and the robot",
        {"movers": Option(0, building.MOST_PEOPLE, building.PEOPLE)},
    ),
    "crossing": WorldKind(
        crossing.crossing, "23 x 23 m open ground crossed by blind movers that avoid each other, as in CrowdNav++",
        {"movers": Option(0, crossing.MOST_MOVERS, crossing.MOVERS)},
    ),
    "static": WorldKind(training.static, "the paper's training scene of walls and roadblocks"),
    "dynamic": WorldKind(
        training.dynamic, "the paper's training scene of many shapes walking at random",
        {"movers": Option(0, training.MOST_MOVERS, training.MOVERS)},
    ),
}  # fmt: skip
"""All generated worlds; ``str`` of a value is its description in one line."""


def make_world(
    name: str,
    seed: int,
    *,
    region: int | None = None,
    movers: int | None = None,
    speed: float = 1.0,
    sighted: float | None = None,
    without: str = "",
    footprint_radius: float = 0.35,
    height: float = TALLEST,
    bringing: Bringing = AS_IT_IS,
) -> World:
    """Make a world by name, or bring one in from a file.

    Args:
        name: One of ``WORLDS``, a path that ends in .yaml or .yml, or a path with ``map:``, ``barn:``, ``dynabarn:`` or
            ``tracks:`` before it.
        seed: Non-negative; the same seed gives the same world. Of a file it only draws which movers are sighted, and
            phases that the file leaves open.
        region: Region of the factory, 1 to 4.
        movers: Number of moving obstacles, where things move; of a scene file's, the first ones.
        speed: Factor on the speeds of the moving obstacles.
        sighted: Share of the moving obstacles that see the robot and give way to it, 0 to 1; None leaves them as the
            world has them. For the same seed those of a smaller share are among those of a greater.
        without: Difficulties to switch off, letters of "VUCA". V: nothing moves. C: walls, blocks and shelves
            are gone, but for the outer ones. U and A are for the robot and change nothing here.
        footprint_radius: Radius of the circle about the footprint that must be able to reach the goal [m].
        height: Height of the body [m]; what hangs above it in a scene file is not in its way.
        bringing: How a file is brought in, and what is changed of any world: its task, people in it.

    Raises:
        UnknownName: No such world.
        BadArgument: An option out of its range, or one that this world does not take.
        BadWorld: A broken file, or no solvable layout for this body.
    """
    without = ordered_difficulties(without)
    if seed < 0:
        raise BadArgument(f"--seed {seed}: a seed is 0 or more")
    if not 0.0 < footprint_radius < 5.0:
        raise BadArgument(f"footprint radius {footprint_radius:g} m: one between 0 and 5 m would be right")
    check_options(name, region=region, movers=movers, speed=speed, sighted=sighted, without=without)
    is_from_file = is_brought(name)
    if is_from_file:
        world = _first_movers(load_world(name, bringing), movers, name)
    else:
        kind, given = WORLDS[name], {"region": region, "movers": movers}
        chosen = {option: o.default for option, o in kind.options.items() if isinstance(o.default, int)}
        chosen |= {option: value for option, value in given.items() if value is not None}
        world = kind.generate(seed=seed, footprint_radius=footprint_radius, **chosen)
    if "V" in without:
        if bringing.obstacles is not None:
            raise BadArgument(
                "--obstacles does not go with --without V, which leaves all moving obstacles out; give one"
            )
        world = replace(world, movers=())
    if "C" in without:
        world = replace(
            world, obstacles=tuple(o for o in world.obstacles if o.outer or o.kind not in CORRIDOR_KINDS), grid=None
        )
    world = replace(world, movers=_turned(world.movers, speed, sighted, seed, name))
    world = with_task(with_people(world, bringing), bringing)
    if is_from_file:
        world = drawn(world, seed)
    return world


def check_options(
    world: str,
    *,
    region: int | None = None,
    movers: int | None = None,
    speed: float = 1.0,
    sighted: float | None = None,
    without: str = "",
) -> None:
    """Refuse options that a world does not take, without making it. A scene file is not read.

    Raises:
        UnknownName: No such world.
        BadArgument: An option out of its range, or one that this world does not take.
    """
    moving = {"movers": movers, "speed": None if speed == 1.0 else speed, "sighted": sighted}
    turned = [(option, value) for option, value in moving.items() if value is not None]
    if turned and "V" in without:
        option, value = turned[0]
        raise BadArgument(
            f"--{option} {value:g} does not go with --without V, which leaves all moving obstacles out; give one"
        )
    if not 0.0 <= speed <= FASTEST_FACTOR:
        raise BadArgument(f"--speed {speed:g}: a factor of 0 to {FASTEST_FACTOR:g} would be right")
    if sighted is not None and not 0.0 <= sighted <= 1.0:
        raise BadArgument(f"--sighted {sighted:g}: a share of 0 to 1 would be right")
    if is_brought(world):
        if region is not None:
            raise BadArgument(f"--region: {world} does not take it (only {_takers('region')})")
        if movers is not None and movers < 0:
            raise BadArgument(f"--movers {movers}: 0 or more would be right")
        return
    if world not in WORLDS:
        raise UnknownName("world", world, WORLDS)
    options = WORLDS[world].options
    for option, value in (("region", region), *turned):
        if value is None:
            continue
        # Whatever turns a dial of the movers needs movers.
        taken = options.get("region" if option == "region" else "movers")
        if taken is None:
            why = "does not take it" if option == "region" else "has nothing that moves"
            raise BadArgument(
                f"--{option}: {world} {why} (only {_takers('region' if option == 'region' else 'movers')})"
            )
        if option in options and not taken.lowest <= value <= taken.highest:
            raise BadArgument(f"--{option} {value}: {world} takes {taken.lowest} to {taken.highest}")


def _first_movers(world: World, movers: int | None, source: str) -> World:
    """The scene with only so many of its movers."""
    if movers is None:
        return world
    if movers > len(world.movers):
        raise BadArgument(f"--movers {movers}: {source} has {len(world.movers)}; that or fewer would be right")
    return replace(world, movers=world.movers[:movers])


def _turned(
    movers: tuple[Mover, ...], speed: float, sighted: float | None, seed: int, source: str
) -> tuple[Mover, ...]:
    """The movers at other speeds, and the given share of them sighted."""
    if speed != 1.0:
        movers = tuple(replace(m, motion=at_speed(m.motion, speed)) for m in movers)
        fastest = max((m.motion.speed for m in movers), default=0.0)
        if fastest > MAX_MOVER_SPEED:
            raise BadArgument(
                f"--speed {speed:g}: the fastest mover of {source} would move at {fastest:.1f} m/s; "
                f"{math.floor(100 * speed * MAX_MOVER_SPEED / fastest) / 100:g} or less would be right"
            )
    if sighted is not None:
        # Every mover has a lot of its own: a greater share takes more of the same order.
        can_see = [i for i, mover in enumerate(movers) if not isinstance(mover.motion, Keyframes)]
        if movers and not can_see:
            raise BadArgument(f"--sighted {sighted:g}: the movers of {source} follow keyframes and give way to nobody")
        order = np.argsort(stream("sighted", seed).random(len(can_see)), kind="stable")
        seeing = {can_see[int(i)] for i in order[: round(sighted * len(can_see))]}
        movers = tuple(replace(m, sighted=i in seeing) for i, m in enumerate(movers))
    return movers


def _takers(option: str) -> str:
    return ", ".join(world for world, kind in WORLDS.items() if option in kind.options)


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
