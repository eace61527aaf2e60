"""One training run: stages, checkpoints, curves, and the weights it ends with."""

import copy
import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from robots.locomotion.config import QuadrupedConfig
from robots.locomotion.network import gait_contract
from train.locomotion.curves import draw_curves
from train.locomotion.environment import EnvironmentConfig, LocomotionEnvironment
from train.locomotion.learner import Learner, PpoConfig
from train.locomotion.policy import export
from train.ppo.run_directory import CHECKPOINT, CONFIG, LOG, read_log, save_checkpoint, write_log
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole

_SAVE_EVERY = 25
"""Iterations between checkpoints: half a minute."""
_NEW_FLOORS = 0.02
"""Share of the robots that get a new body and floor after each iteration."""


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
falls far more often (docs/locomotion.md)."""


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
    ppo: PpoConfig = field(default_factory=PpoConfig)
    stages: tuple[Stage, ...] = STAGES

    @property
    def steps_per_iteration(self) -> int:
        """Control steps."""
        return self.environment.num_robots * self.ppo.horizon

    @property
    def iterations(self) -> int:
        """Of collecting and learning."""
        return math.ceil(self.steps / self.steps_per_iteration)


class Training:
    """A run that can be interrupted and gone on with, to the very weights it would have had without.

    Args:
        robot: Who learns.
        config: How.
        out: Directory of checkpoint, log, curves and weights.
        resume: Go on with what is in ``out``.
        threads: Processor cores for the physics.

    Raises:
        BadArgument: If ``out`` cannot be written to, or holds a run and it shall not be resumed, or holds none and
            it shall, or one whose checkpoint or log cannot be read or that is of another robot, gait or config.
    """

    def __init__(
        self, robot: QuadrupedConfig, config: TrainingConfig, out: Path, *, resume: bool = False, threads: int = 1
    ):
        checkpoint = out / CHECKPOINT
        prepare_directory(out)
        if checkpoint.exists() and not resume:
            raise BadArgument(f"{out} holds a training run; go on with it by --resume, or give another --out")
        if resume and not checkpoint.exists():
            raise BadArgument(f"--resume: there is no {checkpoint}")
        torch.set_num_threads(1)  # how a sum is shared out among threads decides about its last bits
        self.robot, self.config, self.out, self._threads = robot, config, out, threads
        self._rng = np.random.default_rng(np.random.SeedSequence(config.seed))
        self._stage = 0
        self.learner = Learner(self._environment(config.stages[0]), config.ppo, config.seed)
        self.elapsed = 0.0
        if resume:
            self._load(checkpoint)
        else:
            (out / LOG).unlink(missing_ok=True)  # of a run that came to no checkpoint
        self._now = self._state()
        write_whole(out / CONFIG, json.dumps(asdict(config), indent=2) + "\n")

    def _load(self, checkpoint: Path) -> None:
        try:
            state = torch.load(checkpoint, weights_only=True)
            contract = {key: state.get(key) for key in self._contract()}
        except Exception as error:  # torch raises whatever the broken bytes lead to
            raise BadArgument(f"{checkpoint} is not a checkpoint that can be read: {error}") from error
        for key, right in self._contract().items():
            if contract[key] != right:
                raise BadArgument(f"{checkpoint} is a run of {key} {contract[key]!r}, not of {right!r}")
        try:
            self._enter_stage(int(state["stage"]))
            self.learner.environment.load({key: tensor.numpy() for key, tensor in state["environment"].items()})
            self.learner.load(state["learner"])
            self._rng.bit_generator.state = json.loads(state["generator"])
            self.elapsed = float(state["elapsed"])
        except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
            raise BadArgument(f"{checkpoint} does not fit the networks of this run: {error}") from error
        log = self.out / LOG
        if log.exists():  # what came after the checkpoint is lost, and will come again
            write_log(log, read_log(log, self.learner.iteration))

    def _contract(self) -> dict[str, str | int]:
        """What a run must have in common with the one it goes on with: everything its weights depend on."""
        config = asdict(self.config)
        seed, steps, ppo = config.pop("seed"), config.pop("steps"), config.pop("ppo")
        return {
            "robot": self.robot.spec.name, "gait": gait_contract(self.robot), "seed": seed, "steps": steps,
            "ppo": json.dumps(ppo, sort_keys=True), "environment and stages": json.dumps(config, sort_keys=True),
        }  # fmt: skip

    def _state(self) -> dict:
        """A copy of everything the next iteration depends on."""
        environment = {key: torch.from_numpy(array) for key, array in self.learner.environment.state().items()}
        live = {
            **self._contract(), "learner": self.learner.state(), "environment": environment, "stage": self._stage,
            "generator": json.dumps(self._rng.bit_generator.state), "elapsed": self.elapsed,
        }  # fmt: skip
        return copy.deepcopy(live)

    def run(self) -> None:
        """Train to the end; interrupted from the keyboard, save the last whole iteration and let the interrupt pass."""
        try:
            self._run()
        except KeyboardInterrupt:
            self._save_checkpoint()
            raise
        self.save()
        draw_curves(self.out / LOG, self.out / "curves.png")

    def _run(self) -> None:
        config, learner = self.config, self.learner
        per_iteration = config.steps_per_iteration
        with (
            SummaryWriter(str(self.out / "tensorboard"), purge_step=learner.iteration) as writer,
            (self.out / LOG).open("a", buffering=1) as log,
            tqdm(
                total=config.iterations * per_iteration, initial=learner.iteration * per_iteration, unit="step",
                unit_scale=True, smoothing=0.05,
            ) as bar,
        ):  # fmt: skip
            for report in self._iterations():
                row = {"iteration": learner.iteration, "steps": learner.iteration * per_iteration}
                log.write(json.dumps({**row, "seconds": round(self.elapsed, 2), **report}) + "\n")
                for key, value in report.items():
                    writer.add_scalar(key, value, learner.iteration)
                bar.set_postfix(
                    reward=f"{report['reward/total']:.2f}", falls=f"{report['falls_per_minute']:.2f}/min", refresh=False
                )
                bar.update(per_iteration)
                if learner.iteration % _SAVE_EVERY == 0:
                    self.save()

    def save(self) -> None:
        """Checkpoint and weights of the last whole iteration."""
        self._save_checkpoint()
        notes = {
            "seed": str(self.config.seed), "minutes": f"{self.elapsed / 60.0:.1f}",
            "control_steps": str(self.learner.iteration * self.config.steps_per_iteration),
            "threads": str(self._threads), "mujoco": mujoco.__version__, "torch": str(torch.__version__),
        }  # fmt: skip
        export(self.out / self.robot.weights, self.robot, self.learner.averaged, self.learner.see, notes)

    def _save_checkpoint(self) -> None:
        save_checkpoint(self.out, self._now)

    def _iterations(self) -> Iterator[dict[str, float]]:
        config, learner = self.config, self.learner
        while learner.iteration < config.iterations:
            start = time.perf_counter()
            progress = learner.iteration / config.iterations
            self._enter_stage(max(k for k, stage in enumerate(config.stages) if stage.start <= progress))
            environment = learner.environment
            environment.difficulty = min(
                config.first_commands + (1.0 - config.first_commands) * progress / config.opened, 1.0
            )
            environment.roughness = self._roughness(progress)
            report = learner.iterate(progress)
            environment.new_floors(_NEW_FLOORS)
            self.elapsed += time.perf_counter() - start
            report["roughness"], report["difficulty"] = environment.roughness, environment.difficulty
            if not math.isfinite(report["critic_loss"]):
                raise FloatingPointError(f"training diverged at iteration {learner.iteration}")
            self._now = self._state()
            yield report

    def _enter_stage(self, stage: int) -> None:
        if stage != self._stage:
            self._stage = stage
            self.learner.move_to(self._environment(self.config.stages[stage]))

    def _roughness(self, progress: float) -> float:
        """Rises over the first half of a stage from the last one's to its own."""
        stages, k = self.config.stages, self._stage
        end = stages[k + 1].start if k + 1 < len(stages) else 1.0
        before = stages[k - 1].roughness if k > 0 else 0.0
        share = (progress - stages[k].start) / (end - stages[k].start)
        return before + (stages[k].roughness - before) * min(max(2.0 * share, 0.0), 1.0)

    def _environment(self, stage: Stage) -> LocomotionEnvironment:
        config = replace(self.config.environment, physics=stage.physics, num_sills=stage.num_sills)
        return LocomotionEnvironment(self.robot, config, self._rng, self._threads)
