"""Settings of the training of the critic of V^h."""

from dataclasses import dataclass, field

from train.arena.config import ArenaConfig
from vuca_nav.checks import check_counts, check_fields, check_positive, check_shares


@dataclass(frozen=True, slots=True)
class CriticConfig:
    """Settings of the training of the critic."""

    policy: str = "fusion-plus"
    """Policy that drives."""
    arena: ArenaConfig = field(
        default_factory=lambda: ArenaConfig(static=0.05, dynamic=0.15, mixed=0.25, square=0.1, corridor=0.45)
    )
    """Worlds to drive in, mostly among walls."""
    rounds: int = 60
    episodes: int = 4096
    """Episodes in a round."""
    passes: int = 3
    """Passes over a round's observations, before the next round."""
    spacing: int = 5
    """Decisions between two observations that are learnt from."""
    sent: float = 0.7
    """Share of the episodes in which the robot is given another goal ..."""
    sent_elsewhere: tuple[int, int] = (3, 50)
    """... and the first decision at which that happens, and one past the last."""
    time: float = 6.0
    """Time constant [s]: a meeting after t seconds counts as exp(-t / time), as the distant future may change."""
    hidden: int = 128
    """Units of both hidden layers."""
    minibatch: int = 4096
    rate: float = 2e-3
    """Adam's learning rate at first; falls linearly to a hundredth."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
        check_counts(self, "rounds", "episodes", "passes", "spacing", "hidden", "minibatch")
        right = "two whole numbers, the first 0 or more and the second greater"
        check_fields(self, right, lambda pair: 0 <= pair[0] < pair[1], "sent_elsewhere")
        check_positive(self, "time", "rate")
        check_shares(self, "sent")
