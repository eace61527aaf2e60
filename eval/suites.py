"""Named sets of episodes."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace

from eval.episode import EpisodeConfig
from eval.methods import BEST, UNCHANGED, MethodOptions, resolve
from robots.registry import ROBOTS
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


@dataclass(frozen=True, slots=True)
class Suite:
    """A set of tasks, each to be run with every seed."""

    description: str
    tasks: tuple[Task, ...]
    seeds: range
    """Seeds of the episodes, unless others are asked for."""


REGIONS = (1, 2, 3, 4)

SUITES: dict[str, Suite] = {
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
        check_options(**asdict(tasks[-1]))
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


def episodes_of(
    suite: Suite,
    *,
    robot: str = "tiago",
    method: str = BEST,
    seeds: Iterable[int] | None = None,
    limit: int | None = None,
    options: MethodOptions = UNCHANGED,
) -> tuple[EpisodeConfig, ...]:
    """All episodes of a suite, the first seed of every task before the second.

    Args:
        suite: The suite to run.
        robot: A robot's name.
        method: A method's name.
        seeds: Seeds instead of the suite's own.
        limit: Greatest number of episodes, the first ones.
        options: Changes to the method.

    Raises:
        VucaError: There is no such robot, method or weights file, an option does not go with the method, or the limit
            is not positive.
    """
    if robot not in ROBOTS:
        raise UnknownName("robot", robot, ROBOTS)
    resolve(method, options)
    if limit is not None and limit < 1:
        raise BadArgument(f"--episodes must be 1 or more, got {limit}")
    every = tuple(
        EpisodeConfig(**asdict(task), robot=robot, method=method, seed=seed, options=options)
        for seed in (suite.seeds if seeds is None else seeds)
        for task in suite.tasks
    )
    return every[:limit]
