"""Training of the critic of V^h: the chance of reaching a place without meeting a mover.

A trained policy drives through the arena, now and then sent elsewhere on its way, so that observations come
with goals in all directions; for every observation the critic learns whether a mover was met before the goal was
reached. The same is computed for frontiers (``vuca_nav.exploration.critic``).
"""

import contextlib
import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors.numpy import save
from torch import nn

from train.arena.arena import Arena
from train.critic.card import write_card
from train.critic.config import CriticConfig
from train.critic.curves import draw_curves
from train.critic.learner import CriticLearner
from train.navigation.weights import actor_of, sorted_header
from train.ppo.loop import Report, TrainingLoop
from train.ppo.run_directory import RunDirectory
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.critic import FORMAT
from vuca_nav.files import write_whole
from vuca_nav.policy.weights_file import load_weights

NAME = "critic"


class CriticTraining(TrainingLoop[CriticLearner]):
    """A training that can be interrupted and resumed, a round of episodes an iteration.

    Args:
        config: Settings of the training.
        seed: Seed of weights, episodes and minibatches.
        policy: Weights file of the policy that drives.
        out: Directory of checkpoint, log, curves and weights.
        threads: Number of threads that step the arena; the weights do not depend on it.
        command: The command line, for the page.
        resume: Go on with the run in ``out``, if there is one.

    Raises:
        BadArgument: If ``out`` holds a run and ``resume`` is not set, or a run of another configuration.
        BadWeights: If the policy is missing or broken.
    """

    unit = "round"

    def __init__(
        self, config: CriticConfig, seed: int, policy: Path, out: Path, threads: int, command: str, *, resume: bool
    ):
        if threads < 1:
            raise BadArgument(f"--workers must be 1 or more, got {threads}")
        self.config, self.seed, self.command = config, seed, command
        self.policy, self._threads = load_weights(policy), threads
        digest = hashlib.sha256(policy.read_bytes()).hexdigest()
        contract = {"critic": asdict(config), "seed": seed, "policy": digest}
        super().__init__(NAME, RunDirectory(out, contract, resume=resume))

    @property
    def weights(self) -> Path:
        """File of the weights that the run ends with."""
        return self.directory.path / f"{NAME}.safetensors"

    @property
    def steps(self) -> int:
        """Number of rounds."""
        return self.config.rounds

    def start(self) -> None:
        """Train in this process, with the arena's threads."""
        torch.set_num_threads(1)
        config, observation = self.config, self.policy.observation
        arena = Arena(config.arena, observation, config.episodes, 0, self._threads, once=True)
        with contextlib.closing(arena):
            self.train(CriticLearner(config, self.seed, actor_of(self.policy), observation, arena))

    def export(self, learner: CriticLearner, done: int, elapsed: float) -> None:
        """Write the weights as ``vuca_nav.exploration.critic`` reads them."""
        linear = [layer for layer in learner.network.modules() if isinstance(layer, nn.Linear)]
        arrays = {}
        for k, layer in enumerate(linear):
            arrays[f"weight_{k}"], arrays[f"bias_{k}"] = layer.weight.detach().numpy(), layer.bias.detach().numpy()
        metadata = {
            "format": FORMAT, "observation": json.dumps(asdict(self.policy.observation)), "command": self.command,
            "seed": str(self.seed), "rounds": str(done), "policy": self.config.policy,
            "commit": ", ".join(self.directory.commits), "torch": str(torch.__version__),
        }  # fmt: skip
        write_whole(self.weights, sorted_header(save(arrays, metadata)))

    def describe(self, done: int, elapsed: float, rows: list[Report]) -> None:
        """Draw the curves and write the page of the weights."""
        draw_curves(rows, self.directory.path / "curves.png")
        page, commits = self.weights.with_suffix(".md"), self.directory.commits
        write_card(page, self.config, self.command, self.seed, commits, elapsed, rows)

    def shown(self, report: Report) -> dict[str, str]:
        """Cross entropies for the progress bar."""
        return {key: f"{report[key]:.4f}" for key in ("loss", "baseline")}
