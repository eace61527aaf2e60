"""The line of progress of long work."""

import io
import time

from vuca_nav.progress import CountedProgress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_sees_what_is_done_and_the_time_left(monkeypatch):
    clock = iter([0.0, 0.0, 10.0, 10.1, 20.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    stream = Terminal()
    with CountedProgress(stream, "steps recorded", 1000) as progress:
        for done in (0, 100, 101, 500):  # what comes too soon after the last is not shown
            progress(done)
    assert stream.getvalue() == "\r100 of 1,000 steps recorded, 90 s left \r500 of 1,000 steps recorded, 20 s left \n"


def test_the_start_is_not_taken_for_the_pace(monkeypatch):
    clock = iter([0.0, 100.0, 101.0, 112.0])  # a hundred seconds of compiling
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    stream = io.StringIO()
    with CountedProgress(stream, "ticks", 34) as progress:
        progress(1)
        progress(2)
        progress(13)
    assert stream.getvalue() == "2 of 34 ticks, 32 s left\n13 of 34 ticks, 21 s left\n"


def test_short_work_says_nothing():
    stream = Terminal()
    with CountedProgress(stream, "ticks", 2) as progress:
        progress(1)
        progress(2)
    assert stream.getvalue() == ""
