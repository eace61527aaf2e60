"""The courses of missions: where each robot drove, and what its gate did, for figures.

``python -m eval.analysis.measurements.courses DIR... --out FILE.jsonl`` runs one mission of each method, robot and
place of the evaluations again, which repeat to the bit.
"""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from eval.analysis.attribution import config_of
from eval.analysis.measurements.files import measure
from eval.analysis.report.cells import Cell, cells_of, read_evaluation
from eval.episode import Episode, EpisodeConfig
from eval.methods import is_users_own
from eval.runner import Crash, key_of
from eval.store import Row
from vuca_nav.cli import optional, run_module
from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_file
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2
from worlds.world import Box, Shape, World

KIND = "courses"
PERIOD = 0.5
"""Time between two points of a course [s]."""
_TICKS = 15
"""Ticks of 1/30 s in it."""
_REPEATED = ("outcome", "duration", "path_length")
"""Fields that are the same in two runs of an episode that repeats."""


class _Course(Telemetry):
    """Keeps the true place and the gate's shares, every ``PERIOD``."""

    def __init__(self) -> None:
        self.places: list[list[float]] = []
        self.shares: list[list[float]] = []
        self.last: list[float] = []
        self._now: list[float] = []
        self._ticks = 0

    def gate(self, shares: FloatArray) -> None:
        self._now = [round(float(share), 3) for share in shares]

    def true_pose(self, world_from_base: Pose2) -> None:
        self.last = [round(world_from_base.x, 2), round(world_from_base.y, 2)]
        if self._ticks % _TICKS == 0:
            self.places.append(self.last)
            self.shares.append(self._now)
        self._now = []
        self._ticks += 1


def course_of(config: EpisodeConfig) -> Row:
    """Run an episode, and keep its course.

    Returns:
        The episode's own fields; ``outcome``, ``duration`` [s], ``path_length`` [m]; ``path``: x, y every ``period``
        and at the end [m]; ``expert_shares``: the experts' shares every ``period``, empty where the policy was
        not asked, None without a gate; ``scene``.
    """
    course, episode = _Course(), Episode(config)
    now = episode.run(course).row()
    return {
        **config.row(),
        **{name: now[name] for name in _REPEATED},
        "period": PERIOD,
        "path": [*course.places, course.last],
        "expert_shares": course.shares if any(course.shares) else None,
        "scene": scene_row(episode.world),
    }


def scene_row(world: World) -> dict[str, Any]:
    """What stands, to the centimetre: ``boxes`` as x, y, yaw, length, width, ``cylinders`` as x, y, radius."""
    shapes: list[Shape] = [obstacle.shape for obstacle in world.obstacles]
    boxes = [(s.x, s.y, s.yaw, s.length, s.width) for s in shapes if isinstance(s, Box)]
    cylinders = [(s.x, s.y, s.radius) for s in shapes if not isinstance(s, Box)]
    return {
        "bounds": list(world.bounds),
        "start": [world.start.x, world.start.y],
        "goal": list(world.goal),
        "boxes": [[round(v, 2) for v in box] for box in boxes],
        "cylinders": [[round(v, 2) for v in cylinder] for cylinder in cylinders],
    }


@dataclass(frozen=True, kw_only=True)
class CoursesArguments:
    """Run one mission of each method, robot and place again, and keep where it drove, for the figures of a report."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Directories of vuca eval, complete or not, or files of kept rows."""
    out: Path
    """The file of measurements, as runs/courses.jsonl; begun again, it goes on where it was."""
    seed: Annotated[int | None, optional("N")] = None
    """Seed of the missions; by default the first that all methods, robots and places have."""
    workers: Annotated[int | None, optional("W")] = None
    """Number of processes; by default one for each core."""
    trust: bool = False
    """Run the Python that rows name, if their method is module:build."""


def missions(cells: Sequence[Cell], seed: int | None) -> list[Row]:
    """The rows of one seed in the places that are as their worlds are.

    Raises:
        BadArgument: There is no such place, or no row of the seed.
    """
    plain = [cell for cell in cells if cell.is_plain]
    if not plain:
        raise BadArgument("no evaluation has a world with all its difficulties; give one that has")
    if seed is None:
        common = set.intersection(*(set(cell.rows) for cell in plain))
        if not common:
            raise BadArgument("no seed was run by all methods in all places; give --seed")
        seed = min(common)
    found = [cell.rows[seed] for cell in plain if seed in cell.rows]
    if not found:
        raise BadArgument(f"no row has seed {seed}; there are {min(plain[0].rows)} to {max(plain[0].rows)}")
    return found


def keep_courses(
    rows: Sequence[Row], out: Path, workers: int | None = None, command: str = ""
) -> tuple[list[Row], list[Crash]]:
    """Run the episodes of rows again, and keep their courses with ``is_repeated``: whether they came out as before."""
    before = {key_of(config_of(row).row()): row for row in rows}

    def compared(now: Row) -> Row:
        return {**now, "is_repeated": all(now[name] == before[key_of(now)].get(name) for name in _REPEATED)}

    configs = [config_of(row) for row in before.values()]
    return measure(out, KIND, configs, course_of, workers=workers, command=command, finish=compared)


def main(arguments: CoursesArguments) -> None:
    """Run and keep.

    Raises:
        VucaError: The evaluations cannot be read, or the file cannot be written or gone on with.
    """
    if not arguments.folders:
        raise BadArgument("give one or more directories of vuca eval")
    prepare_file(arguments.out)
    cells = cells_of([read_evaluation(folder) for folder in arguments.folders])
    rows = missions(cells, arguments.seed)
    own = next((row["method"] for row in rows if is_users_own(row["method"])), None)
    if own is not None and not arguments.trust:
        raise BadArgument(f"method {shown(own)} runs Python code of your own; add --trust if you trust it")
    command = shlex.join(["python", "-m", "eval.analysis.measurements.courses", *sys.argv[1:]])
    rows, crashes = keep_courses(rows, arguments.out, arguments.workers, command)
    other = sum(not row["is_repeated"] for row in rows)
    if other:
        print(f"{other} of {len(rows)} missions went otherwise than their rows say", file=sys.stderr)
    print(f"{len(rows)} courses: {arguments.out}")
    if crashes:
        raise BadArgument(f"{len(crashes)} missions could not be run; give the same command again")


if __name__ == "__main__":
    run_module("courses", main, CoursesArguments)
