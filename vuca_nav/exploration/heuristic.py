"""The heuristic function (Zhang et al., Section III-C): length of the way to the goal, and its safety."""

from abc import ABC, abstractmethod
from typing import Literal, NamedTuple

import numpy as np

from vuca_nav.perception.percept import Percept
from vuca_nav.types import FloatArray, Pose2

LEAST = 1e-9
"""A spread of less is none."""


class Critic(ABC):
    """Rates points as goals: V^h of Section III-C."""

    @abstractmethod
    def values(self, points_in_map: FloatArray, percept: Percept, map_from_base: Pose2) -> FloatArray:
        """V^h of each point as a goal: the chance of getting there unharmed, or a policy's own value.

        Args:
            points_in_map: (n, 2) [m].
            percept: The percept of this tick.
            map_from_base: The robot's pose.

        Returns:
            (n,); higher is safer. Chances are in [0, 1].
        """


class NoCritic(Critic):
    """Rates every point as equally safe, which leaves the goal term alone to decide."""

    def values(self, points_in_map: FloatArray, percept: Percept, map_from_base: Pose2) -> FloatArray:
        """Return ones, (n,)."""
        return np.ones(len(points_in_map))


Score = Literal["metres", "normalised"]
"""How the two terms are weighed: ``metres`` adds them as lengths, ``normalised`` divides each by its spread."""


class Scores(NamedTuple):
    """The two terms and their sum, each (n,), in metres or normalised; the smallest total is best."""

    goal_term: FloatArray
    safety_term: FloatArray
    total: FloatArray


def score_candidates(goal_cost: FloatArray, safety: FloatArray, gamma: float, score: Score = "metres") -> Scores:
    """Score candidates by ``D - D_min + gamma (V_max - V)``; ``normalised`` divides each term by its spread.

    The paper prints ``normalised`` (Section III-C). With it, a hair's breadth between points that are equally safe
    weighs as much as a crowd before one of them.

    Args:
        goal_cost: D^h (n,), n >= 1: path length from the robot plus length of the way on to the goal [m].
        safety: V^h (n,), higher is safer.
        gamma: Weight of V^h: for ``metres`` the extra way that is worth it if it surely spares meeting a mover [m], for
            ``normalised`` without dimension.
        score: How the terms are weighed.
    """
    goal_term, safety_term = goal_cost - goal_cost.min(), safety.max() - safety
    if score == "normalised":
        goal_term, safety_term = goal_term / max(goal_term.max(), LEAST), safety_term / max(safety_term.max(), LEAST)
    safety_term = gamma * safety_term
    return Scores(goal_term, safety_term, goal_term + safety_term)
