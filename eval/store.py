"""The directory of an evaluation: its configuration, a row an episode, its summary. It survives a kill.

``config.json`` holds the evaluation and the code that runs it, which never change, and notes each run of the command
with its machine; ``episodes.jsonl`` gets a row as an episode ends; ``summary.json`` is written at the end.
"""

import json
import os
import sys
from collections.abc import Iterable
from io import RawIOBase
from pathlib import Path
from typing import Any, NamedTuple

from eval.checked import CONFIG_KINDS, RUN_KINDS, check_values
from vuca_nav.data_files import parse_json, read_text
from vuca_nav.errors import BadArgument
from vuca_nav.files import DirectoryLock, check_regular, write_whole
from vuca_nav.provenance import machine

Row = dict[str, Any]


class StoredConfig(NamedTuple):
    """The content of ``config.json``."""

    config: Row
    """Suite, robots, methods and episodes that are run."""
    made_by: Row
    """What decides on the bits of its rows: code, libraries, settings."""
    runs: list[Row]
    """Each run of the command: ``began``, ``command``, ``machine``, ``commit``."""


def read_config(directory: Path) -> StoredConfig:
    """Read the configuration of an evaluation.

    Raises:
        BadArgument: The file is missing, or is not the configuration of an evaluation.
    """
    path = directory / "config.json"
    return parse_config(read_text(path, BadArgument), str(path))


def parse_config(text: str, source: str) -> StoredConfig:
    """The configuration of an evaluation, from the text of ``config.json``.

    Raises:
        BadArgument: The text is not the configuration of an evaluation.
    """
    wrong = f"{source} is not the configuration of an evaluation"
    stored = parse_json(text, wrong, BadArgument)
    parts = stored if isinstance(stored, dict) else {}
    config, made_by, runs = parts.get("config"), parts.get("made_by"), parts.get("runs", [])
    if not (isinstance(config, dict) and isinstance(made_by, dict) and isinstance(runs, list)):
        raise BadArgument(wrong)
    check_values(config, CONFIG_KINDS, wrong)
    for run in runs:
        check_values(run, RUN_KINDS, f"{wrong}: a run")
    return StoredConfig(config, made_by, runs)


