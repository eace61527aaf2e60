"""A training run of a gait, and the weights it ends with."""

from dataclasses import asdict
from pathlib import Path

import mujoco
import torch

from robots.locomotion.config import QuadrupedConfig
from robots.locomotion.network import gait_contract
from train.locomotion.card import write_card
from train.locomotion.config import TrainingConfig
from train.locomotion.policy import (
    ActorNetwork,
    Perceptron,
    action_mirror,
    export,
    observation_mirror,
    privileged_mirror,
)
from train.locomotion.rollouts import Course, GaitRollouts
from train.ppo.curves import draw_curves
from train.ppo.learner import Networks, PpoLearner
from train.ppo.loop import Report, TrainingLoop
from train.ppo.random_streams import ContinuedStream
from train.ppo.rollout import Mirror
from train.ppo.run_directory import RunDirectory
from train.ppo.team import Alone

_PANELS = (
    ("reward a second", ("reward/total",)),
    ("falls a minute", ("falls_per_minute",)),
    ("slow tracking error [m/s, rad/s]", ("slow_error/v_x", "slow_error/v_y", "slow_error/w_z")),
    ("control steps a second", ("speed/total", "speed/collect")),
)


def make_learner(robot: QuadrupedConfig, config: TrainingConfig, threads: int = 1) -> PpoLearner:
    """Make a learner with random first weights, and its robots on their first floors.

    Args:
        robot: The robot that learns.
        config: Settings of the training.
        threads: Processor cores for the physics.
    """
    course = Course(robot, config, threads)
    generator = torch.Generator().manual_seed(config.seed)
    actor = ActorNetwork(generator, config.hidden, config.initial_std)
    critic = Perceptron.critic(generator, config.hidden)
    rollouts = GaitRollouts(course, actor, critic, config.ppo.horizon, config.normaliser_until)
    mirrors = {
        "observation": Mirror.of(*observation_mirror()), "privileged": Mirror.of(*privileged_mirror()),
        "action": Mirror.of(*action_mirror()),
    }  # fmt: skip
    networks = Networks(actor, critic, mirrors, critic_reads=("privileged",))
    return PpoLearner(networks, rollouts, config.ppo, ContinuedStream(generator), Alone())


class GaitTraining(TrainingLoop[PpoLearner]):
    """A run that can be interrupted and resumed, and ends with the very weights of one that was not.

    Args:
        robot: The robot that learns.
        config: Settings of the training.
        out: Directory of checkpoint, log, curves and weights.
        resume: Go on with the run in ``out``, if there is one.
        threads: Processor cores for the physics; the weights do not depend on them.

    Raises:
        BadArgument: If ``out`` cannot be written to, or holds a run and ``resume`` is not set, or a run of another
            robot, gait or configuration.
    """

    save_every = 25  # iterations, half a minute
    save_on_interrupt = True

    def __init__(
        self, robot: QuadrupedConfig, config: TrainingConfig, out: Path, *, resume: bool = False, threads: int = 1
    ):
        self.robot, self.config, self._threads = robot, config, threads
        contract = {"robot": robot.spec.name, "gait": gait_contract(robot), "training": asdict(config)}
        super().__init__(robot.spec.name, RunDirectory(out, contract, resume=resume))

    @property
    def weights(self) -> Path:
        """File of the weights that the run ends with."""
        return self.directory.path / self.robot.weights

    @property
    def steps(self) -> int:
        """Control steps of all robots together, in whole iterations."""
        return self.config.iterations * self.config.steps_per_iteration

    @property
    def steps_per_iteration(self) -> int:
        """Control steps of a batch."""
        return self.config.steps_per_iteration

    def start(self) -> None:
        """Train in this process, with the physics' threads."""
        torch.set_num_threads(1)  # the last bits of a sum depend on how threads share it out
        self.train(make_learner(self.robot, self.config, self._threads))

    def export(self, learner: PpoLearner, done: int, elapsed: float) -> None:
        """Write the averaged weights as ``robots.locomotion.network`` reads them."""
        notes = {
            "seed": str(self.config.seed), "minutes": f"{elapsed / 60.0:.1f}",
            "control_steps": str(done * self.steps_per_iteration), "commit": ", ".join(self.directory.commits),
            "threads": str(self._threads), "mujoco": mujoco.__version__, "torch": str(torch.__version__),
        }  # fmt: skip
        actor, rollouts = learner.averaged, learner.rollouts
        assert isinstance(actor, ActorNetwork)
        assert isinstance(rollouts, GaitRollouts)
        export(self.weights, self.robot, actor, rollouts.see, notes)

    def describe(self, done: int, elapsed: float, rows: list[Report]) -> None:
        """Draw the curves and write the page of the weights."""
        draw_curves(rows, _PANELS, "control steps", self.directory.path / "curves.png")
        page = self.weights.with_suffix(".md")
        write_card(page, self.robot.spec.name, self.config, self.directory.commits, elapsed, rows)

    def shown(self, report: Report) -> dict[str, str]:
        """Reward and rate of falls, for the progress bar."""
        return {"reward": f"{report['reward/total']:.2f}", "falls": f"{report['falls_per_minute']:.2f}/min"}
