"""Methods against each other in the same episodes: ``python -m eval.analysis.compare FIRST SECOND...``.

The directories are those of ``vuca eval``. An episode is the same for all methods that meet it, so that differences are
taken in pairs; those that only one of two evaluations has yet are left out. Episodes of one seed in several tasks, as
with 8 and with 40 movers, are one observation of ``all`` (``eval.analysis.statistics.paired_difference``).
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro

from eval.analysis.statistics import paired_difference
from eval.episode import OUTCOMES
from eval.store import Row
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument

EPISODE = ("world", "region", "movers", "without", "robot", "start", "goal", "seed")
"""What makes it the same episode."""


@dataclass(frozen=True)
class CompareArguments:
    """How much more often each outcome came about than in the first evaluation, in the same episodes."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Of evaluations, complete or not; all are compared with the first."""
    seeds: tuple[int, int] | None = None
    """Only the seeds from the first to before the second."""


def read_episodes(folder: Path, seeds: tuple[int, int] | None = None) -> dict[str, Row]:
    """The episodes of an evaluation, by what makes them the same.

    Raises:
        BadArgument: There are none, or they cannot be read.
    """
    path = folder / "episodes.jsonl"
    try:
        rows = [json.loads(line) for line in path.read_text().splitlines()]
        if seeds is not None:
            rows = [row for row in rows if seeds[0] <= row["seed"] < seeds[1]]
        episodes: dict[str, Row] = {json.dumps([row[key] for key in EPISODE]): row for row in rows}
        if not all(isinstance(row["outcome"], str) for row in rows):
            raise ValueError("outcomes must be text")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadArgument(f"{path} is not a list of episodes: {error}") from error
    if not episodes:
        raise BadArgument(f"{path} has no episodes{'' if seeds is None else ' of these seeds'}")
    return episodes


class Differences(NamedTuple):
    """In one task."""

    pairs: int
    """Episodes that both have."""
    seeds: int
    """Different ones among them."""
    of: dict[str, tuple[float, float, float]]
    """Of the share of each outcome the difference, and the ends of its 95% interval."""


def compare(first: dict[str, Row], second: dict[str, Row]) -> dict[str, Differences]:
    """Paired differences, second less first.

    Args:
        first: Of ``read_episodes``.
        second: The same of another evaluation.

    Returns:
        For each task, and for ``all`` of them if there are several.

    Raises:
        BadArgument: They have no episode in common.
    """
    tasks: dict[str, list[str]] = {}
    for key in first:
        if key in second:
            tasks.setdefault(_task(first[key]), []).append(key)
    if not tasks:
        raise BadArgument("the evaluations have no episode in common; compare the same suite, robot and seeds")
    if len(tasks) > 1:
        tasks["all"] = [key for keys in tasks.values() for key in keys]
    result: dict[str, Differences] = {}
    for task, keys in tasks.items():
        seeds = np.array([first[key]["seed"] for key in keys])
        result[task] = Differences(len(keys), len(np.unique(seeds)), {})
        for outcome in OUTCOMES:
            a, b = (np.array([rows[key]["outcome"] == outcome for key in keys]) for rows in (first, second))
            result[task].of[outcome] = paired_difference(a, b, seeds)
    return result


def _task(row: Row) -> str:
    name = str(row["world"])
    if row["region"] is not None:
        name += f" {row['region']}"
    if row["movers"] is not None:
        name += f", {row['movers']} movers"
    return f"{row['robot']}, {name}" + (f", without {row['without']}" if row["without"] else "")


def table(name: str, against: str, differences: dict[str, Differences]) -> str:
    """As Markdown, in points of a hundred."""
    lines = [f"`{name}` less `{against}`, in points, 95%:", "", f"| task | pairs | {' | '.join(OUTCOMES)} |"]
    lines.append("|---|---|" + "---|" * len(OUTCOMES))
    for task, row in differences.items():
        cells = ["{:+.0f} [{:+.0f}, {:+.0f}]".format(*(100.0 * x for x in row.of[outcome])) for outcome in OUTCOMES]
        pairs = f"{row.pairs}" if row.seeds == row.pairs else f"{row.pairs} of {row.seeds} seeds"
        lines.append(f"| {task} | {pairs} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(arguments: CompareArguments) -> None:
    """Read, compare, print."""
    if len(arguments.folders) < 2:
        raise BadArgument(f"give two or more evaluations to compare, got {len(arguments.folders)}")
    first, *others = arguments.folders
    episodes = read_episodes(first, arguments.seeds)
    for folder in others:
        print(table(folder.name, first.name, compare(episodes, read_episodes(folder, arguments.seeds))), end="\n\n")


if __name__ == "__main__":
    run_module("compare", main, CompareArguments)
