"""Files that are there whole or not at all, and directories that can be written before the work is done."""

import os
from pathlib import Path

from vuca_nav.errors import BadArgument


def write_whole(path: Path, data: str | bytes) -> None:
    """Write a file aside, then move it: after a kill, and for readers meanwhile, the old or the new file is whole.

    Args:
        path: File in a directory that exists; written over.
        data: The whole content; text as UTF-8.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data.encode() if isinstance(data, str) else data)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def prepare_directory(path: Path) -> None:
    """Make the directory of results, before an hour is spent on them.

    Args:
        path: Directory that ``--out`` names.

    Raises:
        BadArgument: If it is no directory, or no file can be written there.
    """
    if path.exists() and not path.is_dir():
        raise BadArgument(f"--out {path} is a file, expected a directory")
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BadArgument(f"--out {path} cannot be written: {error}") from error


def prepare_file(path: Path) -> None:
    """Make the directory of a file of results, and see that the file can be written, before an hour is spent on it.

    Args:
        path: File that ``--out`` names; an existing one is left as it is.

    Raises:
        BadArgument: If it is a directory, or cannot be written.
    """
    if path.is_dir():
        raise BadArgument(f"--out {path} is a directory, expected a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        existed = path.exists()
        path.open("ab").close()
        if not existed:
            path.unlink()
    except OSError as error:
        raise BadArgument(f"--out {path} cannot be written: {error}") from error
