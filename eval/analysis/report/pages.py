"""``vuca report DIR... --out OUT``: Markdown pages, CSV tables, figures, and one HTML page with all of it.

There is a Markdown page for each evaluation, which names the run (command, commit, seeds, machine) and its results, and
an index with the tables of all of them together. The same directories give the same bytes.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eval.analysis.measurements.files import Measurement, is_measurement, read_measurement
from eval.analysis.report.branch import branch_table
from eval.analysis.report.cells import Evaluation, cells_of, read_evaluation, unique
from eval.analysis.report.claims import answers_table, claims_table
from eval.analysis.report.comparisons import Evidence
from eval.analysis.report.default import default_table
from eval.analysis.report.failed import failed_episodes, failed_table
from eval.analysis.report.figures.drawing import Picture
from eval.analysis.report.figures.measured import measured_figures
from eval.analysis.report.figures.outcomes import outcome_figures
from eval.analysis.report.moments import moments_table
from eval.analysis.report.page import html_page
from eval.analysis.report.results import tables_of
from eval.analysis.report.tables import Column, Share, Table, as_csv, grid, markdown
from eval.analysis.summary import by_driver, dials_in_words, statistics_of, summarise
from eval.episode import OUTCOMES
from eval.kept import told_command
from eval.methods import title_of
from eval.store import Row
from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole

INDEX, PAGE = "index", "report.html"
LIBRARIES = ("mujoco", "numpy", "numba", "scipy")
"""The libraries whose versions a page names, as ``eval.provenance.provenance`` records them."""


def write_reports(sources: Sequence[Path], out: Path) -> list[Path]:
    """Write a page for each evaluation, and the tables and figures of all of them together.

    Args:
        sources: Directories of evaluations, or files of kept rows, whose names name the pages; and files of
            measurements.
        out: Directory of the pages.

    Returns:
        The files that were written: the index first, the HTML page, the pages, the tables and the figures.

    Raises:
        BadArgument: A directory is no evaluation, two have the same name or hold the same episodes of one hash with
            different rows, or ``out`` cannot be written.
    """
    kept = [source for source in sources if not is_measurement(source)]
    if not kept:
        raise BadArgument("give one or more directories of vuca eval beside the files of measurements")
    evaluations = sorted(map(read_evaluation, kept), key=lambda each: each.name)
    measurements = [read_measurement(source) for source in sources if source not in kept]
    measurements.sort(key=lambda each: (each.kind, each.name))
    names = [evaluation.name for evaluation in evaluations]
    for name in names:
        if [*names, INDEX].count(name) > 1:
            raise BadArgument(f"there would be two pages named {name}.md; rename one of the directories")
    cells = cells_of(evaluations)
    failed = failed_episodes(cells)
    listed = evaluations_table(evaluations)
    evidence = Evidence(cells, measurements)
    claims = claims_table(evidence)
    tables = [answers_table(claims), claims, default_table(evaluations), tasks_table(evaluations)]
    tables += [*tables_of(cells), branch_table(cells)]
    tables = [table for table in [*tables, moments_table(evidence.rows("moments"))] if table.rows]
    pictures = [*outcome_figures(cells), *measured_figures(evidence)]
    facts = [*map(_facts, evaluations), *map(_facts_of_measurement, measurements)]
    files: dict[str, str] = {
        f"{INDEX}.md": _index(listed, tables, pictures, facts[len(evaluations) :]),
        PAGE: html_page([listed, *tables], pictures, failed, facts),
        **{f"{evaluation.name}.md": page_of(evaluation) for evaluation in evaluations},
        **{f"tables/{table.name}.csv": as_csv(table) for table in (*tables, failed_table(failed))},
        **{f"figures/{picture.name}.svg": picture.svg for picture in pictures},
    }
    for directory in sorted({(out / name).parent for name in files}):
        prepare_directory(directory)
    for name, text in files.items():
        write_whole(out / name, text)
    return [out / name for name in files]


def page_of(evaluation: Evaluation) -> str:
    """The page of an evaluation: the run and its results."""
    rows = evaluation.rows
    facts = _facts(evaluation)
    lines = [f"# {evaluation.name}", "", *grid(("", ""), facts.rows), "", "## Outcomes", "", *_outcomes(evaluation)]
    ways = _ways(rows)
    if ways:
        lines += ["", "## Ways to the goal", "", *ways]
    return _text(lines)


def evaluations_table(evaluations: Sequence[Evaluation]) -> Table:
    """The evaluations with their success."""
    rows: list[list[Any]] = []
    for evaluation in evaluations:
        success = sum(row["outcome"] == "success" for row in evaluation.rows)
        suite, n = evaluation.stored.config.get("suite"), len(evaluation.rows)
        rows.append([evaluation.name, suite, evaluation.robots, evaluation.methods, n, Share(success, n)])
    titles = ("evaluation", "suite", "robot", "method", "episodes", "success")
    note = "Success with Wilson's 95% interval, over all that the evaluation holds."
    return Table("evaluations", "Evaluations", note, tuple(map(Column, titles)), rows)


def tasks_table(evaluations: Sequence[Evaluation]) -> Table:
    """The evaluations of brought tasks, all tasks of each together; no rows if there are none."""
    rows: list[list[Any]] = []
    for evaluation in evaluations:
        found = by_driver(evaluation.all_rows, evaluation.name) if evaluation.is_of_tasks else []
        for group in found:
            method, n = title_of(group["method"], group), group["n"]
            contacts = group["contacts"]
            shares = [Share(group[outcome]["count"], n) for outcome in OUTCOMES]
            figures = [contacts["own"], contacts["static"], group["spl"], group.get("score")]
            rows.append([group["world"], group["robot"], method, group.get("refused", 0), n, *shares, *figures])
    names = ("tasks", "robot", "method", "refused", "episodes", *OUTCOMES, "own contacts", "static ones")
    columns = (*map(Column, names), Column("SPL", 3), Column("score", 4))
    note = (
        "All tasks of a file or a folder together, with Wilson's 95% intervals. Refused: no way is wide enough for the "
        "body by the check. SPL and score are means over the episodes; the score is BARN's, where the tasks have it."
    )
    return Table("tasks", "Brought tasks", note, columns, rows)


def _index(listed: Table, tables: Sequence[Table], pictures: Sequence[Picture], measured: Sequence[Table]) -> str:
    """The index: the evaluations, the tables and figures of all together, what was measured besides."""
    links = [[f"[{name}]({name}.md)", *cells] for name, *cells in listed.texts]
    lines = [
        "# Evaluations",
        "",
        "Written by `vuca report`; each page names its command, commit, seeds and machine. "
        f"[The whole report as one page]({PAGE}).",
        "",
        *grid(listed.header, links),
    ]
    for table in tables:
        lines += ["", *markdown(table), "", f"[As CSV](tables/{table.name}.csv)"]
    if pictures:
        lines += ["", "## Figures"]
    for picture in pictures:
        lines += ["", f"![{picture.title}](figures/{picture.name}.svg)", "", f"{picture.title}. {picture.caption}"]
    for table in measured:
        lines += ["", f"## Measured: {shown(table.title)}", "", *grid(("", ""), table.rows)]
    return _text(lines)


def _facts(evaluation: Evaluation) -> Table:
    """What was run, on what."""
    config, made_by, runs = evaluation.stored
    seeds, asked = config.get("seeds"), config.get("episodes")
    began = sorted(str(run.get("began")) for run in runs)
    commands = unique(f"`{told}`" if (told := told_command(evaluation.name, run)) else "unknown" for run in runs)
    machines, commits = unique(map(_machine, runs)), unique(str(run.get("commit") or "unknown") for run in runs)
    facts: list[tuple[str, Any]] = [("command", command) for command in commands]
    facts += [("commit", commit) for commit in commits]
    facts += [
        ("suite", config.get("suite")),
        ("seeds", " to ".join(unique([str(seeds[0]), str(seeds[1] - 1)])) if seeds else "unknown"),
        ("episodes", f"{len(evaluation.all_rows)} of {asked}"),
        ("robot", evaluation.robots),
        ("method", evaluation.methods),
    ]
    facts += [("machine", machine) for machine in machines]
    libraries = made_by.get("libraries") or {}
    facts += [("libraries", ", ".join(f"{name} {libraries[name]}" for name in LIBRARIES if name in libraries))]
    facts += [("date", " to ".join(unique([began[0][:10], began[-1][:10]])))] if began else []
    return Table("facts", evaluation.name, "", (Column("what"), Column("value")), [list(fact) for fact in facts])


def _facts_of_measurement(measurement: Measurement) -> Table:
    """What was measured, on what."""
    name, runs = measurement.file, measurement.runs
    facts: list[tuple[str, Any]] = [("measurement", measurement.kind), ("rows", len(measurement.rows))]
    facts += [("command", f"`{told}`") for told in unique(told_command(name, run) for run in runs) if told]
    facts += [("commit", commit) for commit in unique(str(run.get("commit") or "unknown") for run in runs)]
    facts += [("machine", machine) for machine in unique(map(_machine, runs))]
    return Table("facts", measurement.name, "", (Column("what"), Column("value")), [list(fact) for fact in facts])


def _machine(run: Row) -> str:
    machine = run.get("machine") or {}
    cpu, cores, system, python = (machine.get(name, "unknown") for name in ("cpu", "cores", "os", "python"))
    return f"{cpu}, {cores} cores, {system}, Python {python}"


def _outcomes(evaluation: Evaluation) -> list[str]:
    rows = [{**row, "world": row.get("task", row["world"])} for row in evaluation.all_rows]
    header = ("world", "robot", "method", "episodes", *OUTCOMES, "mean time [s]", "SPL", "way per collision [m]")
    scored, refused = any(row.get("score") is not None for row in rows), bool(evaluation.refused)
    header += ("score",) * scored + ("refused",) * refused

    def figures(group: Row) -> list[Any]:
        score = group.get("score")
        return [
            *_figures(group),
            *(["-" if score is None else f"{score:.4f}"] * scored),
            *([group.get("refused", 0)] * refused),
        ]

    groups = summarise(rows)
    if evaluation.is_of_tasks:
        groups = [*by_driver(rows, "all"), *groups]
    cells = [
        [_world(group), group["robot"], f"`{title_of(group['method'], group)}`", *figures(group)] for group in groups
    ]
    if len(cells) > 1:
        cells.append(["all", "", "", *figures(statistics_of(rows))])
    note = "Counts with Wilson's 95% intervals; the mean time is of the episodes that arrived."
    return [note, "", *grid(header, cells)]


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
    return grid(("world", "way", "entered first"), cells) if cells else []


def _text(lines: Sequence[str]) -> str:
    return "\n".join([*lines, ""])
