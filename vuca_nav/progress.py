"""Progress of long work on stderr: what is done, of how much, and the time left."""

import time
from typing import TextIO

ON_A_TERMINAL = 0.2
"""Time between two updates of the line [s]."""
IN_A_LOG = 10.0
"""Time between two lines where there is no terminal [s]."""


class CountedProgress:
    """A line that counts, with the time left. Use it as a context manager.

    Args:
        stream: Stream to write to; on a terminal the line is rewritten in place.
        what: Name of what is counted, as in "steps recorded".
        total: Number of it.
    """

    def __init__(self, stream: TextIO, what: str, total: int):
        self._stream, self._what, self._total = stream, what, total
        self._in_place = stream.isatty()
        self._interval = ON_A_TERMINAL if self._in_place else IN_A_LOG
        self._last = time.perf_counter()
        self._first: tuple[int, float] | None = None
        self._written = False

    def __enter__(self) -> "CountedProgress":
        """Begin."""
        return self

    def __call__(self, done: int) -> None:
        """Write the line if it is due.

        Args:
            done: Number that is done.
        """
        now = time.perf_counter()
        if self._first is None:  # what is compiled or loaded before does not come again
            self._first = done, now
        before, began = self._first
        if now - self._last < self._interval or done <= before:
            return
        self._last = now
        left = (now - began) / (done - before) * max(self._total - done, 0)
        line = f"{done:,} of {self._total:,} {self._what}, {left:.0f} s left"
        self._stream.write(f"\r{line} " if self._in_place else f"{line}\n")
        self._stream.flush()
        self._written = True

    def __exit__(self, *_: object) -> None:
        """End the terminal's line."""
        if self._in_place and self._written:
            self._stream.write("\n")
