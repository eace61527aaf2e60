"""The learner of a navigation policy on batches from arenas on a Ray cluster."""

import contextlib
from collections.abc import Iterator
from functools import partial

import numpy as np
from tensordict import TensorDict
from torch import Tensor, nn

from train.arena.arena import Arena
from train.arena.torchrl_env import ArenaEnv
from train.navigation.learner import make_learner
from train.navigation.networks import Actor, FusedActor
from train.navigation.rollouts import batch_report
from train.navigation.stages import StageConfig
from train.ppo.learner import PpoLearner
from train.ppo.ray_rollouts import RayRollouts
from train.ppo.rollout import Rollouts
from train.ppo.team import Alone


class _Gated(nn.Module):
    """A fused actor with the shares of its own gate."""

    def __init__(self, actor: FusedActor):
        super().__init__()
        self.actor = actor

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        return self.actor(observation, self.actor.gate(observation))


@contextlib.contextmanager
def ray_learner(stage: StageConfig, seed: int, workers: int) -> Iterator[PpoLearner]:
    """Make a learner whose batches workers on a Ray cluster collect; see ``RayRollouts``.

    Args:
        stage: The stage to be trained.
        seed: Seed of all randomness.
        workers: Number of collectors, a core each, with an equal share of the worlds.

    Raises:
        BadArgument: If the cluster has fewer cores than workers, or a gate is to be taught that has not
            four experts.
    """
    config = stage.ppo
    rows = config.worlds // workers
    with contextlib.ExitStack() as stack:

        def make_rollouts(actor: Actor, critic: nn.Module) -> Rollouts:
            assert isinstance(actor, FusedActor)  # check_run lets no other through
            make_envs = [partial(_make_env, stage, rows)] * workers
            decisions = config.worlds * config.horizon
            rollouts = RayRollouts(
                make_envs, _Gated(actor), critic, decisions, seed, config.reward_scale, partial(_summarise, actor)
            )
            return stack.enter_context(rollouts)

        yield make_learner(stage, seed, Alone(), make_rollouts)


def _make_env(stage: StageConfig, rows: int) -> ArenaEnv:
    return ArenaEnv(Arena(stage.arena, stage.observation, rows, seed=0, threads=1), stage.rewards)


def _summarise(actor: FusedActor, batch: TensorDict) -> dict[str, float]:
    def after(key: str) -> Tensor:
        return batch["next", key]  # type: ignore[return-value]

    reached, timed_out = after("reached"), after("truncated")
    ends = np.array([float(flag.sum()) for flag in (reached, after("terminated") & ~reached, timed_out)])
    terms = after("terms").mean(1).sum(0).double().numpy()
    return batch_report(ends, np.asarray(terms), actor, batch["observation"])
