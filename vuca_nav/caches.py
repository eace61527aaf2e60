"""Folders of what may be lost, and files in them that are whole or count as not there."""

import contextlib
import hashlib
import logging
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from vuca_nav.files import write_whole

_LOG = logging.getLogger(__name__)
_DIGEST = hashlib.sha256().digest_size


def cache_folder(name: str, chosen: str | None = None) -> Path | None:
    """A folder that can be written, for files that are made again if they are lost.

    It is ``$XDG_CACHE_HOME/vuca-nav/NAME``, in ``~/.cache`` by default. Without a home, or with one that cannot be
    written, it is in this user's own folder under the temporary one.

    Args:
        name: Name of the folder.
        chosen: A folder that the user names for it, tried first.

    Returns:
        The folder, made if it was not there; None if there is no place that can be written.
    """
    for base in _bases(chosen):
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.R_OK | os.W_OK | os.X_OK):
            return folder
    return None


def read_sealed(path: Path) -> bytes | None:
    """Content of a file of ``write_sealed``; None if it is not there.

    A file that is empty, torn or altered is named in a warning and removed, and counts as not there.
    """
    try:
        data = path.read_bytes()
    except OSError:
        return None
    seal, content = data[:_DIGEST], data[_DIGEST:]
    if seal == hashlib.sha256(content).digest():
        return content
    _LOG.warning("%s is damaged; it is made again", path)
    with contextlib.suppress(OSError):  # it is written over, or stays and is not used
        path.unlink()
    return None


def write_sealed(path: Path, content: bytes) -> None:
    """Write a file whole, behind the SHA-256 of its content; a disk that is full or read-only only costs time."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, hashlib.sha256(content).digest() + content)
    except OSError:
        return


def _bases(chosen: str | None) -> Iterator[Path]:
    if chosen:
        yield Path(chosen) / "vuca-nav"
    with contextlib.suppress(RuntimeError):  # this user has no home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vuca-nav"
    try:
        own = Path(tempfile.gettempdir()) / f"vuca-nav-{os.getuid()}"
        own.mkdir(mode=0o700, exist_ok=True)
        found = own.lstat()
    except OSError:
        return
    # Everybody can write in the temporary folder, and compiled kernels are run as they are found.
    if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022:
        yield own
