"""A tiny environment: points on open ground that move at the speed of their actions."""

from typing import NamedTuple

import numpy as np

from train.navigation.stages import StageConfig


class Step(NamedTuple):
    observation: np.ndarray
    progress: np.ndarray
    clearance: np.ndarray
    turn_rate: np.ndarray
    collided: np.ndarray
    reached: np.ndarray
    timed_out: np.ndarray
    final_observation: np.ndarray


class OpenGround:
    def __init__(self, stage: StageConfig, rows: int):
        self.config, self.n = stage.observation, rows

    def restart(self, seed: int) -> np.ndarray:
        self.rng = np.random.default_rng(seed)
        self.goals = self.rng.uniform(-3.0, 3.0, (self.n, 2))
        self.age = np.zeros(self.n, int)
        return self.observe()

    def observe(self) -> np.ndarray:
        observation = np.zeros((self.n, self.config.size), np.float32)
        distance = np.hypot(*self.goals.T)
        goal = self.config.goal_slice
        if self.config.kind == "frames":
            observation[:, goal] = self.goals
            return observation
        observation[:, goal] = np.stack([2.0 * distance / (distance + 3.0) - 1.0, *(self.goals.T / distance)], axis=1)
        return observation

    def step(self, action: np.ndarray) -> Step:
        before = np.hypot(*self.goals.T)
        self.goals -= 0.1 * action[:, :2]
        self.age += 1
        after = np.hypot(*self.goals.T)
        reached = after < 0.3
        timed_out = (self.age >= 60) & ~reached
        over = reached | timed_out
        last = self.observe()
        self.goals[over] = self.rng.uniform(-3.0, 3.0, (int(over.sum()), 2))
        self.age[over] = 0
        nothing = np.zeros(self.n, bool)
        clearance = np.full(self.n, 6.0)
        return Step(self.observe(), before - after, clearance, np.abs(action[:, 2]), nothing, reached, timed_out, last)
