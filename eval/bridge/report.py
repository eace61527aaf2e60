"""``python -m eval.bridge.report DIR... --out OUT``: a page and tables of what was measured over the wire.

The directories are those of ``python -m eval.bridge.parity``, ``real_time`` and ``faults``, complete or not. The same
directories give the same bytes.
"""

import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import tyro

from eval.analysis.report.cells import unique
from eval.analysis.report.tables import Column, Table, as_csv, markdown
from eval.bridge import parity, real_time
from eval.bridge.faults.kept import Campaign, is_campaign, read_campaign
from eval.bridge.faults.table import memory_in_words, table_of
from eval.bridge.trials import Driven, driven_in, typed
from eval.kept import name_of, told_command
from eval.store import Row
from vuca_nav.cli import run_module, show
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole

FACTS = tuple(map(Column, ("directory", "command", "commit", "date", "machine")))
UNKNOWN = "unknown"


@dataclass(frozen=True, kw_only=True)
class ReportArguments:
    """Write the page of what was measured over the wire: lockstep, real time, faults."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Directories that python -m eval.bridge.parity, real_time and faults have written, complete or not; their names
    name them on the page."""
    out: Path
    """Directory of the page, as docs/results/bridge: index.md and tables/; files of the same names are written over."""
    note: str = ""
    """What the reader has to know of the machine besides, in sentences: other work on it, or a priority."""


class Found(NamedTuple):
    """What a directory holds."""

    source: Path
    cells: list[Driven]
    """Missions that were driven both ways."""
    campaign: Campaign | None
    """Faults."""

    @property
    def name(self) -> str:
        """Name of the directory."""
        return name_of(self.source)

    def of_settings(self, settings: Row) -> Iterator[Driven]:
        """The cells whose missions over the wire had these settings."""
        for cell in self.cells:
            configurations = cell.stored[0].config.get("configurations", {})
            if settings in configurations.values():
                yield cell

    @property
    def runs(self) -> list[Row]:
        """Each run of a command that wrote into it."""
        if self.campaign is not None:
            return self.campaign.runs
        return [run for cell in self.cells for stored in cell.stored for run in stored.runs]


def run(arguments: ReportArguments) -> None:
    """Write the page and the tables."""
    if not arguments.folders:
        raise BadArgument("give one or more directories of python -m eval.bridge.parity, real_time or faults")
    found = sorted(map(read_found, arguments.folders), key=lambda each: each.name)
    twice = [name for name, count in Counter(each.name for each in found).items() if count > 1]
    if twice:
        raise BadArgument(f"two directories are named {twice[0]}; rename one of them")
    files = pages_of(found, arguments.note)
    for directory in sorted({(arguments.out / name).parent for name in files}):
        prepare_directory(directory)
    for name, text in files.items():
        write_whole(arguments.out / name, text)
    show(f"{len(files)} files: {arguments.out / 'index.md'}")


def read_found(source: Path) -> Found:
    """What a directory holds.

    Raises:
        BadArgument: It is none that a command of the bridge wrote, or holds nothing yet.
    """
    if is_campaign(source):
        campaign = read_campaign(source)
        if not campaign.trials and not campaign.crashes:
            raise BadArgument(f"{source} holds no trial yet")
        return Found(source, [], campaign)
    places = sorted(source.iterdir()) if source.is_dir() else []
    cells = [cell for place in places if place.is_dir() and (cell := driven_in(place)) is not None]
    if not cells:
        raise BadArgument(
            f"{source} holds neither faults nor a mission that was driven both ways: give a directory of python -m "
            "eval.bridge.parity, real_time or faults"
        )
    return Found(source, cells, None)


def pages_of(found: Sequence[Found], note: str = "") -> dict[str, str]:
    """The files by their names: the page, and each table as CSV.

    Args:
        found: What the directories hold, in the order of the page.
        note: What the reader has to know of the machine besides.
    """
    tables = [(table, "") for table in (_parity(found), _real_time(found)) if table.rows] + list(_faults(found))
    lines = [
        "# The deployed stack and the simulator as two processes",
        "",
        "Written by `python -m eval.bridge.report`. `vuca deploy` drives `vuca bridge`'s simulator over DDS on one "
        "machine; times of the wall clock are as good as the machine is idle.",
        *(["", note] if note else []),
        "",
        *markdown(_facts(found)),
    ]
    for table, verdict in tables:
        lines += ["", *markdown(table), *(["", verdict] if verdict else []), "", f"[As CSV](tables/{table.name}.csv)"]
    files = {"index.md": "\n".join([*lines, ""])}
    return files | {f"tables/{table.name}.csv": as_csv(table) for table, _ in tables}


def _parity(found: Sequence[Found]) -> Table:
    """The table of the missions in lockstep."""
    return parity.table_of(_named([(each, cell) for each in found for cell in each.of_settings(parity.SETTINGS)]))


def _real_time(found: Sequence[Found]) -> Table:
    """The table of the missions in real time."""
    return real_time.table_of(_named([(each, cell) for each in found for cell in each.of_settings(real_time.SETTINGS)]))


def _named(cells: Sequence[tuple[Found, Driven]]) -> list[Driven]:
    """Cells whose names differ: with that of their directory where several have the same robot and task."""
    counts = Counter(cell.name for _, cell in cells)
    return [
        cell if counts[cell.name] == 1 else cell._replace(name=f"{cell.name} ({each.name})") for each, cell in cells
    ]


def _faults(found: Sequence[Found]) -> Iterator[tuple[Table, str]]:
    """A table for each campaign, and the verdict on the memory where there are faults at random."""
    for each in found:
        campaign = each.campaign
        if campaign is None:
            continue
        table = table_of(campaign.trials, campaign.crashes)
        drivers = ", ".join(unique(f"{run['robot']}, {run['method']}" for run in campaign.runs))
        title = f"{'Faults at random' if campaign.memory else 'Faults'}: {drivers}"
        verdict = memory_in_words(campaign.memory) if campaign.memory else ""
        yield table._replace(name=each.name, title=title), verdict


def _facts(found: Sequence[Found]) -> Table:
    """What was run, by which code, on what."""
    rows: list[list[Any]] = []
    for each in found:
        runs = each.runs
        commands = unique(_command(each.name, run) for run in runs)
        commits = unique(str(run.get("commit") or UNKNOWN) for run in runs)
        dates = sorted(unique(str(run["began"])[:10] for run in runs if run.get("began")))
        machines = unique(map(_machine, runs))
        rows.append([each.name, *(", ".join(values) or UNKNOWN for values in (commands, commits, dates, machines))])
    note = "Directories by their names, each with the commands that wrote it; a mission begun again is one of several."
    return Table("runs", "What was run", note, FACTS, rows)


def _command(name: str, run: Row) -> str:
    """The command of a run as it is typed, its directory without the place where that lies on one machine."""
    words = shlex.split(str(run.get("command") or ""))
    return f"`{told_command(name, {'command': typed(words)})}`" if words else UNKNOWN


def _machine(run: Row) -> str:
    machine = run.get("machine") or {}
    cpu, cores, python = (machine.get(name, UNKNOWN) for name in ("cpu", "cores", "python"))
    return f"{cpu}, {cores} cores, Python {python}"


if __name__ == "__main__":
    run_module("report", run, ReportArguments)
