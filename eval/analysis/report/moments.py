"""The table of the last moments at which collisions could be avoided, as ``vuca explain DIR --all`` finds them."""

import itertools
from collections.abc import Sequence

from eval.analysis.attribution import EARLIEST
from eval.analysis.report.cells import place_of
from eval.analysis.report.tables import Column, Table, Value
from eval.methods import title_of
from eval.store import Row

WITHIN = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Bounds of the table's columns [s]."""


def moments_table(moments: Sequence[Row]) -> Table:
    """Collisions by how long before the contact they could last be avoided; own ones and others apart."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in moments:
        groups.setdefault((place_of(row), str(row["robot"]), title_of(str(row["method"]), row)), []).append(row)
    lines: list[list[Value]] = []
    for names, members in sorted(groups.items()):
        faults = {"own": True, "not own": False, "unknown": None}
        by_fault = {name: [row for row in members if _is_own(row) is value] for name, value in faults.items()}
        for name, found in {"all": members, **by_fault}.items():
            if found:
                lines.append([*names, name, *_counts(found)])
    titles = (
        "world", "robot", "method", "fault", "collisions", *(f"to {bound:g} s" for bound in WITHIN), "earlier", "never",
        "uncertain", "not repeated",
    )  # fmt: skip
    note = (
        "Time before the contact at which other commands could last avoid it, with all that moves known "
        "(t_inevitable), in steps of half a second; earlier: up to 10 s; never: no way was found in 10 s. Own: the "
        "robot's point of contact closed in on the other. Of the uncertain ones a later moment may exist, since the "
        "search gave up or the body did not follow it. Not repeated: the run now differs from the row's, which other "
        "code made."
    )
    return Table("moments", "Last avoidable moments", note, tuple(map(Column, titles)), lines)


def _is_own(row: Row) -> bool | None:
    return None if row.get("contact") is None else bool(row["contact"].get("own"))


def _counts(rows: Sequence[Row]) -> list[Value]:
    repeated = [row for row in rows if row.get("contact") is not None]
    found = [row["t_inevitable"] for row in repeated if row["t_inevitable"] is not None]
    counts = [sum(low < each <= high for each in found) for low, high in itertools.pairwise((0.0, *WITHIN, EARLIEST))]
    uncertain = sum(row.get("t_inevitable_is_certain") is False for row in repeated)
    other = sum(row.get("contact") is None or row.get("is_repeated") is False for row in rows)
    return [len(rows), *counts, len(repeated) - len(found), uncertain, other]
