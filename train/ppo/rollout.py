"""Batches that a learner learns from, and the interface of their sources."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor


class Rollout(NamedTuple):
    """Decisions of n rows over h time steps, as the learner's networks read them."""

    seen: dict[str, Tensor]
    """Inputs of actor and critic, by the names that ``Networks`` gives, each (h, n, size)."""
    action: Tensor
    """Actions as drawn, (h, n, k)."""
    log_prob: Tensor
    """Log-probability of the action, (h, n)."""
    mean: Tensor
    """Mean of the distribution that the action was drawn from, (h, n, k)."""
    value: Tensor
    """Critic's value of the observation before each decision, (h, n, 1)."""
    following: Tensor
    """Critic's value of the observation after it, before a new episode began; where one terminated, any number, (h, n,
    1)."""
    reward: Tensor
    """Rewards, (h, n, 1)."""
    done: Tensor
    """Whether an episode ended with the decision, (h, n, 1)."""
    terminated: Tensor
    """Whether an episode ended for another reason than the time limit, (h, n, 1)."""

    @classmethod
    def zeros(cls, horizon: int, rows: int, seen: dict[str, int], actions: int) -> "Rollout":
        """Make buffers to be filled.

        Args:
            horizon: Number of time steps.
            rows: Number of rows of the batch.
            seen: Sizes of the inputs of the networks.
            actions: Size of an action.
        """
        h, n = horizon, rows
        flags = torch.zeros(2, h, n, 1, dtype=torch.bool)
        return cls(
            {key: torch.zeros(h, n, size) for key, size in seen.items()}, torch.zeros(h, n, actions),
            torch.zeros(h, n), torch.zeros(h, n, actions), *torch.zeros(3, h, n, 1), *flags,
        )  # fmt: skip


class Rollouts(ABC):
    """A source of batches, each collected with the present weights."""

    def restart(self, iteration: int) -> None:
        """Begin new episodes, if this source begins any at a checkpoint; a function of the iteration alone."""
        return

    @abstractmethod
    def collect(self, progress: float, generator: torch.Generator) -> tuple[Rollout, dict[str, float]]:
        """Collect one batch.

        Args:
            progress: Share of the training done, 0-1.
            generator: Source of the exploration's noise.

        Returns:
            The batch, borrowed until the next one, and numbers for the plots.
        """

    def state(self) -> dict:
        """State that the next batch depends on beside the networks and the iteration: tensors and numbers."""
        return {}

    def load(self, state: dict) -> None:
        """Restore such a state."""
        return


class Mirror(NamedTuple):
    """Exchange of left and right: ``mirrored = signs * x[..., order]``."""

    order: Tensor
    """Order of the mirrored values, (size,)."""
    signs: Tensor
    """Signs of the mirrored values, (size,)."""

    @classmethod
    def of(cls, order: Sequence[int], signs: Sequence[float]) -> "Mirror":
        """Make a mirror from plain numbers."""
        return cls(torch.tensor(order), torch.tensor(signs))

    def __call__(self, x: Tensor) -> Tensor:
        """Mirror (..., size)."""
        return x[..., self.order] * self.signs
