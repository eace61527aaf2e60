"""The page that goes with the weights of a gait."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import mujoco
import torch

from train.locomotion.config import TrainingConfig
from vuca_nav.files import write_whole


def write_card(
    path: Path, robot: str, config: TrainingConfig, commits: Sequence[str], seconds: float, log: list[dict]
) -> None:
    """Write the Markdown page of a finished run.

    Args:
        path: Markdown file to be written.
        robot: Name of the robot that learnt.
        config: Settings of the training.
        commits: Commits that the run was at, one after another.
        seconds: Time that the training took.
        log: Rows of the log.
    """
    tail = log[-max(len(log) // 50, 1) :]
    reward, falls = (sum(row[key] for row in tail) / len(tail) for key in ("reward/total", "falls_per_minute"))
    lines = [
        f"# Gait of {robot}",
        "",
        "Joint targets from a quadruped's own sensors and a commanded twist, trained by PPO over batched MuJoCo.",
        "",
        f"- Made with: torch {torch.__version__}, mujoco {mujoco.__version__}; seed {config.seed}",
        f"- Commit: {', then '.join(commits)}",
        f"- Steps: {log[-1]['steps']:,} control steps in {seconds / 60:.1f} minutes",
        f"- Settings: `{json.dumps(asdict(config))}`",
        f"- At the end of the training, with the noise of exploration: reward {reward:.2f} a second, {falls:.2f} falls "
        "a minute",
        "",
        "![learning curves](curves.png)",
        "",
    ]
    write_whole(path, "\n".join(lines))
