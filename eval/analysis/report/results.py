"""The tables of measurements: outcomes, measures, contacts, failures, paired tests, and the cost of the body."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.analysis.report.cells import Cell, families, unique
from eval.analysis.report.tables import Column, Share, Table, Value
from eval.analysis.statistics import (
    Estimate,
    holm,
    interquartile_mean,
    mcnemar_exact,
    mcnemar_mid_p,
    paired_difference,
    paired_e_value,
)
from eval.contact import CONTACT_CLASSES
from eval.episode import OUTCOMES
from eval.failure import FAILURE_CLASSES
from eval.methods import BEST
from eval.store import Row

WHERE = (Column("world"), Column("robot"), Column("method"))
MEASURES = (
    Column("arriving_time", 1),
    Column("spl", 3),
    Column("path_length", 1),
    Column("arsps", 4),
    Column("ansps", 6),
)
"""Fields of a row that are averaged, and the digits that are shown."""
ANY_TIME = 20.0
"""The E-value at which a run may be stopped: 1 / alpha for alpha = 0.05."""


def tables_of(cells: Sequence[Cell]) -> list[Table]:
    """All tables of measurements; those without rows are left out."""
    tables = [outcomes(cells), measures(cells), paired_tests(cells), contacts(cells), failures(cells), bodies(cells)]
    return [table for table in tables if table.rows]


def outcomes(cells: Sequence[Cell]) -> Table:
    """How the episodes ended."""
    rows: list[list[Value]] = [
        [*_where(cell), len(cell.rows), *(cell.share(_ended(outcome)) for outcome in OUTCOMES)] for cell in cells
    ]
    columns = (*WHERE, Column("episodes"), *map(Column, OUTCOMES))
    return Table("outcomes", "Outcomes", "Counts, with Wilson's 95% intervals of the shares.", columns, rows)


def measures(cells: Sequence[Cell]) -> Table:
    """Interquartile means of the continuous measures, for each cell, for all worlds, and over training seeds."""
    rows: list[list[Value]] = []
    for cell in cells:
        rows.append([*_where(cell), "episodes", len(cell.rows), *_interquartile(_by_field([cell]))])
    for robot, method in unique((cell.robot, cell.method) for cell in cells):
        members = [cell for cell in cells if (cell.robot, cell.method) == (robot, method) and cell.is_plain]
        if len(members) > 1:
            n = sum(len(cell.rows) for cell in members)
            rows.append(["all worlds", robot, method, "episodes", n, *_interquartile(_by_field(members))])
    for (place, robot, method), members in families(cells).items():
        means = {
            column.title: [np.array([v.mean() for cell in members if len(v := cell.values(column.title))])]
            for column in MEASURES
        }
        rows.append([place, robot, method, "training seeds", len(members), *_interquartile(means)])
    note = (
        "Interquartile means, with 95% intervals of a stratified bootstrap (Agarwal et al. 2021, rliable): over the "
        "seeds of episodes, or, where a method's weights are of several training seeds, over those, each by its mean. "
        "The strata are the worlds. The time [s] is of the episodes that arrived, all else of all: SPL, the path's "
        "length [m], the average risk score per step (ARSPS, less is better) and the average navigation score per step "
        "(ANSPS)."
    )
    titles = ("time [s]", "SPL", "path [m]", "ARSPS", "ANSPS")
    columns = (*WHERE, Column("over"), Column("n"), *(c._replace(title=t) for c, t in zip(MEASURES, titles)))
    return Table("measures", "Time, path and risk", note, columns, rows)


def paired_tests(cells: Sequence[Cell], against: str = BEST) -> Table:
    """Paired tests of each method against one, in each place on each robot."""
    rows: list[list[Value]] = []
    for place, robot in unique((cell.place, cell.robot) for cell in cells):
        here = [cell for cell in cells if (cell.place, cell.robot) == (place, robot)]
        reference = next((cell for cell in here if cell.method == against), here[0])
        pairs = [(cell, paired(reference, cell)) for cell in here if cell is not reference]
        pairs = [(cell, pair) for cell, pair in pairs if pair.n]
        adjusted = holm([pair.exact for _, pair in pairs])
        for (cell, pair), p in zip(pairs, adjusted, strict=True):
            collisions = paired(reference, cell, "collision").difference
            names = [*_where(cell), reference.method, pair.n, pair.gained, pair.lost]
            tested = [pair.exact, pair.mid, p, _e_value(pair.e_value)]
            rows.append([*names, _points(pair.difference), *tested, _points(collisions)])
    note = (
        "Episodes of the same seed, in pairs. Only the episodes count in which just one of the two arrives: they are "
        "as likely the one's as the other's if the methods are equally good (McNemar's exact test, and its mid-p). "
        "Holm's p is the exact one, adjusted for the number of methods in that world on that robot. E is the evidence "
        f"of a run that is looked at while it goes on: at {ANY_TIME:g} it may be stopped, at any time, with an error "
        "of at most 5%. Differences are in points of a hundred, with Agresti and Min's 95% intervals."
    )
    columns = (
        *WHERE, Column("against"), Column("pairs"), Column("only it arrives"), Column("only the other"),
        Column("success", 0, True), Column("p", 4), Column("mid-p", 4), Column("Holm's p", 4), Column("E"),
        Column("collision", 0, True),
    )  # fmt: skip
    return Table("tests", "Paired tests", note, columns, rows)


def contacts(cells: Sequence[Cell]) -> Table:
    """Contacts by class, and by own fault."""
    rows: list[list[Value]] = []
    for cell in cells:
        collisions = [row for row in cell.rows.values() if row["outcome"] == "collision"]
        told = [row["contact"] for row in collisions if row.get("contact") is not None]
        if not collisions:
            continue
        counts = Counter(contact["class"] for contact in told)
        own = Share(sum(contact["own"] for contact in told), len(told))
        classes = [counts[name] for name in CONTACT_CLASSES]
        rows.append([*_where(cell), len(cell.rows), len(collisions), *classes, len(collisions) - len(told), own])
    note = (
        "What each collision was: with something that stood (static), of a robot that stood (stopped) or moved away "
        "(yielding), else where it was touched. Own: the robot's point of contact closed in on the other at more than "
        "0.05 m/s, with the 95% interval of its share in the collisions; the other contacts came to a robot that "
        "stood, gave way or passed."
    )
    columns = (
        *WHERE, Column("episodes"), Column("collisions"), *map(Column, CONTACT_CLASSES), Column("not classified"),
        Column("own"),
    )  # fmt: skip
    return Table("contacts", "Contacts", note, columns, rows)


def failures(cells: Sequence[Cell]) -> Table:
    """Missions that neither arrived nor touched something, by class."""
    rows: list[list[Value]] = []
    for cell in cells:
        missed = [row for row in cell.rows.values() if row["outcome"] in ("fall", "timeout")]
        if missed:
            counts = Counter(row["failure"]["class"] for row in missed if row.get("failure") is not None)
            classes = [counts[name] for name in FAILURE_CLASSES]
            rows.append([*_where(cell), len(cell.rows), len(missed), *classes, len(missed) - sum(classes)])
    note = (
        "Why missions that touched nothing did not arrive: the body fell; nothing as fast could have arrived "
        "(unreachable); the pose was lost; the robot was stuck in one place; or it was on its way when the time ended."
    )
    names = [name.replace("_", " ") for name in FAILURE_CLASSES]
    columns = (*WHERE, Column("episodes"), Column("did not arrive"), *map(Column, names), Column("not classified"))
    return Table("failures", "Missions that did not arrive", note, columns, rows)


def bodies(cells: Sequence[Cell], first: str = "tiago") -> Table:
    """The cost of the body: every other robot against the first, with the same method in the same episodes."""
    rows: list[list[Value]] = []
    for cell in cells:
        other = find(cells, cell.place, first, cell.method)
        if cell.robot == first or other is None or not (pair := paired(other, cell)).n:
            continue
        collisions, falls = (_points(paired(other, cell, name).difference) for name in ("collision", "fall"))
        numbers = [pair.n, _points(pair.difference), pair.exact, collisions, falls]
        rows.append([*_where(cell), first, *numbers, later([(other, cell)])])
    note = (
        "What a method does on one robot, less what it does on the other with the same seeds: points of a hundred with "
        "Agresti and Min's 95% intervals, p of McNemar's exact test, and the interquartile mean of the differences of "
        "the arriving times [s] where both arrive."
    )
    columns = (
        *WHERE, Column("against"), Column("pairs"), Column("success", 0, True), Column("p", 4),
        Column("collision", 0, True), Column("fall", 0, True), Column("time [s]", 1, True),
    )  # fmt: skip
    return Table("bodies", "The cost of the body", note, columns, rows)


class Pair(NamedTuple):
    """Two methods in the same episodes."""

    n: int
    gained: int
    """Episodes that only the second ends so."""
    lost: int
    """Episodes that only the first ends so."""
    difference: Estimate | None
    """Share of the second less that of the first."""
    exact: float
    mid: float
    e_value: float


def paired(first: Cell, second: Cell, outcome: str = "success") -> Pair:
    """The pairs of two cells: how often each ends in an outcome."""
    a, b, _ = ended([(first, second)], outcome)
    difference = Estimate(*paired_difference(a, b)) if len(a) else None
    gained, lost = int((b & ~a).sum()), int((a & ~b).sum())
    e_value = paired_e_value(gained, lost)
    return Pair(len(a), gained, lost, difference, mcnemar_exact(a, b), mcnemar_mid_p(a, b), e_value)


def ended(pairs: Sequence[tuple[Cell, Cell]], outcome: str) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray]:
    """Whether the episodes that both cells of a pair have ended in an outcome: the first's, the second's, the seeds."""
    found = [
        (first.rows[seed]["outcome"] == outcome, second.rows[seed]["outcome"] == outcome, seed)
        for first, second in pairs
        for seed in sorted(first.rows.keys() & second.rows.keys())
    ]
    a, b, seeds = zip(*found, strict=True) if found else ((), (), ())
    return np.array(a, np.bool_), np.array(b, np.bool_), np.array(seeds)


def later(pairs: Sequence[tuple[Cell, Cell]]) -> Estimate | None:
    """Interquartile mean of how much later the second arrives, where both arrive [s]; the strata are the pairs."""
    strata = []
    for first, second in pairs:
        times = [
            (first.rows[seed].get("arriving_time"), second.rows[seed].get("arriving_time"))
            for seed in sorted(first.rows.keys() & second.rows.keys())
        ]
        strata.append(np.array([b - a for a, b in times if a is not None and b is not None], float))
    return interquartile_mean(strata)


def find(cells: Sequence[Cell], place: str, robot: str, method: str) -> Cell | None:
    """The cell of a place, a robot and a method; None if there is none."""
    return next((cell for cell in cells if (cell.place, cell.robot, cell.method) == (place, robot, method)), None)


def _where(cell: Cell) -> list[Value]:
    return [cell.place, cell.robot, cell.method]


def _ended(outcome: str) -> Callable[[Row], bool]:
    return lambda row: row["outcome"] == outcome


def _by_field(cells: Sequence[Cell]) -> dict[str, list[NDArray[np.floating]]]:
    return {column.title: [cell.values(column.title) for cell in cells] for column in MEASURES}


def _interquartile(strata: dict[str, list[NDArray[np.floating]]]) -> list[Value]:
    return [interquartile_mean(strata[column.title]) for column in MEASURES]


def _points(difference: Estimate | None) -> Estimate | None:
    return None if difference is None else Estimate(*(100.0 * part for part in difference))


def _e_value(value: float) -> str:
    return f"{value:.3g}"
