"""The critic of V^h: how likely it is to get to a place without meeting anything that moves, by what came of episodes.

Monte Carlo regression: a trained policy drives through the arena, now and then sent elsewhere on its way, so that all
there is to see is seen with goals in all directions; for every observation the critic learns whether a mover was met
before the goal was reached. It is asked the same of frontiers (``vuca_nav.policy.safety``).
"""

import hashlib
import json
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.numpy import save
from torch import Tensor, nn
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from train.arena.arena import Arena
from train.arena.config import ArenaConfig
from train.arena.shard import Shard
from train.navigation.mirror import observation_mirror
from train.navigation.networks import FusedActor, NetworkConfig, make_critic
from train.navigation.weights import actor_of, sorted_header
from train.run_directory import CHECKPOINT, LOG, load_checkpoint, open_run, read_log, save_checkpoint, write_log
from vuca_nav.errors import BadArgument
from vuca_nav.files import write_whole
from vuca_nav.policy.safety import FORMAT
from vuca_nav.policy.weights_file import load_weights
from worlds.mover_columns import RADIUS, X, Y

NAME = "safety"
TOUCH = 0.3
"""An episode that ends with a collision while a mover's circle is this near to the body's has met it [m]."""
BINS = 10
"""Of the chances, to compare them with what came."""


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """How the critic is trained."""

    policy: str = "fusion_plus"
    """Who drives."""
    arena: ArenaConfig = field(
        default_factory=lambda: ArenaConfig(static=0.05, dynamic=0.15, mixed=0.25, square=0.1, corridor=0.45)
    )
    """Where, mostly among walls."""
    rounds: int = 60
    episodes: int = 4096
    """In a round."""
    passes: int = 3
    """Over a round's observations, before the next round."""
    spacing: int = 5
    """Decisions between two observations that are learnt from."""
    sent: float = 0.7
    """Share of the episodes in which the robot is given another goal ..."""
    sent_elsewhere: tuple[int, int] = (3, 50)
    """... and the first decision at which, and the one after the last."""
    time: float = 6.0
    """A meeting after t seconds counts as exp(-t / time): what is farther off may change [s]."""
    hidden: int = 128
    """Units of both hidden layers."""
    minibatch: int = 4096
    rate: float = 2e-3
    """Adam's at first; falls linearly to a hundredth."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        whole = (self.rounds, self.episodes, self.passes, self.spacing, self.hidden, self.minibatch)
        first, last = self.sent_elsewhere
        if min(whole) < 1 or not 0 <= first < last:
            raise BadArgument(f"rounds, episodes, passes, ... must be 1 or more, sent_elsewhere A < B, got {self}")
        if not (self.time > 0.0 and self.rate > 0.0 and 0.0 <= self.sent <= 1.0):
            raise BadArgument(f"time and rate must be positive, sent a share from 0 to 1, got {self}")


class Samples(NamedTuple):
    """What one round has to teach."""

    observations: NDArray[np.float32]
    """(n, size)"""
    safety: NDArray[np.float32]
    """(n,) 1, less what a meeting counts."""


def play(arena: Arena, actor: FusedActor, config: SafetyConfig, seed: int) -> Samples:
    """One round of episodes by the policy's mean actions.

    Args:
        arena: Each of whose rows runs one episode.
        actor: The policy.
        config: What is kept of them.
        seed: Of the episodes.
    """
    rng, n, period = np.random.default_rng((seed, 1)), arena.n, 1.0 / arena.config.decision_rate
    observation = arena.reset(seed)
    phase, elsewhere = rng.integers(0, config.spacing, n), rng.integers(*config.sent_elsewhere, n)
    draws = rng.random((n, 3))
    kept: list[tuple[int, NDArray[np.int64], NDArray[np.float32]]] = []
    elsewhere[draws[:, 0] >= config.sent] = -1  # never
    met_at = np.full(n, np.inf)
    decision, action = 0, np.zeros((n, 3), np.float32)
    with torch.no_grad():
        while (active := arena.active).any():
            sent = active & (elsewhere == decision)
            _send_elsewhere(arena, sent, draws[:, 1:])
            # What is seen on the way to a goal that will be given up says nothing of a way that is gone to its end.
            due = (decision >= elsewhere) & ((decision + phase) % config.spacing == 0)
            rows = np.flatnonzero(active & (sent | due))
            kept.append((decision, rows, observation[rows].copy()))
            seen = torch.from_numpy(observation[active])
            action[active] = actor.mean(seen, actor.gate(seen)).numpy()
            arena.step(action)
            decision += 1
            met_at[_meets(arena, active)] = decision * period
    safety = [1.0 - np.exp((at * period - met_at[rows]) / config.time) for at, rows, _ in kept]
    return Samples(np.concatenate([seen for _, _, seen in kept]), np.concatenate(safety).astype(np.float32))


def _shards(arena: Arena) -> list[tuple[Shard, slice]]:
    """Each with its rows."""
    ends = np.cumsum([shard.n for shard in arena.shards])
    return [(shard, slice(int(end) - shard.n, int(end))) for shard, end in zip(arena.shards, ends)]


def _send_elsewhere(arena: Arena, sent: NDArray[np.bool_], draws: NDArray[np.floating]) -> None:
    """Give some rows the start or the goal of another task in their layout."""
    pairs = arena.bank.pairs
    for shard, rows in _shards(arena):
        chosen = np.flatnonzero(sent[rows])
        if len(chosen):
            task, end = (draws[rows][chosen] * (pairs.shape[1], 2)).astype(np.int64).T
            ends = pairs[shard.rows.layout[chosen], task, :4].reshape(-1, 2, 2)  # start and goal
            shard.send_to(chosen, ends[np.arange(len(chosen)), end])


def _meets(arena: Arena, active: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which of the rows that were active have just collided with something that moves, (n,)."""
    result = active & arena.outputs.collided
    for shard, rows in _shards(arena):
        state = shard.rows
        for i in np.flatnonzero(result[rows]):
            movers, count = state.movers[i], state.counts[i]
            gaps = np.hypot(movers[:count, X] - state.pose[i, 0], movers[:count, Y] - state.pose[i, 1])
            gaps -= state.constants[i, :count, RADIUS] + arena.bodies.shape[state.body[i], 0]
            result[rows.start + i] = count > 0 and gaps.min() < TOUCH
    return result


