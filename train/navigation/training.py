"""One stage of the training of a navigation policy: workers, and the weights it ends with."""

import hashlib
import importlib.util
import logging
import os
import signal
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch.multiprocessing.spawn import ProcessExitedException, ProcessRaisedException, start_processes

from train.arena.rewards import find_rewards
from train.navigation.card import write_card
from train.navigation.config import RunConfig
from train.navigation.environment import Environment, MakeEnvironment
from train.navigation.learner import make_local_learner
from train.navigation.networks import Actor
from train.navigation.stages import StageConfig
from train.navigation.weights import export, find_sources, start_from
from train.ppo.curves import draw_curves
from train.ppo.learner import PpoLearner
from train.ppo.loop import Report, TrainingLoop
from train.ppo.run_directory import RunDirectory
from train.ppo.team import Alone, Team
from vuca_nav.errors import BadArgument, how_to_install

_PANELS = (
    ("share of episodes", ("episodes/reached", "episodes/collided", "episodes/timed_out")),
    ("reward a decision", ("reward/total",)),
    ("gate", ("gate/0", "gate/1", "gate/2", "gate/3", "gate/entropy")),
    ("standard deviation of actions", ("std/v_x", "std/v_y", "std/w_z")),
    ("share of the return explained", ("loss/explained",)),
)


class NavigationTraining(TrainingLoop[PpoLearner]):
    """A stage that can be interrupted and resumed; at each checkpoint all episodes start anew.

    Args:
        stage: The stage to be trained.
        run: Settings of the run.
        out: Directory of checkpoint, log, curves and weights.
        make_environment: Builds a worker's arena.
        resume: Go on with the run in ``out``, if there is one.

    Raises:
        BadArgument: If ``out`` holds a run and ``resume`` is not set, or a run of another configuration, if the
            worlds or the minibatch cannot be shared out evenly, or the experts cannot start as the sources.
        BadWeights: If a source is missing or broken.
    """

    save_every = 50

    def __init__(
        self, stage: StageConfig, run: RunConfig, out: Path, make_environment: MakeEnvironment, *, resume: bool = False
    ):
        check_run(stage, run)
        self._sources = find_sources(run.sources, stage.network, stage.observation) if run.sources else []
        self.stage, self.run_config, self._make = stage, run, make_environment
        contract: dict = {"stage": asdict(stage), "seed": run.seed, "workers": run.workers}
        if run.collector != "local":
            contract["collector"] = run.collector
        if run.sources:
            contract["sources"] = [[path.stem, hashlib.sha256(path.read_bytes()).hexdigest()] for path in run.sources]
        super().__init__(stage.name, RunDirectory(out, contract, resume=resume))

    @property
    def weights(self) -> Path:
        """File of the weights that the run ends with."""
        return self.directory.path / f"{self.stage.name}.safetensors"

    @property
    def steps(self) -> int:
        """Number of decisions of all worlds together."""
        return self.stage.steps

    @property
    def steps_per_iteration(self) -> int:
        """Number of decisions in a batch."""
        return self.stage.ppo.worlds * self.stage.ppo.horizon

    def start(self) -> None:
        """Train in this process, in workers of this computer, or on batches from a Ray cluster."""
        run, stage = self.run_config, self.stage
        if run.collector == "ray":
            from train.navigation.ray_cluster import ray_learner

            torch.set_num_threads(1)
            with ray_learner(stage, run.seed, run.workers) as learner:
                self.train(learner)
            return
        rows = stage.ppo.worlds // run.workers
        environments = [self._make(stage, rows) for _ in range(run.workers)]
        if run.workers == 1:
            _work(0, self, environments, "")
            return
        with tempfile.TemporaryDirectory() as folder:
            # Forked, a worker has its worlds and torch at once; nothing has begun to use threads yet.
            meeting = str(Path(folder) / "meeting")
            workers: Any = start_processes(
                _work, (self, environments, meeting), nprocs=run.workers, join=False, start_method="fork"
            )
            logging.getLogger(start_processes.__module__).setLevel(logging.ERROR)  # the error says what ended them
            try:
                while not workers.join():
                    pass
            except ProcessRaisedException as error:
                raise _cause(error) from error
            except ProcessExitedException as error:
                raise BadArgument(f"a worker process died ({error}); --resume goes on from the checkpoint") from error
            finally:
                for process in filter(None, workers.processes):
                    process.kill()
                    process.join()

    def begin(self, learner: PpoLearner) -> None:
        """Let the experts start as the sources."""
        if self._sources:
            noise = torch.Generator().manual_seed(self.run_config.seed + 1)
            assert isinstance(learner.actor, Actor)
            start_from(learner.actor, learner.critic, self._sources, self.stage.copy_noise, noise)

    def export(self, learner: PpoLearner, done: int, elapsed: float) -> None:
        """Write the weights as ``vuca_nav.policy`` reads them."""
        stage, run = self.stage, self.run_config
        notes = {
            "command": run.command, "seed": str(run.seed), "workers": str(run.workers),
            "steps": str(done * self.steps_per_iteration), "rewards": stage.rewards,
            "experts_from": " ".join(source.stem for source in run.sources),
            "commit": ", ".join(self.directory.commits), "torch": str(torch.__version__),
        }  # fmt: skip
        actor, critic, rate = learner.averaged, learner.critic, float(stage.arena.decision_rate)
        assert isinstance(actor, Actor)
        export(self.weights, stage.name, actor, critic, stage.network, stage.observation, rate, notes)

    def describe(self, done: int, elapsed: float, rows: list[Report]) -> None:
        """Draw the curves and write the page of the weights."""
        panels = [panel for panel in _PANELS if panel[0] != "gate" or self.stage.network.experts > 1]
        draw_curves(rows, panels, "decisions", self.directory.path / "curves.png")
        write_card(self.weights.with_suffix(".md"), self.stage, self.run_config, self.directory.commits, elapsed, rows)

    def shown(self, report: Report) -> dict[str, str]:
        """Shares of the outcomes and the reward, for the progress bar."""
        return {
            "reached": f"{report['episodes/reached']:.2f}", "crashed": f"{report['episodes/collided']:.2f}",
            "reward": f"{report['reward/total']:.3f}",
        }  # fmt: skip


