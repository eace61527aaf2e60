"""Proximal policy optimisation of a navigation policy: TorchRL's loss and advantage over the batched arena."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.objectives import ClipPPOLoss

from train.arena.rewards import TERMS, RewardWeights, reward_terms
from train.navigation.mirror import ACTION_SIGNS, observation_mirror
from train.navigation.networks import ACTION_SIZE, FusedActor, NetworkConfig, as_policy, as_value, make_critic
from train.navigation.skills import SKILLS, skill_labels
from train.ppo.distribution import advantages, log_prob
from train.ppo.team import Alone
from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.types import FloatArray

if TYPE_CHECKING:
    from train.navigation.environment import Environment


@dataclass(frozen=True, slots=True)
class PpoConfig:
    """Settings of the learner; sizes are of all workers together."""

    worlds: int = 512
    """Rows of the arena."""
    horizon: int = 32
    """Decisions between updates."""
    minibatch: int = 2048
    epochs: int = 3
    gamma: float = 0.99
    """A decision."""
    lambda_: float = 0.95
    clip: float = 0.2
    first_rate: float = 1e-3
    """Of Adam at first, falling linearly ..."""
    last_rate: float = 1e-4
    """... to this at the end."""
    gate_rate: float = 1.0
    """The gate learns so many times as fast as the rest."""
    entropy: float = 0.003
    """Weight of the actions' entropy at first; falls linearly to 0."""
    gate_information: float = 0.0
    """Weight of the mutual information of observation and expert: gates that are sure of each observation, and yet
    use all experts."""
    reward_scale: float = 0.2
    max_gradient: float = 1.0
    """Norm that gradients are clipped to, of actor and critic each."""
    critic_first: int = 0
    """Iterations at first in which only the critic learns, so that a trained actor is not spoilt by a new one."""
    teach_gate: bool = False
    """In these, teach a gate of four the skill that each observation calls for."""
    mirror: bool = True
    """Half of each minibatch with left and right exchanged."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        check_counts(self, "worlds", "horizon", "minibatch", "epochs")
        batch = self.worlds * self.horizon
        right = f"no more than a batch, {self.worlds} worlds x {self.horizon} decisions = {batch}"
        check_fields(self, right, lambda minibatch: minibatch <= batch, "minibatch")
        check_fields(self, "above 0 and at most 1", lambda share: 0.0 < share <= 1.0, "gamma", "lambda_", "clip")
        check_positive(self, "first_rate", "last_rate", "gate_rate", "reward_scale", "max_gradient")
        check_not_negative(self, "entropy", "gate_information", "critic_first")


class BaseLearner(ABC):
    """Actor, critic, their optimiser, and one iteration of PPO; wherever its batches come from.

    Args:
        observation: What it shows.
        network: Sizes.
        config: Settings.
        seed: Of weights, actions and minibatches.
        team: Who learns along.

    Raises:
        BadArgument: If there is no gate of four to be taught.
    """

    def __init__(
        self, observation: ObservationConfig, network: NetworkConfig, config: PpoConfig, seed: int, team: Alone
    ):
        self.config, self.team, self.iteration = config, team, 0
        self._observation = observation
        if config.teach_gate and (network.experts != len(SKILLS) or config.critic_first < 1):
            raise BadArgument(f"teach_gate needs {len(SKILLS)} experts and critic_first of 1 or more")
        self._seed = seed
        first = torch.Generator().manual_seed(seed)
        self.actor = FusedActor(observation.size, network, first)
        self.critic = make_critic(observation.size, network, first)
        self._loss = ClipPPOLoss(
            as_policy(self.actor), as_value(self.critic), clip_epsilon=config.clip, functional=False,
            entropy_bonus=config.entropy > 0.0, entropy_coeff=config.entropy, critic_coeff=1.0,
            loss_critic_type="smooth_l1", normalize_advantage=False, log_explained_variance=False,
        )  # fmt: skip
        gate = [] if self.actor.gate_layers is None else list(self.actor.gate_layers.parameters())
        rest = [p for p in self.actor.parameters() if not any(p is q for q in gate)]
        groups = [{"params": rest}, {"params": list(self.critic.parameters())}, *([{"params": gate}] if gate else [])]
        self._optimiser = torch.optim.Adam(groups, lr=config.first_rate)
        self._order, self._signs = observation_mirror(observation)
        self._action_signs = torch.tensor(ACTION_SIGNS)
        self._generator = torch.Generator()
        n, h = config.worlds // team.size, config.horizon
        self._observations = torch.empty(h, n, observation.size)
        self._actions, self._log_probs = torch.empty(h, n, ACTION_SIZE), torch.empty(h, n)
        self._values, self._following, self._rewards = torch.zeros(3, h, n, 1)
        self._done, self._terminated = torch.zeros(2, h, n, 1, dtype=torch.bool)

    @abstractmethod
    def restart(self) -> None:
        """New episodes; a function of the iteration, so that a run that is gone on with sees what it would have."""

    @abstractmethod
    def _roll_out(self) -> tuple[FloatArray, FloatArray]:
        """Fill the buffers with one batch.

        Returns:
            How many episodes were reached, collided, timed out (3,), and the rewards' terms, means over the rows
            summed up over the horizon (7,).
        """

    def iterate(self, progress: float, clock: Callable[[], float] = time.perf_counter) -> dict[str, float]:
        """Collect one batch and learn from it.

        Args:
            progress: Share of the training done, 0-1.
            clock: [s]

        Returns:
            What is worth plotting, averaged over the workers.
        """
        # A function of the iteration, as the episodes are.
        sequence = np.random.SeedSequence((self._seed, self.team.rank, self.iteration))
        self._generator.manual_seed(int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1)))
        start = clock()
        report = self._collect()
        collected = clock()
        report |= self._learn(progress)
        self.iteration += 1
        samples = self._rewards.numel() * self.team.size
        report["speed/collect"] = samples / (collected - start)
        report["speed/total"] = samples / (clock() - start)
        keys = list(report)
        values = torch.tensor([report[key] for key in keys], dtype=torch.float64)
        self.team.average(values)
        return dict(zip(keys, values.tolist()))

    @torch.no_grad()
    def _collect(self) -> dict[str, float]:
        ends, terms = self._roll_out()
        horizon = self.config.horizon
        shares = self.actor.gate(self._observations[-1])
        reached, collided, timed_out = (ends / max(ends.sum(), 1.0)).tolist()
        return {
            "episodes/reached": reached, "episodes/collided": collided, "episodes/timed_out": timed_out,
            "episodes/ended": float(ends.sum()),
            "reward/total": float(terms.sum()) / horizon,
            **{f"reward/{name}": float(term) / horizon for name, term in zip(TERMS, terms)},
            **{f"std/{name}": float(value) for name, value in zip(("v_x", "v_y", "w_z"), self.actor.std())},
            "gate/entropy": float(entropy(shares).mean()),
            **{f"gate/{k}": float(share) for k, share in enumerate(shares.mean(0))},
        }  # fmt: skip

    def _learn(self, progress: float) -> dict[str, float]:
        config, team = self.config, self.team
        advantage, target = advantages(
            self._rewards, self._values, self._following, self._done, self._terminated, config.gamma, config.lambda_
        )
        moments = torch.stack((advantage.mean(), advantage.square().mean()))
        team.average(moments)
        advantage = (advantage - moments[0]) / (moments[1] - moments[0] ** 2).clamp_min(1e-12).sqrt()
        rate = config.first_rate + (config.last_rate - config.first_rate) * progress
        for group, factor in zip(self._optimiser.param_groups, (1.0, 1.0, config.gate_rate)):
            group["lr"] = rate * factor
        self._loss.entropy_coeff.fill_(config.entropy * (1.0 - progress))  # type: ignore[union-attr,operator]
        flat = {
            "observation": self._observations.flatten(0, 1), "action": self._actions.flatten(0, 1),
            "action_log_prob": self._log_probs.flatten(), "advantage": advantage.flatten(0, 1),
            "value_target": target.flatten(0, 1),
        }  # fmt: skip
        count = len(flat["advantage"])
        size = min(config.minibatch // team.size, count)
        sums, updates = torch.zeros(5), 0
        for _ in range(config.epochs):
            order = torch.randperm(count, generator=self._generator)
            for k in range(count // size):
                rows = order[k * size : (k + 1) * size]
                part = TensorDict({key: tensor[rows] for key, tensor in flat.items()}, [size])
                if config.mirror:
                    self._mirror_half(part)
                sums += self._update(part)
                updates += 1
        means = (sums / updates).tolist()
        names = ("loss/objective", "loss/critic", "loss/divergence", "loss/clipped", "loss/gradient")
        variance = float(target.var())
        residual = float((target - self._values).var())
        return {**dict(zip(names, means)), "loss/explained": 1.0 - residual / max(variance, 1e-12), "rate": rate}

    def _update(self, part: TensorDict) -> Tensor:
        """One step of the optimiser; returns what is worth plotting, (5,)."""
        config, actor = self.config, self.actor
        shares = actor.gate(part["observation"])
        losses = self._loss(part.set("gate", shares))
        loss = losses["loss_critic"]
        if self.iteration >= config.critic_first:
            loss = loss + losses["loss_objective"]
            if config.entropy > 0.0:
                loss = loss + losses["loss_entropy"]
            if config.gate_information > 0.0:
                information = entropy(shares.mean(0)) - entropy(shares).mean()
                loss = loss - config.gate_information * information
        elif config.teach_gate:
            labels = skill_labels(part["observation"], self._observation)
            loss = loss + nn.functional.nll_loss(shares.clamp_min(1e-8).log(), labels)
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        self.team.average_gradients([*actor.parameters(), *self.critic.parameters()])
        norm = torch.nn.utils.clip_grad_norm_(actor.parameters(), config.max_gradient)
        torch.nn.utils.clip_grad_norm_(self.critic.parameters(), config.max_gradient)
        self._optimiser.step()
        keys = ("loss_objective", "loss_critic", "kl_approx", "clip_fraction")
        return torch.stack([*(losses[key].detach().reshape(()) for key in keys), norm.reshape(())])

    def _mirror_half(self, part: TensorDict) -> None:
        half = len(part) // 2
        observation, action = part["observation"], part["action"]
        observation[:half] = observation[:half][:, self._order] * self._signs
        action[:half] *= self._action_signs

    def state(self) -> dict:
        """For a checkpoint: tensors and numbers only."""
        return {
            "actor": self.actor.state_dict(), "critic": self.critic.state_dict(),
            "optimiser": self._optimiser.state_dict(), "iteration": self.iteration,
        }  # fmt: skip

    def load(self, state: dict) -> None:
        """Go on from a checkpoint."""
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        self._optimiser.load_state_dict(state["optimiser"])
        self.iteration = state["iteration"]


class Learner(BaseLearner):
    """Learns from an environment of its own, in this process.

    Args:
        environment: With this worker's share of the worlds.
        observation: What it shows.
        network: Sizes.
        config: Settings.
        rewards: What is paid.
        seed: Of weights, actions and minibatches.
        team: Who learns along.

    Raises:
        BadArgument: If there is no gate of four to be taught.
    """

    def __init__(
        self,
        environment: "Environment",
        observation: ObservationConfig,
        network: NetworkConfig,
        config: PpoConfig,
        rewards: RewardWeights,
        seed: int,
        team: Alone,
    ):
        super().__init__(observation, network, config, seed, team)
        self._environment, self._rewards_of = environment, rewards
        self._terms = np.zeros((len(TERMS), config.worlds // team.size), np.float32)

    def restart(self) -> None:
        """New episodes."""
        seed = np.random.SeedSequence((self._seed, self.team.rank, self.iteration, 1)).generate_state(1)[0]
        self._now = torch.tensor(self._environment.restart(int(seed)))

    def _roll_out(self) -> tuple[FloatArray, FloatArray]:
        config, actor = self.config, self.actor
        std = actor.std()
        ends, terms = np.zeros(3), np.zeros(len(TERMS))
        observation = self._now
        for t in range(config.horizon):
            self._observations[t] = observation
            observation = self._observations[t]
            mean = actor.mean(observation, actor.gate(observation))
            action = mean + std * torch.randn(mean.shape, generator=self._generator)
            self._actions[t], self._log_probs[t] = action, log_prob(action, mean, std)
            self._values[t] = self.critic(observation)
            step = self._environment.step(action.clamp(-1.0, 1.0).numpy())
            reward_terms(step, self._rewards_of, self._terms)
            self._rewards[t, :, 0] = torch.from_numpy(self._terms.sum(axis=0)) * config.reward_scale
            terminated = step.collided | step.reached
            self._terminated[t, :, 0] = torch.from_numpy(terminated)
            self._done[t, :, 0] = torch.from_numpy(terminated | step.timed_out)
            if step.timed_out.any():
                last = torch.from_numpy(step.final_observation[step.timed_out])
                self._following[t][torch.from_numpy(step.timed_out)] = self.critic(last)
            ends += (step.reached.sum(), step.collided.sum(), step.timed_out.sum())
            terms += self._terms.mean(axis=1)
            observation = torch.from_numpy(step.observation)
        self._now = observation.clone()
        goes_on = ~self._done
        self._following[:-1][goes_on[:-1]] = self._values[1:][goes_on[:-1]]
        self._following[-1][goes_on[-1]] = self.critic(self._now)[goes_on[-1]]
        return ends, terms


def entropy(shares: Tensor) -> Tensor:
    """Of distributions (..., k) [nat]; ln k where all are alike."""
    return -(shares * shares.clamp_min(math.exp(-50.0)).log()).sum(-1)
