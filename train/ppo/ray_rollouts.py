"""PPO on worlds that are elsewhere: TorchRL's collectors on a Ray cluster gather the batches, this process learns."""

import logging
from functools import partial
from types import TracebackType

import numpy as np
import ray  # pyright: ignore[reportMissingImports]  (an extra of its own)
import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.collectors.distributed import RayCollector

from train.arena.arena import Arena
from train.arena.torchrl_env import ArenaEnv
from train.navigation.learner import BaseLearner
from train.navigation.networks import FusedActor
from train.navigation.stages import StageConfig
from train.ppo.distribution import log_prob
from train.ppo.team import Alone
from vuca_nav.errors import BadArgument
from vuca_nav.types import FloatArray

_NO_END = 1 << 62
"""Of decisions that the collector is asked for: the run says when it is enough."""


class Explorer(nn.Module):
    """The actor, with noise that only its seed determines.

    Args:
        actor: Whose mean actions; its parameters are what is sent to the workers.
    """

    def __init__(self, actor: FusedActor):
        super().__init__()
        self.actor = actor
        self._noise: torch.Generator | None = None

    def seed_noise(self, seed: int) -> None:
        """What follows depends on this seed alone."""
        self._noise = torch.Generator().manual_seed(seed)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(n, inputs) to the action as the environment takes it (n, 3), as it was drawn, and its log probability."""
        std, mean = self.actor.std(), self.actor.mean(observation, self.actor.gate(observation))
        drawn = mean + std * torch.randn(mean.shape, generator=self._noise)
        return drawn.clamp(-1.0, 1.0), drawn, log_prob(drawn, mean, std)


class RayLearner(BaseLearner):
    """Learns from batches that workers on a Ray cluster collect, all with the present weights.

    A cluster is found by the variable RAY_ADDRESS, else one is started on this computer. The same seed and number of
    workers give the same batches.

    Args:
        stage: What is learnt, and where.
        seed: Of everything.
        workers: Collectors, a core each, with an equal share of the worlds.

    Raises:
        BadArgument: If the cluster has fewer cores than workers, or there is no gate of four to be taught.
    """

    def __init__(self, stage: StageConfig, seed: int, workers: int):
        super().__init__(stage.observation, stage.network, stage.ppo, seed, Alone())
        self._policy = TensorDictModule(Explorer(self.actor), ["observation"], ["action", "drawn", "drawn_log_prob"])
        rows, config = stage.ppo.worlds // workers, stage.ppo
        self._workers = workers
        self._started = not ray.is_initialized()
        if self._started:
            ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.WARNING)
        cores = int(ray.cluster_resources().get("CPU", 0.0))
        if workers > cores:  # the collector would wait for them for ever
            self._stop_ray()
            raise BadArgument(f"{workers} workers need a core each, but the Ray cluster has {cores}")
        self._collector = RayCollector(
            [partial(_make_env, stage, rows)] * workers, self._policy, frames_per_batch=config.worlds * config.horizon,
            total_frames=_NO_END, sync=True, remote_configs={"num_cpus": 1},
        )  # fmt: skip
        self._batches = iter(self._collector)

    def __enter__(self) -> "RayLearner":
        """Itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        """Let the workers go, and the cluster if it was started here."""
        self._collector.shutdown()
        self._stop_ray()

    def _stop_ray(self) -> None:
        if self._started:
            ray.shutdown()

    def restart(self) -> None:
        """New episodes and new noise on all workers."""
        sequences = np.random.SeedSequence((self._seed, self.iteration, 2)).spawn(self._workers)
        seeds = [(int(sequence.generate_state(1)[0]),) for sequence in sequences]
        self._collector.map_fn("policy.module.seed_noise", seeds)
        self._collector.map_fn("env.set_seed", seeds)
        self._collector.map_fn("reset")

    def _roll_out(self) -> tuple[FloatArray, FloatArray]:
        config = self.config
        self._collector.update_policy_weights_(self._policy)
        batch = next(self._batches)  # (workers, rows, horizon)

        def by_time(*key: str) -> Tensor:
            values: Tensor = batch[key]
            return values.reshape(-1, *values.shape[2:]).transpose(0, 1)

        self._observations[:], self._actions[:] = by_time("observation"), by_time("drawn")
        self._log_probs[:] = by_time("drawn_log_prob")
        timed_out, reached = by_time("next", "truncated"), by_time("next", "reached")
        collided = by_time("next", "terminated") & ~reached
        self._values[:] = self.critic(self._observations)
        self._following[:] = self.critic(by_time("next", "observation"))  # of the old episode, where one ended
        self._rewards[:] = by_time("next", "reward") * config.reward_scale
        self._done[:], self._terminated[:] = by_time("next", "done"), by_time("next", "terminated")
        ends = np.array([float(flag.sum()) for flag in (reached, collided, timed_out)])
        return ends, by_time("next", "terms").mean(1).sum(0).double().numpy()


def _make_env(stage: StageConfig, rows: int) -> ArenaEnv:
    return ArenaEnv(Arena(stage.arena, stage.observation, rows, seed=0, threads=1), stage.rewards)
