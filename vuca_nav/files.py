"""Files that are there whole or not at all, and directories that can be written before the work is done."""

import errno
import fcntl
import os
import stat
import weakref
from pathlib import Path

from vuca_nav.errors import BadArgument


def write_whole(path: Path, data: str | bytes) -> None:
    r"""Write a file aside, then move it: after a kill, and for readers meanwhile, the old or the new file is whole.

    A link is followed: the file that it names is written.

    Args:
        path: File in a directory that exists; written over.
        data: The whole content; text as UTF-8, with the bytes of a file name that are not UTF-8 as ``\udcXX``.

    Raises:
        OSError: If it cannot be written, with the name of the file.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():  # a device would be replaced by a file of its name
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    content = data.encode(errors="backslashreplace") if isinstance(data, str) else data
    temporary = target.with_name(f".vuca-{os.getpid()}.tmp")
    try:
        temporary.write_bytes(content)
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def prepare_directory(path: Path, option: str = "--out") -> None:
    """Make the directory of results, before an hour is spent on them.

    Args:
        path: Directory that the option names.
        option: The option, for the message.

    Raises:
        BadArgument: If it is no directory, or no file can be written there.
    """
    if path.exists() and not path.is_dir():
        raise BadArgument(f"{option} {path} is a file, expected a directory")
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / f".vuca-{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise BadArgument(f"{option} {path} cannot be written: {error.strerror}") from error


def prepare_file(path: Path, option: str = "--out") -> None:
    """Make the directory of a file of results, and see that the file can be written, before an hour is spent on it.

    Args:
        path: File that the option names, or a link to one; an existing one is left as it is.
        option: The option, for the message.

    Raises:
        BadArgument: If it is a directory, a pipe or a device, or cannot be written.
    """
    target = Path(os.path.realpath(path))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        existed = target.exists()
        if existed:
            check_regular(option, path)
        target.open("ab").close()
        if not existed:
            target.unlink()
    except OSError as error:
        raise BadArgument(f"{option} {path} cannot be written: {error.strerror}") from error


def check_regular(option: str, path: Path) -> None:
    """Refuse an existing path that is no regular file: opening a pipe that nobody reads would wait for ever.

    Args:
        option: Option that names it, for the message.
        path: Path that exists; a link is followed.

    Raises:
        BadArgument: If it is a directory, a pipe, a socket or a device.
        OSError: If it cannot be looked at.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise BadArgument(f"{option} {path} is a directory, expected a file")
    if not stat.S_ISREG(mode):
        raise BadArgument(f"{option} {path} is a pipe or a device, expected a file")


class DirectoryLock:
    """A directory that one process writes; the lock ends with ``release``, with this object, or with the process.

    Args:
        path: A directory that exists. Where its file system knows no locks there is none.
        writer: Program that writes, for the message.

    Raises:
        BadArgument: If another process holds the lock.
    """

    def __init__(self, path: Path, writer: str):
        descriptor = os.open(path, os.O_RDONLY)
        self._close = weakref.finalize(self, os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise BadArgument(
                f"{path} is being written by another {writer}; wait for it, or give another --out"
            ) from None
        except OSError:
            self.release()

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        self._close()
