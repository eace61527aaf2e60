"""Evaluations that were never run: rows by formulas, so that each test knows what the report must say."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from eval.episode import EpisodeConfig
from eval.methods import title_of

MACHINE = {"cpu": "A CPU", "cores": 8, "os": "Linux-6.1", "python": "3.11.7"}
CONTACT = {
    "class": "stopped", "own": False, "with": "cart_3", "robot_speed": 0.01, "other_speed": 0.8, "closing": 0.5,
    "bearing": -0.8, "straight_for": 1.5, "in_sight_for": 9.5,
}  # fmt: skip
FAILURE = {"class": "stuck", "where": [1.0, 2.0], "since": 30.0, "slam_error": 0.01, "detour": 1.4, "mean_speed": 0.3}


def row_of(config: EpisodeConfig, outcome: str, time: float = 40.0, **changes: Any) -> dict[str, Any]:
    """The row of an episode that ended so, after that time [s]."""
    arrived = outcome == "success"
    return {
        **config.row(),
        "outcome": outcome,
        "arriving_time": time if arrived else None,
        "duration": time,
        "contact": CONTACT if outcome == "collision" else None,
        "failure": FAILURE if outcome == "timeout" else None,
        "path_length": 0.5 * time,
        "spl": 0.5 if arrived else 0.0,
        "arsps": 0.01,
        "ansps": 0.0005,
        "min_clearance": 0.1,
        **dict.fromkeys(("slam_ate", "slam_final_error", "odometry_ate", "odometry_final_error"), 0.01),
        "real_time_factor": 1.0,
        "way": None,
        "bits": f"{title_of(config.method, config.options.given())}-{config.robot}",
        **changes,
    }


def write_evaluation(folder: Path, rows: Iterable[dict[str, Any]], suite: str = "made-up") -> Path:
    """A directory of ``vuca eval`` with these rows."""
    folder.mkdir(parents=True)
    found = list(rows)
    seeds = [row["seed"] for row in found]
    stored = {"suite": suite, "seeds": [min(seeds), max(seeds) + 1], "episodes": len(found)}
    run = {"began": "2026-01-01T10:00:00+00:00", "command": f"vuca eval {suite} --out {folder}", "machine": MACHINE}
    made_by = {"code": "c0de", "libraries": {"mujoco": "3.17.0"}}
    (folder / "config.json").write_text(json.dumps({"config": stored, "made_by": made_by, "runs": [run]}))
    (folder / "episodes.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in found))
    return folder


def episodes(
    config: dict[str, Any], outcomes: Sequence[str], times: Sequence[float] | None = None, first_seed: int = 2000
) -> list[dict[str, Any]]:
    """A row for each outcome, of the seeds from the first one on."""
    return [
        row_of(EpisodeConfig(**config, seed=first_seed + k), outcome, 40.0 if times is None else times[k])
        for k, outcome in enumerate(outcomes)
    ]
