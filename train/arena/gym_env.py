"""The arena as a gymnasium vector environment.

``gymnasium.make_vec("vuca_nav.environments:vuca/Arena-v0", num_envs=64, kind="mixed", body="go2")``
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from train.arena.arena import Arena
from train.arena.config import ArenaConfig
from train.arena.rewards import TERMS, find_rewards, reward_terms
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig

ENV_ID = "vuca/Arena-v0"


class ArenaVectorEnv(VectorEnv):
    """The arena as n environments; where an episode ends, ``infos["final_obs"]`` has its last observation.

    The observation returned for it is the first of the next episode. The environments can be neither copied nor
    pickled: TypeError.

    Args:
        arena: The arena whose rows are the environments.
        rewards: Column of Table I of Zhang et al.

    Raises:
        UnknownName: If there is no such column.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}  # noqa: RUF012  (gymnasium's own form)

    def __init__(self, arena: Arena, rewards: str = "fusion"):
        self._arena, self._weights = arena, find_rewards(rewards)
        self._terms = np.zeros((len(TERMS), arena.n), np.float32)
        self._begun = False
        self.num_envs = arena.n
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (arena.observation_size,), np.float32)
        self.single_action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, arena.n)
        self.action_space = batch_space(self.single_action_space, arena.n)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin new episodes everywhere.

        Args:
            seed: Seed of these and all that follow, always the same ones. None goes on with each row's next ones, or
                at the first time draws a seed at random.
            options: Ignored: there are none.

        Raises:
            BadArgument: If the seed is not a single one: each row derives its own.
        """
        if seed is not None and not isinstance(seed, int):
            raise BadArgument(f"seed {seed!r}: one whole number for all rows, or None, would be right")
        super().reset(seed=seed)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(2**31))
        self._begun = True
        return self._arena.reset(seed).copy(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Carry out one decision of all robots.

        Args:
            actions: (n, 3) shares of the body's limits in [-1, 1]; values beyond are clipped, and a differential base
                ignores the second.

        Raises:
            ResetNeeded: If the environments have not been reset.
            BadArgument: If an action is not finite or the shape is wrong.
        """
        if self.closed:
            raise ClosedEnvironmentError("step() after close()")
        if not self._begun:
            raise ResetNeeded("step() before reset(): call reset() first")
        step = self._arena.step(actions)
        reward_terms(step, self._weights, self._terms)
        infos: dict[str, Any] = {"reached": step.reached.copy(), "collided": step.collided.copy()}
        terminated, truncated = step.collided | step.reached, step.timed_out.copy()
        ended = terminated | truncated
        if ended.any():
            infos["final_obs"], infos["_final_obs"] = step.final_observation.copy(), ended
        return step.observation.copy(), self._terms.sum(axis=0), terminated, truncated, infos

    def close_extras(self, **_: Any) -> None:
        """Stop the arena's threads."""
        self._arena.close()


def make_arena_env(
    num_envs: int = 1,
    kind: str | None = None,
    body: str | None = None,
    rewards: str = "fusion",
    config: ArenaConfig | None = None,
    observation: ObservationConfig | None = None,
    threads: int = 1,
    render_mode: None = None,
) -> ArenaVectorEnv:
    """Make the environments; ``gymnasium.make_vec`` calls this.

    Args:
        num_envs: Number of robots, each in a world of its own.
        kind: Only this kind of world, one of ``train.arena.config.KINDS``.
        body: Only this body, one of ``train.arena.config.BODY_KINDS``.
        rewards: Column of Table I of Zhang et al.
        config: All other settings of the episodes; by default those that policies are trained in.
        observation: Observation of the robots; by default that of the paper.
        threads: Number of threads that step the rows; episodes do not depend on them.
        render_mode: None: the arena draws no pictures.

    Raises:
        BadArgument: If there is no such kind, body or render mode, or a number is out of its range.
        UnknownName: If there is no such column of rewards.
    """
    if render_mode is not None:
        raise BadArgument(f"render_mode {render_mode!r}: the arena draws no pictures, None would be right")
    find_rewards(rewards)  # checked first: worlds take longer
    config = config or ArenaConfig()
    config = config if kind is None else config.of(kind)
    config = config if body is None else config.driven_by(body)
    return ArenaVectorEnv(Arena(config, observation or ObservationConfig(), num_envs, 0, threads), rewards)


gymnasium.register(id=ENV_ID, vector_entry_point=make_arena_env)  # type: ignore[arg-type]
