"""The heuristic function (Zhang et al., Section III-C): length of the way to the goal, and its safety."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from vuca_nav.perception.percept import Percept
from vuca_nav.types import FloatArray, Pose2


class Critic(ABC):
    """Rates points as goals: V^h of Section III-C."""

    @abstractmethod
    def values(self, points_in_map: FloatArray, percept: Percept, map_from_base: Pose2) -> FloatArray:
        """Chances of getting there unharmed.

        Args:
            points_in_map: (n, 2) [m].
            percept: The percept of this tick.
            map_from_base: The robot's pose.

        Returns:
            (n,) in [0, 1]; higher is safer.
        """


class NoCritic(Critic):
    """Rates every point as equally safe, which leaves the goal term alone to decide."""

    def values(self, points_in_map: FloatArray, percept: Percept, map_from_base: Pose2) -> FloatArray:
        """Return ones, (n,)."""
        return np.ones(len(points_in_map))


class Scores(NamedTuple):
    """The two terms and their sum, each (n,) [m]; the smallest total is best."""

    goal_term: FloatArray
    safety_term: FloatArray
    total: FloatArray


def score_candidates(goal_cost: FloatArray, safety: FloatArray, gamma: float) -> Scores:
    """``D - D_min + gamma (V_max - V)``: both terms are metres, and 0 for the best.

    The paper divides each term by its spread among the candidates. With that, a hair's breadth between points that are
    equally safe weighs as much as a crowd before one of them.

    Args:
        goal_cost: D^h (n,), n >= 1: Euclidean distance to the goal plus path length from the robot [m].
        safety: V^h (n,), chances.
        gamma: Extra way that is worth it if it surely spares meeting a mover [m].
    """
    goal_term = goal_cost - goal_cost.min()
    safety_term = gamma * (safety.max() - safety)
    return Scores(goal_term, safety_term, goal_term + safety_term)
