"""The PPO learner of a navigation policy: its networks, its mirror symmetry and its gate's losses."""

from collections.abc import Callable

import torch

from train.arena.rewards import find_rewards
from train.navigation.environment import Environment
from train.navigation.gate_losses import GateLoss
from train.navigation.mirror import ACTION_SIGNS, observation_mirror
from train.navigation.networks import FusedActor, make_critic
from train.navigation.rollouts import ArenaRollouts
from train.navigation.stages import StageConfig
from train.ppo.learner import Networks, PpoLearner
from train.ppo.random_streams import StreamPerIteration
from train.ppo.rollout import Mirror, Rollouts
from train.ppo.team import Alone

MakeRollouts = Callable[[FusedActor, torch.nn.Module], Rollouts]
"""Function from actor and critic to the source of their batches."""


def make_learner(stage: StageConfig, seed: int, team: Alone, make_rollouts: MakeRollouts) -> PpoLearner:
    """Make a learner with random first weights.

    Args:
        stage: The stage to be trained.
        seed: Seed of weights, actions and minibatches.
        team: The workers that learn along.
        make_rollouts: Makes the source of the batches.

    Raises:
        BadArgument: If a gate is to be taught that has not four experts.
    """
    first, size, config = torch.Generator().manual_seed(seed), stage.observation.size, stage.ppo
    actor = FusedActor(size, stage.network, first)
    critic = make_critic(size, stage.network, first)
    loss = GateLoss(actor, stage.network, stage.observation, config)
    mirrors = {
        "observation": Mirror(*observation_mirror(stage.observation)),
        "action": Mirror.of(range(len(ACTION_SIGNS)), ACTION_SIGNS),
    }
    groups = [] if actor.gate_layers is None else [(list(actor.gate_layers.parameters()), config.gate_rate)]
    networks = Networks(actor, critic, mirrors, actor_reads=("observation", "gate"), groups=groups)
    random = StreamPerIteration(seed, team.rank)
    return PpoLearner(networks, make_rollouts(actor, critic), config, random, team, loss)


def make_local_learner(stage: StageConfig, seed: int, team: Alone, environment: Environment) -> PpoLearner:
    """Make a learner with an environment of its own, in this process; see ``make_learner``.

    Args:
        stage: The stage to be trained.
        seed: Seed of weights, episodes, actions and minibatches.
        team: The workers that learn along.
        environment: The environment with this worker's share of the worlds.
    """
    rewards = find_rewards(stage.rewards)
    return make_learner(
        stage, seed, team,
        lambda actor, critic: ArenaRollouts(environment, (actor, critic), stage.ppo, rewards, seed, team),
    )  # fmt: skip
