"""Sweeps over the settings of a method, on seeds that no result is reported of.

``python -m eval.analysis.tuning NAME --runs DIR --out FILE.md``: every set of settings drives the same missions, and
the page shows them all. The best set is kept in ``eval.methods`` by hand. Run it again, and it goes on where it was.
"""

import os
import shlex
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import tyro

from eval.analysis.statistics import mean, wilson_interval
from eval.baselines.move_base.config import MoveBaseConfig
from eval.episode import Episode, EpisodeConfig
from eval.evaluate import evaluate
from eval.method_config import MethodConfig
from eval.methods import METHODS, AnyConfig, identity_of, resolve
from eval.store import Row
from eval.suites import Task, parse_seeds
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.files import prepare_file, write_whole
from vuca_nav.provenance import commit


class Tuning(NamedTuple):
    """Sets of settings of a method, and the missions that they are tried in."""

    method: str
    sets: dict[str, AnyConfig]
    """Each set by the name that the page shows."""
    tasks: tuple[Task, ...]
    seeds: range


FACTORY_AND_SQUARE = (*(Task("factory", region) for region in (1, 2, 3, 4)), Task("square"))


def tunings() -> dict[str, Tuning]:
    """All sweeps by name."""
    paper, move_base = METHODS["paper"].config, MoveBaseConfig()
    assert isinstance(paper, MethodConfig)
    layers, window = move_base.layers, move_base.window
    wide = replace(layers, inflation_radius=0.9, cost_scaling=4.0)
    careful = replace(window, comfort=0.6, comfort_weight=1.5)
    return {
        "paper": Tuning(
            "paper",
            {f"gamma {gamma:g}": replace(paper, gamma=gamma) for gamma in (0.1, 0.25, 0.5, 1.0, 2.0)},
            (Task("factory", 3), Task("factory", 4), Task("double_branch", movers=8), Task("square")),
            range(700, 720),
        ),
        "move_base": Tuning(
            "move_base",
            {
                "as the original": move_base,
                "wide inflation": replace(move_base, layers=wide),
                "wide clearance": replace(move_base, window=careful),
                "both": replace(move_base, layers=wide, window=careful),
                "both, 1 m ahead": replace(move_base, layers=wide, window=careful, look_ahead=1.0),
                "both, 4 m ahead": replace(move_base, layers=wide, window=careful, look_ahead=4.0),
                "both, horizon 2.6 s": replace(move_base, layers=wide, window=replace(careful, horizon=2.6)),
                "both, horizon 1.2 s": replace(move_base, layers=wide, window=replace(careful, horizon=1.2)),
            },
            FACTORY_AND_SQUARE,
            range(700, 720),
        ),
    }


@dataclass(frozen=True)
class TuningArguments:
    """Drive the same missions with every set of a method's settings, and write what came of it as Markdown."""

    name: tyro.conf.Positional[str]
    """The sweep's name: paper or move_base."""
    runs: Path
    """Directory of the rows; it goes on where it was."""
    out: Path
    """The Markdown page, written over if it exists."""
    robot: str = "tiago"
    """A robot's name."""
    seeds: str | None = None
    """The seeds A:B instead of the sweep's own."""
    workers: int | None = None
    """Number of processes; by default one for each core."""


def run_with(method: AnyConfig, config: EpisodeConfig) -> Row:
    """Run an episode by settings that are no entry of the table of methods."""
    episode = Episode(config)
    episode.method = method
    return episode.run().row()


