"""The arena as one TorchRL environment with a batch size."""

from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from train.arena.arena import Arena
from train.arena.rewards import TERMS, find_rewards, reward_terms


class ArenaEnv(EnvBase):
    """The arena as n environments; ``next`` holds an ended episode's own last observation.

    A reset of a row gives the first observation of its next episode. Beside the reward there are the terms that it is
    the sum of, (n, 7), and whether the goal was reached, (n, 1).

    Args:
        arena: The arena whose rows are the environments.
        rewards: Column of Table I of Zhang et al.

    Raises:
        UnknownName: If there is no such column.
    """

    def __init__(self, arena: Arena, rewards: str = "fusion"):
        super().__init__(device="cpu", batch_size=torch.Size([arena.n]))
        self._arena, self._weights = arena, find_rewards(rewards)
        self._terms = np.zeros((len(TERMS), arena.n), np.float32)
        n = arena.n
        size = torch.Size([n, arena.observation_size])
        flag = Binary(n=1, shape=torch.Size([n, 1]), dtype=torch.bool)
        self.observation_spec = Composite(
            observation=Unbounded(size, dtype=torch.float32),
            terms=Unbounded(torch.Size([n, len(TERMS)]), dtype=torch.float32),
            reached=flag,
            shape=self.batch_size,
        )
        self.action_spec = Bounded(low=-1.0, high=1.0, shape=torch.Size([n, 3]), dtype=torch.float32)
        self.reward_spec = Unbounded(torch.Size([n, 1]), dtype=torch.float32)
        self.done_spec = Composite(
            done=flag.clone(), terminated=flag.clone(), truncated=flag.clone(), shape=self.batch_size
        )
        self._ended = np.zeros(n, np.bool_)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        n = self._arena.n
        mask = tensordict.get("_reset", None) if tensordict is not None else None
        if mask is None:
            observation = self._arena.reset()
        else:
            rows = mask.reshape(n).numpy()
            # Ended episodes have begun anew already; only those that are reset on the way have to.
            observation = self._arena.restart(rows & ~self._ended)
        self._ended[:] = False
        none = torch.zeros((n, 1), dtype=torch.bool)
        return TensorDict(
            {
                "observation": torch.from_numpy(observation.copy()),
                "terms": torch.zeros((n, len(TERMS))),
                "reached": none.clone(),
                "done": none,
                "terminated": none.clone(),
                "truncated": none.clone(),
            },
            batch_size=self.batch_size,
        )

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        step = self._arena.step(tensordict.get("action").numpy())
        reward_terms(step, self._weights, self._terms)
        terminated = step.collided | step.reached
        self._ended = terminated | step.timed_out
        observation = np.where(self._ended[:, None], step.final_observation, step.observation)
        return TensorDict(
            {
                "observation": torch.from_numpy(observation),
                "terms": torch.from_numpy(self._terms.T.copy()),
                "reached": torch.from_numpy(step.reached[:, None].copy()),
                "reward": torch.from_numpy(self._terms.sum(axis=0)[:, None]),
                "done": torch.from_numpy(self._ended[:, None].copy()),
                "terminated": torch.from_numpy(terminated[:, None]),
                "truncated": torch.from_numpy(step.timed_out[:, None].copy()),
            },
            batch_size=self.batch_size,
        )

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            self._arena.reset(seed)
