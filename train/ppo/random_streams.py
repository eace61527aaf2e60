"""Random numbers of a training that can be interrupted and gone on with."""

from typing import Protocol

import numpy as np
import torch


class RandomStream(Protocol):
    """Where a learner's random numbers come from: exploration, then the order of the minibatches."""

    def at(self, iteration: int) -> torch.Generator:
        """The generator for an iteration that begins."""
        ...

    def state(self) -> dict:
        """For a checkpoint."""
        ...

    def load(self, state: dict) -> None:
        """Go on from such a state."""
        ...


class StreamPerIteration:
    """Numbers that are a function of seed, worker and iteration; a checkpoint needs none of them.

    Args:
        seed: Of the training.
        rank: Of the worker.
    """

    def __init__(self, seed: int, rank: int):
        self._seed, self._rank, self._generator = seed, rank, torch.Generator()

    def at(self, iteration: int) -> torch.Generator:
        """The generator, seeded anew."""
        sequence = np.random.SeedSequence((self._seed, self._rank, iteration))
        return self._generator.manual_seed(int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1)))

    def state(self) -> dict:
        """Nothing."""
        return {}

    def load(self, state: dict) -> None:
        """Nothing to be gone on with."""


class ContinuedStream:
    """One generator throughout; its state belongs to the checkpoint.

    Args:
        generator: As it was left by whoever drew the networks' first weights from it.
    """

    def __init__(self, generator: torch.Generator):
        self._generator = generator

    def at(self, iteration: int) -> torch.Generator:
        """The generator as it is."""
        return self._generator

    def state(self) -> dict:
        """The generator's."""
        return {"generator": self._generator.get_state()}

    def load(self, state: dict) -> None:
        """Go on from such a state."""
        self._generator.set_state(state["generator"])
