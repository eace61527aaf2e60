"""The PPO learner of a navigation policy: its networks, its mirror symmetry and its gate's losses, put together."""

from collections.abc import Callable

import torch

from train.arena.rewards import find_rewards
from train.navigation.environment import Environment
from train.navigation.gate import GateLoss
from train.navigation.mirror import ACTION_SIGNS, observation_mirror
from train.navigation.networks import FusedActor, make_critic
from train.navigation.rollouts import ArenaRollouts
from train.navigation.stages import StageConfig
from train.ppo.learner import Networks, PpoLearner
from train.ppo.random_streams import StreamPerIteration
from train.ppo.rollout import Mirror, Rollouts
from train.ppo.team import Alone

MakeRollouts = Callable[[FusedActor, torch.nn.Module], Rollouts]
"""From actor and critic to where their batches come from."""


def make_learner(stage: StageConfig, seed: int, team: Alone, make_rollouts: MakeRollouts) -> PpoLearner:
    """A learner with random first weights.

    Args:
        stage: What is learnt.
        seed: Of weights, actions and minibatches.
        team: The workers that learn along.
        make_rollouts: Where batches come from.

    Raises:
        BadArgument: If there is no gate of four to be taught.
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
    """A learner with an environment of its own, in this process; see ``make_learner``.

    Args:
        stage: What is learnt.
        seed: Of weights, episodes, actions and minibatches.
        team: The workers that learn along.
        environment: With this worker's share of the worlds.
    """
    rewards = find_rewards(stage.rewards)
    return make_learner(
        stage, seed, team,
        lambda actor, critic: ArenaRollouts(environment, (actor, critic), stage.ppo, rewards, seed, team),
    )  # fmt: skip
