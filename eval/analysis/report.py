"""Reports of evaluations as Markdown: ``vuca report DIR... --out OUT`` writes a page for each directory and an index.

A page names the run (command, commit, seeds, machine) and its results; the index compares the evaluations that
hold the same episodes, pair by pair. The same directories give the same bytes.
"""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from eval.analysis.compare import by_method, compare, read_rows, table
from eval.analysis.summary import dials_in_words, is_result, statistics_of, summarise
from eval.episode import OUTCOMES
from eval.kept import name_of, read_stored, told_command
from eval.methods import title_of
from eval.store import Row, StoredConfig
from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole

INDEX = "index"
LIBRARIES = ("mujoco", "numpy", "numba", "scipy")
"""The libraries whose versions a page names, as ``eval.provenance.provenance`` records them."""


class Evaluation(NamedTuple):
    """An evaluation as its directory holds it."""

    name: str
    """Name of the directory."""
    stored: StoredConfig
    rows: list[Row]

    @property
    def methods(self) -> str:
        """The methods as they are typed, options included."""
        return ", ".join(f"`{title}`" for title in _unique(title_of(row["method"], row) for row in self.rows))

    @property
    def robots(self) -> str:
        """The names of the robots."""
        return ", ".join(_unique(row["robot"] for row in self.rows))


def read_evaluation(source: Path) -> Evaluation:
    """Read the directory of an evaluation, complete or not, or a file of kept rows.

    Raises:
        BadArgument: It is no evaluation.
    """
    stored, rows = read_stored(source), read_rows(source)
    for row in rows:
        if not is_result(row):
            raise BadArgument(f"{source} has a row that is not the result of an episode: {shown(row, 500)}")
    return Evaluation(name_of(source), stored, rows)


def write_reports(directories: Sequence[Path], out: Path) -> list[Path]:
    """Write a page for each evaluation, and an index with their paired differences.

    Args:
        directories: Directories of evaluations; their names name the pages.
        out: Directory of the pages.

    Returns:
        The files that were written, the index first.

    Raises:
        BadArgument: A directory is no evaluation, two have the same name, or ``out`` cannot be written.
    """
    evaluations = sorted((read_evaluation(directory) for directory in directories), key=lambda each: each.name)
    names = [evaluation.name for evaluation in evaluations]
    for name in names:
        if [*names, INDEX].count(name) > 1:
            raise BadArgument(f"there would be two pages named {name}.md; rename one of the directories")
    prepare_directory(out)
    pages = {INDEX: index_of(evaluations), **{evaluation.name: page_of(evaluation) for evaluation in evaluations}}
    for name, text in pages.items():
        write_whole(out / f"{name}.md", text)
    return [out / f"{name}.md" for name in pages]


def page_of(evaluation: Evaluation) -> str:
    """The page of an evaluation: the run and its results."""
    rows = evaluation.rows
    lines = [
        f"# {evaluation.name}",
        "",
        *_what_was_run(evaluation),
        "",
        "## Outcomes",
        "",
        *_outcomes(rows),
    ]
    ways = _ways(rows)
    if ways:
        lines += ["", "## Ways to the goal", "", *ways]
    return _text(lines)


def index_of(evaluations: Sequence[Evaluation]) -> str:
    """The index: the evaluations with their success, and paired differences of those that share episodes."""
    lines = [
        "# Evaluations",
        "",
        "Written by `vuca report`; each page names its command, commit, seeds and machine.",
        "",
    ]
    cells = []
    for evaluation in evaluations:
        total = statistics_of(evaluation.rows)
        suite, link = evaluation.stored.config.get("suite"), f"[{evaluation.name}]({evaluation.name}.md)"
        cells.append([link, suite, evaluation.robots, evaluation.methods, total["n"], _rate(total["success"])])
    lines += _table(("evaluation", "suite", "robot", "method", "episodes", "success, 95%"), cells)
    methods = {
        evaluation.name + (f", {title}" if len(found) > 1 else ""): episodes
        for evaluation in evaluations
        for found in [by_method(evaluation.rows)]
        for title, episodes in found.items()
    }
    for (first, before), (second, after) in itertools.combinations(methods.items(), 2):
        if before.keys() & after.keys():
            lines += ["", f"## {second} against {first}", "", table(second, first, compare(before, after))]
    return _text(lines)


