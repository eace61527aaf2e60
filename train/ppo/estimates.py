"""Estimates of PPO: log-probabilities, advantages, divergences."""

import math

from torch import Tensor
from torch.distributions import Independent, Normal
from torchrl.objectives.value.functional import vec_generalized_advantage_estimate

from train.ppo.rollout import Rollout


class DiagonalNormal(Independent):
    """A normal distribution of independent actions, as TorchRL's actor wants it."""

    def __init__(self, loc: Tensor, scale: Tensor):
        super().__init__(Normal(loc, scale, validate_args=False), 1, validate_args=False)


def log_prob(action: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Logarithm of the density of actions (..., k) under a diagonal normal distribution, (...)."""
    z = (action - mean) / std
    return (-0.5 * z * z - std.log() - 0.5 * math.log(2.0 * math.pi)).sum(-1)


def divergence(old: Tensor, old_std: Tensor, new: Tensor, new_std: Tensor) -> Tensor:
    """Mean Kullback-Leibler divergence of diagonal normal distributions (n, k), old from new."""
    return ((new_std / old_std).log() + (old_std**2 + (old - new) ** 2) / (2.0 * new_std**2) - 0.5).sum(-1).mean()


def advantages(rollout: Rollout, gamma: float, lambda_: float) -> tuple[Tensor, Tensor]:
    """Generalised advantage estimates (Schulman et al. 2016) and the critic's targets.

    An episode whose time was up is worth what would have followed (Pardo et al. 2018, "Time limits in reinforcement
    learning"): an observation does not show that it was.

    Args:
        rollout: A batch.
        gamma: Discount.
        lambda_: Weight of longer returns.

    Returns:
        Advantages and value targets, each (h, n, 1).
    """
    return vec_generalized_advantage_estimate(
        gamma, lambda_, rollout.value, rollout.following, rollout.reward, rollout.done, rollout.terminated, time_dim=0
    )
