"""Hundreds of robots on randomised floors, stepped together by MuJoCo."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import copy
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from robots.locomotion.config import LEGS, QuadrupedConfig
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.model import GRAVITY, QuadrupedModel
from robots.noise import NoiseConfig
from train.locomotion.batch import Batch, SensorNoise
from train.locomotion.floors import Floor, compile_model
from train.locomotion.kernels import (
    CRITIC_SIZE,
    NUM_NORMAL,
    NUM_UNIFORM,
    Challenge,
    Chance,
    Observations,
    PhysicsResult,
    Verdict,
    go_on,
    judge,
)
from train.locomotion.randomise import Randomisation, randomise
from train.locomotion.rewards import REWARDS, RewardWeights
from vuca_nav.types import BodySpec, FloatArray


@dataclass(frozen=True, slots=True)
class EnvironmentConfig:
    """Settings of the batch."""

    num_robots: int = 512
    physics: int = 120
    """Rate of the physics [Hz]."""
    control: int = 60
    """Rate of the gait [Hz]."""
    episode: float = 20.0
    """Longest episode [s]."""
    command_margin: tuple[float, float, float, float, float, float] = (0.1, 0.15, 0.1, 0.1, 0.2, 0.2)
    """Amounts by which commands go beyond the robot's limits, lowest and highest v_x, v_y [m/s] and w_z [rad/s]: the
    greatest trim and a little more."""
    push_speed: float = 1.2
    """Largest sudden change of velocity [m/s]."""
    push_interval: float = 3.0
    """Mean time between pushes [s]."""
    num_sills: int = 0
    """Number of bars on each robot's floor."""
    randomisation: Randomisation = field(default_factory=lambda: Randomisation(friction=(0.3, 1.25)))
    """Ranges of robots and floors. The floors are more slippery than those of the evaluation: on its worst ones most
    falls happened."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    noise_factor: float = 1.5
    """Factor on the simulation's noise in training: no robot's noise is known better."""


class Transition(NamedTuple):
    """Results of one control step; arrays are borrowed until the next one."""

    observation: NDArray[np.float32]
    """Observations with the sensors' noise, (n, OBSERVATION_SIZE); after a reset, of the new episode."""
    privileged: NDArray[np.float32]
    """Inputs of the critic without noise, with quantities that no robot measures, (n, CRITIC_SIZE)."""
    reward: NDArray[np.float32]
    """Rewards, (n,)."""
    terminated: NDArray[np.bool_]
    """Whether each robot fell, (n,)."""
    truncated: NDArray[np.bool_]
    """Whether each episode's time was up, (n,)."""


