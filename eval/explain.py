"""``vuca explain``: one failed episode of an evaluation, run again, in words, as a recording and as a picture."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eval import contact, failure
from eval.analysis.attribution import EARLIEST, SURVIVED, Explanation, config_of
from eval.analysis.attribution import explain as run_again
from eval.checked import ROW_KINDS, check_values
from eval.episode import CONFIG_FIELDS
from eval.kept import MOST_BYTES
from eval.methods import title_of
from eval.progress import ProgressLine
from eval.recordings import file_name
from eval.store import Row
from vuca_nav.data_files import parse_json, read_text
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory

_DIFFERS = ("outcome", "duration", "path_length")
"""Fields by which a row is told to be of another run than the one now."""


@dataclass(frozen=True, slots=True)
class Explained:
    """The answer of ``vuca explain``."""

    text: str
    """The answer in words."""
    row: Row
    """The row of the run now, ``t_inevitable``, and the files."""


def find_rows(source: Path, filters: dict[str, Any]) -> list[Row]:
    """The rows of episodes.

    Args:
        source: Directory of an evaluation, or a file with rows among other lines.
        filters: Fields that the rows must have.

    Raises:
        BadArgument: There are none.
    """
    path = source / "episodes.jsonl" if source.is_dir() else source
    rows = [row for row in _read(path) if all(row.get(key) == value for key, value in filters.items())]
    if not rows:
        asked = ", ".join(f"{key} {value}" for key, value in filters.items())
        raise BadArgument(
            f"{path} has no rows of episodes{' of ' if asked else ''}{asked}; give the directory of a vuca eval"
        )
    return rows


def find_row(source: Path, seed: int | None, filters: dict[str, Any]) -> Row:
    """The row of the episode to explain.

    Args:
        source: Directory of an evaluation, or a file with rows among other lines.
        seed: Seed of the episode; None if there is only one.
        filters: Further fields that the row must have.

    Raises:
        BadArgument: No such episode, several of them, or one that arrived.
    """
    path = source / "episodes.jsonl" if source.is_dir() else source
    rows = _read(path)
    if not rows:
        raise BadArgument(f"{path} has no rows of episodes; give the directory of a vuca eval")
    of_seed = [row for row in rows if seed is None or row["seed"] == seed]
    if not of_seed:
        raise BadArgument(f"{path} has no seed {seed}; {_failed(rows)}")
    fitting = [row for row in of_seed if all(row.get(key) == value for key, value in filters.items())]
    if not fitting:
        asked = ", ".join(f"{key} {value}" for key, value in filters.items())
        raise BadArgument(f"{path} has no episode of {asked}{'' if seed is None else f' with seed {seed}'}")
    if len(fitting) > 1:
        names = [key for key in (*CONFIG_FIELDS, "task") if len({json.dumps(row.get(key)) for row in fitting}) > 1]
        values = [f"{key} ({', '.join(sorted({str(row.get(key)) for row in fitting})[:8])})" for key in names]
        raise BadArgument(
            f"{path} has {len(fitting)} such episodes; choose by {' and '.join(values) or 'another file'}"
        )
    (row,) = fitting
    if row["outcome"] == "success":
        raise BadArgument(f"seed {row['seed']} arrived, there is nothing to explain; {_failed(rows)}")
    return row


def explain_row(row: Row, out: Path, *, trust: bool = False) -> Explained:
    """Run the episode of a row again, and say why it failed.

    Args:
        row: A row of an episode that failed.
        out: Directory of the recording and the picture.
        trust: Whether motions of the user's own, in its scene file, may be run.

    Raises:
        VucaError: The episode cannot be run, or a file cannot be written.
    """
    from eval.analysis.picture import draw
    from vuca_nav.telemetry.rerun.recorder import RerunTelemetry

    config = config_of(row, trust=trust)
    prepare_directory(out)
    recording = out / file_name(row)
    picture = recording.with_suffix(".png")
    method = title_of(config.method, config.options.given())
    telemetry = RerunTelemetry.record(recording, title=f"{config.world}, {config.robot}, {method}, seed {config.seed}")

    def searching(before: float, most: float) -> None:
        print(
            f"searching a way from {before:g} s before the contact, of at most {most:g} s", file=sys.stderr, flush=True
        )

    try:
        with ProgressLine(sys.stderr) as progress:
            explanation = run_again(config, telemetry, progress, searching)
    finally:
        telemetry.close()
    draw(explanation, picture)
    lines = [*_words(row, explanation), f"recording: {recording}", f"picture: {picture}"]
    files = {"recording": str(recording), "picture": str(picture)}
    return Explained("\n".join(lines), explanation.row() | files)


def _words(row: Row, explanation: Explanation) -> list[str]:
    now = explanation.result.row()
    lines = [f"{now['outcome']} after {now['duration']:.2f} s and {now['path_length']:.1f} m"]
    different = [key for key in _DIFFERS if row.get(key) != now[key]]
    if different:
        told = ", ".join(f"{key} {row.get(key)}" for key in different)
        lines.append(f"the row, by other code or on another machine, has {told}: what follows is of the run now")
    if now["contact"] is not None:
        lines += contact.in_words(now["contact"]).splitlines()
    if now["failure"] is not None:
        lines.append(failure.in_words(now["failure"]))
    found = explanation.avoidable
    if found is None:
        return lines
    at = explanation.result.duration
    if found.seconds is None:
        lines.append(
            f"inevitable: no way was found that survives, from up to {min(EARLIEST, at):g} s before the contact"
        )
    else:
        lines.append(
            f"last avoidable {found.seconds:g} s before the contact (t_inevitable), at {at - found.seconds:.2f} s: "
            f"other commands from there on, driven in the simulation, touch nothing until {SURVIVED:g} s after it"
        )
    if not found.is_certain:
        lines.append("the search gave up on some later moments, or the body did not follow it: a later one may exist")
    return lines


def _read(path: Path) -> list[Row]:
    rows = []
    for number, line in enumerate(read_text(path, BadArgument, MOST_BYTES).splitlines(), start=1):
        if not line.startswith("{"):
            continue
        try:
            row = parse_json(line, str(path), BadArgument)
        except BadArgument:
            continue  # the torn last line of an evaluation that was killed
        if {"outcome", "seed", "world", "robot", "method"} <= row.keys():
            check_values(row, ROW_KINDS, f"{path}: line {number}")
            rows.append(row)
    return rows


def _failed(rows: list[Row]) -> str:
    seeds = sorted({row["seed"] for row in rows if row["outcome"] != "success"})
    if not seeds:
        return "no episode failed there"
    shown = ", ".join(map(str, seeds[:12]))
    return f"failed there: {shown}{', ...' if len(seeds) > 12 else ''}"
