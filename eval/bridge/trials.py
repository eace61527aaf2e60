"""Cells of a robot and a task, driven over the wire and in one process: what parity and real-time runs share."""

import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.analysis.compare import read_rows
from eval.bridge.processes import Deployment, own_domain
from eval.bridge.remote_stack import Pace, RemoteStack
from eval.bridge.robot_wire import RobotWire
from eval.bridge.session import Drive, drive, drive_all, wait_for_stack
from eval.episode import CONFIG_FIELDS, EpisodeConfig
from eval.evaluate import evaluate
from eval.methods import MethodOptions, identity_of, resolve, title_of
from eval.metrics import TIMING_FIELDS
from eval.store import Row, StoredConfig, read_config
from eval.suites import Task, parse_seeds
from robots.registry import make_body
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.errors import BadArgument
from vuca_nav.progress import CountedProgress

TASKS = {"factory-2": Task("factory", 2), "building": Task("building")}
"""The tasks by name: a maze with movers, and a building with pedestrians."""
MONITORED = MethodOptions(monitor=True)
"""In one process the stack has the safety layer under it, too: a deployed one always has."""
_NOT_COMPARED = {*TIMING_FIELDS, *CONFIG_FIELDS, "bits", "monitor_ticks", "why"}
_STEPS = 1000
"""Steps that a bundle records for vuca check."""
WIRE, ALONE = "wire", "alone"
"""Directories of a cell's rows over the wire and in one process."""


@dataclass(frozen=True, kw_only=True)
class TrialArguments:
    """Which missions are driven."""

    out: Path
    """Directory of the bundles, the rows and the table; the same command goes on where it was."""
    robots: str = "tiago,go2"
    """Robots, with commas between them."""
    tasks: str = ",".join(TASKS)
    """Tasks, with commas between them."""
    seeds: str = "0:20"
    """The seeds A to B - 1."""
    method: str = "ours-dh"
    """The method that is deployed."""
    timeout: float = 120.0
    """How long to wait for the deployed stack to appear, and in lockstep for each command [s]."""


class Cell(NamedTuple):
    """A robot and a task."""

    robot: str
    task: str
    configs: tuple[EpisodeConfig, ...]
    """Its missions, one for each seed."""

    @property
    def name(self) -> str:
        """Name of the cell, of a directory as well."""
        return f"{self.robot}-{self.task}"


def cells_of(arguments: TrialArguments) -> list[Cell]:
    """The cells that are asked for.

    Raises:
        BadArgument: A task is unknown, or the seeds are none.
    """
    cells = []
    for robot in arguments.robots.split(","):
        make_body(robot)
        for task in arguments.tasks.split(","):
            if task not in TASKS:
                raise BadArgument(f"--tasks: unknown task {task!r} (available: {', '.join(TASKS)})")
            configs = (
                EpisodeConfig(**asdict(TASKS[task]), robot=robot, method=arguments.method, seed=seed)
                for seed in parse_seeds(arguments.seeds)
            )
            cells.append(Cell(robot, task, tuple(configs)))
    return cells


def bundle_of(robot: str, method: str, folder: Path) -> Path:
    """The bundle of a robot and a method, made if it is not there."""
    from eval.export.making import make_bundle
    from eval.export.recording import REGION, WORLD

    bundle = folder / f"{robot}-{method}"
    if not bundle.exists():
        with CountedProgress(sys.stderr, f"steps recorded for {bundle}", _STEPS) as progress:
            command = shlex.join(["vuca", "export", "--robot", robot, "--method", method])
            make_bundle(EpisodeConfig(WORLD, REGION, robot, method), bundle, progress, _STEPS, command)
    return bundle


