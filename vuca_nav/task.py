"""The facts of the navigation task, each stated once; worlds, evaluation and training take them from here.

They are the goal's tolerance, the near range, the time limit, and the rewards of training: Table I of Zhang et al.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

GOAL_TOLERANCE = 0.3
"""Distance of the true position from the goal within which the goal counts as reached [m]."""
NEAR_RANGE = 0.6
"""Anything nearer than this counts as a risk [m]: R_o in Table I and S_risk of ARSPS in Section V."""
RISK_CLAMP = 0.1
"""Least distance that the risk score is computed with [m].

As printed the score is max(0.6 - m, 0) / (0.6 - max(0.6 - m, 0)), which is (0.6 - m) / m below 0.6 m and has a pole at
m = 0. The lidar's own least range bounds it: no step scores more than (0.6 - 0.1) / 0.1 = 5.
"""
TIME_LIMIT_FACTOR = 4.0
"""Multiple of the time that the shortest way takes at full speed."""
TIME_LIMIT_SLACK = 60.0
"""Time allowed on top of that [s]."""


def risk_score(nearest: float | NDArray[np.floating], weight: float = 1.0) -> NDArray[np.floating]:
    """Risk score of a least distance: S_risk of ARSPS, and with its weight R_o of Table I.

    It is 0 from 0.6 m on, 1 at 0.3 m, and 5 at 0.1 m and nearer.

    Args:
        nearest: Least distance, of any shape [m].
        weight: Factor of the score, w_o of Table I.

    Returns:
        The score, of the same shape.
    """
    clamped = np.minimum(np.maximum(nearest, RISK_CLAMP), NEAR_RANGE)
    return weight * (NEAR_RANGE - clamped) / clamped


def time_limit(shortest: float, max_speed: float) -> float:
    """Time limit of an episode [s]: four times the shortest way at full speed, and a minute.

    Args:
        shortest: Length of the shortest way if nothing moved [m].
        max_speed: The body's greatest speed [m/s].
    """
    return TIME_LIMIT_FACTOR * shortest / max_speed + TIME_LIMIT_SLACK


TERMS = ("R_g", "R_o", "R_c", "R_r", "R_t", "R_e", "R_a")
"""The rows of Table I, in its order."""
COLLISION, REACHED, STEP, TIMEOUT = 15.0, 20.0, 0.01, 5.0
"""The constants of R_c, R_r, R_t and R_e in Table I."""
FREE_TURN_RATE = 0.3
"""Turn rate up to which R_a costs nothing [rad/s]: Table I."""


class RewardWeights(NamedTuple):
    """A column of Table I: the weight of each of ``TERMS``."""

    w_g: float
    """Weight of progress towards the goal [1/m]."""
    w_o: float
    """Weight of the risk score."""
    w_c: float
    """Weight of a collision."""
    w_r: float
    """Weight of reaching the goal."""
    w_t: float
    """Weight of every step."""
    w_e: float
    """Weight of a time-out."""
    w_a: float
    """Weight of turning [s/rad]."""


REWARDS = {
    "go-straight": RewardWeights(3.0, 0.0, -0.25, 1.0, -1.0, -1.0, -0.5),
    "obstacle-avoidance": RewardWeights(1.0, -0.4, -1.0, 0.25, 1.0, 1.0, 0.0),
    "fusion": RewardWeights(4.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0),
    "careful": RewardWeights(4.0, 0.0, -3.0, 1.0, 0.0, -1.0, 0.0),
}
"""The three columns of Table I, and ``careful``, which is not the paper's: as ``fusion``, but a collision costs three
times as much, and a time-out costs what it costs in ``go-straight``: with time-outs free the policy waited too long."""
