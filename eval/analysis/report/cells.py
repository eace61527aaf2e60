"""The rows of several evaluations, joined into cells: one for each place, robot and method."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.analysis.compare import read_run_and_refused
from eval.analysis.report.tables import Share
from eval.analysis.summary import dials_in_words, is_result
from eval.checked import NUMBERS, is_number
from eval.contact import CONTACT_CLASSES
from eval.failure import FAILURE_CLASSES
from eval.kept import name_of, read_stored
from eval.methods import METHODS, title_of
from eval.metrics import TIMING_FIELDS
from eval.store import Row, StoredConfig
from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument

TASK = (
    "world", "region", "without", "movers", "speed", "sighted", "start", "goal", "tolerance", "time_limit",
    "obstacles", "unknown",
)  # fmt: skip
"""The fields of a row that say which task it is of."""


class Evaluation(NamedTuple):
    """An evaluation as its directory holds it."""

    name: str
    """Name of the directory."""
    source: Path
    stored: StoredConfig
    rows: list[Row]
    refused: list[Row]
    """Rows of tasks that were refused."""

    @property
    def methods(self) -> str:
        """The methods as they are typed, options included."""
        return ", ".join(f"`{title}`" for title in unique(title_of(row["method"], row) for row in self.all_rows))

    @property
    def robots(self) -> str:
        """The names of the robots."""
        return ", ".join(unique(row["robot"] for row in self.all_rows))

    @property
    def all_rows(self) -> list[Row]:
        """The rows of what was run and of what was refused."""
        return [*self.rows, *self.refused]

    @property
    def is_of_tasks(self) -> bool:
        """Whether it is of tasks of a file or a folder, not of a suite."""
        return any("task" in row for row in self.all_rows)


class Cell(NamedTuple):
    """The episodes of one method on one robot in one task."""

    place: str
    """The task in words, as ``factory 4, without V``."""
    robot: str
    method: str
    """The method as it is typed; with the hash of what decides on its bits if there are rows of several."""
    rows: dict[int, Row]
    """Rows by their seed."""
    evaluations: dict[int, Evaluation]
    """The evaluation that each row is of, by its seed."""

    @property
    def task(self) -> Row:
        """The fields that all rows share."""
        row = next(iter(self.rows.values()))
        return {name: row.get(name) for name in TASK}

    @property
    def is_plain(self) -> bool:
        """Whether the task is that of its world: all difficulties, no dial turned, its own start and goal."""
        return is_plain(self.task)

    def share(self, test: Callable[[Row], bool]) -> Share:
        """Share of the episodes of a kind."""
        return Share(sum(map(test, self.rows.values())), len(self.rows))

    def values(self, field: str) -> NDArray[np.floating]:
        """Values of a field, of the episodes that have it."""
        found = [self.rows[seed].get(field) for seed in sorted(self.rows)]
        return np.array([value for value in found if value is not None], float)


def is_plain(task: Row) -> bool:
    """Whether a task is that of its world, unchanged."""
    names = ("movers", "sighted", "start", "goal", "tolerance", "time_limit", "obstacles", "unknown")
    changed = (task.get(name) for name in names)
    return not task["without"] and task["speed"] in (None, 1.0) and all(value is None for value in changed)


def read_evaluation(source: Path) -> Evaluation:
    """Read the directory of an evaluation, complete or not, or a file of kept rows.

    Raises:
        BadArgument: It is no evaluation.
    """
    stored, (rows, refused) = read_stored(source), read_run_and_refused(source)
    for row in (*rows, *refused):
        if not (is_result(row) and _is_classified(row)):
            raise BadArgument(f"{source} has a row that is not the result of an episode: {shown(row, 500)}")
    if not (rows or refused):
        raise BadArgument(f"{source} has no episodes")
    return Evaluation(name_of(source), source, stored, rows, refused)


def _is_classified(row: Row) -> bool:
    """Whether the contact and the failure of a row, if it has any, are whole."""
    contact, failure = row.get("contact"), row.get("failure")
    return (
        contact is None
        or (
            contact.get("class") in CONTACT_CLASSES
            and isinstance(contact.get("own"), bool)
            and isinstance(contact.get("with"), str)
            and all(map(is_number, (contact.get(name) for name in _OF_A_CONTACT)))
            and (contact.get("straight_for") is None or is_number(contact["straight_for"]))
        )
    ) and (
        failure is None
        or (
            failure.get("class") in FAILURE_CLASSES
            and NUMBERS.test(failure.get("where"))
            and len(failure["where"]) == 2
            and all(map(is_number, (failure.get(name) for name in _OF_A_FAILURE)))
        )
    )


_OF_A_CONTACT = ("robot_speed", "other_speed", "closing", "bearing", "in_sight_for")
_OF_A_FAILURE = ("since", "slam_error", "detour", "mean_speed")


def cells_of(evaluations: Sequence[Evaluation]) -> list[Cell]:
    """The cells of evaluations, in an order that does not depend on that of the evaluations.

    Rows of one hash (``bits``) are joined, whatever evaluation they are of. Rows of another hash, as by other code,
    are another method; so are those of older evaluations, which have no hash.

    Raises:
        BadArgument: Two rows of one hash and one episode differ.
    """
    versions: dict[tuple[str, str], set[str]] = {}
    for evaluation in evaluations:
        for row in evaluation.rows:
            versions.setdefault(_driver(row), set()).add(_version(evaluation, row))
    cells: dict[tuple, Cell] = {}
    for evaluation in sorted(evaluations, key=lambda each: (each.name, str(each.source))):
        for row in evaluation.rows:
            robot, title = _driver(row)
            version = _version(evaluation, row)
            method = title if len(versions[robot, title]) == 1 else f"{title} ({version[:8]})"
            key = (*_order(row), robot, _rank(title), title, version)
            cell = cells.setdefault(key, Cell(place_of(row), robot, method, {}, {}))
            before = cell.rows.setdefault(row["seed"], row)
            first = cell.evaluations.setdefault(row["seed"], evaluation)
            different = [name for name in row if name not in TIMING_FIELDS and row[name] != before.get(name)]
            if different:
                raise BadArgument(
                    f"{first.source} and {evaluation.source} have the same episode of one hash with different "
                    f"{', '.join(shown(name) for name in different[:5])}: {cell.place}, {shown(robot)}, "
                    f"{shown(method)}, seed {row['seed']}; leave out the one that is wrong"
                )
    return [cells[key] for key in sorted(cells)]


def place_of(row: Row) -> str:
    """The task of a row in words: its name, if a file of tasks gave it one."""
    if "task" in row:
        return f"{row['task']}{dials_in_words(row)}"
    region = "" if row["region"] is None else f" {row['region']}"
    names = {"start": "from", "goal": "to"}
    ends = [f"{word} {_point(row[name])}" for name, word in names.items() if row[name] is not None]
    without = [f"without {row['without']}"] * bool(row["without"])
    judged = (("tolerance", " m"), ("time_limit", " s"), ("obstacles", ""), ("unknown", ""))
    changed = [
        f"{name.replace('_', ' ')} {value:g}{unit}" if isinstance(value, float | int) else f"{name} {value}"
        for name, unit in judged
        if (value := row.get(name)) is not None
    ]
    return ", ".join([f"{row['world']}{region}{dials_in_words(row)}", *without, *ends, *changed])


def families(cells: Iterable[Cell]) -> dict[tuple[str, str, str], list[Cell]]:
    """Cells whose methods are the same but for the training seed, by place, robot and the method without it.

    The training seed is the number after ``seed`` in the name of the weights, as in
    ``fusion --policy runs/seed-3/policy.safetensors``.
    """
    found: dict[tuple[str, str, str], list[Cell]] = {}
    for cell in cells:
        general = re.sub(r"(seed[-_=]?)\d+", r"\1N", cell.method)
        if general != cell.method:
            found.setdefault((cell.place, cell.robot, general), []).append(cell)
    return {key: members for key, members in found.items() if len(members) > 1}


def unique(values: Iterable[Any]) -> list[Any]:
    """The values without repetitions, in their order."""
    return list(dict.fromkeys(values))


def _driver(row: Row) -> tuple[str, str]:
    return str(row["robot"]), title_of(str(row["method"]), row)


def _version(evaluation: Evaluation, row: Row) -> str:
    return row.get("bits") or evaluation.name


def _rank(title: str) -> int:
    """Place of a method in the table of methods; others come last."""
    names = list(METHODS)
    name = title.split(" ")[0]
    return names.index(name) if name in names else len(names)


def _order(row: Row) -> tuple:
    return tuple((row.get(name) is not None, row.get(name) or 0) if name in _NUMBERS else str(row.get(name) or "")
                 for name in TASK)  # fmt: skip


_NUMBERS = ("region", "movers", "speed", "sighted")


def _point(numbers: Any) -> str:
    return " ".join("-" if number is None else f"{number:g}" for number in numbers)
