"""What every PPO learner here shares: the action's distribution, and the advantage."""

import math

import torch
from torch import Tensor
from torch.distributions import Independent, Normal
from torchrl.objectives.value.functional import vec_generalized_advantage_estimate


class DiagonalNormal(Independent):
    """A normal distribution of independent actions, as TorchRL's actor wants it."""

    def __init__(self, loc: Tensor, scale: Tensor):
        super().__init__(Normal(loc, scale, validate_args=False), 1, validate_args=False)


def log_prob(action: Tensor, mean: Tensor, std: Tensor) -> Tensor:
    """Of actions (..., k) under a diagonal normal distribution, (...)."""
    z = (action - mean) / std
    return (-0.5 * z * z - std.log() - 0.5 * math.log(2.0 * math.pi)).sum(-1)


@torch.no_grad()
def advantages(
    rewards: Tensor, values: Tensor, following: Tensor, done: Tensor, terminated: Tensor, gamma: float, lambda_: float
) -> tuple[Tensor, Tensor]:
    """Generalised advantage estimates (Schulman et al. 2016) and the critic's targets.

    An episode whose time was up is worth what would have followed (Pardo et al. 2018, "Time limits in reinforcement
    learning"): nothing in an observation tells that it was.

    Args:
        rewards: (t, n, 1).
        values: (t, n, 1) of what was seen before each step.
        following: (t, n, 1) of what was seen after it, before a new episode began; where one terminated, any number.
        done: (t, n, 1) whether an episode ended with the step.
        terminated: (t, n, 1) whether it ended for another reason than that its time was up.
        gamma: Discount.
        lambda_: Weight of longer returns.

    Returns:
        Advantages and value targets, each (t, n, 1).
    """
    return vec_generalized_advantage_estimate(gamma, lambda_, values, following, rewards, done, terminated, time_dim=0)