def _work(rank: int, training: NavigationTraining, environments: Sequence[Environment], meeting: str) -> None:
    """Run a worker process, or the only one."""
    if meeting:
        for number in (signal.SIGTERM, signal.SIGHUP):  # not the parent's, which end the whole command
            signal.signal(number, signal.SIG_DFL)
    torch.set_num_threads(1)
    run = training.run_config
    team = Team(rank, run.workers, Path(meeting)) if meeting else Alone()
    try:
        training.train(make_local_learner(training.stage, run.seed, team, environments[rank]), leads=rank == 0)
    finally:
        team.close()


def _cause(error: ProcessRaisedException) -> Exception:
    """The error of a worker that its user can mend, as this process would raise it; otherwise the error itself."""
    last = str(error).strip().splitlines()[-1]
    kind, _, message = last.partition(": ")
    mendable = kind.startswith("vuca_nav.errors.") or message.startswith("[Errno")
    return BadArgument(message) if mendable else error


def even_workers(stage: StageConfig, most: int) -> list[int]:
    """Numbers of workers, up to ``most``, that share out worlds, whole ones, and minibatches evenly; 1 always does."""
    ppo, robots = stage.ppo, stage.arena.robots
    return [n for n in range(1, most + 1) if ppo.worlds % (n * robots) == 0 and ppo.minibatch % n == 0] or [1]


def check_run(stage: StageConfig, run: RunConfig) -> None:
    """Raise BadArgument for a run whose workers cannot share it out, or whose requirements are not installed."""
    find_rewards(stage.rewards)
    most = (os.cpu_count() or 1) if run.collector == "local" else stage.ppo.worlds
    if not 1 <= run.workers <= most:
        raise BadArgument(f"--workers must be 1 to {most}, got {run.workers}")
    if run.collector == "ray" and stage.network.architecture != "fused":
        raise BadArgument(f"--collector ray trains fused networks; {stage.name} is {stage.network.architecture}")
    if stage.ppo.worlds // max(run.workers, 1) % stage.arena.robots:
        raise BadArgument(
            f"{stage.ppo.worlds} rows on {run.workers} workers do not make whole worlds of {stage.arena.robots} robots"
        )
    if run.collector == "ray" and importlib.util.find_spec("ray") is None:
        raise BadArgument(f"--collector ray needs Ray: {how_to_install('distributed')}")
    even = even_workers(stage, most)
    if run.workers not in even:
        raise BadArgument(
            f"--workers {run.workers} cannot share out {stage.ppo.worlds} worlds and minibatches of "
            f"{stage.ppo.minibatch} evenly; {', '.join(map(str, even))} can"
        )
