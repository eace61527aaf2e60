"""Batches collected by workers on a Ray cluster, through TorchRL's collectors."""

import logging
from collections.abc import Callable, Sequence
from types import TracebackType

import numpy as np
import ray  # pyright: ignore[reportMissingImports]  (an extra of its own)
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.collectors.distributed import RayCollector
from torchrl.envs import EnvBase

from train.ppo.estimates import log_prob
from train.ppo.rollout import Rollout, Rollouts
from vuca_nav.errors import BadArgument

_NO_END = 1 << 62
"""Number of decisions that the collector is to make: without end, as the run ends it."""


class Explorer(nn.Module):
    """A policy with noise that depends on its seed alone.

    Args:
        policy: Network from an observation to mean and standard deviation of an action; its parameters are sent to the
            workers.
    """

    def __init__(self, policy: nn.Module):
        super().__init__()
        self.policy = policy
        self._noise: torch.Generator | None = None

    def seed_noise(self, seed: int) -> None:
        """Seed the noise, which depends on this seed alone from here on."""
        self._noise = torch.Generator().manual_seed(seed)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Draw actions: within [-1, 1], as drawn, their means, each (n, k), and log-probabilities."""
        mean, std = self.policy(observation)
        drawn = mean + std * torch.randn(mean.shape, generator=self._noise)
        return drawn.clamp(-1.0, 1.0), drawn, mean, log_prob(drawn, mean, std)


class RayRollouts(Rollouts):
    """Batches that workers on a Ray cluster collect, all with the present weights.

    A cluster is found by the variable RAY_ADDRESS, else one is started on this computer. The same seed and number of
    workers give the same batches. It is a context manager: leaving it stops the workers.

    Args:
        make_envs: Makers of an environment for each worker, which has a core of its own; all with as many rows.
        policy: The policy, as ``Explorer`` takes it.
        critic: Network from an observation to its value.
        decisions: Number of decisions of a batch, of all workers together.
        seed: Seed of all randomness.
        reward_scale: Factor on the rewards of the environments.
        summarise: Makes the numbers for the plots from what the collectors gather, (h, n, ...).

    Raises:
        BadArgument: If the cluster has fewer cores than workers.
    """

    def __init__(
        self, make_envs: Sequence[Callable[[], EnvBase]], policy: nn.Module, critic: nn.Module, decisions: int,
        seed: int, reward_scale: float, summarise: Callable[[TensorDict], dict[str, float]],
    ):  # fmt: skip
        self._explorer = TensorDictModule(
            Explorer(policy), ["observation"], ["action", "drawn", "drawn_mean", "drawn_log_prob"]
        )
        self._critic, self._seed, self._scale, self._summarise = critic, seed, reward_scale, summarise
        self._workers = len(make_envs)
        self._started = not ray.is_initialized()
        if self._started:
            ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.WARNING)
        cores = int(ray.cluster_resources().get("CPU", 0.0))
        if self._workers > cores:  # otherwise the collector would wait for them for ever
            self._stop_ray()
            raise BadArgument(f"{self._workers} workers need a core each, but the Ray cluster has {cores}")
        self._collector = RayCollector(
            list(make_envs), self._explorer, frames_per_batch=decisions, total_frames=_NO_END, sync=True,
            remote_configs={"num_cpus": 1},
        )  # fmt: skip
        self._batches = iter(self._collector)

    def __enter__(self) -> "RayRollouts":
        """Return itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        """Stop the workers, and the cluster if it was started here."""
        self._collector.shutdown()
        self._stop_ray()

    def _stop_ray(self) -> None:
        if self._started:
            ray.shutdown()

    def restart(self, iteration: int) -> None:
        """Begin new episodes and new noise on all workers."""
        sequences = np.random.SeedSequence((self._seed, iteration, 2)).spawn(self._workers)
        seeds = [(int(sequence.generate_state(1)[0]),) for sequence in sequences]
        self._collector.map_fn("policy.module.seed_noise", seeds)
        self._collector.map_fn("env.set_seed", seeds)
        self._collector.map_fn("reset")

    def collect(self, progress: float, generator: torch.Generator) -> tuple[Rollout, dict[str, float]]:
        """Let the workers play on, with noise of their own generators."""
        self._collector.update_policy_weights_(self._explorer)
        batch = next(self._batches)  # (workers, rows, horizon)
        batch = batch.reshape(-1, batch.shape[-1]).transpose(0, 1)
        after, observation = batch["next"], batch["observation"]
        rollout = Rollout(
            {"observation": observation}, batch["drawn"], batch["drawn_log_prob"], batch["drawn_mean"],
            value=self._critic(observation),
            following=self._critic(after["observation"]),  # of the old episode, where one ended
            reward=after["reward"] * self._scale, done=after["done"], terminated=after["terminated"],
        )  # fmt: skip
        return rollout, self._summarise(batch)
