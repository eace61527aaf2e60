"""Episodes of tasks: the source's metrics in their rows, and rows of tasks that are refused."""

import contextlib
import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import NamedTuple

from eval.episode import REFUSED, EpisodeConfig, EpisodeResult, run_episode
from eval.metrics import Metrics
from eval.store import Row
from eval.suites import Suite, Task
from robots.arithmetic import fingerprint
from vuca_nav.errors import BadWorld
from worlds.importers.occupancy_map import image_of
from worlds.importers.sources import KINDS, SCENE_SUFFIXES

BARN_SPEED = 2.0
"""Speed of BARN's optimal time [m/s]."""
BARN_LEAST, BARN_MOST = 2.0, 8.0
"""Multiples of the optimal time between which the arriving time counts: the rule since 2024."""
_IDENTITY = ("world", "start", "goal", "tolerance", "time_limit", "obstacles", "unknown")
"""Fields that tell tasks apart: dials may change the others."""


class NamedTask(NamedTuple):
    """A task of a file."""

    name: str
    task: Task
    optimal_length: float | None
    """Length of the optimal way by the source [m]; None: the shortest way around standing obstacles for the body."""


def barn_score(success: bool, time: float, optimal_length: float) -> float:
    """BARN's score of a mission by its rule since 2024; at most 0.5.

    Success times OT over the arriving time, which counts as no less than 2 OT and no more than 8 OT. The clock starts
    when the robot has moved 0.1 m. (The BARN Challenge, https://people.cs.gmu.edu/~xiao/Research/BARN_Challenge.)

    Args:
        success: Whether it came within the tolerance, without a contact and in time.
        time: Arriving time from the first motion [s].
        optimal_length: Length of the optimal way [m], which takes OT at 2 m/s.
    """
    optimal = optimal_length / BARN_SPEED
    return float(success) * optimal / min(max(time, BARN_LEAST * optimal), BARN_MOST * optimal) if optimal else 0.0


def suite_of(source: Path, tasks: Sequence[NamedTask]) -> Suite:
    """The tasks as a suite of one seed."""
    return Suite(f"the tasks of {source}", tuple(each.task for each in tasks), range(1))


def files_of(tasks: Sequence[NamedTask]) -> dict[str, str]:
    """Hash of each world's file, a map's with its image, so that an evaluation does not go on with another."""
    named = {name for each in tasks for name in (each.task.world, each.task.obstacles) if name and ":" in name}
    named |= {each.task.world for each in tasks if each.task.world.endswith(SCENE_SUFFIXES)}
    return {str(path_of(name)): _hash_of(name) for name in sorted(named)}


def _hash_of(name: str) -> str:
    path = path_of(name)
    content = hashlib.sha256(path.read_bytes())
    if name.startswith("map:"):
        with contextlib.suppress(BadWorld):  # whose rows will say so
            content.update(image_of(path).read_bytes())
    return content.hexdigest()[:16]


def path_of(world: str) -> Path:
    """Path of a world that is brought in."""
    kind, colon, path = world.partition(":")
    if kind == "keyframes":
        return Path(path.rpartition("#")[0])
    return Path(path if colon and kind in KINDS else world)


@dataclass(frozen=True)
class TaskJob:
    """Runs an episode of a task in a worker, and gives its row with the source's metrics.

    A row has ``task``, ``optimal_length`` [m] and, of a world whose clock starts on motion, BARN's ``score``. A task
    that cannot be run becomes a row ``refused`` with its ``reason``.
    """

    names: dict[tuple, tuple[str, float | None]]
    """Name and optimal length of each task, by what tells it apart."""

    def __call__(self, config: EpisodeConfig) -> Row:
        """Run it."""
        name, optimal = self.names[_identity(config)]
        try:
            row = run_episode(config).row()
        except BadWorld as error:
            return {**refused_row(config, str(error)), "task": name, "optimal_length": optimal}
        optimal = row["shortest_path"] if optimal is None else optimal
        row |= {"task": name, "optimal_length": optimal}
        if row["judged_by_motion"]:
            success = row["outcome"] == "success"
            time = (row["arriving_time"] or 0.0) - (row["moved_after"] or 0.0)
            row["score"] = barn_score(success, time, optimal)
        return row


def _identity(task: Task | EpisodeConfig) -> tuple:
    return tuple(getattr(task, name) for name in _IDENTITY)


def job_of(tasks: Sequence[NamedTask]) -> TaskJob:
    """The job that runs these tasks."""
    return TaskJob({_identity(each.task): (each.name, each.optimal_length) for each in tasks})


def refused_row(config: EpisodeConfig, reason: str) -> Row:
    """The row of a task that cannot be run."""
    empty = dict.fromkeys(
        field.name
        for kind in (EpisodeResult, Metrics)
        for field in fields(kind)
        if field.name not in ("config", "metrics")
    )
    return {**config.row(), **empty, "outcome": REFUSED, "reason": reason, "arithmetic": fingerprint()}


def note(tasks: Sequence[NamedTask]) -> list[Row]:
    """The tasks as an evaluation's ``config.json`` notes them."""
    return [{"name": each.name, **asdict(each.task), "optimal_length": each.optimal_length} for each in tasks]