class Driven(NamedTuple):
    """The missions of a cell that were driven both ways."""

    name: str
    """Robot and task."""
    directory: Path
    wire: list[Row]
    """Rows over the wire, by seed."""
    alone: list[Row]
    """Rows of the same missions in one process, in the same order."""
    stored: tuple[StoredConfig, StoredConfig]
    """Configurations of both."""

    @property
    def missions(self) -> str:
        """How many missions there are, of how many that were asked for."""
        asked = self.stored[0].config.get("episodes")
        return str(asked) if asked == len(self.wire) else f"{len(self.wire)} of {asked}"

    def arrived(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which missions arrived over the wire, and which in one process."""
        over, alone = (np.array([row["outcome"] == "success" for row in rows]) for rows in (self.wire, self.alone))
        return over, alone


def driven_in(directory: Path) -> Driven | None:
    """What the directory of a cell holds; None while no mission has been driven both ways.

    Raises:
        BadArgument: It holds something else.
    """
    ways = directory / WIRE, directory / ALONE
    files = [way / "episodes.jsonl" for way in ways]
    if not all(file.is_file() and file.stat().st_size for file in files):
        return None
    wire, alone = ({row["seed"]: row for row in read_rows(way)} for way in ways)
    seeds = sorted(wire.keys() & alone.keys())
    if not seeds:
        return None
    rows = [wire[seed] for seed in seeds], [alone[seed] for seed in seeds]
    return Driven(directory.name, directory, *rows, (read_config(ways[0]), read_config(ways[1])))


def typed(words: Sequence[str]) -> str:
    """A command of this package as it is typed, from its ``sys.argv``."""
    module = Path(words[0])
    if module.suffix != ".py":
        return shlex.join(words)
    parts = module.parent.parts[-1:] if module.stem == "__main__" else (module.stem,)
    return shlex.join(["python", "-m", ".".join(("eval.bridge", *parts)), *words[1:]])


class Deployed:
    """The deployed stack of a cell in a process of its own, found by the robot's topics in this one.

    Args:
        cell: Robot and task.
        arguments: Which missions are driven.
        options: Options of ``vuca deploy``.
        pace: How the simulation waits.
    """

    def __init__(self, cell: Cell, arguments: TrialArguments, options: Sequence[str], pace: Pace):
        self._cell, self._arguments, self._options, self.pace = cell, arguments, options, pace

    @contextmanager
    def __call__(self) -> Iterator[RemoteStack]:
        """Start it, and end it at the end."""
        cell, arguments = self._cell, self._arguments
        bundle = bundle_of(cell.robot, arguments.method, arguments.out / "bundles")
        domain, log = own_domain(), arguments.out / cell.name / "deploy.log"
        with (
            Deployment(bundle, self._options, domain, log) as process,
            DdsTransport(NetworkConfig(domain)) as transport,
        ):
            wire = RobotWire(transport, make_body(cell.robot))
            wait_for_stack(wire, arguments.timeout, process.check)
            yield RemoteStack(wire, self.pace)


def drive_over_the_wire(
    cell: Cell, arguments: TrialArguments, deployed: Deployed, settings: Row, drive: Drive = drive
) -> list[Row]:
    """Rows of a cell's missions over the wire; kept as they come.

    Args:
        cell: Robot and task.
        arguments: Which missions are driven.
        deployed: Their stack.
        settings: What the rows depend on beside the missions.
        drive: Runs one mission.
    """
    out = arguments.out / cell.name / WIRE
    return list(drive_all(cell.configs, deployed, out, typed(sys.argv), settings, drive).rows)


def drive_alone(cell: Cell, arguments: TrialArguments) -> list[Row]:
    """Rows of a cell's missions in one process, with the safety layer under the method; kept as they come."""
    configs = [replace(config, options=MONITORED) for config in cell.configs]
    title = title_of(arguments.method, MONITORED.given())
    identity: Row = {
        "suite": "bridge",
        "robots": [cell.robot],
        "methods": [title],
        "configurations": {title: identity_of(resolve(arguments.method, MONITORED))},
        "seeds": [configs[0].seed, configs[-1].seed + 1],
        "episodes": len(configs),
        "tasks": [asdict(TASKS[cell.task])],
    }
    evaluation = evaluate(identity, configs, arguments.out / cell.name / ALONE, workers=1, command=typed(sys.argv))
    if evaluation.crashes:
        raise BadArgument(f"{evaluation.crashes[0].config} crashed: {evaluation.crashes[0].error}")
    return list(evaluation.rows)


def differences(wire: Row, alone: Row) -> list[str]:
    """Names of the fields in which two rows of one mission differ, in a single bit."""
    names = sorted(({*wire} | {*alone}) - _NOT_COMPARED)
    return [name for name in names if wire.get(name) != alone.get(name)]
