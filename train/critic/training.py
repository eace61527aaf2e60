"""The critic of V^h: how likely it is to get to a place without meeting anything that moves, by what came of episodes.

Monte Carlo regression: a trained policy drives through the arena, now and then sent elsewhere on its way, so that all
there is to see is seen with goals in all directions; for every observation the critic learns whether a mover was met
before the goal was reached. It is asked the same of frontiers (``vuca_nav.exploration.critic``).
"""

import contextlib
import hashlib
import json
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save
from torch import Tensor, nn
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from train.arena.arena import Arena
from train.critic.card import write_card
from train.critic.config import CriticConfig
from train.critic.curves import draw_curves
from train.critic.samples import Samples, cross_entropy, judge, play
from train.navigation.mirror import observation_mirror
from train.navigation.networks import NetworkConfig, make_critic
from train.navigation.weights import actor_of, sorted_header
from train.ppo.run_directory import (
    CHECKPOINT,
    LOG,
    load_checkpoint,
    note_commit,
    open_run,
    read_commits,
    read_whole_log,
    save_checkpoint,
    write_log,
)
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.critic import FORMAT
from vuca_nav.files import write_whole
from vuca_nav.policy.weights_file import load_weights

NAME = "critic"


class CriticTraining:
    """A training that can be interrupted and gone on with: its rounds do not depend on each other's episodes.

    Args:
        config: What is learnt, and how.
        seed: Of weights, episodes and minibatches.
        policy: Weights file of who drives.
        out: Directory of checkpoint, log, curves and weights.
        threads: That step the arena; the weights do not depend on them.
        command: What was typed, for the page.
        resume: Go on with what is in ``out``, if anything is.

    Raises:
        BadArgument: If ``out`` holds a run and it shall not be resumed, or one of another configuration.
        BadWeights: If the policy is missing or broken.
    """

    def __init__(
        self, config: CriticConfig, seed: int, policy: Path, out: Path, threads: int, command: str, *, resume: bool
    ):
        if threads < 1:
            raise BadArgument(f"--workers must be 1 or more, got {threads}")
        self.config, self.seed, self.out, self.command = config, seed, out, command
        self.policy, self._threads = load_weights(policy), threads
        digest = hashlib.sha256(policy.read_bytes()).hexdigest()
        contract = json.loads(json.dumps({"critic": asdict(config), "seed": seed, "policy": digest}))
        open_run(out, contract, resume=resume)

    @property
    def weights(self) -> Path:
        """The file it makes."""
        return self.out / f"{NAME}.safetensors"

    def run(self) -> None:
        """All rounds that are left.

        Raises:
            BadArgument: If checkpoint or log of a run that is gone on with are damaged.
        """
        torch.set_num_threads(1)
        config, observation = self.config, self.policy.observation
        sizes, generator = NetworkConfig(critic=config.hidden), torch.Generator().manual_seed(self.seed)
        network = make_critic(observation.size, sizes, generator)
        optimiser = torch.optim.Adam(network.parameters(), config.rate)
        done, elapsed, rows = 0, 0.0, []
        log = self.out / LOG
        if (self.out / CHECKPOINT).exists():
            state = load_checkpoint(self.out / CHECKPOINT, ("network", "optimiser", "done", "elapsed"))
            network.load_state_dict(state["network"])
            optimiser.load_state_dict(state["optimiser"])
            done, elapsed = state["done"], state["elapsed"]
            rows = read_whole_log(log, done, counter="round")
        if done == config.rounds and self.weights.with_suffix(".md").exists():
            return
        if done < config.rounds:
            note_commit(self.out)
            actor, mirror = actor_of(self.policy), observation_mirror(observation)
            with (
                contextlib.closing(
                    Arena(config.arena, observation, config.episodes, 0, self._threads, once=True)
                ) as arena,
                SummaryWriter(str(self.out / "tensorboard"), purge_step=done) as writer,
                tqdm(total=config.rounds, initial=done, desc=NAME, unit="round") as bar,
            ):
                while done < config.rounds:
                    start = time.perf_counter()
                    words = np.random.SeedSequence((self.seed, done)).generate_state(2)
                    samples = play(arena, actor, config, int(words[0]))
                    report = judge(network, samples)
                    generator = torch.Generator().manual_seed(int(words[1]))
                    self._learn(network, optimiser, samples, mirror, done, generator)
                    done, elapsed = done + 1, elapsed + time.perf_counter() - start
                    rows.append({"round": done, "seconds": round(elapsed, 1), **report})
                    for key in ("loss", "baseline"):
                        writer.add_scalar(key, report[key], done)
                    bar.set_postfix(loss=f"{report['loss']:.4f}", baseline=f"{report['baseline']:.4f}", refresh=False)
                    bar.update()
                    write_log(log, rows)
                    self._save(network, optimiser, done, elapsed)
        draw_curves(rows, self.out / "curves.png")
        page, commits = self.weights.with_suffix(".md"), read_commits(self.out)
        write_card(page, config, self.command, self.seed, commits, elapsed, rows)

    def _learn(
        self, network: nn.Module, optimiser: torch.optim.Adam, samples: Samples, mirror: tuple[Tensor, Tensor],
        done: int, generator: torch.Generator,
    ) -> None:  # fmt: skip
        """From one round, the observations half of them with left and right exchanged."""
        config, (order, signs) = self.config, mirror
        for group in optimiser.param_groups:
            group["lr"] = config.rate * (1.0 - 0.99 * done / config.rounds)
        x, y = torch.from_numpy(samples.observations), torch.from_numpy(samples.safety)
        for _ in range(config.passes):
            for part in torch.randperm(len(x), generator=generator).split(config.minibatch):
                batch, half = x[part], len(part) // 2
                batch[:half] = batch[:half][:, order] * signs
                loss = cross_entropy(network(batch), y[part])
                optimiser.zero_grad(set_to_none=True)
                loss.backward()
                optimiser.step()

    def _save(self, network: nn.Module, optimiser: torch.optim.Adam, done: int, elapsed: float) -> None:
        """Weights and checkpoint, the checkpoint last, as it says what is there."""
        linear = [layer for layer in network.modules() if isinstance(layer, nn.Linear)]
        arrays = {}
        for k, layer in enumerate(linear):
            arrays[f"weight_{k}"], arrays[f"bias_{k}"] = layer.weight.detach().numpy(), layer.bias.detach().numpy()
        metadata = {
            "format": FORMAT, "observation": json.dumps(asdict(self.policy.observation)), "command": self.command,
            "seed": str(self.seed), "rounds": str(done), "policy": self.config.policy,
            "commit": ", ".join(read_commits(self.out)), "torch": str(torch.__version__),
        }  # fmt: skip
        write_whole(self.weights, sorted_header(save(arrays, metadata)))
        state = {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "done": done, "elapsed": elapsed}
        save_checkpoint(self.out, state)
