"""Run a suite into a directory; run again, it goes on where it was."""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tqdm import tqdm

from eval.analysis.summary import is_result, statistics_of, summarise
from eval.episode import EpisodeConfig
from eval.methods import title_of
from eval.provenance import bits_of, driver_of, made_with, provenance
from eval.runner import Crash, RunEpisode, key_of, run_episodes, run_one
from eval.store import ResultStore, Row
from vuca_nav.errors import BadArgument
from vuca_nav.provenance import find_commit, machine

RunEpisodes = Callable[[Sequence[EpisodeConfig], int | None, RunEpisode], Iterator[Row | Crash]]
"""Runs episodes by a job with so many workers, and yields rows in the order in which they end."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The result of an evaluation."""

    rows: tuple[Row, ...]
    """Rows in the order of the episodes asked for."""
    groups: list[Row]
    """The summary: one group for each place, robot and method."""
    total: Row
    """The summary of all rows."""
    crashes: tuple[Crash, ...]
    """Episodes that could not be run."""


def evaluate(
    identity: Row,
    configs: Sequence[EpisodeConfig],
    out: Path,
    *,
    workers: int | None,
    command: str = "",
    job: RunEpisode = run_one,
    run: RunEpisodes | None = None,
    made_by: Row | None = None,
) -> Evaluation:
    """Run those episodes that ``out`` does not hold yet, then summarise all of them.

    Args:
        identity: Identity of the evaluation, for its ``config.json``; another one cannot continue it. Its
            ``configurations`` are those of the methods, by their titles.
        configs: Its episodes, one or more.
        out: The directory of the results.
        workers: Number of processes; None for what ``run`` chooses.
        command: The command as typed, noted with the machine if there are episodes to run.
        job: Runs one episode in a worker.
        run: Runs the episodes, on this computer by default.
        made_by: What decides on the bits of the rows; by default the ``provenance`` of the episodes' methods.

    Raises:
        BadArgument: The directory cannot be used for this evaluation.
    """
    asked = [config.row() for config in configs]
    place = {key_of(row): i for i, row in enumerate(asked)}
    made_by = made_by or provenance(configs)
    bits = _bits(identity, made_by, configs)
    crashes: list[Crash] = []
    with ResultStore(out, identity, made_by) as store:
        done: set[str] = set()
        for number, row in enumerate(store.rows, start=1):
            if key_of(row) not in place or key_of(row) in done or not is_result(row):
                raise BadArgument(
                    f"{out / 'episodes.jsonl'}:{number} is not a row of this evaluation, or there twice; "
                    "remove the line, or choose another --out"
                )
            done.add(key_of(row))
        todo = [config for config in configs if key_of(config.row()) not in done]
        if done:
            print(f"{len(done)} of {len(configs)} episodes are there already", file=sys.stderr)
        if todo:
            began = datetime.now(UTC).isoformat(timespec="seconds")
            note: Row = {"began": began, "command": command, "machine": machine(), **made_with()}
            reason = find_commit().reason
            if reason is not None:
                note["commit_not_known"] = reason
                print(f"the commit is not known: {reason}", file=sys.stderr)
            store.note_run(note)
        pause = pause_of_progress()
        with tqdm(total=len(configs), initial=len(done), unit="episode", file=sys.stderr, mininterval=pause) as bar:
            try:
                for result in (run or run_episodes)(todo, workers, job) if todo else ():
                    if isinstance(result, Crash):
                        crashes.append(result)
                        bar.write(f"crashed: {result.config}\n{result.trace}", file=sys.stderr)
                    else:
                        store.append({**result, "bits": bits[key_of(result)]})
                    bar.set_postfix_str(_arrived(store.rows), refresh=False)
                    bar.update()
            except KeyboardInterrupt:
                bar.close()
                kept = f"{len(store.rows)} of {len(configs)} episodes are in {out}"
                print(f"{kept}; the same command goes on from there", file=sys.stderr)
                raise
        rows = sorted(store.rows, key=lambda row: place[key_of(row)])
        groups, total = summarise(rows), statistics_of(rows)
        failures = [{"config": crash.config, "error": crash.error} for crash in crashes]
        store.finish(rows, {**identity, "made_by": made_by, "groups": groups, "total": total, "crashed": failures})
    return Evaluation(tuple(rows), groups, total, tuple(crashes))


def pause_of_progress() -> float:
    """Time between two updates of a progress bar [s]: in a log each is a line."""
    return 0.1 if sys.stderr.isatty() else 10.0


def _bits(identity: Row, made_by: Row, configs: Sequence[EpisodeConfig]) -> dict[str, str]:
    """Hash of what decides on the bits of each episode, by its key."""
    configurations = identity.get("configurations", {})
    by_driver: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for config in configs:
        driver = driver_of(config)
        if driver not in by_driver:
            configuration = configurations.get(title_of(config.method, config.options.given()), {})
            by_driver[driver] = bits_of(made_by, driver, configuration)
        hashes[key_of(config.row())] = by_driver[driver]
    return hashes


def _arrived(rows: Sequence[Row]) -> str:
    """Missions that arrived, by method."""
    counts: dict[str, list[int]] = {}
    for row in rows:
        count = counts.setdefault(title_of(row["method"], row), [0, 0])
        count[0] += row["outcome"] == "success"
        count[1] += 1
    return "arrived: " + ", ".join(f"{title} {arrived}/{n}" for title, (arrived, n) in counts.items())
