"""The writer of a log: a thread of its own, so that a disk that stands still, or is slow, does not hold up the loop."""

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

from vuca_nav.deploy.transport.ros_types import definition_of, type_hash
from vuca_nav.errors import BadArgument

METADATA = "vuca"
"""Name of the metadata record that says which bundle drove."""
CHUNK = 128 * 2**10
"""Size of a chunk before it is compressed [bytes]: a second or two of a mission, the most that a kill loses."""
MOST_WAITING = 16 * 2**20
"""Greatest size of the messages that wait for the disk [bytes]: a minute or more of a mission."""
_OVERHEAD = 500
"""Memory of a message beside its data [bytes]."""
_LOOK = 0.01
"""Time between two looks whether all is written [s]."""


class Entry(NamedTuple):
    """A message of a log."""

    topic: str
    type_name: str
    data: bytes
    """CDR with its header."""
    log_time: int
    """[ns]"""
    publish_time: int
    """[ns]"""
    number: int
    """Its number on the topic; where messages are left out, one is missing."""

    @property
    def size(self) -> int:
        """Memory that it takes [bytes]."""
        return len(self.data) + _OVERHEAD


class LogWriter:
    """Writes messages to an MCAP file as they come, in a thread; what the disk is too slow for is left out and counted.

    Args:
        path: The file; it must not exist yet.
        about: What the file says of itself.

    Raises:
        BadArgument: If there is something at ``path``, or it cannot be written.
    """

    def __init__(self, path: Path, about: Mapping[str, str]):
        from mcap.writer import CompressionType, Writer

        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(path, "xb")  # noqa: SIM115
        except FileExistsError:
            raise BadArgument(f"--log {path} exists; a log is never written over: give another name") from None
        except OSError as error:
            raise BadArgument(f"--log {path} cannot be written: {error.strerror}") from error
        self._path, self._about = path, dict(about)
        self._failure: str | None = None
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._left_out = 0
        # Each is changed by one thread alone: the sizes of what was taken in, and of what was dealt with.
        self._taken = self._done = 0
        self._is_closed = False
        self._writer = Writer(self._file, chunk_size=CHUNK, compression=CompressionType.ZSTD)
        self._queue: SimpleQueue[Entry | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="log writer", daemon=True)  # a hung one ends with us
        self._thread.start()

    @property
    def failure(self) -> str | None:
        """Why the log is not whole; None while it is."""
        if self._failure is None and self._left_out:
            return f"the disk is too slow for the log: {self._left_out:,} messages are left out"
        return self._failure

    def add(self, entry: Entry, *, always: bool = False) -> None:
        """Have a message written; it is left out if too much waits already.

        Args:
            entry: The message.
            always: Whether it is taken in whatever waits, as is right for what is rare and small.
        """
        if not always and self._taken - self._done + entry.size > MOST_WAITING:
            self._left_out += 1
            return
        self._taken += entry.size
        self._queue.put(entry)

    def flush(self, timeout: float) -> bool:
        """Wait until all is written, at most ``timeout`` [s]; whether it is."""
        end = time.monotonic() + timeout
        while self._done != self._taken and self._thread.is_alive() and time.monotonic() < end:
            time.sleep(_LOOK)
        return self._done == self._taken

    def close(self, timeout: float) -> None:
        """Write what is left, and the index; a second call does nothing. A log without a message is not kept.

        Args:
            timeout: How long to wait for the disk [s].
        """
        if self._is_closed:
            return
        self._is_closed = True
        self._queue.put(None)
        self._thread.join(timeout)
        if self._thread.is_alive():
            self._failure = f"the disk has not taken the end of the log in {timeout:g} s"
        elif not self._taken and not self._left_out:  # ended before the first: the same command can be given again
            with contextlib.suppress(OSError):
                self._path.unlink()

    def _run(self) -> None:
        """Write until there is an end."""
        self._guarded(self._begin)
        while True:
            try:
                entry = self._queue.get_nowait()
            except Empty:  # the right moment to hand over what the file's own buffer holds
                self._guarded(self._file.flush)
                entry = self._queue.get()
            if entry is None:
                break
            self._guarded(self._write, entry)
            self._done += entry.size
        self._guarded(self._writer.finish)
        with contextlib.suppress(OSError):  # of the last bytes, on a disk that is full
            self._file.close()

    def _begin(self) -> None:
        self._writer.start(profile="ros2", library="vuca-nav")
        self._writer.add_metadata(METADATA, self._about)

    def _write(self, entry: Entry) -> None:
        topic, type_name = entry.topic, entry.type_name
        if topic not in self._channels:
            if type_name not in self._schemas:
                definition = definition_of(type_name).encode()
                self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition)
            told = {"offered_qos_profiles": "", "topic_type_hash": type_hash(type_name)}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[type_name], told)
        self._writer.add_message(self._channels[topic], entry.log_time, entry.data, entry.publish_time, entry.number)

    def _guarded(self, work: Callable[..., object], *arguments: object) -> None:
        """Do some writing, unless some has failed before."""
        if self._failure is not None:
            return
        try:
            work(*arguments)
        except OSError as error:
            self._failure = f"the log cannot be written any more: {error.strerror}"
