"""Clocks and results of the benchmarks."""

import contextlib
import functools
import time
from collections.abc import Callable, Iterator
from typing import Any

Result = dict[str, Any]
"""A result: name, value, unit and meaning."""


def result(name: str, value: float, unit: str, meaning: str) -> Result:
    """One line of ``vuca bench``."""
    return {"name": name, "value": value, "unit": unit, "meaning": meaning}


def best_of(repeats: int, job: Callable[[], None]) -> float:
    """Least wall time [s], after one run that does not count: the least disturbed one."""
    job()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        job()
        times.append(time.perf_counter() - began)
    return min(times)


class StageClock:
    """Times the calls it watches; the time of a watched call inside another counts for the inner one only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inner = [0.0]
        """Time of the watched calls inside each running call [s]."""

    @contextlib.contextmanager
    def watch(self, name: str, owner: Any, call: str) -> Iterator[None]:
        """Replace ``owner.call`` by a timed one for as long as the context lasts."""
        original = getattr(owner, call)
        seconds, inner, clock = self.seconds, self._inner, time.perf_counter
        seconds.setdefault(name, 0.0)

        @functools.wraps(original)
        def timed(*args: Any, **kwargs: Any) -> Any:
            inner.append(0.0)
            began = clock()
            try:
                return original(*args, **kwargs)
            finally:
                elapsed = clock() - began
                seconds[name] += elapsed - inner.pop()
                inner[-1] += elapsed

        setattr(owner, call, timed)
        try:
            yield
        finally:
            setattr(owner, call, original)
