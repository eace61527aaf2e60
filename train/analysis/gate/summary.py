"""Summary of a gate's shares in each situation: means, with intervals that draw whole episodes again."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eval.analysis.statistics import resampled_totals
from train.analysis.gate.play import Decisions
from train.analysis.situations import SITUATIONS
from train.navigation.skills import SKILLS
from vuca_nav.types import FloatArray

DRAWS = 1000
"""Number of draws of the bootstrap."""
SLOW = 0.1
"""Share of the limits up to which a command counts as standing still."""
MOTIONS = ("forward", "turn", "stop", "backward", "sideways")
"""Names of the motions that a command can mostly be."""
COMMAND = ("v_x", "turn", "w_z")
"""Columns of a mean command, as shares of the body's limits: v_x, |w_z|, and w_z, in which turns to left and right
cancel."""


def motions(command: NDArray[np.floating]) -> NDArray[np.int64]:
    """Classify each command by its greatest component, in shares of its limits.

    Args:
        command: v_x, v_y, w_z, (..., 3).

    Returns:
        (...,) indices into ``MOTIONS``: stop if all are at most ``SLOW``, otherwise the greatest component.
    """
    size = np.abs(command)
    most = np.array([0, 4, 1])[size.argmax(-1)]
    most[(most == 0) & (command[..., 0] < 0.0)] = 3
    most[size.max(-1) <= SLOW] = 2
    return most


def summarise(decisions: Decisions, kinds: NDArray[np.int64], names: Sequence[str], seed: int = 0) -> dict:
    """Summarise one policy as tables, ready for JSON.

    Args:
        decisions: Decisions of all episodes.
        kinds: Kind of each episode's world, index into ``names``, (episodes,).
        names: Names of the kinds of worlds.
        seed: Seed of the bootstrap.

    Returns:
        ``situations``: for each, and for ``all`` together, decisions, episodes and means as [mean, lower, upper end],
        None where there are no decisions; ``skills``: the expert that leads where an observation calls for which skill;
        ``worlds``: decisions of each situation in each kind of world.
    """
    table = _Table(decisions, kinds, seed)
    situations = {name: table.row(k) for k, name in enumerate((*SITUATIONS, "all"))}
    worlds, places = kinds[decisions.episode], len(SITUATIONS)
    counts = [np.bincount(decisions.situation[worlds == k], minlength=places).tolist() for k in range(len(names))]
    return {
        "situations": situations,
        "skills": {name: table.skill(k) for k, name in enumerate(SKILLS)},
        "worlds": {name: dict(zip(SITUATIONS, row)) for name, row in zip(names, counts)},
    }


def episode_rows(decisions: Decisions, kinds: NDArray[np.int64], names: Sequence[str], policy: str) -> list[dict]:
    """Counts of each episode by situation, as a file of measurements has them.

    Args:
        decisions: Decisions of all episodes.
        kinds: Kind of each episode's world, index into ``names``, (episodes,).
        names: Names of the kinds of worlds.
        policy: Name of the policy.

    Returns:
        A row for each episode: ``policy``, ``kind``, ``seed`` (number of the episode in its kind), and for each
        situation that came up the number of ``decisions``, of those that each expert ``leads``, and sums of ``shares``.
    """
    experts, places = decisions.shares.shape[1], len(SITUATIONS)
    cell, length = decisions.episode * places + decisions.situation, len(kinds) * places
    columns = np.concatenate([np.eye(experts)[decisions.shares.argmax(1)], decisions.shares], 1).T
    count = np.bincount(cell, minlength=length).reshape(-1, places)
    sums = np.stack([np.bincount(cell, column, length) for column in columns], 1).reshape(-1, places, 2, experts)
    first = np.searchsorted(kinds, kinds)  # each kind's episodes follow one another
    return [
        {
            "policy": policy,
            "kind": names[kind],
            "seed": int(episode - first[episode]),
            "situations": {
                SITUATIONS[k]: {
                    "decisions": int(count[episode, k]),
                    "leads": [int(lead) for lead in sums[episode, k, 0]],
                    "shares": [round(float(share), 2) for share in sums[episode, k, 1]],
                }
                for k in np.flatnonzero(count[episode]).tolist()
            },
        }
        for episode, kind in enumerate(kinds.tolist())
    ]


class _Table:
    """Sums over decisions by episode, situation (the last one: all of them) and column, and draws of their totals."""

    def __init__(self, decisions: Decisions, kinds: NDArray[np.int64], seed: int):
        shares = decisions.shares.astype(float)
        count, self.experts = shares.shape
        leads = np.eye(self.experts)[shares.argmax(1)]
        entropy = -(shares * np.log(np.maximum(shares, 1e-12))).sum(1, keepdims=True)
        taught = np.eye(len(SKILLS))[decisions.taught]
        most = np.eye(len(MOTIONS))[motions(decisions.alone)]
        alone = np.concatenate([_commands(decisions.alone), most], 2)  # (d, E, commands + motions)
        blocks = {
            "one": np.ones((count, 1)), "shares": shares, "leads": leads, "entropy": entropy,
            "led": leads[:, :, None] * _commands(decisions.action)[:, None, :], "alone": alone, "taught": taught,
            "taught and leads": taught[:, :, None] * leads[:, None, :],
        }  # fmt: skip
        self.shapes = {name: block.shape[1:] for name, block in blocks.items()}
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in self.shapes.values())])
        self.slices = {name: slice(a, b) for name, a, b in zip(blocks, ends, ends[1:])}
        episodes, places = len(kinds), len(SITUATIONS)
        cell = decisions.episode * places + decisions.situation
        columns = (column for block in blocks.values() for column in block.reshape(count, -1).T)
        sums = np.stack([np.bincount(cell, column, episodes * places) for column in columns], 1)
        sums = sums.reshape(episodes, places, -1).astype(float)
        self.sums = np.concatenate([sums, sums.sum(1, keepdims=True)], 1)  # (episodes, situations + 1, columns)
        draws = resampled_totals(self.sums.reshape(episodes, -1), kinds, DRAWS, np.random.default_rng(seed))
        self.draws = draws.reshape(DRAWS, *self.sums.shape[1:])

    def row(self, k: int) -> dict:
        """Means of one situation."""
        share, leads, entropy, alone = (self._per(k, what, "one") for what in ("shares", "leads", "entropy", "alone"))
        led = self._per(k, "led", "leads")
        return {
            "decisions": int(self.sums[:, k, 0].sum()), "episodes": int((self.sums[:, k, 0] > 0).sum()),
            "entropy": _triples(entropy)[0],
            "experts": [
                {
                    "share": _triples(share)[n], "leads": _triples(leads)[n],
                    "command_where_it_leads": dict(zip(COMMAND, _triples(led[:, n]))),
                    "command_alone": dict(zip(COMMAND, _triples(alone[:, n, : len(COMMAND)]))),
                    "motion_alone": dict(zip(MOTIONS, _triples(alone[:, n, len(COMMAND) :]))),
                }
                for n in range(self.experts)
            ],
        }  # fmt: skip

    def skill(self, k: int) -> dict:
        """Shares of the decisions that each expert leads where a skill is called for."""
        leads = self._per(len(SITUATIONS), "taught and leads", "taught")[:, k]
        count = self.sums[:, len(SITUATIONS), self.slices["taught"]][:, k].sum()
        return {"decisions": int(count), "leads": _triples(leads)}

    def _per(self, k: int, what: str, of: str) -> FloatArray:
        """Ratio of two totals: value, lower and upper end of its interval, (3, *shape); NaN where there is nothing."""
        totals = np.concatenate([self.sums.sum(0)[None], self.draws])[:, k]  # (1 + draws, columns)
        above = totals[:, self.slices[what]].reshape(-1, *self.shapes[what])
        below = totals[:, self.slices[of]].reshape(-1, *self.shapes[of])
        below = below.reshape(*below.shape, *(1,) * (above.ndim - below.ndim))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = above / below
        result = np.full((3, *self.shapes[what]), np.nan)
        result[0] = ratio[0]
        some = np.isfinite(ratio[0])
        if some.any():
            result[1:, some] = np.nanpercentile(ratio[1:, some], (2.5, 97.5), axis=0)
        return result


def _commands(command: NDArray[np.floating]) -> FloatArray:
    """Compute v_x, |w_z| and w_z of commands (..., 3)."""
    return np.stack([command[..., 0], np.abs(command[..., 2]), command[..., 2]], -1).astype(float)


def _triples(values: FloatArray) -> list:
    """Convert (3, k) to a list of k [mean, lower, upper], or None."""
    return [None if np.isnan(triple[0]) else triple.tolist() for triple in values.T]