class SafetyTraining:
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
        self, config: SafetyConfig, seed: int, policy: Path, out: Path, threads: int, command: str, *, resume: bool
    ):
        if threads < 1:
            raise BadArgument(f"--workers must be 1 or more, got {threads}")
        self.config, self.seed, self.out, self.command = config, seed, out, command
        self.policy, self._threads = load_weights(policy), threads
        digest = hashlib.sha256(policy.read_bytes()).hexdigest()
        contract = json.loads(json.dumps({"safety": asdict(config), "seed": seed, "policy": digest}))
        open_run(out, contract, resume=resume)

    @property
    def weights(self) -> Path:
        """The file it makes."""
        return self.out / f"{NAME}.safetensors"

    def run(self) -> None:
        """All rounds that are left."""
        torch.set_num_threads(1)
        config, observation = self.config, self.policy.observation
        sizes, generator = NetworkConfig(critic=config.hidden), torch.Generator().manual_seed(self.seed)
        network = make_critic(observation.size, sizes, generator)
        optimiser = torch.optim.Adam(network.parameters(), config.rate)
        done, elapsed = 0, 0.0
        if (self.out / CHECKPOINT).exists():
            state = load_checkpoint(self.out / CHECKPOINT, ("network", "optimiser", "done", "elapsed"))
            network.load_state_dict(state["network"])
            optimiser.load_state_dict(state["optimiser"])
            done, elapsed = state["done"], state["elapsed"]
        log = self.out / LOG
        # What came after the checkpoint is lost, and will come again.
        rows = [row for row in read_log(log) if row["round"] <= done] if log.exists() else []
        if done == config.rounds and self.weights.with_suffix(".md").exists():
            return
        if done < config.rounds:
            arena = Arena(config.arena, observation, config.episodes, 0, self._threads, once=True)
            actor, mirror = actor_of(self.policy), observation_mirror(observation)
            with SummaryWriter(str(self.out / "tensorboard"), purge_step=done) as writer, tqdm(
                total=config.rounds, initial=done, desc=NAME, unit="round"
            ) as bar:  # fmt: skip
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
            arena.close()
        draw_curves(rows, self.out / "curves.png")
        self._write_page(rows, elapsed)

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
                loss = _loss(network(batch), y[part])
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
            "seed": str(self.seed), "rounds": str(done), "policy": self.config.policy, "torch": str(torch.__version__),
        }  # fmt: skip
        write_whole(self.weights, sorted_header(save(arrays, metadata)))
        state = {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "done": done, "elapsed": elapsed}
        save_checkpoint(self.out, state)

    def _write_page(self, rows: list[dict], elapsed: float) -> None:
        config = self.config
        loss, baseline = (sum(row[key] for row in rows[-10:]) / len(rows[-10:]) for key in ("loss", "baseline"))
        lines = [
            f"# {NAME}", "",
            "The critic of V^h: the chance of getting to a place without meeting anything that moves, by what the "
            "robot sees now. It rates where the ways to frontiers lead first.", "",
            f"- Command: `{self.command}`, torch {torch.__version__}; seed {self.seed}",
            f"- Learnt from: {config.rounds} rounds of {config.episodes:,} episodes driven by {config.policy}, "
            f"in {elapsed / 60:.1f} minutes",
            f"- Settings: `{json.dumps(asdict(config))}`",
            f"- Cross entropy in the last ten rounds, before they were learnt from: {loss:.4f}; of one chance for "
            f"everything: {baseline:.4f}", "",
            "![learning curve, and chances against what came](curves.png)", "",
        ]  # fmt: skip
        write_whole(self.weights.with_suffix(".md"), "\n".join(lines))


