"""The page that goes with weights: the policy, its training, and its results in training."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import torch

from train.arena.rewards import TERMS, RewardWeights, find_rewards
from train.navigation.config import RunConfig
from train.navigation.networks import NetworkConfig
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
    weights = find_rewards(stage.rewards)
    names = TERMS if isinstance(weights, RewardWeights) else weights._fields
    rewards = ", ".join(f"{name} {weight:g}" for name, weight in zip(names, weights))
    sources = ", ".join(source.stem for source in run.sources) or "nothing: random weights"
    head = ["reached", "collided", "timed out", "reward a decision"]
    cells = [f"{last(f'episodes/{end}'):.1%}" for end in ("reached", "collided", "timed_out")]
    cells.append(f"{last('reward/total'):.3f}")
    if network.architecture == "fused":
        head.append("entropy of the gate")
        cells.append(f"{last('gate/entropy'):.2f} of {_most(network.experts):.2f}")
    table = [f"| {' | '.join(row)} |" for row in (head, cells)]
    table.insert(1, "|---" * len(head) + "|")
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
        f"- Network: {_describe(network)}",
        f"- Weights of the rewards: {rewards}",
        f"- PPO: `{json.dumps(asdict(stage.ppo))}`",
        f"- Arena: `{json.dumps(asdict(stage.arena))}`",
        "",
        "At the end of the training, with the noise of exploration, of the episodes that ended:",
        "",
        *table,
        "",
        "![learning curves](curves.png)",
        "",
    ]
    write_whole(path, "\n".join(lines))


def _describe(network: NetworkConfig) -> str:
    if network.architecture == "convolutional":
        return (
            "two convolutions and layers of 256 and 128 (vuca_nav.policy.drl_network), a critic of the same sizes, relu"
        )
    return (
        f"{network.experts} x ({network.hidden}, {network.hidden}), gate {network.gate}, critic "
        f"({network.critic}, {network.critic}), {network.activation}"
    )


def _most(experts: int) -> float:
    return float(torch.tensor(float(experts)).log())
