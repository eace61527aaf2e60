"""What a learner acts in: the arena, as it asks for it."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from train.arena.arena import Arena
from train.arena.rewards import Outcome
from train.navigation.stages import StageConfig


class EnvironmentStep(Outcome, Protocol):
    """An outcome, and what follows."""

    @property
    def observation(self) -> NDArray[np.float32]:
        """(n, size), of the new episode where one ended."""
        ...

    @property
    def final_observation(self) -> NDArray[np.float32]:
        """(n, size), the last one of an episode that ended; other rows may hold anything."""
        ...


class Environment(Protocol):
    """Rows that start anew by themselves when their episode ends. What is given back may be overwritten later."""

    def restart(self, seed: int) -> NDArray[np.float32]:
        """New episodes everywhere, drawn by this seed alone; observations (n, size)."""
        ...

    def step(self, action: NDArray[np.float32]) -> EnvironmentStep:
        """Actions (n, 3) in [-1, 1]."""
        ...


MakeEnvironment = Callable[[StageConfig, int], Environment]
"""Stage and number of rows to an environment."""


class ArenaEnvironment:
    """A worker's share of the arena.

    Args:
        stage: Whose arena.
        rows: How many worlds.
    """

    def __init__(self, stage: StageConfig, rows: int):
        self._arena = Arena(stage.arena, stage.observation, rows, seed=0, threads=1)

    def restart(self, seed: int) -> NDArray[np.float32]:
        """New episodes everywhere, drawn by this seed alone."""
        (shard,) = self._arena.shards
        words = np.random.SeedSequence(seed).generate_state(self._arena.n, np.uint64)
        shard.rows.stream[:] = words
        shard.rows.drawn[:] = 0
        return self._arena.reset()

    def step(self, action: NDArray[np.float32]) -> EnvironmentStep:
        """One decision."""
        return self._arena.step(action)