def _loss(logits: Tensor, safety: Tensor) -> Tensor:
    return nn.functional.binary_cross_entropy_with_logits(logits[:, 0], safety)


def judge(network: nn.Module, samples: Samples) -> dict:
    """How well a network foresees what it has not learnt from.

    Returns:
        Cross entropy, that of a baseline that gives everything the average chance, and for each of ``BINS`` equal
        ranges of the chance how many there were, their mean chance and the mean of what came.
    """
    with torch.no_grad():
        logits, safety = network(torch.from_numpy(samples.observations)), torch.from_numpy(samples.safety)
        mean = safety.mean().clamp(1e-6, 1.0 - 1e-6)
        loss, baseline = _loss(logits, safety), _loss(mean.logit().expand_as(logits), safety)
        chances = logits[:, 0].sigmoid().numpy()
    bins = np.minimum((chances * BINS).astype(np.int64), BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    foreseen, came = (np.bincount(bins, x, BINS) / np.maximum(count, 1) for x in (chances, samples.safety))
    return {
        "loss": float(loss), "baseline": float(baseline), "met": float(1.0 - samples.safety.mean()),
        "count": count.tolist(), "foreseen": foreseen.tolist(), "came": came.tolist(),
    }  # fmt: skip


def draw_curves(rows: list[dict], picture: Path) -> None:
    """The loss over the rounds, and the last ten rounds' chances against what came; PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
    for key, label in (("loss", "critic, before it learns from the round"), ("baseline", "one chance for everything")):
        left.plot([row["round"] for row in rows], [row[key] for row in rows], lw=1, label=label)
    left.set(title="cross entropy", xlabel="round")
    left.legend(fontsize=7)
    count = np.sum([row["count"] for row in rows[-10:]], axis=0)
    some = count > 0
    foreseen, came = (
        np.sum([np.multiply(row["count"], row[key]) for row in rows[-10:]], axis=0)[some] / count[some]
        for key in ("foreseen", "came")
    )
    right.plot([0, 1], [0, 1], "k:", lw=1)
    right.plot(foreseen, came, "o-", ms=4)
    right.set(title="chances of the last ten rounds", xlabel="foreseen", ylabel="came")
    for axis in (left, right):
        axis.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)
    plt.close(figure)
