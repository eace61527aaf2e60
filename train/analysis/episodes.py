"""Episodes that are the same for every policy, so that policies are compared row by row, in pairs."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from train.arena.arena import Arena, ArenaStep
from train.arena.config import KINDS, ArenaConfig
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.task import risk_score
from vuca_nav.types import FloatArray
from worlds.motion.movers import TICK_RATE
from worlds.registry import TRAINING_SEED

EVALUATION_SEED = 0
"""First seed of the layouts, which no training has seen."""
Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""Function from observations (n, size) to actions (n, 3)."""


@dataclass(frozen=True, slots=True)
class EpisodeRecords:
    """Results of the episodes; all arrays are (episodes,)."""

    success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    timeout: NDArray[np.bool_]
    time: FloatArray
    """Time at which the episode ended [s]."""
    path_length: FloatArray
    """Length of the true path [m]."""
    shortest: FloatArray
    """Length of the shortest path if nothing moved [m]."""
    arsps: FloatArray
    """Average risk score per step (``vuca_nav.task.risk_score``); less is better."""
    ansps: FloatArray
    """Average navigation score per step of 1/30 s, as eval.metrics has it."""
    min_clearance: FloatArray
    """Least true range beyond the footprint at a decision [m]."""
    kind: NDArray[np.int64]
    """Kind of world, index into KINDS."""
    body: NDArray[np.int64]
    """Body: 0 TIAGo, 1 Go2, from 2 on drawn ones."""

    def of(self, kind: str) -> "EpisodeRecords":
        """Select the episodes in one kind of world."""
        chosen = self.kind == KINDS.index(kind)
        return EpisodeRecords(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})


class Evaluation:
    """Episodes that depend on configuration, seed and index only: each policy meets the same worlds, bodies and movers.

    Args:
        config: Settings of the episodes. Unless it names layouts of its own, those for evaluation are taken.
        observer_config: Observation of the policy; episodes do not depend on it.
        episodes: Number of episodes.
        seed: Seed of the episodes.
        threads: Number of threads that step them.

    Attributes:
        observation: (episodes, size) float32, borrowed.
        arena: The arena, with a row for each episode; one that has ended stays as it was.
    """

    def __init__(
        self, config: ArenaConfig, observer_config: ObservationConfig, episodes: int, seed: int, threads: int = 1
    ):
        if config.world_seed == TRAINING_SEED:
            config = replace(config, world_seed=EVALUATION_SEED)
        self.arena = Arena(config, observer_config, episodes, seed, threads, once=True)
        self._seed, self._ticks = seed, TICK_RATE / config.decision_rate
        self.again()

    def again(self, only: NDArray[np.bool_] | None = None) -> None:
        """Start the same episodes again.

        Args:
            only: (episodes,) which of them are played; the others are not played, and their records mean nothing.
        """
        self.observation, episodes = self.arena.reset(self._seed), self.arena.n
        if only is not None:
            self.arena.end(~only)
        state = self.arena.gather
        self._start_distance = state("distance")
        self._shortest = state("task")[:, 4]
        self._kind, self._body = state("kind"), state("body")
        self._risk, self._decisions = np.zeros(episodes), np.zeros(episodes)
        self._path, self._closest = np.zeros(episodes), self.arena.outputs.clearance.copy()
        self._time = np.zeros(episodes)

    @property
    def active(self) -> NDArray[np.bool_]:
        """Whether each episode still goes on, (episodes,)."""
        return self.arena.active

    def step(self, action: NDArray[np.float32]) -> ArenaStep:
        """Make one decision in the episodes that still go on."""
        before, out = self.active, self.arena.outputs
        risk = risk_score(out.nearest)
        step = self.arena.step(action)
        self._risk[before] += risk[before]
        self._decisions[before] += 1.0
        self._path[before] += out.way[before]
        self._closest[before] = np.minimum(self._closest, out.clearance)[before]
        now = self.active
        self._time[before] += np.where(now, self._ticks, out.ended)[before] / TICK_RATE
        return step

    def run(self, policy: Policy) -> EpisodeRecords:
        """Run all episodes to their ends."""
        while self.active.any():
            self.step(policy(self.observation))
        return self.records()

    def records(self) -> EpisodeRecords:
        """Results of the episodes; of an episode that still goes on, the results so far."""
        out, steps = self.arena.outputs, np.maximum(self._time * TICK_RATE, 1.0)
        gained = (self._start_distance - self.arena.gather("distance")) / self._start_distance
        return EpisodeRecords(
            out.reached.copy(), out.collided.copy(), out.timed_out.copy(), self._time.copy(), self._path.copy(),
            self._shortest.copy(), self._risk / np.maximum(self._decisions, 1.0), gained / steps,
            self._closest.copy(), self._kind.copy(), self._body.copy(),
        )  # fmt: skip
