"""Random numbers of a training that can be interrupted and resumed."""

from typing import Protocol

import numpy as np
import torch


class RandomStream(Protocol):
    """Source of a learner's random numbers: exploration, then the order of the minibatches."""

    def at(self, iteration: int) -> torch.Generator:
        """Give the generator for an iteration that begins."""
        ...

    def state(self) -> dict:
        """State for a checkpoint."""
        ...

    def load(self, state: dict) -> None:
        """Restore such a state."""
        ...


class StreamPerIteration:
    """Numbers that are a function of seed, worker and iteration; a checkpoint needs none of them.

    Args:
        seed: Seed of the training.
        rank: Rank of the worker.
    """

    def __init__(self, seed: int, rank: int):
        self._seed, self._rank, self._generator = seed, rank, torch.Generator()

    def at(self, iteration: int) -> torch.Generator:
        """Seed the generator anew."""
        sequence = np.random.SeedSequence((self._seed, self._rank, iteration))
        return self._generator.manual_seed(int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1)))

    def state(self) -> dict:
        """Empty state: there is nothing to save."""
        return {}

    def load(self, state: dict) -> None:
        """Do nothing: there is nothing to restore."""


class ContinuedStream:
    """One generator throughout, whose state belongs to the checkpoint.

    Args:
        generator: The generator, as it is once the networks' first weights were drawn from it.
    """

    def __init__(self, generator: torch.Generator):
        self._generator = generator

    def at(self, iteration: int) -> torch.Generator:
        """Give the generator as it is."""
        return self._generator

    def state(self) -> dict:
        """State of the generator."""
        return {"generator": self._generator.get_state()}

    def load(self, state: dict) -> None:
        """Restore such a state."""
        self._generator.set_state(state["generator"])
