"""Named sets of episodes: tasks, seeds, and in some suites the robots and methods that meet them."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

from eval.episode import EpisodeConfig
from eval.methods import BEST, UNCHANGED, UNIFORM, MethodOptions, resolve, taken_by, title_of
from robots.registry import check_robot
from vuca_nav.errors import BadArgument, UnknownName
from worlds.registry import TRAINING_SEED, check_options


@dataclass(frozen=True, slots=True)
class Task:
    """A place and its difficulties: an episode without robot, method and seed."""

    world: str
    region: int | None = None
    without: str = ""
    movers: int | None = None
    speed: float = 1.0
    """Factor on the movers' speeds."""
    sighted: float | None = None
    """Share of the movers that see the robot; None: as the world has it."""
    start: tuple[float, float, float | None] | None = None
    """Start instead of the world's own: x [m], y [m], yaw [rad], or None for a heading in which the body fits."""
    goal: tuple[float, float] | None = None
    """Goal instead of the world's own [m]."""
    tolerance: float | None = None
    """Distance from the goal within which it counts as reached, instead of the world's own [m]."""
    time_limit: float | None = None
    """Time limit instead of the world's own [s]."""
    obstacles: str | None = None
    """``tracks:FILE``: recorded people in the world besides."""
    unknown: str | None = None
    """What a map's unknown cells are."""


class Driver(NamedTuple):
    """A method and what is changed of it."""

    method: str
    options: MethodOptions = UNCHANGED

    def __str__(self) -> str:
        """The method as it is typed, with its options."""
        return title_of(self.method, self.options.given())


@dataclass(frozen=True, slots=True)
class Suite:
    """A set of cells, a robot, a method and a task each, to be run with every seed."""

    description: str
    tasks: tuple[Task, ...]
    seeds: range
    """Seeds of the episodes, unless others are asked for."""
    drivers: tuple[Driver, ...] = (Driver(BEST),)
    """Methods, unless others are asked for."""
    robots: tuple[str, ...] = ("tiago",)
    """Names of the robots, unless others are asked for."""


REGIONS = (1, 2, 3, 4)
BOTH = ("tiago", "go2")
FACTORY_4, SQUARE = Task("factory", 4), Task("square")
SYSTEMS = tuple(map(Driver, ("move_base", "move_base+dh", "drl", "paper-dh", "paper", "ours-dh", "ours")))
"""The whole systems that the paper compares, and this project's own."""
FRESH = 3000
"""First seed of the suites that are reported: nothing was tuned on this one and those above it."""

