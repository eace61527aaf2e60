"""The choice of the default method: ``ours`` against ``ours-dh`` in the same episodes of all suites."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eval.analysis.report.cells import Cell, Evaluation, cells_of
from eval.analysis.report.results import ended, find, later
from eval.analysis.report.tables import Column, Share, Table, Value
from eval.analysis.statistics import Estimate, holm, mcnemar_exact, paired_difference
from eval.suites import SUITES

FIRST, SECOND = "ours-dh", "ours"
ALPHA = 0.05
ALL = "all"
NOTE = "\n\n".join(
    (
        f"{SECOND} less {FIRST} in the same episodes of all suites: points of a hundred with Agresti and Min's 95% "
        "intervals, p of McNemar's exact test; a seed that several tasks have counts once in both. The time is the "
        "interquartile mean of the differences where both arrive. In all suites together each seed weighs the same, "
        "and in it each task.",
        "Better is the one that arrives more often: of all suites together if p is below 0.05, of one suite if Holm's "
        "p, adjusted for the number of suites and robots, is. The default is to be the one that is better in all "
        "suites together on all robots, and in no suite worse.",
    )
)


class _Pairs(NamedTuple):
    """The episodes that both methods have, of a suite and a robot, or of all."""

    suite: str
    robot: str
    pairs: list[tuple[Cell, Cell]]


def default_table(evaluations: Sequence[Evaluation]) -> Table:
    """The comparison of both methods: for all suites together and for each, on all robots and on each."""
    suites = {str(each.stored.config.get("suite")) for each in evaluations}
    names = sorted(suites, key=lambda name: (list(SUITES).index(name) if name in SUITES else len(SUITES), name))
    groups = _groups(ALL, cells_of(evaluations))
    for name in names:
        members = [each for each in evaluations if str(each.stored.config.get("suite")) == name]
        groups += _groups(name, cells_of(members))
    if all(group.suite == ALL for group in groups):
        return Table("default", "Which default", NOTE, (), [])
    tested = [_tests(group) for group in groups]
    single = [k for k, group in enumerate(groups) if group.suite != ALL and group.robot != ALL]
    adjusted = dict(zip(single, holm([tested[k][1] for k in single])))
    rows: list[list[Value]] = []
    better: list[str] = []
    for k, (group, (cells, p)) in enumerate(zip(groups, tested)):
        decides = adjusted.get(k, p if group.suite == ALL else None)
        better.append(_better(group, decides))
        rows.append([group.suite, group.robot, *cells, p, adjusted.get(k), better[-1] or None])
    titles = ("suite", "robot", "pairs", "seeds", FIRST, SECOND)
    columns = (
        *map(Column, titles), Column("success", 0, True), Column("collision", 0, True), Column("time [s]", 1, True),
        Column("p", 4), Column("Holm's p", 4), Column("better"),
    )  # fmt: skip
    answer = _answer(list(zip(groups, better)))
    return Table("default", "Which default", f"{NOTE}\n\nAnswer: {answer}.", columns, rows)


def _groups(suite: str, cells: Sequence[Cell]) -> list[_Pairs]:
    """The pairs on all robots, if there are several, and on each."""
    firsts = [cell for cell in cells if cell.method == FIRST]
    found = [(first, find(cells, first.place, first.robot, SECOND)) for first in firsts]
    pairs = [(a, b) for a, b in found if b is not None and a.rows.keys() & b.rows.keys()]
    robots = sorted({first.robot for first, _ in pairs})
    groups = [_Pairs(suite, robot, [pair for pair in pairs if pair[0].robot == robot]) for robot in robots]
    return [_Pairs(suite, ALL, pairs), *groups] if len(robots) > 1 else groups


def _tests(group: _Pairs) -> tuple[list[Value], float]:
    """The cells of a line that are measured, and p."""
    first, second, seeds = ended(group.pairs, "success")
    collided = ended(group.pairs, "collision")
    shares = (Share(int(each.sum()), len(each)) for each in (first, second))
    cells: list[Value] = [len(seeds), len(np.unique(seeds)), *shares]
    differences = [paired_difference(first, second, seeds), paired_difference(*collided)]
    cells += [Estimate(*(100.0 * part for part in each)) for each in differences]
    return [*cells, later(group.pairs)], mcnemar_exact(first, second, seeds)


def _better(group: _Pairs, p: float | None) -> str:
    """The method that arrives more often; none if that may be chance, or is not asked."""
    if p is None:
        return ""
    first, second, seeds = ended(group.pairs, "success")
    if p >= ALPHA:
        return "undecided"
    return SECOND if paired_difference(first, second, seeds)[0] > 0.0 else FIRST


def _answer(found: Sequence[tuple[_Pairs, str]]) -> str:
    together = [better for group, better in found if group.suite == ALL]
    alone = [(group, better) for group, better in found if group.suite != ALL and better in (FIRST, SECOND)]
    for method in (FIRST, SECOND):
        worse = [f"{group.suite} on {group.robot}" for group, better in alone if better != method]
        if all(better == method for better in together):
            return method if not worse else f"{method} in all suites together, but it is worse in {', '.join(worse)}"
    told = [f"{better} in {group.suite} on {group.robot}" for group, better in alone]
    return "; ".join(["undecided: neither is better in all suites together on all robots", *told])
