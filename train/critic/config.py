"""Settings of the training of the critic of V^h."""

from dataclasses import dataclass, field

from train.arena.config import ArenaConfig
from vuca_nav.checks import check_counts, check_fields, check_positive, check_shares


@dataclass(frozen=True, slots=True)
class CriticConfig:
    """How the critic is trained."""

    policy: str = "fusion-plus"
    """Who drives."""
    arena: ArenaConfig = field(
        default_factory=lambda: ArenaConfig(static=0.05, dynamic=0.15, mixed=0.25, square=0.1, corridor=0.45)
    )
    """Where, mostly among walls."""
    rounds: int = 60
    episodes: int = 4096
    """In a round."""
    passes: int = 3
    """Over a round's observations, before the next round."""
    spacing: int = 5
    """Decisions between two observations that are learnt from."""
    sent: float = 0.7
    """Share of the episodes in which the robot is given another goal ..."""
    sent_elsewhere: tuple[int, int] = (3, 50)
    """... and the first decision at which, and the one after the last."""
    time: float = 6.0
    """A meeting after t seconds counts as exp(-t / time): what is farther off may change [s]."""
    hidden: int = 128
    """Units of both hidden layers."""
    minibatch: int = 4096
    rate: float = 2e-3
    """Adam's at first; falls linearly to a hundredth."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        check_counts(self, "rounds", "episodes", "passes", "spacing", "hidden", "minibatch")
        right = "two whole numbers, the first 0 or more and the second greater"
        check_fields(self, right, lambda pair: 0 <= pair[0] < pair[1], "sent_elsewhere")
        check_positive(self, "time", "rate")
        check_shares(self, "sent")
