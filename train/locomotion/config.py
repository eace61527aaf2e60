"""Settings of the training of a gait: its recipe."""

import math
from dataclasses import dataclass, field

from train.locomotion.environment import EnvironmentConfig
from train.ppo.config import PpoConfig

GAIT_PPO = PpoConfig(
    horizon=24, minibatch=3072, epochs=4, normalise="minibatch", divergence=(0.03, 0.008), entropy=0.001,
    averaging=0.98,
)  # fmt: skip
"""Four minibatches of 512 robots. What the actor learns at is adapted to the divergence."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A part of the training, from a share of its steps on."""

    start: float
    """Share of the training's steps, 0-1."""
    physics: int
    """[Hz]"""
    num_sills: int
    roughness: float
    """Reached at the stage's end, from the last stage's: 1 is sills of 4.5 cm and slopes of 12%."""


STAGES = (Stage(0.0, 120, 0, 0.0), Stage(0.25, 120, 6, 1.0))
"""Flat floor first, then sills and slopes. The simulation's 300 Hz cost more than twice as much a step, and a gait
trained at 120 Hz tracks as well there."""


STEPS = 8_000_000
"""Control steps of the full recipe: 13 to 22 minutes on one core. After twice as many it follows commands better and
falls far more often (docs/findings.md)."""


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """Everything the weights depend on. Not the number of threads: they share the robots out, and learning has one."""

    seed: int = 0
    steps: int = STEPS
    """Control steps of all robots together, rounded up to whole iterations."""
    opened: float = 0.1
    """Share of the steps in which the command range opens."""
    first_commands: float = 0.4
    """Share of the command range at first."""
    environment: EnvironmentConfig = field(default_factory=EnvironmentConfig)
    ppo: PpoConfig = field(default_factory=lambda: GAIT_PPO)
    hidden: int = 128
    """Units of both hidden layers of actor and critic."""
    initial_std: float = 0.5
    """Of every action at first."""
    normaliser_until: float = 0.8
    """Share of the training after which the normalisers are frozen: commands, sills and slopes are all there by then,
    and the rest is left to the policy to settle on what it sees."""
    stages: tuple[Stage, ...] = STAGES

    @property
    def steps_per_iteration(self) -> int:
        """Control steps."""
        return self.environment.num_robots * self.ppo.horizon

    @property
    def iterations(self) -> int:
        """Batches to be learnt from."""
        return math.ceil(self.steps / self.steps_per_iteration)
