"""The last avoidable moments of all collisions of an evaluation: ``vuca explain DIR --all``."""

import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from eval.analysis.attribution import EARLIEST, NotRepeated, config_of, explain
from eval.analysis.report.tables import Column, Table, Value
from eval.analysis.summary import dials_in_words
from eval.episode import CONFIG_FIELDS
from eval.methods import title_of
from eval.runner import key_of
from eval.store import Row
from vuca_nav.files import prepare_directory, write_whole

FILE = "moments.jsonl"
WITHIN = (0.5, 1.0, 1.5, 2.0)
"""Bounds of the table's columns [s]."""


def find_moments(rows: Sequence[Row], out: Path) -> list[Row]:
    """Find the last avoidable moment of every collision; begun again, it goes on where it was.

    Args:
        rows: Rows of episodes, of which those that ended in a collision are run again.
        out: Directory of ``moments.jsonl``, which gets a line for each.

    Returns:
        Of each collision the fields that name the episode, ``contact``, ``t_inevitable`` [s] (None if no moment was
        found in 10 s), ``t_inevitable_is_certain``, and ``is_repeated``: whether the run came out as the row says.

    Raises:
        VucaError: An episode cannot be run, or the file cannot be written.
    """
    prepare_directory(out)
    path = out / FILE
    known = _read(path)
    collisions = [row for row in rows if row["outcome"] == "collision"]
    todo = [row for row in collisions if key_of(row) not in known]
    for row in tqdm(
        todo, initial=len(collisions) - len(todo), total=len(collisions), unit="collision", file=sys.stderr
    ):
        known[key_of(row)] = _moment_of(row)
        write_whole(path, "".join(f"{json.dumps(each, allow_nan=False)}\n" for each in known.values()))
    return [known[key_of(row)] for row in collisions]


def moments_table(moments: Sequence[Row]) -> Table:
    """Collisions by how long before the contact they could last be avoided, for each world, robot and method."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in moments:
        region = "" if row.get("region") is None else f" {row['region']}"
        world = f"{row['world']}{region}{dials_in_words(row)}"
        groups.setdefault((world, str(row["robot"]), title_of(str(row["method"]), row)), []).append(row)
    titles = ("world", "robot", "method", "collisions", *(f"to {bound:g} s" for bound in WITHIN), "earlier", "never")
    lines: list[list[Value]] = []
    for names, of in groups.items():
        found = [row["t_inevitable"] for row in of if row["t_inevitable"] is not None]
        edges = (0.0, *WITHIN, EARLIEST)
        counts = [sum(low < each <= high for each in found) for low, high in itertools.pairwise(edges)]
        lines.append([*names, len(of), *counts, len(of) - len(found)])
    note = "Time before the contact at which other commands could last avoid it; never: no way was found in 10 s."
    return Table("moments", "Last avoidable moments", note, tuple(map(Column, titles)), lines)


def _moment_of(row: Row) -> dict[str, Any]:
    named = {name: row.get(name) for name in CONFIG_FIELDS}
    try:
        now = explain(config_of(row)).row()
    except NotRepeated:
        now = {}
    is_repeated = all(now.get(name) == row.get(name) for name in ("outcome", "duration", "path_length"))
    told = {name: now.get(name) for name in ("contact", "t_inevitable", "t_inevitable_is_certain")}
    return {**named, **told, "is_repeated": is_repeated}


def _read(path: Path) -> dict[str, Row]:
    """The moments that were found before, by episode; a torn last line is left out."""
    if not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    return {key_of(row): row for row in map(json.loads, lines)}