SUITES: dict[str, Suite] = {
    "paper-system": Suite(
        "the paper's comparison of systems: factory regions 1 to 4 and the square, 7 methods, both robots, 400 seeds",
        (*(Task("factory", region) for region in REGIONS), SQUARE),
        range(FRESH, FRESH + 400),
        SYSTEMS,
        BOTH,
    ),
    "paper-ablation": Suite(
        "the paper's comparison of policies: factory region 4, square, static, dynamic; drl, both experts, single, "
        "fusion; both robots, 400 seeds",
        (FACTORY_4, SQUARE, Task("static"), Task("dynamic")),
        range(FRESH, FRESH + 400),
        tuple(map(Driver, ("drl", "go-straight", "obstacle-avoidance", "single", "fusion"))),
        BOTH,
    ),
    "paper-branch": Suite(
        "which of two ways is taken, the short one with 0, 4, 8 and 12 moving obstacles: with and without V^h, and "
        "move_base; both robots, 100 seeds",
        tuple(Task("double_branch", movers=movers) for movers in (0, 4, 8, 12)),
        range(FRESH, FRESH + 100),
        tuple(map(Driver, ("move_base", "paper-dh", "paper", "ours-dh", "ours"))),
        BOTH,
    ),
    "paper-gate": Suite(
        "what the gate is good for: fusion with its gate, with equal shares, and without each expert; factory region "
        "4, square, static, dynamic; both robots, 100 seeds",
        (FACTORY_4, SQUARE, Task("static"), Task("dynamic")),
        range(FRESH, FRESH + 100),
        (
            Driver("fusion"),
            Driver("fusion", MethodOptions(gate=UNIFORM)),
            *(Driver("fusion", MethodOptions(without_expert=expert)) for expert in (1, 2, 3, 4)),
        ),
        BOTH,
    ),
    "building": Suite(
        "the building and its crowd, in place of the paper's real one: ours and ours-dh, both robots, 100 seeds",
        (Task("building"),),
        range(FRESH, FRESH + 100),
        (Driver("ours-dh"), Driver("ours")),
        BOTH,
    ),
    "vuca": Suite(
        "factory region 2 with all of V, U, C and A, and without each: 7 methods, both robots, 100 seeds",
        tuple(Task("factory", 2, without) for without in ("", "V", "U", "C", "A")),
        range(FRESH, FRESH + 100),
        SYSTEMS,
        BOTH,
    ),
    "dials": Suite(
        "the square over the number, the speed and the sight of its moving obstacles: move_base+dh, paper-dh, ours-dh, "
        "ours; both robots, 100 seeds",
        (
            *(Task("square", movers=movers) for movers in (8, 16, 24, 40)),
            *(Task("square", speed=speed) for speed in (0.5, 1.0, 1.5, 2.0)),
            *(Task("square", sighted=share) for share in (0.0, 0.5, 1.0)),
        ),
        range(FRESH, FRESH + 100),
        tuple(map(Driver, ("move_base+dh", "paper-dh", "ours-dh", "ours"))),
        BOTH,
    ),
    "crowdnav": Suite(
        "open ground crossed by 20 movers that do not see the robot, as in CrowdNav++: 7 methods, both robots, "
        "500 seeds",
        (Task("crossing"),),
        range(FRESH, FRESH + 500),
        SYSTEMS,
        BOTH,
    ),
    "factory": Suite(
        "the factory's regions 1 to 4, all difficulties, 25 seeds each",
        tuple(Task("factory", region) for region in REGIONS),
        range(25),
    ),
    "factory-still": Suite(
        "the same without moving obstacles",
        tuple(Task("factory", region, without="V") for region in REGIONS),
        range(25),
    ),
    "square": Suite("the open plaza with 24 moving obstacles, 50 seeds", (Task("square"),), range(50)),
    "factory-4": Suite("the whole factory, all difficulties, 100 seeds", (Task("factory", 4),), range(1000, 1100)),
    "crowd": Suite(
        "the open plaza with 8, 16, 24 and 40 moving obstacles, 100 seeds each",
        tuple(Task("square", movers=movers) for movers in (8, 16, 24, 40)),
        range(1000, 1100),
    ),
    "branches": Suite(
        "two ways to the goal, the short one with 0, 4, 8 and 12 moving obstacles, 50 seeds each",
        tuple(Task("double_branch", movers=movers) for movers in (0, 4, 8, 12)),
        range(1000, 1050),
    ),
    "smoke": Suite(
        "factory region 1 and the square, with and without moving obstacles, 2 seeds each",
        (Task("factory", 1), Task("factory", 1, "V"), Task("square"), Task("square", without="V")),
        range(2),
    ),
}


def find_suite(name: str) -> Suite:
    """The suite of that name.

    Raises:
        UnknownName: There is none.
    """
    if name not in SUITES:
        raise UnknownName("suite", name, SUITES)
    return SUITES[name]


