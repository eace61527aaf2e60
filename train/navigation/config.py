"""Settings of PPO for navigation policies, and of one run of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from train.ppo.config import PpoConfig
from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationPpoConfig(PpoConfig):
    """Settings of PPO, of the worlds and of the gate."""

    worlds: int = 512
    """Number of rows of the arena."""
    gate_rate: float = 1.0
    """Learning rate of the gate, as a multiple of the other networks'."""
    gate_information: float = 0.0
    """Weight of the mutual information of observation and expert, which favours gates that are sure of each
    observation, and yet use all experts."""
    reward_scale: float = 0.2
    teach_gate: bool = False
    """While only the critic learns, teach a gate of four the skill that each observation calls for."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
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
    """Settings that a run depends on beside its stage."""

    seed: int
    workers: int
    """Number of processes, a core each; another number gives other weights."""
    sources: tuple[Path, ...]
    """Weights that the experts start from, or none."""
    command: str = ""
    """The command line, for the page."""
    collector: Collector = "local"
    """Place of the worlds: ``local``, each worker has its share of them and learns from it; ``ray``, the workers are
    TorchRL's collectors on a Ray cluster, and this process learns."""
