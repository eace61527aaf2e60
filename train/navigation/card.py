"""The page that goes with weights: the policy, its training, and its results in training."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import torch

from train.arena.rewards import TERMS, find_rewards
from train.navigation.config import RunConfig
from train.navigation.stages import StageConfig
from vuca_nav.files import write_whole


def write_card(
    path: Path, stage: StageConfig, run: RunConfig, commits: Sequence[str], seconds: float,
    log: list[dict],
) -> None:  # fmt: skip
    """Write the Markdown page of a finished run.

    Args:
        path: Markdown file to be written.
        stage: The stage that was trained.
        run: Settings of the run.
        commits: Commits that the run was at, one after another.
        seconds: Time that the training took.
        log: Rows of the log.
    """
    steps: int = log[-1]["steps"]
    tail = log[-max(len(log) // 50, 1) :]

    def last(key: str) -> float:
        return sum(row[key] for row in tail) / len(tail)

    observation, network = stage.observation, stage.network
    rewards = ", ".join(f"{term} {weight:g}" for term, weight in zip(TERMS, find_rewards(stage.rewards)))
    sources = ", ".join(source.stem for source in run.sources) or "nothing: random weights"
    lines = [
        f"# {stage.name}",
        "",
        f"A local navigation policy. {stage.about}",
        "",
        f"- Command: `{run.command}`, torch {torch.__version__}; seed {run.seed}, {run.workers} workers",
        f"- Commit: {', then '.join(commits)}",
        f"- Steps: {steps:,} decisions at {stage.arena.decision_rate:g} Hz in {seconds / 60:.1f} minutes "
        f"({steps / max(seconds, 1e-9):,.0f} a second)",
        f"- Started from: {sources}",
        f"- Observation: {observation.kind}, {observation.sectors} sectors to {observation.max_range:g} m, "
        f"{observation.size} numbers",
        f"- Network: {network.experts} x ({network.hidden}, {network.hidden}), gate {network.gate}, critic "
        f"({network.critic}, {network.critic}), {network.activation}",
        f"- Weights of the rewards: {rewards}",
        f"- PPO: `{json.dumps(asdict(stage.ppo))}`",
        f"- Arena: `{json.dumps(asdict(stage.arena))}`",
        "",
        "At the end of the training, with the noise of exploration, of the episodes that ended:",
        "",
        "| reached | collided | timed out | reward a decision | entropy of the gate |",
        "|---|---|---|---|---|",
        f"| {last('episodes/reached'):.1%} | {last('episodes/collided'):.1%} | {last('episodes/timed_out'):.1%} "
        f"| {last('reward/total'):.3f} | {last('gate/entropy'):.2f} of {_most(network.experts):.2f} |",
        "",
        "![learning curves](curves.png)",
        "",
    ]
    write_whole(path, "\n".join(lines))


def _most(experts: int) -> float:
    return float(torch.tensor(float(experts)).log())