def _what_was_run(evaluation: Evaluation) -> list[str]:
    config, made_by, runs = evaluation.stored
    seeds, asked = config.get("seeds"), config.get("episodes")
    began = sorted(str(run.get("began")) for run in runs)
    commands = _unique(f"`{told}`" if (told := told_command(evaluation.name, run)) else "unknown" for run in runs)
    machines, commits = _unique(map(_machine, runs)), _unique(str(run.get("commit") or "unknown") for run in runs)
    facts: list[tuple[str, Any]] = [("command", command) for command in commands]
    facts += [("commit", commit) for commit in commits]
    facts += [
        ("suite", config.get("suite")),
        ("seeds", " to ".join(_unique([str(seeds[0]), str(seeds[1] - 1)])) if seeds else "unknown"),
        ("episodes", f"{len(evaluation.rows)} of {asked}"),
        ("robot", evaluation.robots),
        ("method", evaluation.methods),
    ]
    facts += [("machine", machine) for machine in machines]
    libraries = made_by.get("libraries") or {}
    facts += [("libraries", ", ".join(f"{name} {libraries[name]}" for name in LIBRARIES if name in libraries))]
    facts += [("date", " to ".join(_unique([began[0][:10], began[-1][:10]])))] if began else []
    return _table(("", ""), facts)


def _machine(run: Row) -> str:
    machine = run.get("machine") or {}
    cpu, cores, system, python = (machine.get(name, "unknown") for name in ("cpu", "cores", "os", "python"))
    return f"{cpu}, {cores} cores, {system}, Python {python}"


def _outcomes(rows: Sequence[Row]) -> list[str]:
    header = ("world", "robot", "method", "episodes", *OUTCOMES, "mean time [s]", "SPL", "way per collision [m]")
    cells = [
        [_world(group), group["robot"], f"`{title_of(group['method'], group)}`", *_figures(group)]
        for group in summarise(rows)
    ]
    if len(cells) > 1:
        cells.append(["all", "", "", *_figures(statistics_of(rows))])
    note = "Counts with Wilson's 95% intervals; the mean time is of the episodes that arrived."
    return [note, "", *_table(header, cells)]


def _world(group: Row) -> str:
    region = "" if group["region"] is None else f" {group['region']}"
    return f"{group['world']}{region}{dials_in_words(group)}" + (
        f", without {group['without']}" if group["without"] else ""
    )


def _figures(group: Row) -> list[Any]:
    outcomes = [_rate(group[outcome]) for outcome in OUTCOMES]
    means = ((group["arriving_time"], 1), (group["spl"], 3), (group["way_per_collision"], 0))
    return [group["n"], *outcomes, *("-" if mean is None else f"{mean:.{digits}f}" for mean, digits in means)]


def _rate(outcome: Row) -> str:
    low, high = outcome["interval"]
    return f"{outcome['count']} [{100 * low:.0f}, {100 * high:.0f}%]"


def _ways(rows: Sequence[Row]) -> list[str]:
    """A table of the ways that were entered first, in the worlds that name theirs."""
    cells = [
        [_world(group), way, _rate(entered)] for group in summarise(rows) for way, entered in group["ways"].items()
    ]
    return _table(("world", "way", "entered first"), cells) if cells else []


def _table(header: Sequence[str], cells: Sequence[Sequence[Any]]) -> list[str]:
    return [_line(header), "|" + "---|" * len(header), *(_line(row) for row in cells)]


def _line(cells: Sequence[Any]) -> str:
    """A line of a table; what a folder says is one line of text in it, neither markup nor columns."""
    texts = (shown(cell, 1000).replace("|", "\\|").replace("<", "&lt;") for cell in cells)
    return f"| {' | '.join(texts)} |"


def _unique(values: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(values))


def _text(lines: Sequence[str]) -> str:
    return "\n".join([*lines, ""])
