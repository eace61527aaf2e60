"""Many episodes in many processes: a worker a core, a single thread a worker, rows kept as they come."""

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from eval.episode import ADDED_FIELDS, CONFIG_FIELDS, EpisodeConfig, run_episode
from eval.store import Row
from vuca_nav.provenance import usable_cores

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""Variables that numerical libraries read when first imported, which is why workers are spawned, not forked."""


@dataclass(frozen=True, slots=True)
class Crash:
    """An episode that raised an exception instead of ending."""

    config: Row
    error: str
    trace: str


RunEpisode = Callable[[EpisodeConfig], Row]


def run_one(config: EpisodeConfig) -> Row:
    """Run one episode and give its row; the default job of a worker."""
    return run_episode(config).row()


def key_of(row: Row) -> str:
    """Identity of the episode that a row is of: its configuration."""
    return repr([row.get(name, ADDED_FIELDS.get(name)) for name in CONFIG_FIELDS])


def run_episodes(
    configs: Sequence[EpisodeConfig], workers: int | None, job: RunEpisode = run_one
) -> Iterator[Row | Crash]:
    """Run episodes, and yield rows in the order in which they end.

    Args:
        configs: The episodes to run.
        workers: Number of processes; one is a process of its own as well, so that it gives the same rows. None for one
            each core.
        job: Function that a worker calls with a configuration; must be importable.
    """
    with worker_pool(max(1, min(workers or usable_cores(), len(configs)))) as pool:
        waiting = {pool.submit(run_safely, job, config): config for config in configs}
        for future in as_completed(waiting):
            config = waiting.pop(future)
            try:
                yield future.result()
            except BrokenProcessPool as error:
                yield Crash(config.row(), "a worker process died; run again to go on", str(error))


@contextmanager
def worker_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Start processes of a single thread each; after an exception they are ended in the middle of their work.

    Args:
        workers: Number of processes.
    """
    spawn = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with (
        _single_threaded_children(),
        ProcessPoolExecutor(workers, mp_context=spawn, initializer=_start_worker) as pool,
    ):
        try:
            yield pool
        except BaseException:  # an interrupt, or the one who reads the results has stopped
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise


def run_safely(job: RunEpisode, config: EpisodeConfig) -> Row | Crash:
    """Run the job and turn an exception into a value: some exceptions do not survive the way back."""
    try:
        return job(config)
    except Exception as error:
        return Crash(config.row(), f"{type(error).__name__}: {error}", traceback.format_exc())


def _start_worker() -> None:
    """Make an interrupt end a worker without a trace, and a worker end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_die_with, args=(parent.sentinel,), daemon=True).start()


def _die_with(parent: Any) -> None:
    multiprocessing.connection.wait([parent])
    os._exit(1)


@contextmanager
def _single_threaded_children() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
