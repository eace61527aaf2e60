"""Proximal policy optimisation by TorchRL's loss and advantage: one learner for all policies."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss

from train.ppo.config import PpoConfig
from train.ppo.estimates import DiagonalNormal, advantages, divergence
from train.ppo.random_streams import RandomStream
from train.ppo.rollout import Mirror, Rollout, Rollouts
from train.ppo.team import Alone

_LEAST_RATE, _MOST_RATE, _RATE_STEP = 1e-5, 1e-2, 1.5
"""Bounds of an actor's adapted rate, and the factor of one step (Rudin et al. 2022; rsl_rl's defaults)."""
_TOO_FAR, _TOO_NEAR = 2.0, 0.5
"""Multiples of the wanted divergence beyond which the rate is adapted (rsl_rl's)."""


@dataclass(frozen=True, slots=True)
class Networks:
    """Networks to be trained, and how they read a minibatch."""

    actor: nn.Module
    """Network that gives the action's mean and standard deviation, each (n, k)."""
    critic: nn.Module
    """Network that gives values (n, 1)."""
    mirrors: Mapping[str, Mirror]
    """Mirror of each tensor of a minibatch, "action" included."""
    actor_reads: tuple[str, ...] = ("observation",)
    critic_reads: tuple[str, ...] = ("observation",)
    groups: Sequence[tuple[Sequence[nn.Parameter], float]] = ()
    """Parameters of the actor with learning rates of their own, as multiples of the others'."""


class ExtraLoss(Protocol):
    """Terms of a policy's loss beside PPO's own."""

    def prepare(self, part: TensorDict) -> None:
        """Put tensors into a minibatch that the actor reads and no rollout holds."""
        ...

    def extra(self, part: TensorDict, *, critic_only: bool) -> Tensor | None:
        """Compute a term to be added to the loss.

        Args:
            part: A minibatch after ``prepare``.
            critic_only: Whether the actor does not learn by PPO yet.
        """
        ...


class NoExtraLoss:
    """PPO's own loss alone."""

    def prepare(self, part: TensorDict) -> None:
        """Add nothing."""

    def extra(self, part: TensorDict, *, critic_only: bool) -> Tensor | None:
        """Add nothing."""
        return None


class PpoLearner:
    """Actor, critic, their optimiser, and one iteration of PPO on batches from any source.

    Args:
        networks: Networks to be trained.
        rollouts: Source of the batches.
        config: Settings of PPO.
        random: Random numbers of the actions and the minibatches.
        team: The workers that learn along.
        extra: Terms of the loss beside PPO's.
    """

    def __init__(
        self, networks: Networks, rollouts: Rollouts, config: PpoConfig, random: RandomStream, team: Alone,
        extra: ExtraLoss | None = None,
    ):  # fmt: skip
        self.config, self.team, self.rollouts, self.iteration = config, team, rollouts, 0
        self.networks, self.actor, self.critic = networks, networks.actor, networks.critic
        self._random, self._extra = random, extra or NoExtraLoss()
        policy = ProbabilisticActor(
            TensorDictModule(self.actor, list(networks.actor_reads), ["loc", "scale"]), in_keys=["loc", "scale"],
            distribution_class=DiagonalNormal, return_log_prob=True,
        )  # fmt: skip
        self._loss = ClipPPOLoss(
            policy, ValueOperator(self.critic, in_keys=list(networks.critic_reads)), clip_epsilon=config.clip,
            functional=False, entropy_bonus=config.entropy > 0.0, entropy_coeff=config.entropy, critic_coeff=1.0,
            loss_critic_type="smooth_l1", normalize_advantage=config.normalise == "minibatch",
            log_explained_variance=False,
        )  # fmt: skip
        special = {id(p) for group, _ in networks.groups for p in group}
        rest = [p for p in self.actor.parameters() if id(p) not in special]
        groups: list[dict[str, Any]] = [{"params": rest}, {"params": list(self.critic.parameters())}]
        groups += [{"params": list(group)} for group, _ in networks.groups]
        self._factors = (1.0, 1.0, *(factor for _, factor in networks.groups))
        self._optimiser = torch.optim.Adam(groups, lr=config.first_rate)
        self._average = None
        if config.averaging is not None:
            self._average = AveragedModel(self.actor, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))

    @property
    def averaged(self) -> nn.Module:
        """The actor that is exported: the running mean of its weights, if there is one."""
        return self.actor if self._average is None else self._average.module

    @property
    def rate(self) -> float:
        """Present learning rate of the actor."""
        return self._optimiser.param_groups[0]["lr"]

    def restart(self) -> None:
        """Begin new episodes."""
        self.rollouts.restart(self.iteration)

    def iterate(self, progress: float, clock: Callable[[], float] = time.perf_counter) -> dict[str, float]:
        """Collect one batch and learn from it.

        Args:
            progress: Share of the training done, 0-1.
            clock: [s]

        Returns:
            Numbers for the log and the plots, averaged over the workers.
        """
        generator = self._random.at(self.iteration)
        start = clock()
        with torch.no_grad():
            rollout, report = self.rollouts.collect(progress, generator)
        collected = clock()
        report |= self.learn(rollout, progress, generator)
        if self._average is not None:
            self._average.update_parameters(self.actor)
        self.iteration += 1
        samples = rollout.reward.numel() * self.team.size
        report["speed/collect"] = samples / (collected - start)
        report["speed/total"] = samples / (clock() - start)
        keys = list(report)
        values = torch.tensor([report[key] for key in keys], dtype=torch.float64)
        self.team.average(values)
        return dict(zip(keys, values.tolist()))

    def learn(self, rollout: Rollout, progress: float, generator: torch.Generator) -> dict[str, float]:
        """Learn in all epochs over one batch.

        Args:
            rollout: The batch.
            progress: Share of the training done, 0-1.
            generator: Source of the order of the minibatches.

        Returns:
            Numbers for the log and the plots.
        """
        config, team = self.config, self.team
        with torch.no_grad():
            advantage, target = advantages(rollout, config.gamma, config.lambda_)
            if config.normalise == "batch":
                moments = torch.stack((advantage.mean(), advantage.square().mean()))
                team.average(moments)
                advantage = (advantage - moments[0]) / (moments[1] - moments[0] ** 2).clamp_min(1e-12).sqrt()
        self._set_rates(progress)
        self._loss.entropy_coeff.fill_(config.entropy * (1.0 - progress))  # type: ignore[union-attr,operator]
        flat = {key: tensor.flatten(0, 1) for key, tensor in rollout.seen.items()}
        flat |= {
            "action": rollout.action.flatten(0, 1), "action_log_prob": rollout.log_prob.flatten(),
            "advantage": advantage.flatten(0, 1), "value_target": target.flatten(0, 1),
        }  # fmt: skip
        wanted = None
        if config.divergence is not None:
            flat["loc"] = rollout.mean.flatten(0, 1)
            wanted = config.divergence[0] + (config.divergence[1] - config.divergence[0]) * progress
        count = len(flat["advantage"])
        size = min(config.minibatch // team.size, count)
        sums, diverged, updates, old_std = torch.zeros(5), 0.0, 0, None
        for _ in range(config.epochs):
            order = torch.randperm(count, generator=generator)
            for k in range(count // size):
                rows = order[k * size : (k + 1) * size]
                part = TensorDict({key: tensor[rows] for key, tensor in flat.items()}, [size])
                if config.mirror:
                    self._mirror_half(part)
                if wanted is not None and old_std is None:
                    old_std = self._distribution(part, slice(0, 1))[1]
                sums += self.update(part)
                if wanted is not None and old_std is not None:
                    # Only the half that was not mirrored: the other would also measure how unlike the sides are.
                    own = slice(size // 2 if config.mirror else 0, size)
                    mean, std = self._distribution(part, own)
                    apart = float(divergence(part["loc"][own], old_std, mean, std))
                    self._adapt_rate(apart, wanted)
                    diverged += apart
                updates += 1
        means = (sums / updates).tolist()
        names = ("loss/objective", "loss/critic", "loss/divergence", "loss/clipped", "loss/gradient")
        report: dict[str, float] = {}
        report.update(zip(names, means))
        if wanted is not None:
            report["divergence"] = diverged / updates
        residual = float((target - rollout.value).var())
        explained = 1.0 - residual / max(float(target.var()), 1e-12)
        return {**report, "loss/explained": explained, "rate": self.rate}

    def update(self, part: TensorDict) -> Tensor:
        """Make one step of the optimiser.

        Args:
            part: A minibatch.

        Returns:
            Objective, critic's loss, TorchRL's estimate of the divergence, share of clipped actions and the norm of
            the actor's gradient, (5,).
        """
        config, critic_only = self.config, self.iteration < self.config.critic_first
        self._extra.prepare(part)
        losses = self._loss(part)
        loss = losses["loss_critic"]
        if not critic_only:
            loss = loss + losses["loss_objective"]
            if config.entropy > 0.0:
                loss = loss + losses["loss_entropy"]
        extra = self._extra.extra(part, critic_only=critic_only)
        if extra is not None:
            loss = loss + extra
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        self.team.average_gradients([*self.actor.parameters(), *self.critic.parameters()])
        norm = nn.utils.clip_grad_norm_(self.actor.parameters(), config.max_gradient)
        nn.utils.clip_grad_norm_(self.critic.parameters(), config.max_gradient)
        self._optimiser.step()
        keys = ("loss_objective", "loss_critic", "kl_approx", "clip_fraction")
        return torch.stack([*(losses[key].detach().reshape(()) for key in keys), norm.reshape(())])

    def _mirror_half(self, part: TensorDict) -> None:
        """Exchange left and right in half of a minibatch: what is learnt on one side holds on the other.

        The old mean mirrors with the action, so that the old log-probability still belongs to it.
        """
        half = len(part) // 2
        for key, mirror in self.networks.mirrors.items():
            for name in (key, "loc") if key == "action" else (key,):
                if name in part.keys():  # noqa: SIM118  (a TensorDict is not a dict)
                    tensor = cast(Tensor, part[name])
                    tensor[:half] = mirror(tensor[:half])

    @torch.no_grad()
    def _distribution(self, part: TensorDict, rows: slice) -> tuple[Tensor, Tensor]:
        """Mean (n, k) and standard deviation (n, k) of the present policy."""
        return self.actor(*(part[key][rows] for key in self.networks.actor_reads))

    def _set_rates(self, progress: float) -> None:
        config = self.config
        if config.divergence is None:
            rate = config.first_rate + (config.last_rate - config.first_rate) * progress
            for group, factor in zip(self._optimiser.param_groups, self._factors):
                group["lr"] = rate * factor

    def _adapt_rate(self, apart: float, wanted: float) -> None:
        group = self._optimiser.param_groups[0]
        if apart > _TOO_FAR * wanted:
            group["lr"] = max(group["lr"] / _RATE_STEP, _LEAST_RATE)
        elif apart < _TOO_NEAR * wanted:
            group["lr"] = min(group["lr"] * _RATE_STEP, _MOST_RATE)

    def state(self) -> dict:
        """State for a checkpoint: tensors and numbers only."""
        return {
            "actor": self.actor.state_dict(), "critic": self.critic.state_dict(),
            "optimiser": self._optimiser.state_dict(), "iteration": self.iteration,
            "average": {} if self._average is None else self._average.state_dict(),
            "random": self._random.state(), "rollouts": self.rollouts.state(),
        }  # fmt: skip

    def load(self, state: dict) -> None:
        """Restore the state of a checkpoint."""
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        self._optimiser.load_state_dict(state["optimiser"])
        if self._average is not None:
            self._average.load_state_dict(state["average"])
        self.iteration = int(state["iteration"])
        self._random.load(state["random"])
        self.rollouts.load(state["rollouts"])
