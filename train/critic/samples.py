"""Samples that the critic of V^h learns from and is judged by: whether an episode's robot met a mover."""

from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from train.arena.arena import Arena
from train.arena.shard import Shard
from train.critic.config import CriticConfig
from train.navigation.networks import FusedActor
from worlds.motion.mover_columns import RADIUS, X, Y

TOUCH = 0.3
"""Distance of a mover's circle to the body's, at most, for an episode that ends with a collision to have met it [m]."""
BINS = 10
"""Number of ranges of the chances, for comparison with the outcomes."""


class Samples(NamedTuple):
    """Samples of one round."""

    observations: NDArray[np.float32]
    """Observations, (n, size)."""
    safety: NDArray[np.float32]
    """Safety, 1 less the weight of a meeting, (n,)."""


def play(arena: Arena, actor: FusedActor, config: CriticConfig, seed: int) -> Samples:
    """Play one round of episodes by the policy's mean actions.

    Args:
        arena: An arena each of whose rows runs one episode.
        actor: The policy.
        config: Settings, of which samples are kept.
        seed: Seed of the episodes.
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
            # Observations on the way to a goal that will be given up say nothing about a path driven to its end.
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
    """Shards, each with its rows."""
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
    """Whether each row that was active has just collided with a mover, (n,)."""
    result = active & arena.outputs.collided
    for shard, rows in _shards(arena):
        state = shard.rows
        for i in np.flatnonzero(result[rows]):
            movers, count = state.movers[i], state.counts[i]
            gaps = np.hypot(movers[:count, X] - state.pose[i, 0], movers[:count, Y] - state.pose[i, 1])
            gaps -= state.constants[i, :count, RADIUS] + arena.bodies.shape[state.body[i], 0]
            result[rows.start + i] = count > 0 and gaps.min() < TOUCH
    return result


def cross_entropy(logits: Tensor, safety: Tensor) -> Tensor:
    """Cross entropy of chances, given as logits (n, 1), and outcomes (n,)."""
    return nn.functional.binary_cross_entropy_with_logits(logits[:, 0], safety)


def judge(network: nn.Module, samples: Samples) -> dict:
    """Judge how well a network predicts samples that it has not learnt from.

    Returns:
        Cross entropy, that of a baseline that gives everything the average chance, and for each of ``BINS`` equal
        ranges of the chance their number, their mean chance and the mean outcome.
    """
    with torch.no_grad():
        logits, safety = network(torch.from_numpy(samples.observations)), torch.from_numpy(samples.safety)
        mean = safety.mean().clamp(1e-6, 1.0 - 1e-6)
        loss, baseline = cross_entropy(logits, safety), cross_entropy(mean.logit().expand_as(logits), safety)
        chances = logits[:, 0].sigmoid().numpy()
    bins = np.minimum((chances * BINS).astype(np.int64), BINS - 1)
    count = np.bincount(bins, minlength=BINS)
    foreseen, came = (np.bincount(bins, x, BINS) / np.maximum(count, 1) for x in (chances, samples.safety))
    return {
        "loss": float(loss), "baseline": float(baseline), "met": float(1.0 - samples.safety.mean()),
        "count": count.tolist(), "foreseen": foreseen.tolist(), "came": came.tolist(),
    }  # fmt: skip
