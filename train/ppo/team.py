"""Workers that learn one policy together: gradients are averaged over them (DPPO, Heess et al. 2017)."""

from collections.abc import Iterable
from datetime import timedelta
from pathlib import Path

import torch
import torch.distributed as dist
from torch import Tensor, nn

_PATIENCE = timedelta(minutes=10)
"""Time that a worker waits for another: the first ones to be ready wait for kernels being compiled."""


class Alone:
    """A team of one, with nothing to average."""

    rank = 0
    size = 1

    def average(self, tensor: Tensor) -> None:
        """Replace a tensor by its mean over the workers."""

    def average_gradients(self, parameters: Iterable[nn.Parameter]) -> None:
        """Replace all gradients by their means over the workers."""

    def close(self) -> None:
        """Leave the team."""


class Team(Alone):
    """One of several processes on this computer that average over gloo.

    Args:
        rank: Rank of this process, 0 to size - 1.
        size: Number of processes.
        meeting: A file, absent at first, by which they find one another.
    """

    def __init__(self, rank: int, size: int, meeting: Path):
        dist.init_process_group(
            "gloo", init_method=f"file://{meeting.resolve()}", rank=rank, world_size=size, timeout=_PATIENCE
        )
        self.rank, self.size = rank, size
        self._buffer = torch.empty(0)

    def average(self, tensor: Tensor) -> None:
        """Replace a tensor by its mean over the workers."""
        dist.all_reduce(tensor)
        tensor /= self.size

    def average_gradients(self, parameters: Iterable[nn.Parameter]) -> None:
        """Replace all gradients by their means over the workers, in one message."""
        gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
        count = sum(gradient.numel() for gradient in gradients)
        if len(self._buffer) != count:
            self._buffer = torch.empty(count)
        torch.cat([gradient.reshape(-1) for gradient in gradients], out=self._buffer)
        self.average(self._buffer)
        at = 0
        for gradient in gradients:
            gradient.copy_(self._buffer[at : at + gradient.numel()].view_as(gradient))
            at += gradient.numel()

    def close(self) -> None:
        """Leave the team."""
        dist.destroy_process_group()
