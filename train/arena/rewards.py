"""The rewards of the paper's Table I: seven terms, one column of weights for each policy that is trained.

Two signs are not as printed: R_g there pays for moving away from the goal, and R_a for turning to the left only.
The column ``careful`` is ours, for what goes beyond the paper.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eval.metrics import RISK_CLAMP, RISK_RANGE
from vuca_nav.errors import UnknownName

TERMS = ("R_g", "R_o", "R_c", "R_r", "R_t", "R_e", "R_a")
COLLISION, REACHED, STEP, TIMEOUT = 15.0, 20.0, 0.01, 5.0
"""The constants of R_c, R_r, R_t and R_e in Table I."""
FREE_TURN_RATE = 0.3
"""A turn rate that R_a leaves alone [rad/s]: Table I."""


class RewardWeights(NamedTuple):
    """A column of Table I."""

    w_g: float
    """Progress towards the goal [1/m]."""
    w_o: float
    """Nearness of obstacles."""
    w_c: float
    """Collision."""
    w_r: float
    """Goal reached."""
    w_t: float
    """Every step."""
    w_e: float
    """Time-out."""
    w_a: float
    """Turning [s/rad]."""


REWARDS = {
    "go-straight": RewardWeights(3.0, 0.0, -0.25, 1.0, -1.0, -1.0, -0.5),
    "obstacle-avoidance": RewardWeights(1.0, -0.4, -1.0, 0.25, 1.0, 1.0, 0.0),
    "fusion": RewardWeights(4.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0),
    "careful": RewardWeights(4.0, 0.0, -3.0, 1.0, 0.0, -1.0, 0.0),
}
"""Table I, column by column; and ``careful``: as ``fusion``, but a collision costs three times as much. With time-outs
free, that made a policy that waits too long (docs/training.md)."""


def find_rewards(name: str) -> RewardWeights:
    """A column by its name.

    Raises:
        UnknownName: If there is no such column.
    """
    if name not in REWARDS:
        raise UnknownName("reward column", name, REWARDS)
    return REWARDS[name]


class Outcome(Protocol):
    """What must be known of a step, as an ``ArenaStep`` tells it; each (n,)."""

    @property
    def progress(self) -> NDArray[np.floating]:
        """How much nearer the goal came [m]."""
        ...

    @property
    def clearance(self) -> NDArray[np.floating]:
        """Least distance beyond the footprint [m]."""
        ...

    @property
    def turn_rate(self) -> NDArray[np.floating]:
        """|w_z| [rad/s]."""
        ...

    @property
    def collided(self) -> NDArray[np.bool_]: ...  # noqa: D102

    @property
    def reached(self) -> NDArray[np.bool_]: ...  # noqa: D102

    @property
    def timed_out(self) -> NDArray[np.bool_]: ...  # noqa: D102


def reward_terms(step: Outcome, weights: RewardWeights, out: NDArray[np.float32]) -> None:
    """The seven terms of every row of a batch.

    Args:
        step: What happened.
        weights: A column of ``REWARDS``.
        out: (7, n), in the order of ``TERMS``; their sum over the first axis is the reward.
    """
    nearest = np.clip(step.clearance, RISK_CLAMP, RISK_RANGE)
    out[0] = weights.w_g * step.progress
    out[1] = weights.w_o * (RISK_RANGE - nearest) / nearest
    out[2] = weights.w_c * COLLISION * step.collided
    out[3] = weights.w_r * REACHED * step.reached
    out[4] = weights.w_t * STEP
    out[5] = weights.w_e * TIMEOUT * step.timed_out
    out[6] = weights.w_a * np.maximum(step.turn_rate - FREE_TURN_RATE, 0.0)
