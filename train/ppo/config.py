"""Settings of the PPO learner."""

from dataclasses import dataclass
from typing import Literal

from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class PpoConfig:
    """Proximal policy optimisation (Schulman et al. 2017); sizes are of all workers together."""

    horizon: int = 32
    """Decisions between updates."""
    minibatch: int = 2048
    epochs: int = 3
    gamma: float = 0.99
    """Discount of a decision."""
    lambda_: float = 0.95
    """Weight of longer returns in the advantage (Schulman et al. 2016)."""
    clip: float = 0.2
    normalise: Literal["batch", "minibatch"] = "batch"
    """Set that advantages are normalised over."""
    first_rate: float = 1e-3
    """Adam's learning rate at first, falling linearly ..."""
    last_rate: float = 1e-4
    """... to this rate at the end."""
    divergence: tuple[float, float] | None = None
    """Kullback-Leibler divergence at first and at the end. If given, both rates start at ``first_rate``, the critic's
    stays, and the actor's is adapted to it after every update (rsl_rl's schedule; Rudin et al. 2022)."""
    entropy: float = 0.003
    """Weight of the actions' entropy at first; falls linearly to 0."""
    max_gradient: float = 1.0
    """Norm that the gradients of actor and critic are clipped to, each."""
    critic_first: int = 0
    """Number of iterations at first in which only the critic learns, so that a new critic does not spoil a trained
    actor."""
    mirror: bool = True
    """Exchange left and right in half of each minibatch."""
    averaging: float | None = None
    """Share of a running mean of the weights (Polyak and Juditsky 1992) that is kept at each iteration. If given, the
    mean is exported."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
        check_counts(self, "horizon", "minibatch", "epochs")
        check_fields(self, "above 0 and at most 1", lambda share: 0.0 < share <= 1.0, "gamma", "lambda_", "clip")
        check_positive(self, "first_rate", "last_rate", "max_gradient")
        check_not_negative(self, "entropy", "critic_first")
