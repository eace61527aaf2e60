"""Episodes in which a gate is watched: what it did at every decision, and what the robot's situation was."""

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
    """(d,)"""
    situation: NDArray[np.int64]
    """The robot was in, index into SITUATIONS, (d,)."""
    taught: NDArray[np.int64]
    """Skill that the observation calls for, index into SKILLS, (d,)."""
    shares: NDArray[np.float32]
    """Of the experts, (d, E)."""
    action: NDArray[np.float32]
    """What the fused policy did: v_x, v_y, w_z as shares of the body's limits, v_y 0 if it cannot, (d, 3)."""
    alone: NDArray[np.float32]
    """What each expert alone would have done there, (d, E, 3)."""
    clearance: NDArray[np.float32]
    """Least true range beyond the footprint, ``inf`` if there is nothing, (d,) [m]."""

    @classmethod
    def join(cls, parts: "list[Decisions]") -> "Decisions":
        """One after the other."""
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in cls._fields})

    def at(self, which: NDArray[np.integer]) -> "Decisions":
        """These of them, in this order."""
        return Decisions(**{name: getattr(self, name)[which] for name in self._fields})


class Scene(NamedTuple):
    """What was around the robot when a situation began, in base_link."""

    ranges: NDArray[np.float32]
    """(num_beams,) as reported [m]."""
    movers: FloatArray
    """x, y, v_x, v_y, radius, (m, 5)."""
    goal: tuple[float, float]
    """[m]"""
    footprint: FloatArray
    """(k, 2) [m]"""


@dataclass(frozen=True, slots=True)
class Watched:
    """The episodes of one kind of world."""

    decisions: Decisions
    scenes: dict[tuple[int, int], Scene]
    """By episode and number of the decision within it, at which a situation other than ``other`` began."""
    success: NDArray[np.bool_]
    """(episodes,)"""


def watch(actor: FusedActor, config: ObservationConfig, evaluation: Evaluation, bar: tqdm) -> Watched:
    """Play all episodes with the policy's mean actions, and note down everything.

    Args:
        actor: A fused policy.
        config: What it looks at.
        evaluation: Fresh episodes, on one thread.
        bar: Goes on with every episode that ends.
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
    """Shares (n, E), action (n, 3), each expert's own (n, E, 3), and the skill that is called for (n,)."""
    with torch.no_grad():
        seen = torch.from_numpy(observation)
        shares = actor.gate(seen)
        each = torch.eye(shares.shape[1])
        alone = torch.stack([actor.mean(seen, one.expand_as(shares)) for one in each], 1)
        return shares.numpy(), actor.mean(seen, shares).numpy(), alone.numpy(), skill_labels(seen, config).numpy()


def play_without(
    actor: FusedActor, evaluation: Evaluation, only: NDArray[np.bool_], expert: int, situation: int, bar: tqdm
) -> NDArray[np.bool_]:
    """Which episodes succeed if one expert has no share wherever the robot is in one situation.

    The others' shares add up to 1 again there; elsewhere the gate is as it was trained.

    Args:
        actor: A fused policy.
        evaluation: Of the episodes, on one thread; they start again.
        only: (episodes,) which to play.
        expert: Which has none.
        situation: Index into SITUATIONS.
        bar: Goes on with every episode that ends.

    Returns:
        (episodes,); of those that are not played, nothing.
    """
    evaluation.again(only)
    situations = ArenaSituations(evaluation.arena)
    while (active := evaluation.active).any():
        rows = np.flatnonzero(active)
        situations.look(rows)
        with torch.no_grad():
            seen = torch.from_numpy(evaluation.observation[rows])
            shares = actor.gate(seen).clamp_min(1e-30)  # of a gate that is quite sure, something is left
            shares[torch.from_numpy(situations.label[rows] == situation), expert] = 0.0
            shares = shares / shares.sum(1, keepdim=True)
            _step(evaluation, rows, actor.mean(seen, shares).numpy(), bar)
    return evaluation.records().success


def _step(evaluation: Evaluation, rows: NDArray[np.int64], action: NDArray[np.float32], bar: tqdm) -> None:
    whole = np.zeros((evaluation.arena.n, 3), np.float32)
    whole[rows] = action
    evaluation.step(whole)
    bar.update(len(rows) - int(evaluation.active.sum()))
