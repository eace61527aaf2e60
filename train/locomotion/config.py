"""Settings of the training of a gait: its recipe."""

import math
from dataclasses import dataclass, field

from train.locomotion.environment import EnvironmentConfig
from train.ppo.config import PpoConfig

GAIT_PPO = PpoConfig(
    horizon=24, minibatch=3072, epochs=4, normalise="minibatch", divergence=(0.03, 0.008), entropy=0.001,
    averaging=0.98,
)  # fmt: skip
"""Settings of PPO for gaits: four minibatches of 512 robots; the actor's learning rate is adapted to the divergence."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A part of the training, from a share of its steps on."""

    start: float
    """Share of the training's steps at which the stage begins, 0-1."""
    physics: int
    """Rate of the physics [Hz]."""
    num_sills: int
    roughness: float
    """Roughness reached at the stage's end, from the last stage's: 1 is sills of 4.5 cm and slopes of 12%."""


STAGES = (Stage(0.0, 120, 0, 0.0), Stage(0.25, 120, 6, 1.0))
"""Stages of the training: flat floor first, then sills and slopes. The simulation's 300 Hz cost more than twice as much
a step, and a gait trained at 120 Hz tracks as well there."""


STEPS = 8_000_000
"""Control steps of the full recipe: 13 to 22 minutes on one core. After twice as many it follows commands better and
falls far more often (docs/findings.md)."""


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """All that the weights depend on. The number of threads is not part of it: they only share the robots out."""

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
    """Standard deviation of every action at first."""
    normaliser_until: float = 0.8
    """Share of the training after which the normalisers are frozen: commands, sills and slopes are all there by then,
    and the policy settles on fixed inputs in the rest."""
    stages: tuple[Stage, ...] = STAGES

    @property
    def steps_per_iteration(self) -> int:
        """Control steps of one iteration."""
        return self.environment.num_robots * self.ppo.horizon

    @property
    def iterations(self) -> int:
        """Number of batches to learn from."""
        return math.ceil(self.steps / self.steps_per_iteration)