class ResultStore:
    """Directory of one evaluation, opened for writing; use it as a context manager.

    Args:
        directory: Made if it does not exist; locked while the store is open.
        config: The evaluation. A directory that holds another configuration is refused.
        made_by: What decides on the bits of its rows: code, libraries, settings. A directory that other code began is
            refused.

    Raises:
        BadArgument: The directory cannot be written, belongs to another evaluation or is in use, or its rows
            are not JSON objects.
    """

    def __init__(self, directory: Path, config: Row, made_by: Row):
        self.directory = directory
        self._rows_file = directory / "episodes.jsonl"
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._lock = DirectoryLock(directory, "vuca eval")
            try:
                self._check_config(config, made_by)
                if self._rows_file.exists():
                    check_regular("the file of rows", self._rows_file)
                self._file = open(self._rows_file, "a+b", buffering=0)  # noqa: SIM115
            except BaseException:
                self._lock.release()
                raise
        except OSError as error:
            raise BadArgument(f"cannot write {error.filename or directory}: {error.strerror}") from None
        try:
            self._drop_torn_line()
            self.rows: list[Row] = list(self._read())
        except BaseException:
            self.__exit__()
            raise

    def __enter__(self) -> "ResultStore":
        """Return the store, which the constructor opened."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file and release the lock."""
        self._file.close()
        self._lock.release()

    def append(self, row: Row) -> None:
        """Add a row, whole or not at all: what a full disk takes of it is cut away again.

        Raises:
            BadArgument: The disk is full, or cannot be written for another reason.
        """
        append_row(self._file, self._rows_file, row, len(self.rows))
        self.rows.append(row)

    def note_run(self, run: Row) -> None:
        """Add a run to those noted in ``config.json``: an evaluation may be gone on with, on another machine too.

        Args:
            run: When it began, its command, its machine and the commit of the code.
        """
        path = self.directory / "config.json"
        stored = json.loads(path.read_text())
        write_whole(path, _pretty({**stored, "runs": [*stored.get("runs", []), run]}))

    def finish(self, ordered_rows: Iterable[Row], summary: Row) -> None:
        """Put the rows into a given order and write the summary, each file replaced as a whole."""
        self.rows = list(ordered_rows)
        lines = "".join(f"{json.dumps(row, allow_nan=False)}\n" for row in self.rows)
        write_whole(self._rows_file, lines)
        write_whole(self.directory / "summary.json", _pretty(summary))

    def _check_config(self, config: Row, made_by: Row) -> None:
        path = self.directory / "config.json"
        if not path.exists():
            if self._rows_file.exists():
                raise BadArgument(f"{self.directory} has episodes but no config.json; choose an empty directory")
            write_whole(path, _pretty({"config": config, "made_by": made_by, "runs": []}))
            return
        stored, arithmetic = read_config(self.directory), made_by.get("arithmetic")
        known = stored.config, {**stored.made_by, "arithmetic": arithmetic}
        remedies = ("give the same arguments or another --out", "go on with the same code or choose another --out")
        for begun, now, remedy in zip(known, (config, made_by), remedies, strict=True):
            difference = _first_difference(begun, json.loads(json.dumps(now)))
            if difference is not None:
                key, before, after = difference
                raise BadArgument(
                    f"{self.directory} was begun with {key} = {json.dumps(before)}, not {json.dumps(after)}; {remedy}"
                )
        if stored.made_by.get("arithmetic") != arithmetic:  # last: another version may compute other bits, too
            raise BadArgument(
                f"{self.directory} was begun where the C library or MuJoCo compute other bits than here, on "
                f"{machine()['cpu']}; go on with a processor of the same kind or choose another --out"
            )

    def _drop_torn_line(self) -> None:
        """Drop a last line without its end, as a kill in the middle of a write leaves it, and say so."""
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self._file.truncate(whole)
            print(f"{self._rows_file}: dropped a last row that was not written to its end", file=sys.stderr)

    def _read(self) -> Iterable[Row]:
        self._file.seek(0)
        for number, line in enumerate(self._file.read().splitlines(), start=1):
            try:
                row = parse_json(line.decode(), "", BadArgument)
            except (BadArgument, UnicodeDecodeError):
                raise BadArgument(
                    f"{self._rows_file}:{number} is not JSON; remove the line, and its episode runs again"
                ) from None
            if not isinstance(row, dict):
                raise BadArgument(f"{self._rows_file}:{number} is not a row, which is an object")
            yield row


def append_row(file: RawIOBase, path: Path, row: Row, before: int) -> None:
    """Add a row to a file of lines, whole or not at all: what a full disk takes of it is cut away again.

    Args:
        file: The file, opened for appending without a buffer.
        path: Its name, for the message.
        row: The row.
        before: Number of rows that the file holds, for the message.

    Raises:
        BadArgument: The disk is full, or cannot be written for another reason.
    """
    line = f"{json.dumps(row, allow_nan=False)}\n".encode()
    end = file.seek(0, os.SEEK_END)
    written = 0
    try:
        while written < len(line):  # a disk that becomes full takes a part, without an error
            written += file.write(line[written:]) or 0
    except OSError as error:
        file.truncate(end)
        raise BadArgument(
            f"cannot write {path}: {error.strerror}; the {before} rows before are whole: make room and give the same "
            "command again"
        ) from error


def _first_difference(a: Any, b: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """The first difference of two JSON values: the path to it, and both values there."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in sorted({*a, *b}):
            difference = _first_difference(a.get(name), b.get(name), f"{key}.{name}" if key else name)
            if difference is not None:
                return difference
        return None
    return None if a == b else (key, a, b)


def _pretty(content: Row) -> str:
    return f"{json.dumps(content, indent=2, allow_nan=False)}\n"
