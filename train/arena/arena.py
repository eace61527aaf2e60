"""The arena: n robots, each in a world of its own or several together, one decision a call."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from train.arena.bank import make_bank
from train.arena.bodies import body_columns
from train.arena.config import ArenaConfig
from train.arena.shard import Outputs, Shard
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig, Observer


class ArenaStep(NamedTuple):
    """Results of a decision, a row for each robot; the arrays are overwritten by the next step."""

    observation: NDArray[np.float32]
    """Observations, (n, size); of the new episode where one ended."""
    progress: NDArray[np.float64]
    """Distance gained towards the goal, (n,) [m]."""
    clearance: NDArray[np.float64]
    """Least true range beyond the footprint at the end of the decision, ``inf`` if there is nothing, (n,) [m]."""
    turn_rate: NDArray[np.float64]
    """Actual turn rate, absolute, (n,) [rad/s]."""
    collided: NDArray[np.bool_]
    """Whether the footprint overlapped an obstacle or a mover, (n,)."""
    reached: NDArray[np.bool_]
    """Whether the true position came within ``GOAL_TOLERANCE`` of the goal, (n,)."""
    timed_out: NDArray[np.bool_]
    """Whether the time was up, (n,)."""
    final_observation: NDArray[np.float32]
    """Last observation of an episode that ended, (n, size); other rows have old ones."""


class Arena:
    """Robots that start anew when their episode ends. The same seed gives the same bits for any number of threads.

    Args:
        config: Settings of the episodes.
        observer_config: Observation of the robots.
        n: Number of robots.
        seed: Seed of all episodes; the layouts have their own, ``config.world_seed``.
        threads: Number of threads that step the rows, whole worlds each; more than there are cores is no use.
        once: Each row runs one episode and then stays as it is.

    Attributes:
        n: Number of robots.
        observation_size: Size of an observation.
        outputs: All results of a decision.

    Raises:
        BadArgument: If a number is out of its range, or beams, rates and sectors do not fit each other.
        BadWorld: If the worlds cannot be made.
    """

    def __init__(
        self,
        config: ArenaConfig,
        observer_config: ObservationConfig,
        n: int,
        seed: int,
        threads: int = 1,
        *,
        once: bool = False,
    ):
        if n < 1 or threads < 1 or seed < 0:
            raise BadArgument(f"arena of {n} robots on {threads} threads, seed {seed}: 1, 1 and 0 or more")
        if n % config.robots:
            raise BadArgument(f"arena of {n} robots, {config.robots} in each world: a multiple of {config.robots}")
        worlds = n // config.robots
        threads = min(threads, worlds)
        self.config, self.observer_config, self.n = config, observer_config, n
        bank, bodies = make_bank(config), body_columns(config)
        atlas = Observer(observer_config, [b.spec for b in bodies.bodies], config.num_beams, config.decision_rate)
        self.bank, self.bodies = bank, bodies
        self.observation_size = observer_config.size
        self.outputs = _outputs(n, observer_config.size)
        firsts = [k * worlds // threads * config.robots for k in range(threads + 1)]
        self._bounds = list(pairwise(firsts))
        self.shards = [
            Shard(
                config, observer_config, bank, bodies, atlas, b - a,
                Outputs(*(array[a:b] for array in self.outputs)), once,
            )
            for a, b in self._bounds
        ]  # fmt: skip
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._seed(seed)
        self._begun = False
        self._step = ArenaStep(*self.outputs[:8])

    def reset(self, seed: int | None = None) -> NDArray[np.float32]:
        """Begin new episodes everywhere.

        Args:
            seed: Seed of these and all that follow; None goes on with each row's next ones.

        Returns:
            Their observations, (n, size), borrowed.
        """
        if seed is not None:
            self._seed(seed)
        for shard in self.shards:
            shard.reset()
        self._begun = True
        return self.outputs.observation

    def restart(self, rows: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Begin new episodes in some rows; for the others no time passes.

        Args:
            rows: Whether each row begins a new episode, (n,).

        Returns:
            Observations of all rows, (n, size), borrowed.
        """
        for shard, (a, b) in zip(self.shards, self._bounds):
            shard.restart(np.flatnonzero(rows[a:b]))
        return self.outputs.observation

    def end(self, rows: NDArray[np.bool_]) -> None:
        """End the episodes of these rows (n,), if each row runs only one: they stay as they are."""
        for shard, (a, b) in zip(self.shards, self._bounds):
            shard.active &= ~rows[a:b]

    def _seed(self, seed: int) -> None:
        """Seed each row's stream, which depends on the seed and on the row's index alone."""
        for shard, (a, b) in zip(self.shards, self._bounds):
            words = [np.random.SeedSequence((seed, row)).generate_state(1, np.uint64)[0] for row in range(a, b)]
            shard.rows.stream[:], shard.rows.drawn[:] = words, 0

    def step(self, action: NDArray[np.float32]) -> ArenaStep:
        """Carry out one decision.

        Args:
            action: (n, 3) shares of the body's limits in [-1, 1]; values beyond are clipped.

        Raises:
            BadArgument: If an action is not finite or the shape is wrong, or no episode has begun.
        """
        if not self._begun:
            raise BadArgument("a step of an arena in which no episode has begun: reset() comes first")
        if action.shape != (self.n, 3):
            raise BadArgument(f"actions of shape {action.shape}: {(self.n, 3)} is right")
        if not np.isfinite(action).all():
            raise BadArgument(f"action of row {int(np.argmin(np.isfinite(action).all(1)))} is not finite")
        if self._pool is None:
            self.shards[0].step(action)
            return self._step
        parts = [action[a:b] for a, b in self._bounds]
        waiting = [self._pool.submit(shard.step, part) for shard, part in zip(self.shards[1:], parts[1:])]
        self.shards[0].step(parts[0])
        for future in waiting:
            future.result()
        return self._step

    def __reduce__(self):
        # The shards write into views of the outputs: a copy's outputs would never change again.
        raise TypeError("an Arena can be neither copied nor pickled; another of the same settings and seed is the same")

    @property
    def active(self) -> NDArray[np.bool_]:
        """Whether each row's episode goes on, (n,): always True unless each row runs only one."""
        return np.concatenate([shard.active for shard in self.shards])

    def gather(self, name: str) -> np.ndarray:
        """Copy one of the fields of ``Rows``, of all rows."""
        return np.concatenate([getattr(shard.rows, name) for shard in self.shards])

    def close(self) -> None:
        """Stop the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _outputs(n: int, size: int) -> Outputs:
    def numbers() -> np.ndarray:
        return np.zeros(n)

    def flags() -> np.ndarray:
        return np.zeros(n, np.bool_)

    return Outputs(
        np.zeros((n, size), np.float32), numbers(), numbers(), numbers(), flags(), flags(), flags(),
        np.zeros((n, size), np.float32), np.zeros(n, np.int64), numbers(), numbers(),
    )  # fmt: skip
