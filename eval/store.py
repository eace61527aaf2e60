"""The directory of an evaluation: its configuration, a row an episode, its summary. It survives a kill.

``config.json`` says what is run and is never changed; ``episodes.jsonl`` gets a row as an episode ends;
``summary.json`` is written at the end.
"""

import fcntl
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from vuca_nav.errors import BadArgument

Row = dict[str, Any]


class ResultStore:
    """Opens a directory for one evaluation; use it as a context manager.

    Args:
        directory: Made if it does not exist.
        config: What is run. A directory that holds another configuration is refused.
        made_by: The versions, the commit and the settings that make it. A directory that others began is refused.

    Raises:
        BadArgument: The directory cannot be written, belongs to another evaluation or is in use, or its rows
            are not JSON objects.
    """

    def __init__(self, directory: Path, config: Row, made_by: Row):
        self.directory = directory
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._check_config(config, made_by)
            self._file = open(directory / "episodes.jsonl", "a+b", buffering=0)  # noqa: SIM115
        except OSError as error:
            raise BadArgument(f"cannot write {error.filename or directory}: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise BadArgument(f"{directory} is being written by another vuca eval") from None
        try:
            self._drop_torn_line()
            self.rows: list[Row] = list(self._read())
        except BadArgument:
            self._file.close()
            raise

    def __enter__(self) -> "ResultStore":
        """Nothing more to do: the constructor opened it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file and with it the lock."""
        self._file.close()

    def append(self, row: Row) -> None:
        """Add a row in one write, so that a kill loses at most this one."""
        self._file.write(f"{json.dumps(row, allow_nan=False)}\n".encode())
        self.rows.append(row)

    def finish(self, ordered_rows: Iterable[Row], summary: Row) -> None:
        """Put the rows into a given order and write the summary, each file replaced as a whole."""
        self.rows = list(ordered_rows)
        lines = "".join(f"{json.dumps(row, allow_nan=False)}\n" for row in self.rows)
        _replace(self.directory / "episodes.jsonl", lines)
        _replace(self.directory / "summary.json", _pretty(summary))

    def _check_config(self, config: Row, made_by: Row) -> None:
        path = self.directory / "config.json"
        if not path.exists():
            if (self.directory / "episodes.jsonl").exists():
                raise BadArgument(f"{self.directory} has episodes but no config.json; choose an empty directory")
            _replace(path, _pretty({"config": config, "made_by": made_by}))
            return
        try:
            stored = json.loads(path.read_text())
        except ValueError:
            stored = None
        known = [stored.get(part) for part in ("config", "made_by")] if isinstance(stored, dict) else [None]
        if not all(isinstance(part, dict) for part in known):
            raise BadArgument(f"{path} is not the configuration of an evaluation")
        remedies = ("give the same arguments or another --out", "go on with the same code or choose another --out")
        for begun, now, remedy in zip(known, (config, made_by), remedies, strict=True):
            difference = _first_difference(begun, json.loads(json.dumps(now)))
            if difference is not None:
                key, before, after = difference
                raise BadArgument(
                    f"{self.directory} was begun with {key} = {json.dumps(before)}, not {json.dumps(after)}; {remedy}"
                )

    def _drop_torn_line(self) -> None:
        """A kill in the middle of a write leaves a last line without its end."""
        self._file.seek(0)
        content = self._file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            self._file.truncate(whole)

    def _read(self) -> Iterable[Row]:
        self._file.seek(0)
        for number, line in enumerate(self._file.read().splitlines(), start=1):
            try:
                row = json.loads(line, parse_constant=_refuse)
            except ValueError:
                raise BadArgument(f"{self.directory / 'episodes.jsonl'}:{number} is not JSON") from None
            if not isinstance(row, dict):
                raise BadArgument(f"{self.directory / 'episodes.jsonl'}:{number} is not a row, which is an object")
            yield row


def _first_difference(a: Any, b: Any, key: str = "") -> tuple[str, Any, Any] | None:
    """Where two pieces of JSON differ, by the path to it, and what each of them has there."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in sorted({*a, *b}):
            difference = _first_difference(a.get(name), b.get(name), f"{key}.{name}" if key else name)
            if difference is not None:
                return difference
        return None
    return None if a == b else (key, a, b)


def _refuse(constant: str) -> None:
    """NaN and infinities are not JSON."""
    raise ValueError(constant)


def _pretty(content: Row) -> str:
    return f"{json.dumps(content, indent=2, allow_nan=False)}\n"


def _replace(path: Path, text: str) -> None:
    """Write a file as a whole or not at all."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text)
    os.replace(temporary, path)
