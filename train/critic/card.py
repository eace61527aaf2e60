"""The page that goes with the weights of the critic of V^h."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import torch

from train.critic.config import CriticConfig
from vuca_nav.files import write_whole


def write_card(
    path: Path, config: CriticConfig, command: str, seed: int, commits: Sequence[str], seconds: float,
    log: list[dict],
) -> None:  # fmt: skip
    """Write the Markdown page of a finished critic of V^h.

    Args:
        path: Markdown file to be written.
        config: Settings of the training.
        command: The command line.
        seed: Seed of the training.
        commits: Commits that the run was at, one after another.
        seconds: Time that the training took.
        log: Rows of the log.
    """
    tail = log[-10:]
    loss, baseline = (sum(row[key] for row in tail) / len(tail) for key in ("loss", "baseline"))
    lines = [
        f"# {path.stem}",
        "",
        "The critic of V^h: the chance of getting to a place without meeting anything that moves, by what the "
        "robot sees now. It rates where the ways to frontiers lead first.",
        "",
        f"- Command: `{command}`, torch {torch.__version__}; seed {seed}",
        f"- Commit: {', then '.join(commits)}",
        f"- Learnt from: {config.rounds} rounds of {config.episodes:,} episodes driven by {config.policy}, "
        f"in {seconds / 60:.1f} minutes",
        f"- Settings: `{json.dumps(asdict(config))}`",
        f"- Cross entropy in the last ten rounds, before they were learnt from: {loss:.4f}; of one chance for "
        f"everything: {baseline:.4f}",
        "",
        "![learning curve, and chances against what came](curves.png)",
        "",
    ]
    write_whole(path, "\n".join(lines))
