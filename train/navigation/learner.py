"""The PPO learner of a navigation policy: its networks, its mirror symmetry and its gate's losses."""

from collections.abc import Callable

import torch

from train.arena.rewards import find_rewards
from train.navigation.environment import Environment
from train.navigation.gate_losses import GateLoss
from train.navigation.mirror import observation_mirror
from train.navigation.networks import Actor, FusedActor, make_actor, make_critic_of
from train.navigation.rollouts import ArenaRollouts
from train.navigation.stages import StageConfig
from train.ppo.learner import Networks, PpoLearner
from train.ppo.random_streams import StreamPerIteration
from train.ppo.rollout import Mirror, Rollouts
from train.ppo.team import Alone

MakeRollouts = Callable[[Actor, torch.nn.Module], Rollouts]
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
    first, config = torch.Generator().manual_seed(seed), stage.ppo
    actor = make_actor(stage.observation, stage.network, first)
    critic = make_critic_of(stage.observation, stage.network, first)
    mirrors = {
        "observation": Mirror(*observation_mirror(stage.observation)),
        "action": Mirror.of(range(len(actor.action_signs)), actor.action_signs),
    }
    random, rollouts = StreamPerIteration(seed, team.rank), make_rollouts(actor, critic)
    if not isinstance(actor, FusedActor):
        return PpoLearner(Networks(actor, critic, mirrors), rollouts, config, random, team)
    loss = GateLoss(actor, stage.network, stage.observation, config)
    groups = [] if actor.gate_layers is None else [(list(actor.gate_layers.parameters()), config.gate_rate)]
    networks = Networks(actor, critic, mirrors, actor_reads=("observation", "gate"), groups=groups)
    return PpoLearner(networks, rollouts, config, random, team, loss)


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
