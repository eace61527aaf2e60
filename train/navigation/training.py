"""One stage of the training: workers, checkpoints, curves, and the weights it ends with."""

import hashlib
import importlib.util
import json
import math
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import torch
from torch.multiprocessing.spawn import start_processes
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from train.arena.rewards import find_rewards
from train.navigation.card import write_card
from train.navigation.curves import draw_curves
from train.navigation.environment import Environment, MakeEnvironment
from train.navigation.learner import BaseLearner, Learner, PpoConfig
from train.navigation.stages import StageConfig
from train.navigation.weights import export, find_sources, start_from
from train.ppo.run_directory import (
    CHECKPOINT,
    LOG,
    load_checkpoint,
    note_commit,
    open_run,
    read_commits,
    read_log,
    read_whole_log,
    save_checkpoint,
    write_log,
)
from train.ppo.team import Alone, Team
from vuca_nav.errors import BadArgument, how_to_install

Collector = Literal["local", "ray"]
SAVE_EVERY = 50
"""Iterations between checkpoints; after each, all episodes start anew."""


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


class Training:
    """A run that can be interrupted and gone on with.

    Args:
        stage: What is learnt, and how.
        run: By whom, from what.
        out: Directory of checkpoint, log, curves and weights.
        make_environment: Builds a worker's arena.
        resume: Go on with what is in ``out``, if anything is.

    Raises:
        BadArgument: If ``out`` holds a run and it shall not be resumed, or one of another configuration, or if the
            worlds or the minibatch cannot be shared out evenly, or the experts cannot start as the sources.
        BadWeights: If a source is missing or broken.
    """

    def __init__(
        self, stage: StageConfig, run: RunConfig, out: Path, make_environment: MakeEnvironment, *, resume: bool = False
    ):
        _check(stage, run)
        self._sources = find_sources(run.sources, stage.network, stage.observation) if run.sources else []
        self.stage, self.run_config, self.out, self._make = stage, run, out, make_environment
        contract = json.loads(json.dumps({"stage": asdict(stage), "seed": run.seed, "workers": run.workers}))
        if run.collector != "local":
            contract["collector"] = run.collector
        if run.sources:
            contract["sources"] = [[path.stem, hashlib.sha256(path.read_bytes()).hexdigest()] for path in run.sources]
        open_run(out, contract, resume=resume)

    @property
    def weights(self) -> Path:
        """What the run ends with."""
        return self.out / f"{self.stage.name}.safetensors"

    def run(self) -> None:
        """Train until all steps are made.

        An interrupted run loses what it did since its last checkpoint.

        Raises:
            BadArgument: If checkpoint or log of a run that is gone on with are damaged.
        """
        run = self.run_config
        if (self.out / CHECKPOINT).exists():
            state = load_checkpoint(self.out / CHECKPOINT, ("steps", "elapsed"))
            read_whole_log(self.out / LOG, state["steps"] // (self.stage.ppo.worlds * self.stage.ppo.horizon))
            if state["steps"] >= self.stage.steps:
                if not self.weights.with_suffix(".md").exists():  # killed between the last checkpoint and the page
                    self.describe(state["steps"], state["elapsed"])
                return
        note_commit(self.out)
        if run.collector == "ray":
            from train.ppo.ray_rollouts import RayLearner

            torch.set_num_threads(1)
            with RayLearner(self.stage, run.seed, run.workers) as learner:
                self.learn(learner)
            return
        rows = self.stage.ppo.worlds // run.workers
        environments = [self._make(self.stage, rows) for _ in range(run.workers)]
        if run.workers == 1:
            _work(0, self, environments, "")
            return
        with tempfile.TemporaryDirectory() as folder:
            # Forked, a worker has its worlds and torch at once; nothing has begun to use threads yet.
            meeting = str(Path(folder) / "meeting")
            start_processes(_work, (self, environments, meeting), nprocs=run.workers, start_method="fork")

    def learn(self, learner: BaseLearner) -> None:
        """One worker's part."""
        stage, run, team = self.stage, self.run_config, learner.team
        checkpoint = self.out / CHECKPOINT
        steps, elapsed = 0, 0.0
        if checkpoint.exists():
            state = load_checkpoint(checkpoint, ("learner", "steps", "elapsed"))
            learner.load(state["learner"])
            steps, elapsed = state["steps"], state["elapsed"]
        elif self._sources:
            noise = torch.Generator().manual_seed(run.seed + 1)
            start_from(learner.actor, learner.critic, self._sources, stage.copy_noise, noise)
        reporter = _Reporter(self, learner, steps) if team.rank == 0 else None
        try:
            while steps < stage.steps:
                start = time.perf_counter()
                if learner.iteration % SAVE_EVERY == 0:
                    learner.restart()
                report = learner.iterate(steps / stage.steps)
                steps += stage.ppo.worlds * stage.ppo.horizon
                elapsed += time.perf_counter() - start
                if not all(math.isfinite(value) for value in report.values()):
                    raise FloatingPointError(f"training diverged at iteration {learner.iteration}: {report}")
                if reporter is not None:
                    reporter.report(steps, elapsed, report)
                    if learner.iteration % SAVE_EVERY == 0 or steps >= stage.steps:
                        self.save(learner, steps, elapsed)
        finally:
            if reporter is not None:
                reporter.close()
        if team.rank == 0:
            self.describe(steps, elapsed)

    def describe(self, steps: int, elapsed: float) -> None:
        """Curves and the page of the weights."""
        log, page = self.out / LOG, self.weights.with_suffix(".md")
        draw_curves(log, self.out / "curves.png")
        write_card(page, self.stage, self.run_config, read_commits(self.out), steps, elapsed, read_log(log))

    def save(self, learner: BaseLearner, steps: int, elapsed: float) -> None:
        """Weights and checkpoint, the checkpoint last, as it says what is there."""
        stage, run = self.stage, self.run_config
        notes = {
            "command": run.command, "seed": str(run.seed), "workers": str(run.workers), "steps": str(steps),
            "rewards": stage.rewards, "experts_from": " ".join(source.stem for source in run.sources),
            "commit": ", ".join(read_commits(self.out)), "torch": str(torch.__version__),
        }  # fmt: skip
        rate = float(stage.arena.decision_rate)
        export(
            self.weights, stage.name, learner.actor, learner.critic, stage.network, stage.observation, rate, notes
        )  # fmt: skip
        save_checkpoint(self.out, {"learner": learner.state(), "steps": steps, "elapsed": elapsed})


class _Reporter:
    """Log, TensorBoard and progress bar of a run."""

    def __init__(self, training: Training, learner: BaseLearner, steps: int):
        log = training.out / LOG
        write_log(log, read_log(log, learner.iteration) if learner.iteration else [])
        self._learner = learner
        self._log = log.open("a", buffering=1)
        self._writer = SummaryWriter(str(training.out / "tensorboard"), purge_step=steps)
        stage = training.stage
        self._bar = tqdm(total=stage.steps, initial=steps, unit="step", unit_scale=True, desc=stage.name)

    def report(self, steps: int, elapsed: float, report: dict[str, float]) -> None:
        row = {"iteration": self._learner.iteration, "steps": steps, "seconds": round(elapsed, 2), **report}
        self._log.write(json.dumps(row) + "\n")
        for key, value in report.items():
            self._writer.add_scalar(key, value, steps)
        self._bar.set_postfix(
            reached=f"{report['episodes/reached']:.2f}", crashed=f"{report['episodes/collided']:.2f}",
            reward=f"{report['reward/total']:.3f}", refresh=False,
        )  # fmt: skip
        self._bar.update(min(steps, self._bar.total) - self._bar.n)

    def close(self) -> None:
        self._log.close()
        self._writer.close()
        self._bar.close()


def _work(rank: int, training: Training, environments: Sequence[Environment], meeting: str) -> None:
    """A worker process, or the only one."""
    torch.set_num_threads(1)
    team = Team(rank, training.run_config.workers, Path(meeting)) if meeting else Alone()
    stage = training.stage
    try:
        learner = Learner(
            environments[rank], stage.observation, stage.network, stage.ppo, find_rewards(stage.rewards),
            training.run_config.seed, team,
        )  # fmt: skip
        training.learn(learner)
    finally:
        team.close()


def even_workers(ppo: PpoConfig, most: int) -> list[int]:
    """Numbers of workers, up to ``most``, that share out worlds and minibatches evenly; 1 always does."""
    return [n for n in range(1, most + 1) if ppo.worlds % n == 0 and ppo.minibatch % n == 0]


def _check(stage: StageConfig, run: RunConfig) -> None:
    find_rewards(stage.rewards)
    most = (os.cpu_count() or 1) if run.collector == "local" else stage.ppo.worlds
    if not 1 <= run.workers <= most:
        raise BadArgument(f"--workers must be 1 to {most}, got {run.workers}")
    if run.collector == "ray" and importlib.util.find_spec("ray") is None:
        raise BadArgument(f"--collector ray needs Ray: {how_to_install('distributed')}")
    even = even_workers(stage.ppo, most)
    if run.workers not in even:
        raise BadArgument(
            f"--workers {run.workers} cannot share out {stage.ppo.worlds} worlds and minibatches of "
            f"{stage.ppo.minibatch} evenly; {', '.join(map(str, even))} can"
        )
