"""Speed of the learner, as ratios to named references: ``python -m train.analysis.bench.learner [--json]``."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from train.navigation.environment import ArenaEnvironment
from train.navigation.learner import make_local_learner
from train.navigation.networks import ACTION_SIZE, FusedActor, NetworkConfig
from train.navigation.stages import StageConfig, find_stage
from train.ppo.estimates import log_prob
from train.ppo.learner import PpoLearner
from train.ppo.team import Alone
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument

BATCH = 1024
ROUNDS = 15


@dataclass(frozen=True)
class BenchArguments:
    """Measure the learner on one core."""

    stage: str = "fusion"
    """Stage whose networks and settings are measured."""
    iterations: int = 3
    """Iterations of PPO for the rate from end to end."""
    json: bool = False
    """Print one JSON object, and nothing else."""


class Still:
    """An environment that costs nothing, for a learner that is given its batches."""

    def restart(self, seed: int):
        """Do nothing: it is never called."""
        raise AssertionError

    def step(self, action):
        """Do nothing: it is never called."""
        raise AssertionError


def compare(first: Callable[[], None], second: Callable[[], None], rounds: int = ROUNDS) -> tuple[float, float]:
    """Measure the least times of both in turns, so that both see the same machine [s]."""
    best = [float("inf"), float("inf")]
    for call in (first, second):
        call()
    for _ in range(rounds):
        for k, call in enumerate((first, second)):
            start = time.perf_counter()
            for _ in range(4):
                call()
            best[k] = min(best[k], (time.perf_counter() - start) / 4)
    return best[0], best[1]


def fused_against_separate(stage: StageConfig, *, gate: bool) -> tuple[float, float]:
    """Time passes through the fused layers, and through their experts as separate networks, over ``BATCH`` rows [s].

    A pass is forward and backward.

    Args:
        stage: The stage that the sizes are from.
        gate: Compute the shares, too, by the gate; else they are given, and only their gradients computed.
    """
    generator = torch.Generator().manual_seed(0)
    size, network = stage.observation.size, stage.network
    actor = FusedActor(size, network, generator)
    one = replace(network, experts=1)
    separate = [FusedActor(size, one, generator) for _ in range(network.experts)]
    x = torch.randn(BATCH, size, generator=generator)
    alone = torch.ones(BATCH, 1)
    given = torch.rand(BATCH, network.experts, generator=generator).softmax(-1).requires_grad_()

    def fused() -> None:
        actor.mean(x, actor.gate(x) if gate else given).sum().backward()

    def apart() -> None:
        torch.stack([expert.mean(x, alone) for expert in separate]).sum().backward()

    return compare(fused, apart)


def torchrl_against_bare(stage: StageConfig) -> tuple[float, float]:
    """Time one update by our learner, and one of the same networks by bare torch, a minibatch [s]."""
    config = replace(stage.ppo, critic_first=0)
    learner = make_local_learner(replace(stage, ppo=config), 0, Alone(), Still())
    generator = torch.Generator().manual_seed(0)
    n, size = config.minibatch, stage.observation.size
    batch = {
        "observation": torch.randn(n, size, generator=generator),
        "action": torch.randn(n, ACTION_SIZE, generator=generator),
        "action_log_prob": torch.full((n,), -3.0), "advantage": torch.randn(n, 1, generator=generator),
        "value_target": torch.randn(n, 1, generator=generator),
    }  # fmt: skip
    bare = _BarePpo(stage, learner)

    def ours() -> None:
        learner.update(TensorDict(dict(batch), [n]))

    return compare(ours, lambda: bare.update(batch), rounds=5)


class _BarePpo:
    """The loop as it would be written with nothing but torch."""

    def __init__(self, stage: StageConfig, learner: PpoLearner):
        self.config, self.actor, self.critic = stage.ppo, cast(FusedActor, learner.actor), learner.critic
        self.parameters = [*self.actor.parameters(), *self.critic.parameters()]
        self.optimiser = torch.optim.Adam(self.parameters, lr=1e-4)

    def update(self, batch: dict[str, Tensor]) -> None:
        config, x = self.config, batch["observation"]
        shares = self.actor.gate(x)
        mean, std = self.actor.mean(x, shares), self.actor.std()
        ratio = (log_prob(batch["action"], mean, std) - batch["action_log_prob"]).exp()
        advantage = batch["advantage"][:, 0]
        clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
        loss = -torch.minimum(ratio * advantage, clipped * advantage).mean()
        loss = loss + nn.functional.smooth_l1_loss(self.critic(x), batch["value_target"])
        if config.entropy > 0.0:
            loss = loss - config.entropy * std.log().sum()
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.actor.parameters(), config.max_gradient)
        nn.utils.clip_grad_norm_(self.critic.parameters(), config.max_gradient)
        self.optimiser.step()


def end_to_end(stage: StageConfig, iterations: int) -> tuple[float, float]:
    """Measure decisions a second of one worker with half of the worlds: of collecting, and in all."""
    half = replace(stage.ppo, worlds=stage.ppo.worlds // 2, minibatch=stage.ppo.minibatch // 2)
    environment = ArenaEnvironment(stage, half.worlds)
    learner = make_local_learner(replace(stage, ppo=half), 0, Alone(), environment)
    learner.restart()
    learner.iterate(0.0)
    reports = [learner.iterate(0.0) for _ in range(iterations)]
    return max(r["speed/collect"] for r in reports), max(r["speed/total"] for r in reports)


def bench(arguments: BenchArguments) -> dict[str, float]:
    """Run all benchmarks."""
    torch.set_num_threads(1)
    stage = find_stage(arguments.stage)
    four = replace(stage, network=NetworkConfig(experts=4))
    fused, separate = fused_against_separate(four, gate=False)
    gated, beside = fused_against_separate(four, gate=True)
    ours, bare = torchrl_against_bare(stage)
    collect, total = end_to_end(stage, arguments.iterations)
    return {
        "fused_layers_ms": 1e3 * fused, "separate_ms": 1e3 * separate, "fused_layers_over_separate": fused / separate,
        "fused_over_separate": gated / beside,
        "update_ms": 1e3 * ours, "bare_update_ms": 1e3 * bare, "update_over_bare": ours / bare,
        "collect_steps_per_second_a_core": collect, "steps_per_second_a_core": total,
    }  # fmt: skip


def main(arguments: BenchArguments) -> None:
    """Print the figures.

    Raises:
        BadArgument: If there are no iterations.
        UnknownName: If there is no such stage.
    """
    if arguments.iterations < 1:
        raise BadArgument(f"--iterations must be 1 or more, got {arguments.iterations}")
    figures = bench(arguments)
    if arguments.json:
        print(json.dumps(figures))
    else:
        print("\n".join(f"{name:36} {value:12.3f}" for name, value in figures.items()))


if __name__ == "__main__":
    run_module("bench", main, BenchArguments)
