"""Recordings of the missions of an evaluation that failed: ``vuca eval --record failures``.

A mission repeats to the bit, so that the failed ones are run again with a recorder afterwards: what is recorded costs
its own time, and what arrived costs none. A recording that is there is not made again.
"""

import hashlib
import re
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tqdm import tqdm

from eval.analysis.summary import dials_in_words
from eval.episode import REFUSED, EpisodeConfig, run_episode
from eval.evaluate import pause_of_progress
from eval.methods import title_of
from eval.metrics import TIMING_FIELDS
from eval.runner import Crash, RunEpisode, key_of, run_episodes
from eval.store import Row
from vuca_nav.files import prepare_directory


def record_failures(
    rows: Sequence[Row], configs: Sequence[EpisodeConfig], out: Path, workers: int | None, job: RunEpisode | None = None
) -> list[Crash]:
    """Record the missions that failed and are not recorded yet.

    Args:
        rows: Rows of an evaluation.
        configs: Its episodes.
        out: Directory of the recordings.
        workers: Number of processes; None for one each core.
        job: Runs an episode and records it; by default ``record_episode`` into ``out``.

    Returns:
        Episodes that could not be recorded.

    Raises:
        BadArgument: The directory cannot be written.
    """
    failed = {key_of(row): row for row in rows if row["outcome"] not in ("success", REFUSED)}
    todo = [c for c in configs if key_of(c.row()) in failed and not (out / file_name(c.row())).exists()]
    if not todo:
        return []
    prepare_directory(out)
    crashes: list[Crash] = []
    job = job or partial(record_episode, out)
    with tqdm(total=len(todo), unit="recording", file=sys.stderr, mininterval=pause_of_progress()) as bar:
        for result in run_episodes(todo, workers, job):
            bar.update()
            if isinstance(result, Crash):
                crashes.append(result)
                continue
            before = failed[key_of(result)]
            if any(before.get(key) != value for key, value in result.items() if key not in TIMING_FIELDS):
                name = out / file_name(result)
                bar.write(f"{name} is of a mission that went otherwise than its row says", file=sys.stderr)
    return crashes


def record_episode(out: Path, config: EpisodeConfig) -> Row:
    """Run an episode with a recorder; the file is there whole or not at all.

    Args:
        out: Directory of the recording.
        config: The episode.
    """
    from vuca_nav.telemetry.rerun.recorder import RerunTelemetry

    path = out / file_name(config.row())
    unfinished = path.with_name(f".{path.name}")
    method = title_of(config.method, config.options.given())
    title = f"{config.world}, {config.robot}, {method}, seed {config.seed}"
    telemetry = RerunTelemetry.record(unfinished, title=title)
    try:
        row = run_episode(config, telemetry).row()
    finally:
        telemetry.close()
    unfinished.replace(path)
    return row


def file_name(row: Row) -> str:
    """Name of the recording of an episode, as ``factory-4-go2-ours-2000.rrd``.

    A world of a file adds some digits of the episode's hash: two folders may hold files of one name.
    """
    place = Path(row["world"]).stem + ("" if row["region"] is None else f" {row['region']}") + dials_in_words(row)
    if row["world"] != Path(row["world"]).stem:
        place += f" {hashlib.sha256(key_of(row).encode()).hexdigest()[:6]}"
    for end in (row.get("start"), row.get("goal")):
        place += "" if end is None else f" {end[0]:+g} {end[1]:+g}"
    without = f" without {row['without']}" if row["without"] else ""
    name = f"{place}{without} {row['robot']} {title_of(row['method'], row)} {row['seed']}"
    return f"{re.sub(r' --|[^A-Za-z0-9_.+]+', '-', name)}.rrd"
