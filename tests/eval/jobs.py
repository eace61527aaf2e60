"""Stand-ins for an episode, to be run in worker processes."""

import hashlib
import os
import time
from pathlib import Path
from typing import Any

from eval.episode import EpisodeConfig
from eval.recordings import file_name
from eval.runner import THREAD_VARIABLES


def episode_by_hash(config: EpisodeConfig) -> dict[str, Any]:
    """A row that depends on the configuration alone."""
    draw = int.from_bytes(hashlib.sha256(repr(config).encode()).digest()[:4]) / 2**32
    success = draw > 0.3
    return {
        **config.row(),
        "outcome": "success" if success else "collision",
        "arriving_time": 10.0 + draw if success else None,
        "path_length": 10.0 * draw,
        "spl": draw,
        "arsps": draw,
        "ansps": draw,
        "min_clearance": draw,
        "slam_ate": draw,
        "slam_final_error": draw,
        "odometry_ate": draw,
        "odometry_final_error": draw,
        "real_time_factor": 1.0,
    }


def episode_that_fails_on_seed_1(config: EpisodeConfig) -> dict[str, Any]:
    """One seed has a bug."""
    if config.seed == 1:
        raise ZeroDivisionError("seed 1 divides by zero")
    return episode_by_hash(config)


def episode_that_kills_its_worker(config: EpisodeConfig) -> dict[str, Any]:
    """What a crash in native code looks like."""
    os._exit(1)


def threads_of_a_worker(config: EpisodeConfig) -> dict[str, Any]:
    """How many threads the numerical libraries may use."""
    return {**config.row(), "threads": [os.environ.get(name) for name in THREAD_VARIABLES]}


def episode_that_waits_on_seed_1(config: EpisodeConfig) -> dict[str, Any]:
    """One seed takes for ever."""
    while config.seed == 1:
        time.sleep(60.0)
    return episode_by_hash(config)


def recording_by_hash(out: Path, config: EpisodeConfig) -> dict[str, Any]:
    """A row as above, and a file in place of its recording."""
    row = episode_by_hash(config)
    (out / file_name(row)).touch()
    return row
