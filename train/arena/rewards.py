"""The rewards of Zhang et al., Table I: seven terms (``vuca_nav.task``), one column of weights for each trained policy.

Two signs are not as printed: R_g there pays for moving away from the goal, and R_a for turning to the left only.
The column ``careful`` is ours, for what goes beyond the paper. ``drl`` are the rewards of the baseline, Long et al. as
publicly reproduced, which are put into the same rows.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vuca_nav.errors import UnknownName
from vuca_nav.task import (
    COLLISION,
    FREE_TURN_RATE,
    REACHED,
    REWARDS,
    STEP,
    TERMS,
    TIMEOUT,
    RewardWeights,
    risk_score,
)

__all__ = ["DRL", "REWARDS", "TERMS", "DrlRewards", "Outcome", "RewardWeights", "find_rewards", "reward_terms"]


class DrlRewards(NamedTuple):
    """Rewards of Long et al., numbers as in the public reproduction."""

    progress: float = 2.5
    """Reward of progress towards the goal [1/m]; the step that reaches it is paid ``reached`` in its place."""
    reached: float = 15.0
    collision: float = -15.0
    turn: float = -0.1
    """Reward of each rad/s of a turn that is faster than ``free_turn_rate`` [s/rad]."""
    free_turn_rate: float = 1.05
    """Turn rate up to which turning costs nothing [rad/s]."""


DRL = "drl"
Rewards = RewardWeights | DrlRewards


def find_rewards(name: str) -> Rewards:
    """Find a column, or the rewards of the baseline, by name.

    Raises:
        UnknownName: If there is no such column.
    """
    if name == DRL:
        return DrlRewards()
    if name not in REWARDS:
        raise UnknownName("reward column", name, (*REWARDS, DRL))
    return REWARDS[name]


class Outcome(Protocol):
    """Quantities of a step that the rewards are computed from, as an ``ArenaStep`` has them; each (n,)."""

    @property
    def progress(self) -> NDArray[np.floating]:
        """Distance gained towards the goal [m]."""
        ...

    @property
    def clearance(self) -> NDArray[np.floating]:
        """Least distance beyond the footprint [m]."""
        ...

    @property
    def turn_rate(self) -> NDArray[np.floating]:
        """Absolute turn rate |w_z| [rad/s]."""
        ...

    @property
    def collided(self) -> NDArray[np.bool_]: ...  # noqa: D102

    @property
    def reached(self) -> NDArray[np.bool_]: ...  # noqa: D102

    @property
    def timed_out(self) -> NDArray[np.bool_]: ...  # noqa: D102


def reward_terms(step: Outcome, weights: Rewards, out: NDArray[np.float32]) -> None:
    """Compute the seven terms of every row of a batch.

    Args:
        step: Outcome of the step.
        weights: Result of ``find_rewards``.
        out: (7, n), in the order of ``TERMS``; their sum over the first axis is the reward.
    """
    if isinstance(weights, DrlRewards):
        out[:] = 0.0
        out[0] = weights.progress * step.progress * ~step.reached
        out[2] = weights.collision * step.collided
        out[3] = weights.reached * step.reached
        out[6] = weights.turn * step.turn_rate * (step.turn_rate > weights.free_turn_rate)
        return
    out[0] = weights.w_g * step.progress
    out[1] = risk_score(step.clearance, weights.w_o)
    out[2] = weights.w_c * COLLISION * step.collided
    out[3] = weights.w_r * REACHED * step.reached
    out[4] = weights.w_t * STEP
    out[5] = weights.w_e * TIMEOUT * step.timed_out
    out[6] = weights.w_a * np.maximum(step.turn_rate - FREE_TURN_RATE, 0.0)
