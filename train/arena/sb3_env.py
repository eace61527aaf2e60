"""The arena as a ``VecEnv`` of stable-baselines3, which the extra ``sb3`` brings."""

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument, how_to_install

try:
    from stable_baselines3.common.vec_env import VecEnv  # pyright: ignore[reportMissingImports]  (an extra of its own)
except ModuleNotFoundError as error:
    message = f"train.arena.sb3_env needs the package {error.name}; {how_to_install('sb3')}"
    raise ModuleNotFoundError(message, name=error.name) from None

Indices = None | int | Iterable[int]


class ArenaVecEnv(VecEnv):
    """The arena's n environments as stable-baselines3 takes them.

    Where an episode ends, its info holds ``terminal_observation``, ``TimeLimit.truncated`` and ``is_success``.
    The rows are not objects of their own: attributes are those of the whole, and methods of a row are refused.

    Args:
        envs: The arena, ``gymnasium.make_vec("train.arena.gym_env:vuca/Arena-v0", ...)``.

    Raises:
        BadArgument: If the environments do not begin anew in the step that ends an episode.
    """

    def __init__(self, envs: VectorEnv):
        if envs.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise BadArgument(f"{envs}: environments that begin anew in the same step would be right, as the arena's")
        self._envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin new episodes everywhere; after ``seed``, always the same ones."""
        observation, _ = self._envs.reset(seed=self._seeds[0])  # the rows derive their own from it
        self._reset_seeds()
        self._reset_options()
        return observation

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions of the next step, (n, 3) shares of the body's limits in [-1, 1]."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Carry out one decision of all robots.

        Returns:
            Observations (n, size), of the new episode where one ended; rewards (n,); whether an episode ended (n,);
            and the infos.
        """
        observation, rewards, terminated, truncated, infos = self._envs.step(self._actions)
        ended = terminated | truncated
        rows: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(ended):
            rows[row] = {
                "terminal_observation": infos["final_obs"][row],
                "TimeLimit.truncated": bool(truncated[row] and not terminated[row]),
                "is_success": bool(infos["reached"][row]),
            }
        return observation, rewards, ended, rows

    def close(self) -> None:
        """Stop the arena's threads."""
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The environments' common attribute, once for each row asked for."""
        return [getattr(self._envs, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set the environments' common attribute.

        Raises:
            BadArgument: If it shall be set for some rows only.
        """
        if len(self._rows(indices)) != self.num_envs:
            raise BadArgument(f"attribute {attr_name!r} of some rows: the arena has it for all rows together")
        setattr(self._envs, attr_name, value)

    def env_method(self, method_name: str, *_: Any, indices: Indices = None, **__: Any) -> list[Any]:
        """Refuse: the rows have no methods of their own.

        Raises:
            BadArgument: Always.
        """
        raise BadArgument(f"method {method_name!r} of a row: the arena's rows are no objects of their own")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Indices = None) -> list[bool]:
        """No row is wrapped."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: Indices) -> Sequence[int]:
        return list(self._get_indices(indices))