def page_of(tuning: Tuning, rows: dict[str, list[Row]], command: str) -> str:
    """The page: arrivals, collisions and time-outs of every set, for each task and in all.

    Args:
        tuning: The sweep.
        rows: The rows of each set.
        command: The command as typed.
    """
    best = best_of(rows)
    seeds = tuning.seeds
    lines = [
        f"# Settings of {tuning.method}",
        "",
        f"- Command: `{command}`",
        f"- Commit: {commit() or 'unknown'}; seeds {seeds.start} to {seeds.stop - 1}, of which no result is reported",
        f"- Kept: **{best}**, of which the most missions arrived; of equals, the one that was faster",
        "",
        "Missions that arrived, of each task and of all with 95% intervals; then collisions, time-outs, and the mean "
        "arriving time [s].",
        "",
        _row(["settings", *map(_title, tuning.tasks), "all", "collision", "time-out", "time"]),
        _row(["---"] * (len(tuning.tasks) + 5)),
    ]
    for name, of_set in rows.items():
        counts = [
            f"{_count(members, 'success')}/{len(members)}"
            for task in tuning.tasks
            for members in [[row for row in of_set if _is_of(row, task)]]
        ]
        arrived = _count(of_set, "success")
        low, high = wilson_interval(arrived, len(of_set))
        whole = f"{arrived}/{len(of_set)} [{100 * low:.0f}-{100 * high:.0f}%]"
        others = [str(_count(of_set, "collision")), str(_count(of_set, "timeout"))]
        time = mean(row["arriving_time"] for row in of_set)
        shown = f"**{name}**" if name == best else name
        lines.append(_row([shown, *counts, whole, *others, "-" if time is None else f"{time:.1f}"]))
    return "\n".join(lines) + "\n"


def best_of(rows: dict[str, list[Row]]) -> str:
    """Name of the set of which the most missions arrived; of equals, the one with the least mean arriving time."""

    def order(name: str) -> tuple[float, float]:
        time = mean(row["arriving_time"] for row in rows[name])
        return -_count(rows[name], "success"), float("inf") if time is None else time

    return min(rows, key=order)


def _count(rows: list[Row], outcome: str) -> int:
    return sum(row["outcome"] == outcome for row in rows)


def _is_of(row: Row, task: Task) -> bool:
    return (row["world"], row["region"], row["movers"]) == (task.world, task.region, task.movers)


def _title(task: Task) -> str:
    return task.world if task.region is None else f"{task.world} {task.region}"


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main(arguments: TuningArguments) -> None:
    """Run the sweep that the arguments ask for, and write its page."""
    known = tunings()
    if arguments.name not in known:
        raise UnknownName("sweep", arguments.name, known)
    if arguments.workers is not None and arguments.workers < 1:
        raise BadArgument(f"--workers must be 1 or more, got {arguments.workers}")
    tuning = known[arguments.name]
    if arguments.seeds is not None:
        tuning = tuning._replace(seeds=parse_seeds(arguments.seeds))
    prepare_file(arguments.out)
    resolve(tuning.method)
    workers = arguments.workers or len(os.sched_getaffinity(0))
    configs = [
        EpisodeConfig(task.world, task.region, arguments.robot, tuning.method, seed, movers=task.movers)
        for seed in tuning.seeds
        for task in tuning.tasks
    ]
    command = shlex.join(["python", "-m", "eval.analysis.tuning", *sys.argv[1:]])
    rows: dict[str, list[Row]] = {}
    for name, method in tuning.sets.items():
        print(f"{tuning.method}, {name}", file=sys.stderr)
        identity = {"tuning": arguments.name, "set": name, "robot": arguments.robot, "method": tuning.method}
        identity |= {
            "configurations": {tuning.method: identity_of(method)},
            "seeds": [tuning.seeds.start, tuning.seeds.stop],
        }
        folder = arguments.runs / f"{arguments.name}-{name.replace(' ', '-').replace(',', '')}"
        done = evaluate(identity, configs, folder, workers=workers, command=command, job=partial(run_with, method))
        for crash in done.crashes:
            raise BadArgument(f"{folder}: an episode crashed: {crash.error}; run again to go on")
        rows[name] = list(done.rows)
        write_whole(arguments.out, page_of(tuning, rows, command))
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    run_module("tuning", main, TuningArguments)