def turn_dials(suite: Suite, *, movers: int | None = None, speed: float = 1.0, sighted: float | None = None) -> Suite:
    """The suite with other numbers and speeds of its moving obstacles, or other shares of sighted ones, in all tasks.

    Args:
        suite: The suite to change.
        movers: Number of moving obstacles instead of the tasks' own.
        speed: Factor on their speeds, times the tasks' own.
        sighted: Share of them that see the robot, instead of the tasks' own.

    Raises:
        BadArgument: A number is out of its range, or a task has nothing that moves.
    """
    tasks = []
    for task in suite.tasks:
        if movers is not None:
            task = replace(task, movers=movers)
        if sighted is not None:
            task = replace(task, sighted=sighted)
        tasks.append(replace(task, speed=speed * task.speed))
        check_options(
            task.world, region=task.region, movers=task.movers, speed=tasks[-1].speed, sighted=task.sighted,
            without=task.without,
        )  # fmt: skip
    return replace(suite, tasks=tuple(tasks))


def parse_seeds(text: str) -> range:
    """``"A:B"`` as the seeds A to B - 1, like a slice.

    Raises:
        BadArgument: The text is not of that form, names no seed, or one that policies are trained in.
    """
    first, colon, end = text.partition(":")
    if not (colon and first.isdecimal() and end.isdecimal() and int(first) < int(end)):
        raise BadArgument(f"--seeds must be A:B with 0 <= A < B, as in 0:25 for the seeds 0 to 24, got {text!r}")
    if int(end) > TRAINING_SEED:
        raise BadArgument(
            f"--seeds {text}: policies are trained in worlds of seeds from {TRAINING_SEED} on; give B of at most "
            f"{TRAINING_SEED}"
        )
    return range(int(first), int(end))


def choose(
    suite: Suite,
    methods: Sequence[str] | None = None,
    robots: Sequence[str] | None = None,
    options: MethodOptions = UNCHANGED,
) -> Suite:
    """The suite with other methods and robots, or those of its own that are asked for.

    Args:
        suite: The suite to change.
        methods: Names of methods instead of the suite's own; one that the suite has with options keeps them.
        robots: Names of robots instead of the suite's own.
        options: Changes to the methods. Of several methods each gets those that go with it.

    Raises:
        VucaError: There is no such robot, method or weights file, or an option goes with none of the methods.
    """
    drivers = suite.drivers
    if methods is not None:
        own = {name: [driver for driver in suite.drivers if driver.method == name] for name in methods}
        drivers = tuple(driver for name in dict.fromkeys(methods) for driver in own[name] or [Driver(name)])
    given = options.given()
    if given:
        taken = [taken_by(driver.method, given) for driver in drivers]
        lost = {name: value for name, value in given.items() if not any(name in names for names in taken)}
        if lost:
            resolve(drivers[0].method, MethodOptions(**lost))  # tells what they would go with
        drivers = tuple(
            driver._replace(options=replace(driver.options, **{name: given[name] for name in names}))
            for driver, names in zip(drivers, taken, strict=True)
        )
    robots = suite.robots if robots is None else tuple(dict.fromkeys(robots))
    for robot in robots:
        check_robot(robot)
    for driver in drivers:
        resolve(*driver)
    return replace(suite, drivers=tuple(dict.fromkeys(drivers)), robots=robots)


def episodes_of(
    suite: Suite, *, seeds: Iterable[int] | None = None, limit: int | None = None, trust: bool = False
) -> tuple[EpisodeConfig, ...]:
    """All episodes of a suite, the first seed of every cell before the second.

    Args:
        suite: The suite to run.
        seeds: Seeds instead of the suite's own.
        limit: Greatest number of episodes, the first ones.
        trust: Whether motions of the user's own, in scene files, may be run.

    Raises:
        BadArgument: The limit is not positive.
    """
    if limit is not None and limit < 1:
        raise BadArgument(f"--episodes must be 1 or more, got {limit}")
    every = tuple(
        EpisodeConfig(**asdict(task), robot=robot, method=driver.method, seed=seed, options=driver.options, trust=trust)
        for seed in (suite.seeds if seeds is None else seeds)
        for task in suite.tasks
        for robot in suite.robots
        for driver in suite.drivers
    )
    return every[:limit]
