"""Many episodes on a Ray cluster: a core each, the same rows as on one computer."""

import itertools
import json
import logging
import os
from collections.abc import Iterator, Sequence
from typing import Any

from eval.episode import EpisodeConfig
from eval.provenance import common
from eval.runner import THREAD_VARIABLES, Crash, RunEpisode, run_one, run_safely
from eval.store import Row
from vuca_nav.errors import BadArgument

_AHEAD = 2
"""Episodes that are handed to the cluster for each of its cores, so that none waits for work."""


def run_on_ray(
    configs: Sequence[EpisodeConfig], workers: int | None, job: RunEpisode = run_one
) -> Iterator[Row | Crash]:
    """Run episodes on a Ray cluster, and yield rows in the order in which they end.

    The cluster is that of the variable RAY_ADDRESS; without it one is started on this computer. Its nodes need this
    project installed, at the same version and with the same libraries; files of weights that are given by their path
    must be there. An episode whose node is lost runs again on another.

    Args:
        configs: The episodes to run.
        workers: Greatest number of episodes at a time; None for all cores of the cluster.
        job: Function that a worker calls with a configuration; must be importable.

    Raises:
        BadArgument: There is no such cluster, or a node of it would give other bits.
    """
    import ray  # pyright: ignore[reportMissingImports]  (an extra of its own)

    address = os.environ.get("RAY_ADDRESS")
    local: dict[str, Any] = {} if address else {"num_cpus": workers, "include_dashboard": False}
    try:
        ray.init(
            address or "local", log_to_driver=False, logging_level=logging.WARNING,
            runtime_env={"env_vars": dict.fromkeys(THREAD_VARIABLES, "1")}, **local,
        )  # fmt: skip
    except (ConnectionError, ray.exceptions.RayError) as error:
        raise BadArgument(f"RAY_ADDRESS={address}: {error}; the address of a running cluster would be right") from error
    try:
        yield from _run(ray, configs, workers, job)
    finally:
        ray.shutdown()  # ends what still runs for this program, and a cluster that was started here


def _run(ray: Any, configs: Sequence[EpisodeConfig], workers: int | None, job: RunEpisode) -> Iterator[Row | Crash]:
    here, remote = json.dumps(common()), ray.remote(num_cpus=1)(_run_there)
    left, running = iter(configs), {}
    while True:
        most = workers or _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1.0)))  # nodes may come and go
        for config in itertools.islice(left, max(0, most - len(running))):
            running[remote.remote(job, config)] = config
        if not running:
            return
        (ready, *_), _ = ray.wait(list(running), num_returns=1)
        config = running.pop(ready)
        try:
            there, result = ray.get(ready)
        except ray.exceptions.RayError as error:
            yield Crash(config.row(), "a worker process or its node died; run again to go on", str(error))
            continue
        if there != here:
            raise BadArgument(_difference(json.loads(here), json.loads(there)))
        yield result


def _run_there(job: RunEpisode, config: EpisodeConfig) -> tuple[str, Row | Crash]:
    """Run an episode on a node, and tell what decides on the bits there."""
    return json.dumps(common()), run_safely(job, config)


def _difference(here: Row, there: Row) -> str:
    name = next(name for name in here if here[name] != there.get(name))
    return (
        f"a node of the cluster has {name} {json.dumps(there.get(name))}, not {json.dumps(here[name])}: its rows would "
        "differ; install the same versions on all nodes, of processors of one kind"
    )
