"""The failed episodes of a report, each with its picture and the commands that explain and record it."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from eval import contact, failure
from eval.analysis.report.cells import Cell, Evaluation
from eval.analysis.report.tables import Column, Table, Value
from eval.kept import SUFFIX
from eval.methods import is_users_own, title_of
from eval.recordings import file_name
from eval.store import Row


class Failed(NamedTuple):
    """A failed episode."""

    cell: Cell
    row: Row
    evaluation: Evaluation
    picture: Path | None
    """The picture that ``vuca explain`` drew beside the rows, if there is one."""

    @property
    def seed(self) -> int:
        """The seed of the episode."""
        return self.row["seed"]

    @property
    def words(self) -> str:
        """Why it failed, in short."""
        if (touched := self.row.get("contact")) is not None:
            fault = "own" if touched["own"] else "not own"
            return f"{touched['class']}, {fault}" + (f", {touched['with']}" if touched.get("with") else "")
        if (missed := self.row.get("failure")) is not None:
            return missed["class"].replace("_", " ")
        return "not classified"

    @property
    def explain(self) -> str | None:
        """The command that explains it; None for kept rows, which it does not read."""
        if self.evaluation.source.name.endswith(SUFFIX):
            return None
        filters = ("world", "region", "robot", "method", "without", "movers", "speed", "sighted", "task")
        words = ["vuca", "explain", f"runs/{self.evaluation.name}", str(self.seed), *_flags(self.row, filters)]
        return shlex.join(words)

    @property
    def record(self) -> str:
        """The command that runs it again and records it."""
        scene = (
            "world", "region", "seed", "without", "movers", "speed", "sighted", "start", "goal", "tolerance",
            "time_limit", "obstacles", "unknown", "map", "robot",
        )  # fmt: skip
        words = [
            "vuca",
            "run",
            *_flags(self.row, scene),
            "--method",
            *shlex.split(title_of(self.row["method"], self.row)),
        ]
        words += ["--trust"] * is_users_own(self.row["method"])
        return shlex.join([*words, "--record", file_name(self.row)])


def failed_episodes(cells: Sequence[Cell]) -> list[Failed]:
    """All failed episodes: those of each cell with a picture first, then by seed."""
    names: dict[Path, int] = {}
    for cell in cells:
        for seed, row in cell.rows.items():
            place = _picture(cell.evaluations[seed], row)
            names[place] = names.get(place, 0) + 1
    found = []
    for cell in cells:
        members = []
        for seed, row in sorted(cell.rows.items()):
            if row["outcome"] == "success":
                continue
            path = _picture(cell.evaluations[seed], row)
            is_its_own = names[path] == 1 and path.is_file()  # of two episodes of one name it is not known whose it is
            members.append(Failed(cell, row, cell.evaluations[seed], path if is_its_own else None))
        found += sorted(members, key=lambda each: each.picture is None)
    return found


def failed_table(failed: Sequence[Failed]) -> Table:
    """The failed episodes as a table."""
    rows: list[list[Value]] = [
        [each.cell.place, each.cell.robot, each.cell.method, each.seed, each.row["outcome"], each.words, each.record]
        for each in failed
    ]
    titles = ("world", "robot", "method", "seed", "outcome", "why", "recorded by")
    return Table(
        "failed", "Failed episodes", "Each with the command that records it.", tuple(map(Column, titles)), rows
    )


def in_detail(row: Row) -> str:
    """Why an episode failed, in sentences."""
    if row.get("contact") is not None:
        return contact.in_words(row["contact"])
    if row.get("failure") is not None:
        return failure.in_words(row["failure"])
    return "not classified: the row is of an older version"


def _picture(evaluation: Evaluation, row: Row) -> Path:
    beside = evaluation.source if evaluation.source.is_dir() else evaluation.source.parent
    return (beside / "explained" / file_name(row)).with_suffix(".png")


def _flags(row: Row, names: Sequence[str]) -> list[str]:
    """Fields of a row as flags, those that have their default left out."""
    words = []
    for name in names:
        value = row.get(name)
        if value is None or value == "" or (name, value) == ("speed", 1.0):
            continue
        values = value if isinstance(value, list) else [value]
        words += [f"--{name.replace('_', '-')}", *map(str, values)]
    return words
