"""Episodes in which a gate is watched: its shares at every decision, and the robot's situation there."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from train.analysis.episodes import Evaluation
from train.analysis.situations import OTHER, ArenaSituations
from train.navigation.networks import FusedActor
from train.navigation.skills import skill_labels
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.types import FloatArray


class Decisions(NamedTuple):
    """Decisions of many episodes, each episode's together and in order; d of them."""

    episode: NDArray[np.int64]
    """Index of the episode, (d,)."""
    situation: NDArray[np.int64]
    """Situation of the robot, index into SITUATIONS, (d,)."""
    taught: NDArray[np.int64]
    """Skill that the observation calls for, index into SKILLS, (d,)."""
    shares: NDArray[np.float32]
    """Shares of the experts, (d, E)."""
    action: NDArray[np.float32]
    """Action of the fused policy: v_x, v_y, w_z as shares of the body's limits, v_y 0 if it has no sideways motion, (d,
    3)."""
    alone: NDArray[np.float32]
    """Action that each expert alone would have taken there, (d, E, 3)."""
    clearance: NDArray[np.float32]
    """Least true range beyond the footprint, ``inf`` if there is nothing, (d,) [m]."""

    @classmethod
    def join(cls, parts: "list[Decisions]") -> "Decisions":
        """Join decisions, one group after the other."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in cls._fields})

    def at(self, which: NDArray[np.integer]) -> "Decisions":
        """Select decisions by index, in the order of the indices."""
        return Decisions(**{name: getattr(self, name)[which] for name in self._fields})


class Scene(NamedTuple):
    """Scene around the robot when a situation began, in base_link."""

    ranges: NDArray[np.float32]
    """Ranges as reported, (num_beams,) [m]."""
    movers: FloatArray
    """Movers: x, y, v_x, v_y, radius, (m, 5)."""
    goal: tuple[float, float]
    """[m]"""
    footprint: FloatArray
    """(k, 2) [m]"""


@dataclass(frozen=True, slots=True)
class Watched:
    """The episodes of one kind of world."""

    decisions: Decisions
    scenes: dict[tuple[int, int], Scene]
    """Scenes by episode and number of the decision within it, for each decision at which a situation other than
    ``other`` began."""
    success: NDArray[np.bool_]
    """(episodes,)"""


def watch(actor: FusedActor, config: ObservationConfig, evaluation: Evaluation, bar: tqdm) -> Watched:
    """Play all episodes with the policy's mean actions, and record every decision.

    Args:
        actor: A fused policy.
        config: The observation that it reads.
        evaluation: Fresh episodes, on one thread.
        bar: Progress bar, advanced with every episode that ends.
    """
    situations = ArenaSituations(evaluation.arena)
    (shard,) = evaluation.arena.shards
    bodies, body_of = evaluation.arena.bodies, shard.rows.body
    can = np.ones((evaluation.arena.n, 3), np.float32)
    can[:, 1] = bodies.limits[body_of, 1, 1] > 0.0
    before, age = np.full(evaluation.arena.n, -1), 0
    parts: list[Decisions] = []
    scenes: dict[tuple[int, int], Scene] = {}
    while (active := evaluation.active).any():
        rows = np.flatnonzero(active)
        situations.look(rows)
        label = situations.label[rows]
        shares, action, alone, taught = _decide(actor, evaluation.observation[rows], config)
        nearest = evaluation.arena.outputs.clearance[rows].astype(np.float32)
        parts.append(Decisions(rows, label, taught, shares, action * can[rows], alone * can[rows, None], nearest))
        for i in rows[(label != before[rows]) & (label != OTHER)].tolist():
            footprint, goal = bodies.bodies[body_of[i]].spec.footprint, tuple(shard.goals[i].tolist())
            seen = shard.ranges[i].astype(np.float32)
            scenes[i, age] = Scene(seen, situations.movers_in_base(i), goal, footprint)
        before[rows] = label
        _step(evaluation, rows, action, bar)
        age += 1
    decisions = Decisions.join(parts)
    in_order = decisions.at(np.argsort(decisions.episode, kind="stable"))
    return Watched(in_order, scenes, evaluation.records().success)


def _decide(
    actor: FusedActor, observation: NDArray[np.float32], config: ObservationConfig
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """Compute shares (n, E), action (n, 3), actions of each expert alone (n, E, 3) and the skill called for (n,)."""
    with torch.no_grad():
        seen = torch.from_numpy(observation)
        shares = actor.gate(seen)
        each = torch.eye(shares.shape[1])
        alone = torch.stack([actor.mean(seen, one.expand_as(shares)) for one in each], 1)
        return shares.numpy(), actor.mean(seen, shares).numpy(), alone.numpy(), skill_labels(seen, config).numpy()


def play_without(
    actor: FusedActor, evaluation: Evaluation, only: NDArray[np.bool_], expert: int, situation: int, bar: tqdm
) -> NDArray[np.bool_]:
    """Find which episodes succeed if one expert has no share wherever the robot is in one situation.

    The others' shares add up to 1 again there; elsewhere the gate is as it was trained.

    Args:
        actor: A fused policy.
        evaluation: The episodes, on one thread; they start again.
        only: (episodes,) whether each is played.
        expert: Index of the expert that has none, from 0.
        situation: Index into SITUATIONS.
        bar: Progress bar, advanced with every episode that ends.

    Returns:
        (episodes,) whether each succeeded; without meaning for those that are not played.
    """
    evaluation.again(only)
    situations = ArenaSituations(evaluation.arena)
    while (active := evaluation.active).any():
        rows = np.flatnonzero(active)
        situations.look(rows)
        with torch.no_grad():
            seen = torch.from_numpy(evaluation.observation[rows])
            shares = actor.gate(seen).clamp_min(1e-30)  # even a sure gate leaves the others something
            shares[torch.from_numpy(situations.label[rows] == situation), expert] = 0.0
            shares = shares / shares.sum(1, keepdim=True)
            _step(evaluation, rows, actor.mean(seen, shares).numpy(), bar)
    return evaluation.records().success


def _step(evaluation: Evaluation, rows: NDArray[np.int64], action: NDArray[np.float32], bar: tqdm) -> None:
    whole = np.zeros((evaluation.arena.n, 3), np.float32)
    whole[rows] = action
    evaluation.step(whole)
    bar.update(len(rows) - int(evaluation.active.sum()))
