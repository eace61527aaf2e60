"""Fixtures for tests of every package."""

import contextlib
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

# What a test starts gets its signals as from a terminal, also where the tests run under nohup.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

ROOM = """\
format: vuca-scene-1
name: room
seed: 0
bounds: {x_min: 0, y_min: 0, x_max: 6, y_max: 4}
start: {x: 1.2, y: 2.0, yaw: 0.0}
goal: {x: 4.0, y: 2.2}
obstacles:
  - {kind: wall, shape: {type: box, x: 3.0, y: 0.05, length: 6.0, width: 0.1, yaw: 0.0, height: 2.0}}
  - {kind: wall, shape: {type: box, x: 3.0, y: 3.95, length: 6.0, width: 0.1, yaw: 0.0, height: 2.0}}
  - {kind: wall, shape: {type: box, x: 0.05, y: 2.0, length: 0.1, width: 4.0, yaw: 0.0, height: 2.0}}
  - {kind: wall, shape: {type: box, x: 5.95, y: 2.0, length: 0.1, width: 4.0, yaw: 0.0, height: 2.0}}
movers: []
"""


@contextlib.contextmanager
def _limit(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def small_files() -> Callable[[int], AbstractContextManager[None]]:
    """A disk that is full: no file grows beyond so many bytes, and a write takes what still fits."""
    return _limit


@pytest.fixture(scope="session")
def room(tmp_path_factory) -> Path:
    """Scene file of an empty room, whose goal is reached in seconds."""
    path = tmp_path_factory.mktemp("scene") / "room.yaml"
    path.write_text(ROOM)
    return path
