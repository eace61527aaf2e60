"""Comparison of methods in the same episodes: ``vuca compare DIR...``.

The directories are those of ``vuca eval``, or files of kept rows. An episode is the same for all methods that meet it,
so that differences are taken in pairs; episodes that only one of two methods has yet are left out. Episodes of one seed
in several tasks, as with 8 and with 40 movers, are one observation of ``all``
(``eval.analysis.statistics.paired_difference``).
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eval.analysis.statistics import mcnemar_exact, paired_difference
from eval.analysis.summary import dials_in_words
from eval.checked import ROW_KINDS, check_values
from eval.episode import OUTCOMES, REFUSED
from eval.kept import name_of, read_lines
from eval.methods import title_of
from eval.store import Row
from vuca_nav.data_files import parse_json, shown
from vuca_nav.errors import BadArgument

EPISODE = (
    "world", "region", "movers", "speed", "sighted", "without", "robot", "start", "goal", "seed",
    "tolerance", "time_limit", "obstacles", "unknown", "map",
)  # fmt: skip
"""The fields of a row that make two rows the same episode."""
_ADDED_LATER = {"speed": 1.0, **dict.fromkeys(("sighted", "tolerance", "time_limit", "obstacles", "unknown", "map"))}
"""Fields that older evaluations do not have, and what they mean by that."""


def read_methods(sources: Sequence[Path], seeds: range | None = None) -> dict[str, dict[str, Row]]:
    """Read the episodes of evaluations, method by method, each keyed by the identity of their episode.

    Args:
        sources: Directories of evaluations, which need not be complete, or files of kept rows.
        seeds: Seeds of the episodes to read; by default all.

    Returns:
        The episodes by name: that of the evaluation if it is of one method, else the method's, after the evaluation's
        if there are several.

    Raises:
        BadArgument: An evaluation has no episodes, they cannot be read, or two have one name.
    """
    methods: dict[str, dict[str, Row]] = {}
    for source in sources:
        found = by_method(read_rows(source, seeds))
        for title, episodes in found.items():
            names = [name_of(source)] * (len(sources) > 1 or len(found) == 1) + [title] * (len(found) > 1)
            name = ": ".join(names)
            if name in methods:
                raise BadArgument(f"two evaluations are named {name}; rename one of them")
            methods[name] = episodes
    return methods


def by_method(rows: Sequence[Row]) -> dict[str, dict[str, Row]]:
    """Rows by the title of their method, then by the identity of their episode."""
    found: dict[str, dict[str, Row]] = {}
    for row in rows:
        episode = json.dumps([row[key] for key in EPISODE])
        found.setdefault(title_of(str(row.get("method")), row), {})[episode] = row
    return found


def read_rows(source: Path, seeds: range | None = None) -> list[Row]:
    """Read the rows of an evaluation; tasks that were refused are left out, and told.

    Args:
        source: Its directory, which need not be complete, or a file of kept rows.
        seeds: Seeds of the episodes to read; by default all.

    Raises:
        BadArgument: There are none, or they cannot be read.
    """
    rows, refused = read_run_and_refused(source, seeds)
    if refused:
        print(f"{source}: {len(refused)} tasks that were refused are left out", file=sys.stderr)
    if not rows:
        raise BadArgument(f"{source} has no episodes{'' if seeds is None else ' of these seeds'}")
    return rows


def read_run_and_refused(source: Path, seeds: range | None = None) -> tuple[list[Row], list[Row]]:
    """Read the rows of an evaluation: those of episodes that were run, and those of tasks that were refused.

    Args:
        source: Its directory, which need not be complete, or a file of kept rows.
        seeds: Seeds of the episodes to read; by default all.

    Raises:
        BadArgument: They cannot be read.
    """
    place, lines = read_lines(source)
    wrong = f"{place} is not a list of episodes"
    rows: list[Row] = []
    for number, line in enumerate(lines, start=1):
        parsed = parse_json(line, f"{wrong}: line {number}", BadArgument)
        check_values(parsed, ROW_KINDS, f"{wrong}: line {number}")
        row = {**_ADDED_LATER, **parsed}
        missing = [key for key in (*EPISODE, "outcome") if key not in row]
        if missing:
            raise BadArgument(f"{wrong}: line {number}: {', '.join(missing)} missing")
        if seeds is None or row["seed"] in seeds:
            rows.append(row)
    refused = [row for row in rows if row["outcome"] == REFUSED]
    return [row for row in rows if row["outcome"] != REFUSED], refused


class Differences(NamedTuple):
    """The differences of two evaluations in one task."""

    pairs: int
    """Number of episodes that both have."""
    seeds: int
    """Number of different seeds among them."""
    of: dict[str, tuple[float, float, float]]
    """Difference of the share of each outcome, and the ends of its 95% interval."""
    p: dict[str, float | None]
    """McNemar's exact p-value of each outcome; None where a seed has several episodes, which are not independent."""


def compare(first: dict[str, Row], second: dict[str, Row]) -> dict[str, Differences]:
    """Paired differences, second less first.

    Args:
        first: Episodes of a method, as ``read_methods`` gives them.
        second: Episodes of another one.

    Returns:
        The differences in each task, and in ``all`` of them if there are several.

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
        result[task] = Differences(len(keys), len(np.unique(seeds)), {}, {})
        for outcome in OUTCOMES:
            a, b = (np.array([rows[key]["outcome"] == outcome for key in keys]) for rows in (first, second))
            result[task].of[outcome] = paired_difference(a, b, seeds)
            result[task].p[outcome] = mcnemar_exact(a, b) if result[task].seeds == len(keys) else None
    return result


def _task(row: Row) -> str:
    name = str(row["world"])
    if row["region"] is not None:
        name += f" {row['region']}"
    name += dials_in_words(row)
    return shown(f"{row['robot']}, {name}" + (f", without {row['without']}" if row["without"] else ""), 200)


def table(name: str, against: str, differences: dict[str, Differences]) -> str:
    """The differences as Markdown, in points of a hundred with 95% intervals and p-values."""
    lines = [
        f"`{name}` less `{against}`: points of a hundred, 95% interval, p of McNemar's exact test",
        "",
        f"| task | pairs | {' | '.join(OUTCOMES)} |",
        "|---|---|" + "---|" * len(OUTCOMES),
    ]
    for task, row in differences.items():
        cells = (_cell(row.of[outcome], row.p[outcome]) for outcome in OUTCOMES)
        pairs = f"{row.pairs}" if row.seeds == row.pairs else f"{row.pairs} of {row.seeds} seeds"
        lines.append(f"| {task} | {pairs} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cell(difference: tuple[float, float, float], p: float | None) -> str:
    cell = "{:+.0f} [{:+.0f}, {:+.0f}]".format(*(100.0 * x for x in difference))
    if p is None:
        return cell
    return f"{cell}, p < 0.001" if p < 0.001 else f"{cell}, p = {p:.3f}"