class LocomotionEnvironment:
    """A batch of robots of one kind."""

    def __init__(self, robot: QuadrupedConfig, config: EnvironmentConfig, rng: np.random.Generator, threads: int = 1):
        self.config, self._rng = config, rng
        self.model = QuadrupedModel(robot)
        self.tuning = self.model.tuning(1.0 / config.control)
        floor = Floor.for_training(config.num_sills)
        # Targets are late here too, but by steps of the physics, which the batch counts: faster than MuJoCo's history.
        self._base = compile_model(self.model, config.physics, floor, touch=True, delayed=False)
        self._base.opt.iterations, self._base.opt.ls_iterations = 6, 8
        n = config.num_robots
        self._models = [copy.copy(self._base) for _ in range(n)]
        self._datas = [mujoco.MjData(self._base) for _ in range(threads)]
        self._pool = rollout.Rollout(nthread=threads if threads > 1 else 0)
        size = mujoco.mj_stateSize(self._base, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._substeps = config.physics // config.control
        self._states = np.zeros((n, self._substeps, size))
        self._sensors = np.zeros((n, self._substeps, self._base.nsensordata))
        self._control = np.zeros((n, self._substeps, ACTION_SIZE))
        self._touch = np.array([int(self._base.sensor(f"{robot.spec.name}/{leg}_touch").adr[0]) for leg in LEGS])
        self._uniform, self._normal = np.empty((n, NUM_UNIFORM)), np.empty((n, NUM_NORMAL))
        self.batch = Batch.zeros(n, size)
        self._noise = SensorNoise.of(config.noise, 1.0 / config.control, config.noise_factor)
        self._body_seeds, self._body_roughness = np.zeros(n, np.int64), np.zeros(n)
        self._due = np.zeros(n, np.bool_)
        self.difficulty = 0.0
        """Share of the command range that has been opened, 0-1."""
        self.roughness = 0.0
        """Height of sills and steepness of ramps, 0-1."""
        self._observation = np.zeros((n, OBSERVATION_SIZE), np.float32)
        self._privileged = np.zeros((n, CRITIC_SIZE), np.float32)
        self._reward = np.zeros(n, np.float32)
        self._terminated, self._truncated = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        # Where a robot's place is taken modulo this, the floor is level: it always has the same sills around it.
        self._wrap = 0.5 * floor.length if config.num_sills else 50.0
        self._terms = np.zeros((n, len(REWARDS)))
        self._physics = PhysicsResult(self._states[:, -1], self._sensors[:, -1], self._touch)
        self._verdict = Verdict(self._reward, self._terminated, self._truncated, self._terms)
        self._chance = Chance(self._uniform, self._normal)
        self._observations = Observations(self._observation, self._privileged)
        self._weights = RewardWeights()
        self._low, self._high = command_range(robot.spec, config.command_margin)
        self._draw_bodies(np.arange(n))

    def new_floors(self, share: float) -> None:
        """End the episodes of a share of the robots with the next step; then they get new bodies and floors."""
        self._due |= self._rng.random(self.config.num_robots) < share
        self.batch.must_reset[self._due] = True

    def _draw_bodies(self, chosen: NDArray[np.intp]) -> None:
        self._body_seeds[chosen] = self._rng.integers(2**63, size=len(chosen))
        self._body_roughness[chosen] = self.roughness
        self.batch.delay[chosen] = self._rng.integers(0, self._substeps + 1, len(chosen))
        self._make_bodies(chosen)

    def _make_bodies(self, chosen: NDArray[np.intp]) -> None:
        """Make the bodies from their seeds, so that a checkpoint need not hold the models."""
        for i in chosen.tolist():
            rng, roughness = np.random.default_rng(int(self._body_seeds[i])), float(self._body_roughness[i])
            randomise(self._models[i], self._base, self._datas[0], self.config.randomisation, rng, roughness)
            self.batch.up_world[i] = -self._models[i].opt.gravity / GRAVITY

    def step(self, action: NDArray[np.float32]) -> Transition:
        """Make one control step of all robots. action: (n, ACTION_SIZE)."""
        batch, config = self.batch, self.config
        np.copyto(batch.action, action)
        self._rng.random(out=self._uniform)
        self._rng.standard_normal(out=self._normal)
        batch.targets_for(self.model.legs, self.tuning, self._control)
        self._pool.rollout(
            self._models, self._datas, batch.state, self._control, nstep=self._substeps, skip_checks=True,
            state=self._states, sensordata=self._sensors,
        )  # fmt: skip
        judge(
            self.model.legs, self.tuning, batch, self._physics, self._weights,
            round(config.episode * config.control), self._verdict,
        )  # fmt: skip
        if self._due.any():  # their episodes are over, their next ones have not begun
            self._draw_bodies(np.flatnonzero(self._due))
            self._due[:] = False
        low, high = self._low * self.difficulty, self._high * self.difficulty
        challenge = Challenge(low, high, config.push_speed * self.difficulty, config.push_interval, self._wrap)
        go_on(
            self.model.legs, self.tuning, self._noise, batch, self._terminated | self._truncated, self._physics,
            self._chance, challenge, self._observations,
        )  # fmt: skip
        return Transition(self._observation, self._privileged, self._reward, self._terminated, self._truncated)

    def state(self) -> dict[str, NDArray]:
        """All state that changes from step to step but the generator of random numbers; borrowed."""
        own = {"body_seeds": self._body_seeds, "body_roughness": self._body_roughness, "due": self._due}
        return own | self.batch._asdict()

    def load(self, state: dict[str, NDArray]) -> None:
        """Restore such a state of an environment of the same robot and config.

        Raises:
            KeyError: If a part is missing.
            ValueError: If it is of another number of robots.
        """
        for key, array in self.state().items():
            array[:] = state[key]
        self._make_bodies(np.arange(self.config.num_robots))

    def reward_terms(self) -> dict[str, float]:
        """Mean of each part of the reward in the last step."""
        return dict(zip(REWARDS, self._terms.mean(axis=0).tolist()))


def command_range(spec: BodySpec, margin: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest commands of a training (3,) each: the robot's limits, widened by ``margin`` (6,)."""
    limits = np.array([spec.min_v_x, spec.max_v_x, -spec.max_v_y, spec.max_v_y, -spec.max_w_z, spec.max_w_z])
    # Rounded to decimals: the last bit of a sum would make another training of the same numbers.
    widened = np.round(limits + np.tile((-1.0, 1.0), 3) * margin, 9)
    return widened[0::2], widened[1::2]
