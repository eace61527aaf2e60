"""The heuristic function of Section III-C: normalised goal term plus gamma times normalised safety term."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from vuca_nav.types import FloatArray, Pose2


class SafetyCritic(ABC):
    """Rates points as goals: V^h of Section III-C."""

    @abstractmethod
    def values(self, points_in_map: FloatArray, map_from_base: Pose2) -> FloatArray:
        """Higher is safer, (n,) for points (n, 2) [m], the robot at a pose."""


class NoCritic(SafetyCritic):
    """Holds every point for equally safe, which leaves the goal term alone to decide."""

    def values(self, points_in_map: FloatArray, map_from_base: Pose2) -> FloatArray:
        """Zeros, (n,)."""
        return np.zeros(len(points_in_map))


class Scores(NamedTuple):
    """The two terms and their sum, each (n,); the smallest total is best."""

    goal_term: FloatArray
    safety_term: FloatArray
    total: FloatArray


def score_candidates(goal_cost: FloatArray, safety: FloatArray, gamma: float) -> Scores:
    """``(D - D_min) / (D_max - D_min) + gamma (V_max - V) / (V_max - V_min)``.

    Args:
        goal_cost: D^h (n,), n >= 1: Euclidean distance to the goal plus path length from the robot [m].
        safety: V^h (n,).
        gamma: Weight of the safety term.
    """
    goal_term = _normalise(goal_cost - goal_cost.min())
    safety_term = _normalise(safety.max() - safety)
    return Scores(goal_term, safety_term, goal_term + gamma * safety_term)


def _normalise(above_best: FloatArray) -> FloatArray:
    """To [0, 1]; all zero where all are equal (the paper divides by zero there)."""
    spread = above_best.max()
    return above_best / spread if spread > 0.0 else above_best
