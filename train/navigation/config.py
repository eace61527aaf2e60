"""Settings of PPO for navigation policies, and of one run of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from train.ppo.config import PpoConfig
from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationPpoConfig(PpoConfig):
    """PPO's own settings, and those of the worlds and the gate."""

    worlds: int = 512
    """Rows of the arena."""
    gate_rate: float = 1.0
    """The gate learns so many times as fast as the rest."""
    gate_information: float = 0.0
    """Weight of the mutual information of observation and expert: gates that are sure of each observation, and yet
    use all experts."""
    reward_scale: float = 0.2
    teach_gate: bool = False
    """While only the critic learns, teach a gate of four the skill that each observation calls for."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        PpoConfig.__post_init__(self)  # super() does not know a class with slots
        check_counts(self, "worlds")
        batch = self.worlds * self.horizon
        right = f"no more than a batch, {self.worlds} worlds x {self.horizon} decisions = {batch}"
        check_fields(self, right, lambda minibatch: minibatch <= batch, "minibatch")
        check_positive(self, "gate_rate", "reward_scale")
        check_not_negative(self, "gate_information")


Collector = Literal["local", "ray"]


@dataclass(frozen=True, slots=True)
class RunConfig:
    """What a run depends on beside its stage."""

    seed: int
    workers: int
    """Processes, a core each; another number gives other weights."""
    sources: tuple[Path, ...]
    """Weights that the experts start from, or none."""
    command: str = ""
    """What was typed, for the page."""
    collector: Collector = "local"
    """Where the worlds are: ``local``, each worker has its share of them and learns from it; ``ray``, the workers are
    TorchRL's collectors on a Ray cluster, and this process learns."""
