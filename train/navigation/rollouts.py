"""Batches of a navigation policy's decisions, from an environment in this process."""

import numpy as np
import torch
from torch import Tensor, nn

from train.arena.rewards import TERMS, Rewards, reward_terms
from train.navigation.config import NavigationPpoConfig
from train.navigation.environment import Environment
from train.navigation.gate_losses import entropy
from train.navigation.networks import Actor, FusedActor
from train.ppo.estimates import log_prob
from train.ppo.rollout import Rollout, Rollouts
from train.ppo.team import Alone
from vuca_nav.types import FloatArray


class ArenaRollouts(Rollouts):
    """Rows that a worker steps itself, with its share of the worlds.

    Args:
        environment: The rows.
        networks: Actor and critic.
        config: Settings.
        rewards: Result of ``find_rewards``.
        seed: Seed of the episodes.
        team: The workers, of which this is one.
    """

    def __init__(
        self, environment: Environment, networks: tuple[Actor, nn.Module], config: NavigationPpoConfig,
        rewards: Rewards, seed: int, team: Alone,
    ):  # fmt: skip
        self._environment, self._config, self._rewards = environment, config, rewards
        self._actor, self._critic = networks
        self._seed, self._rank = seed, team.rank
        rows, actor = config.worlds // team.size, self._actor
        self._terms = np.zeros((len(TERMS), rows), np.float32)
        self._rollout = Rollout.zeros(config.horizon, rows, {"observation": actor.inputs}, len(actor.action_names))

    def restart(self, iteration: int) -> None:
        """Begin new episodes, so that a resumed run sees those of an uninterrupted one."""
        seed = np.random.SeedSequence((self._seed, self._rank, iteration, 1)).generate_state(1)[0]
        self._now = torch.tensor(self._environment.restart(int(seed)))

    def collect(self, progress: float, generator: torch.Generator) -> tuple[Rollout, dict[str, float]]:
        """Play on for a horizon."""
        config, actor, batch = self._config, self._actor, self._rollout
        observations, std = batch.seen["observation"], self._actor.std()
        ends, terms = np.zeros(3), np.zeros(len(TERMS))
        observation = self._now
        for t in range(config.horizon):
            observations[t] = observation
            observation = observations[t]
            mean = actor.act(observation)
            action = mean + std * torch.randn(mean.shape, generator=generator)
            batch.mean[t], batch.action[t], batch.log_prob[t] = mean, action, log_prob(action, mean, std)
            batch.value[t] = self._critic(observation)
            step = self._environment.step(actor.shares(action).numpy())
            reward_terms(step, self._rewards, self._terms)
            batch.reward[t, :, 0] = torch.from_numpy(self._terms.sum(axis=0)) * config.reward_scale
            terminated = step.collided | step.reached
            batch.terminated[t, :, 0] = torch.from_numpy(terminated)
            batch.done[t, :, 0] = torch.from_numpy(terminated | step.timed_out)
            if step.timed_out.any():
                last = torch.from_numpy(step.final_observation[step.timed_out])
                batch.following[t][torch.from_numpy(step.timed_out)] = self._critic(last)
            ends += (step.reached.sum(), step.collided.sum(), step.timed_out.sum())
            terms += self._terms.mean(axis=1)
            observation = torch.from_numpy(step.observation)
        self._now = observation.clone()
        goes_on = ~batch.done
        batch.following[:-1][goes_on[:-1]] = batch.value[1:][goes_on[:-1]]
        batch.following[-1][goes_on[-1]] = self._critic(self._now)[goes_on[-1]]
        return batch, batch_report(ends, terms, actor, observations)


def batch_report(ends: FloatArray, terms: FloatArray, actor: Actor, observations: Tensor) -> dict[str, float]:
    """Summarise a batch for the log and the plots.

    Args:
        ends: Numbers of episodes that reached the goal, collided, timed out, (3,).
        terms: Terms of the reward, means over the rows summed up over the horizon, (7,).
        actor: The policy.
        observations: (h, n, size).
    """
    horizon = len(observations)
    gate = {}
    if isinstance(actor, FusedActor):
        shares = actor.gate(observations[-1])
        gate = {"gate/entropy": float(entropy(shares).mean())}
        gate |= {f"gate/{k}": float(share) for k, share in enumerate(shares.mean(0))}
    reached, collided, timed_out = (ends / max(ends.sum(), 1.0)).tolist()
    return {
        "episodes/reached": reached, "episodes/collided": collided, "episodes/timed_out": timed_out,
        "episodes/ended": float(ends.sum()),
        "reward/total": float(terms.sum()) / horizon,
        **{f"reward/{name}": float(term) / horizon for name, term in zip(TERMS, terms)},
        **{f"std/{name}": float(value) for name, value in zip(actor.action_names, actor.std())},
        **gate,
    }  # fmt: skip
