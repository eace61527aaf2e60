"""Proximal policy optimisation of a gait: TorchRL's loss and advantage over our batched environment."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from torchrl.objectives import ClipPPOLoss

from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from train.locomotion.environment import LocomotionEnvironment
from train.locomotion.kernels import CRITIC_SIZE
from train.locomotion.policy import (
    ActorNetwork,
    Normaliser,
    action_mirror,
    make_actor,
    make_critic,
    observation_mirror,
    privileged_mirror,
)
from train.ppo.distribution import advantages as advantages_of
from train.ppo.distribution import log_prob


@dataclass(frozen=True, slots=True)
class PpoConfig:
    """Settings of the learner."""

    horizon: int = 24
    """Control steps between updates."""
    epochs: int = 4
    minibatches: int = 4
    gamma: float = 0.99
    lambda_: float = 0.95
    clip: float = 0.2
    hidden: int = 128
    initial_std: float = 0.5
    actor_rate: float = 1e-3
    """At first; then it follows the Kullback-Leibler divergence."""
    critic_rate: float = 1e-3
    first_divergence: float = 0.03
    last_divergence: float = 0.008
    entropy: float = 0.001
    """Weight at first; falls to 0."""
    averaging: float = 0.98
    """Of the exported weights, which are a running mean over the iterations (Polyak and Juditsky 1992): so much of it
    is kept at each."""
    normaliser_until: float = 0.8
    """Share of the training after which the normalisers are frozen: commands, sills and slopes are all there by then,
    and the rest is left to the policy to settle on what it sees."""


class Learner:
    """Actor, critic, their optimisers, and one iteration of PPO.

    Args:
        environment: Where it learns.
        config: How.
        seed: Of the networks' first weights, the explored actions and the minibatches.
    """

    def __init__(self, environment: LocomotionEnvironment, config: PpoConfig, seed: int):
        self.config = config
        self._generator = torch.Generator().manual_seed(seed)
        self.actor = make_actor(self._generator, config.hidden, config.initial_std)
        self.critic = make_critic(self._generator, config.hidden)
        network = self.actor.module[0].module  # type: ignore[union-attr,index]
        assert isinstance(network, ActorNetwork)
        self.network = network
        self._average = AveragedModel(network, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        self.see = Normaliser(OBSERVATION_SIZE, observation_mirror())
        self.see_all = Normaliser(CRITIC_SIZE, privileged_mirror())
        self._mirrors = {
            "observation": _tensors(observation_mirror()),
            "privileged": _tensors(privileged_mirror()),
            "action": _tensors(action_mirror()),
        }
        self.loss = ClipPPOLoss(
            self.actor, self.critic, clip_epsilon=config.clip, entropy_coeff=config.entropy,
            normalize_advantage=True, loss_critic_type="smooth_l1", critic_coeff=1.0, functional=False,
        )  # fmt: skip
        self.actor_optimiser = torch.optim.Adam(self.network.parameters(), lr=config.actor_rate)
        self.critic_optimiser = torch.optim.Adam(self.critic.parameters(), lr=config.critic_rate)
        self.iteration = 0
        n, h = environment.config.num_robots, config.horizon
        self._observations = torch.empty(h, n, OBSERVATION_SIZE)
        self._privileged = torch.empty(h, n, CRITIC_SIZE)
        self._actions = torch.empty(h, n, ACTION_SIZE)
        self._means, self._log_probs = torch.empty(h, n, ACTION_SIZE), torch.empty(h, n)
        self._values, self._rewards = torch.empty(h + 1, n, 1), torch.empty(h, n, 1)
        self._terminated, self._truncated = torch.zeros(2, h, n, 1, dtype=torch.bool)
        self.move_to(environment)

    @property
    def averaged(self) -> ActorNetwork:
        """The actor that is exported."""
        module = self._average.module
        assert isinstance(module, ActorNetwork)
        return module

    def move_to(self, environment: LocomotionEnvironment) -> None:
        """Go on in another environment with as many robots."""
        self.environment = environment
        first = environment.step(np.zeros((environment.config.num_robots, ACTION_SIZE), np.float32))
        self._now = torch.tensor(first.observation), torch.tensor(first.privileged)

    def iterate(self, progress: float, clock: Callable[[], float] = time.perf_counter) -> dict[str, float]:
        """Collect one batch and learn from it.

        Args:
            progress: Share of the training done, 0-1.
            clock: [s]

        Returns:
            What is worth plotting.
        """
        start = clock()
        report = self._collect(progress < self.config.normaliser_until)
        collected = clock()
        report |= self._learn(progress)
        self._average.update_parameters(self.network)
        self.iteration += 1
        samples = self._rewards.numel()
        report["speed/collect"] = samples / (collected - start)
        report["speed/total"] = samples / (clock() - start)
        return report

    @torch.no_grad()
    def _collect(self, normaliser_learns: bool) -> dict[str, float]:
        environment, config = self.environment, self.config
        std = self.network.log_std.clamp(-3.0, 0.0).exp()
        observation, privileged = self._now
        falls, reward, terms, errors = 0, 0.0, {}, []
        for t in range(config.horizon):
            if normaliser_learns:
                self.see.update(observation)
                self.see_all.update(privileged)
            x, y = self.see(observation), self.see_all(privileged)
            mean = self.network.layers(x)
            action = mean + std * torch.randn(mean.shape, generator=self._generator)
            self._observations[t], self._privileged[t] = x, y
            self._means[t], self._actions[t] = mean, action
            self._log_probs[t] = log_prob(action, mean, std)
            self._values[t] = self.critic.module(y)
            step = environment.step(action.numpy())
            self._rewards[t, :, 0] = torch.from_numpy(step.reward)
            self._truncated[t, :, 0] = torch.from_numpy(step.truncated)
            self._terminated[t, :, 0] = torch.from_numpy(step.terminated)
            falls += int(step.terminated.sum())
            reward += float(step.reward.mean()) / config.horizon
            for key, value in environment.reward_terms().items():
                terms[f"reward/{key}"] = terms.get(f"reward/{key}", 0.0) + value / config.horizon
            batch = environment.batch
            errors.append(np.abs(batch.slow_error).mean(axis=0))
            observation, privileged = torch.from_numpy(step.observation), torch.from_numpy(step.privileged)
        self._now = observation.clone(), privileged.clone()
        self._values[-1] = self.critic.module(self.see_all(privileged))
        v_x, v_y, w_z = np.mean(errors, axis=0).tolist()
        samples = self._rewards.numel()
        minutes = samples / environment.config.control / 60.0
        return {
            "reward/total": reward * environment.config.control,
            "falls_per_minute": falls / minutes,
            "slow_error/v_x": v_x, "slow_error/v_y": v_y, "slow_error/w_z": w_z,
            "std": float(std.mean()), **terms,
        }  # fmt: skip

    def _learn(self, progress: float) -> dict[str, float]:
        config = self.config
        with torch.no_grad():
            advantage, target = advantages(
                config, self._values, self._rewards, self._terminated, self._truncated
            )  # fmt: skip
        flat = TensorDict(
            {
                "observation": self._observations, "privileged": self._privileged, "action": self._actions,
                "loc": self._means, "action_log_prob": self._log_probs, "advantage": advantage,
                "value_target": target,
            },
            batch_size=self._log_probs.shape,
        ).reshape(-1)  # fmt: skip
        wanted = config.first_divergence + (config.last_divergence - config.first_divergence) * progress
        entropy = torch.tensor(config.entropy * (1.0 - progress))
        self.loss.entropy_coeff.copy_(entropy)  # type: ignore[union-attr]
        old_std = self.network.log_std.detach().clamp(-3.0, 0.0).exp()
        size = len(flat) // config.minibatches
        divergence, critic_loss, updates = 0.0, 0.0, 0
        for _ in range(config.epochs):
            order = torch.randperm(len(flat), generator=self._generator)
            for k in range(config.minibatches):
                part = cast(TensorDict, flat[order[k * size : (k + 1) * size]])
                self._mirror_half(part)
                losses = self.loss(part)
                self.actor_optimiser.zero_grad(set_to_none=True)
                self.critic_optimiser.zero_grad(set_to_none=True)
                (losses["loss_objective"] + losses["loss_entropy"] + losses["loss_critic"]).backward()
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
                torch.nn.utils.clip_grad_norm_(self.critic.parameters(), 1.0)
                self.actor_optimiser.step()
                self.critic_optimiser.step()
                with torch.no_grad():  # of what was not mirrored: else it would also measure how unlike the sides are
                    own = size // 2
                    now = self.network.layers(part.get("observation")[own:])
                    std = self.network.log_std.clamp(-3.0, 0.0).exp()
                    kl = float(_divergence(part.get("loc")[own:], old_std, now, std))
                divergence += kl
                critic_loss += float(losses["loss_critic"].detach())
                updates += 1
                self._adapt_rate(kl, wanted)
        return {
            "divergence": divergence / updates,
            "critic_loss": critic_loss / updates,
            "actor_rate": self.actor_optimiser.param_groups[0]["lr"],
        }

    def _mirror_half(self, part: TensorDict) -> None:
        """Left and right exchanged in half of a minibatch: what is learnt on one side holds on the other.

        The old mean mirrors with the action, so that the old log-probability still belongs to it.
        """
        half = len(part) // 2
        for key, mirror in (
            ("observation", "observation"), ("privileged", "privileged"), ("action", "action"), ("loc", "action"),
        ):  # fmt: skip
            order, signs = self._mirrors[mirror]
            tensor = part.get(key)
            tensor[:half] = tensor[:half][:, order] * signs

    def _adapt_rate(self, divergence: float, wanted: float) -> None:
        group = self.actor_optimiser.param_groups[0]
        if divergence > 2.0 * wanted:
            group["lr"] = max(group["lr"] / 1.5, 1e-5)
        elif divergence < 0.5 * wanted:
            group["lr"] = min(group["lr"] * 1.5, 1e-2)

    def state(self) -> dict:
        """For a checkpoint: tensors and numbers only."""
        return {
            "actor": self.network.state_dict(), "critic": self.critic.state_dict(),
            "average": self._average.state_dict(),
            "see": self.see.state_dict(), "see_all": self.see_all.state_dict(),
            "actor_optimiser": self.actor_optimiser.state_dict(),
            "critic_optimiser": self.critic_optimiser.state_dict(), "iteration": self.iteration,
            "generator": self._generator.get_state(), "observation": self._now[0], "privileged": self._now[1],
        }  # fmt: skip

    def load(self, state: dict) -> None:
        """Go on from a checkpoint."""
        self.network.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        self._average.load_state_dict(state["average"])
        self.see.load_state_dict(state["see"])
        self.see_all.load_state_dict(state["see_all"])
        self.actor_optimiser.load_state_dict(state["actor_optimiser"])
        self.critic_optimiser.load_state_dict(state["critic_optimiser"])
        self.iteration = int(state["iteration"])
        self._generator.set_state(state["generator"])
        self._now = state["observation"], state["privileged"]


def advantages(
    config: PpoConfig, values: Tensor, rewards: Tensor, terminated: Tensor, truncated: Tensor
) -> tuple[Tensor, Tensor]:
    """Generalised advantage estimate of a batch whose episodes begin anew within it.

    The batched simulation has begun anew by the time that it tells of an end: what an episode whose time was up saw
    last is not known, and the value of what it saw before that will do.

    Args:
        config: gamma and lambda.
        values: (h + 1, n, 1) of what was seen before each step and after the last.
        rewards: (h, n, 1)
        terminated: (h, n, 1) fell: nothing comes after it.
        truncated: (h, n, 1) its time was up.

    Returns:
        Advantages and the critic's targets, (h, n, 1) each.
    """
    following = torch.where(truncated, values[:-1], values[1:])
    return advantages_of(
        rewards, values[:-1], following, terminated | truncated, terminated, config.gamma, config.lambda_
    )


def _tensors(mirror: tuple[list[int], list[float]]) -> tuple[Tensor, Tensor]:
    return torch.tensor(mirror[0]), torch.tensor(mirror[1])


def _divergence(old: Tensor, old_std: Tensor, new: Tensor, new_std: Tensor) -> Tensor:
    """Mean Kullback-Leibler divergence of diagonal normal distributions, old from new."""
    return ((new_std / old_std).log() + (old_std**2 + (old - new) ** 2) / (2.0 * new_std**2) - 0.5).sum(-1).mean()
