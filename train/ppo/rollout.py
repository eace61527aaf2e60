"""What a learner learns from: a batch of decisions, and where it comes from."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor


class Rollout(NamedTuple):
    """Decisions of n rows over h time steps, as the learner's networks are to see them."""

    seen: dict[str, Tensor]
    """What actor and critic read, by the names that ``Networks`` gives, each (h, n, size)."""
    action: Tensor
    """As drawn, (h, n, k)."""
    log_prob: Tensor
    """Of the action, (h, n)."""
    mean: Tensor
    """Of the distribution that the action was drawn from, (h, n, k)."""
    value: Tensor
    """By the critic, of what was seen before each decision, (h, n, 1)."""
    following: Tensor
    """By the critic, of what was seen after it, before a new episode began; where one terminated, any number,
    (h, n, 1)."""
    reward: Tensor
    """(h, n, 1)"""
    done: Tensor
    """Whether an episode ended with the decision, (h, n, 1)."""
    terminated: Tensor
    """Whether it ended for another reason than that its time was up, (h, n, 1)."""

    @classmethod
    def zeros(cls, horizon: int, rows: int, seen: dict[str, int], actions: int) -> "Rollout":
        """Buffers to be filled.

        Args:
            horizon: Time steps.
            rows: Of the batch.
            seen: Sizes of what the networks read.
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
            generator: Of the exploration's noise.

        Returns:
            The batch, borrowed until the next one, and what is worth plotting.
        """

    def state(self) -> dict:
        """Tensors and numbers that the next batch depends on beside the networks and the iteration."""
        return {}

    def load(self, state: dict) -> None:
        """Go on from such a state."""
        return


class Mirror(NamedTuple):
    """Left and right exchanged: ``mirrored = signs * x[..., order]``."""

    order: Tensor
    """(size,)"""
    signs: Tensor
    """(size,)"""

    @classmethod
    def of(cls, order: Sequence[int], signs: Sequence[float]) -> "Mirror":
        """From plain numbers."""
        return cls(torch.tensor(order), torch.tensor(signs))

    def __call__(self, x: Tensor) -> Tensor:
        """The mirror image of (..., size)."""
        return x[..., self.order] * self.signs
