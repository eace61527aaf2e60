"""Rows that are kept for good: a compressed file for each robot and method of a suite, beside the reports.

A file is self-contained and small enough for git: its first line is the configuration, as ``config.json`` of an
evaluation has it, and each further line a row. Its name ends in the hash of what decided on the bits of its rows, so
that rows of evaluations that met disjoint seeds come together in one file. The same rows give the same bytes.
"""

import json
import lzma
import re
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from eval.methods import title_of
from eval.metrics import TIMING_FIELDS
from eval.runner import key_of
from eval.store import Row, StoredConfig, parse_config, read_config
from vuca_nav.data_files import parse_json, read_bytes, read_text
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole

SUFFIX = ".jsonl.xz"
MOST_ROWS = 2500
"""Greatest number of rows in a file, of which 4,000 fill a megabyte; more are in further files."""
MOST_BYTES = 2**30
"""Greatest size of the rows of an evaluation [bytes]: those of half a million episodes."""
_MOST_COMPRESSED = 16 * 2**20


def name_of(source: Path) -> str:
    """Name of an evaluation: that of its directory, or of its file of kept rows."""
    return source.resolve().name.removesuffix(SUFFIX)


def read_stored(source: Path) -> StoredConfig:
    """Read the configuration of an evaluation.

    Args:
        source: Its directory, or a file of kept rows.

    Raises:
        BadArgument: It is neither.
    """
    return read_config(source) if _is_directory(source) else parse_config(unpacked(source)[0], str(source))


def read_lines(source: Path) -> tuple[str, list[str]]:
    """Read the rows of an evaluation as lines of JSON, not checked; before them, the place to name in messages.

    Args:
        source: Its directory, or a file of kept rows.

    Raises:
        BadArgument: It is neither.
    """
    if not _is_directory(source):
        return str(source), unpacked(source)[1:]
    path = source / "episodes.jsonl"
    return str(path), read_text(path, BadArgument, MOST_BYTES).splitlines()


def keep_rows(sources: Sequence[Path], out: Path) -> list[Path]:
    """Write the rows of evaluations into files, beside those that the files hold already.

    Args:
        sources: Directories of evaluations, complete or not, or files of kept rows.
        out: Directory of the files.

    Returns:
        The files that were written.

    Raises:
        BadArgument: A source is no evaluation, its rows lack the hash of what decided on them, two rows of one hash and
            one episode differ, or the files cannot be written.
    """
    prepare_directory(out)
    written: dict[Path, str | bytes] = {}
    for name, cell in sorted(_cells(sources).items()):
        before = sorted(out.glob(f"{name}{SUFFIX}")) + sorted(out.glob(f"{name}-part-*{SUFFIX}"))
        for path in before:
            cell = _joined(_cells([path])[name], cell, str(path))
        rows = sorted(cell.rows.values(), key=lambda row: (row["seed"], key_of(row)))
        for k in range(0, len(rows), MOST_ROWS):
            part = f"-part-{k // MOST_ROWS + 1}" if k else ""
            members = rows[k : k + MOST_ROWS]
            seeds = [members[0]["seed"], members[-1]["seed"] + 1]
            config = {**cell.config, "seeds": seeds, "episodes": len(members)}
            head = {"config": config, "made_by": cell.made_by, "runs": cell.runs}
            text = "".join(f"{json.dumps(line, allow_nan=False)}\n" for line in (head, *members))
            written[out / f"{name}{part}{SUFFIX}"] = lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME)
    for path, content in written.items():
        write_whole(path, content)
    return list(written)


def told_command(name: str, run: Row) -> str:
    """The command of a run, its directory of results named without the place where that lies on one machine.

    Args:
        name: Name of the evaluation.
        run: Note of the run in the configuration.
    """
    words = shlex.split(str(run.get("command") or ""))
    for k, word in enumerate(words):
        flag, equals, place = word.partition("=")
        if flag != "--out":
            continue
        if equals and not place.startswith("runs/"):
            words[k] = f"--out=runs/{name}"
        elif not equals and k + 1 < len(words) and not words[k + 1].startswith("runs/"):
            words[k + 1] = f"runs/{name}"
    return shlex.join(words)


class _Cell(NamedTuple):
    """A robot and a method of a suite, with the rows of one hash."""

    config: Row
    made_by: Row
    runs: list[Row]
    rows: dict[str, Row]


def _cells(sources: Sequence[Path]) -> dict[str, _Cell]:
    """The cells of evaluations by the names of their files."""
    cells: dict[str, _Cell] = {}
    for source in sources:
        config, made_by, runs = read_stored(source)
        runs = [{**run, "command": told_command(name_of(source), run)} for run in runs]
        here: dict[str, _Cell] = {}
        for row in _rows(source):
            title = title_of(row["method"], row)
            driver = f"{row['robot']}, {title}"
            name = re.sub(r" --|[^\w.+-]+", "-", f"{config.get('suite')}-{row['robot']}-{title}-{row['bits']}")
            if name not in here:
                own = {"robots": [row["robot"]], "methods": [title]}
                own["configurations"] = {title: config.get("configurations", {}).get(title)}
                settings = {driver: made_by.get("settings", {}).get(driver)}
                here[name] = _Cell({**config, **own}, {**made_by, "settings": settings}, runs, {})
            here[name].rows[key_of(row)] = row
        for name, cell in here.items():
            cells[name] = _joined(cells[name], cell, str(source)) if name in cells else cell
    return cells


def _joined(first: _Cell, second: _Cell, source: str) -> _Cell:
    """The rows of both; an episode that both have must be the same to the bit, but for the computer's times."""
    for key in first.rows.keys() & second.rows.keys():
        one, other = ({k: v for k, v in cell.rows[key].items() if k not in TIMING_FIELDS} for cell in (first, second))
        if one != other:
            raise BadArgument(f"{source}: seed {one['seed']} has two rows of one hash that differ: {one} and {other}")
    tasks = _union(first.config.get("tasks", []), second.config.get("tasks", []))
    runs = sorted(_union(first.runs, second.runs), key=lambda run: str(run.get("began")))
    return _Cell({**first.config, "tasks": tasks}, first.made_by, runs, {**second.rows, **first.rows})


def _union(first: list[Any], second: list[Any]) -> list[Any]:
    return first + [each for each in second if each not in first]


def _rows(source: Path) -> Iterator[Row]:
    place, lines = read_lines(source)
    for number, line in enumerate(lines, start=1):
        row = parse_json(line, f"{place}: row {number}", BadArgument)
        if not isinstance(row, dict) or not {"method", "robot", "seed", "bits"} <= row.keys():
            raise BadArgument(f"{place}: row {number} does not say what decided on its bits; run vuca eval again")
        yield row


def _is_directory(source: Path) -> bool:
    return not source.name.endswith(SUFFIX) or source.is_dir()


def unpacked(source: Path) -> list[str]:
    """The lines of a compressed file.

    Raises:
        BadArgument: It is none, or not whole.
    """
    try:
        decompressor = lzma.LZMADecompressor(memlimit=2**28)
        content = decompressor.decompress(read_bytes(source, _MOST_COMPRESSED, BadArgument), max_length=MOST_BYTES)
        lines = content.decode().splitlines()
    except (lzma.LZMAError, UnicodeDecodeError) as error:
        raise BadArgument(f"{source} is not a file of kept rows: {error}") from error
    if not decompressor.eof or not lines:
        raise BadArgument(f"{source} is not a whole file of kept rows")
    return lines
