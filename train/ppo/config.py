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
    """What advantages are normalised over."""
    first_rate: float = 1e-3
    """Adam's at first, falling linearly ..."""
    last_rate: float = 1e-4
    """... to this at the end."""
    divergence: tuple[float, float] | None = None
    """If given, both rates start at ``first_rate``, the critic's stays, and the actor's is adapted after every update
    to this Kullback-Leibler divergence, at first and at the end (rsl_rl's schedule; Rudin et al. 2022)."""
    entropy: float = 0.003
    """Weight of the actions' entropy at first; falls linearly to 0."""
    max_gradient: float = 1.0
    """Norm that gradients are clipped to, of actor and critic each."""
    critic_first: int = 0
    """Iterations at first in which only the critic learns, so that a trained actor is not spoilt by a new one."""
    mirror: bool = True
    """Exchange left and right in half of each minibatch."""
    averaging: float | None = None
    """If given, the exported weights are a running mean over the iterations (Polyak and Juditsky 1992), of which this
    share is kept at each."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        check_counts(self, "horizon", "minibatch", "epochs")
        check_fields(self, "above 0 and at most 1", lambda share: 0.0 < share <= 1.0, "gamma", "lambda_", "clip")
        check_positive(self, "first_rate", "last_rate", "max_gradient")
        check_not_negative(self, "entropy", "critic_first")
