"""The heuristic function of Section III-C: normalised goal term plus gamma times safety term, nearly normalised."""

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


SAFETY_SPREAD = 1.0
"""A smaller spread of V^h counts for no more than it is. In units of the critic of ``fusion_plus``, rewards by 0.2, a
collision costs 9, and the goal that is missed by it 4."""


def score_candidates(
    goal_cost: FloatArray, safety: FloatArray, gamma: float, bonus: FloatArray | float = 0.0
) -> Scores:
    """``(D - D_min) / (D_max - D_min) + gamma (V_max - V) / max(V_max - V_min, SAFETY_SPREAD)``.

    The paper divides by the spread of V however small, so that among equally safe points the last bit of V decides as
    much as danger does.

    Args:
        goal_cost: D^h (n,), n >= 1: Euclidean distance to the goal plus path length from the robot [m].
        safety: V^h (n,).
        gamma: Weight of the safety term.
        bonus: Of candidates (n,), in shares of V's spread.
    """
    goal_term = _normalise(goal_cost - goal_cost.min())
    spread = np.ptp(safety)
    safety_term = (safety.max() - safety - bonus * spread) / max(spread, SAFETY_SPREAD)
    return Scores(goal_term, safety_term, goal_term + gamma * safety_term)


def _normalise(above_best: FloatArray) -> FloatArray:
    """To [0, 1]; all zero where all are equal (the paper divides by zero there)."""
    spread = above_best.max()
    return above_best / spread if spread > 0.0 else above_best
