"""One training run: stages, checkpoints, curves, and the weights it ends with."""

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
from train.locomotion.curves import draw_curves, read_log
from train.locomotion.environment import EnvironmentConfig, LocomotionEnvironment
from train.locomotion.policy import export
from train.locomotion.ppo import Learner, PpoConfig
from vuca_nav.errors import BadArgument

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
_SAVE_EVERY = 25
"""Iterations between checkpoints."""
_NEW_FLOORS = 0.01
"""Share of the robots that get a new body and floor after each iteration."""


@dataclass(frozen=True, slots=True)
class Stage:
    """A part of the training, from a share of its time on."""

    start: float
    """Share of the training's time, 0-1."""
    physics: int
    """[Hz]"""
    num_sills: int
    roughness: float
    """Reached at the stage's end, from the last stage's: 1 is sills of 4.5 cm and slopes of 11%."""


STAGES = (Stage(0.0, 120, 0, 0.0), Stage(0.5, 120, 6, 1.0))
"""Flat floor first, then sills and slopes. The simulation's 300 Hz cost more than twice as much a step, and a gait
trained at 120 Hz tracks as well there."""


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """Everything a run depends on but the machine's speed."""

    seed: int = 0
    minutes: float = 45.0
    threads: int = 2
    opened: float = 0.1
    """Share of the time in which the command range opens."""
    first_commands: float = 0.4
    """Share of the command range at first."""
    environment: EnvironmentConfig = field(default_factory=EnvironmentConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)
    stages: tuple[Stage, ...] = STAGES


class Training:
    """A run that can be interrupted and gone on with.

    Args:
        robot: Who learns.
        config: How.
        out: Directory of checkpoint, log, curves and weights.
        resume: Go on with what is in ``out``.

    Raises:
        BadArgument: If ``out`` holds a run and it shall not be resumed, or holds none and it shall, or one
            that cannot be read or is of another robot, gait, seed or learner.
    """

    def __init__(self, robot: QuadrupedConfig, config: TrainingConfig, out: Path, *, resume: bool = False):
        checkpoint = out / CHECKPOINT
        if checkpoint.exists() and not resume:
            raise BadArgument(f"{out} holds a training run; go on with it by --resume, or give another --out")
        if resume and not checkpoint.exists():
            raise BadArgument(f"--resume: there is no {checkpoint}")
        if out.exists() and not out.is_dir():
            raise BadArgument(f"--out {out} is a file, expected a directory")
        out.mkdir(parents=True, exist_ok=True)
        torch.set_num_threads(config.threads)
        self.robot, self.config, self.out = robot, config, out
        self._rng = np.random.default_rng(np.random.SeedSequence(config.seed))
        self._stage = 0
        self.learner = Learner(self._environment(config.stages[0]), config.ppo, config.seed)
        self.elapsed = 0.0
        if resume:
            self._load(checkpoint)
        (out / "config.json").write_text(json.dumps(asdict(config), indent=2) + "\n")

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
            self.learner.load(state["learner"])
            self.elapsed = float(state["elapsed"])
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise BadArgument(f"{checkpoint} does not fit the networks of this run: {error}") from error
        log = self.out / LOG
        if log.exists():  # what came after the checkpoint is lost, and will come again
            rows = [row for row in read_log(log) if row["iteration"] <= self.learner.iteration]
            temporary = log.with_suffix(".tmp")
            temporary.write_text("".join(json.dumps(row) + "\n" for row in rows))
            temporary.replace(log)

    def _contract(self) -> dict[str, str | int]:
        """What a run must have in common with the one it goes on with."""
        return {
            "robot": self.robot.spec.name, "gait": gait_contract(self.robot), "seed": self.config.seed,
            "ppo": json.dumps(asdict(self.config.ppo), sort_keys=True),
        }  # fmt: skip

    def run(self) -> None:
        """Train until the time is up; interrupted from the keyboard, save and let the interrupt through."""
        try:
            self._run()
        except KeyboardInterrupt:
            self.save()
            raise
        self.save()
        draw_curves(self.out / LOG, self.out / "curves.png")

    def _run(self) -> None:
        total = 60.0 * self.config.minutes
        with (
            SummaryWriter(str(self.out / "tensorboard")) as writer,
            (self.out / LOG).open("a", buffering=1) as log,
            tqdm(total=round(total), initial=round(self.elapsed), unit="s") as bar,
        ):
            for report in self._iterations(total):
                iteration = self.learner.iteration
                log.write(json.dumps({"iteration": iteration, "seconds": round(self.elapsed, 2), **report}) + "\n")
                for key, value in report.items():
                    writer.add_scalar(key, value, iteration)
                bar.n = min(round(self.elapsed), bar.total)
                bar.set_postfix(
                    reward=f"{report['reward/total']:.2f}", falls=f"{report['falls_per_minute']:.2f}/min",
                    steps=f"{report['speed/total']:.0f}/s",
                )  # fmt: skip
                if iteration % _SAVE_EVERY == 0:
                    self.save()

    def save(self) -> None:
        """Checkpoint and weights, each written aside and then moved."""
        temporary = self.out / f"{CHECKPOINT}.tmp"
        state = {**self._contract(), "learner": self.learner.state(), "elapsed": self.elapsed}
        torch.save(state, temporary)
        temporary.replace(self.out / CHECKPOINT)
        steps = self.learner.iteration * self.config.environment.num_robots * self.config.ppo.horizon
        notes = {
            "seed": str(self.config.seed), "minutes": f"{self.elapsed / 60.0:.1f}", "control_steps": str(steps),
            "threads": str(self.config.threads), "mujoco": mujoco.__version__, "torch": str(torch.__version__),
        }  # fmt: skip
        export(self.out / self.robot.weights, self.robot, self.learner.network, self.learner.see, notes)

    def _iterations(self, total: float) -> Iterator[dict[str, float]]:
        config, learner = self.config, self.learner
        while self.elapsed < total:
            start = time.perf_counter()
            progress = self.elapsed / total
            self._enter_stage(progress)
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
            yield report

    def _enter_stage(self, progress: float) -> None:
        stages = self.config.stages
        now = max(k for k, stage in enumerate(stages) if stage.start <= progress)
        if now != self._stage:
            self._stage = now
            self.learner.move_to(self._environment(stages[now]))

    def _roughness(self, progress: float) -> float:
        """Rises over a stage from the last one's to its own."""
        stages, k = self.config.stages, self._stage
        end = stages[k + 1].start if k + 1 < len(stages) else 1.0
        before = stages[k - 1].roughness if k > 0 else 0.0
        share = (progress - stages[k].start) / (end - stages[k].start)
        return before + (stages[k].roughness - before) * min(max(2.0 * share, 0.0), 1.0)

    def _environment(self, stage: Stage) -> LocomotionEnvironment:
        config = replace(
            self.config.environment, physics=stage.physics, num_sills=stage.num_sills, threads=self.config.threads
        )
        return LocomotionEnvironment(self.robot, config, self._rng)
