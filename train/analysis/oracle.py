"""Bound on any policy: the evaluation's episodes solved by a disc with knowledge of all futures.

``python -m train.analysis.oracle --kind dynamic --episodes 1000``
"""

import math
import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from train.analysis.episodes import Evaluation
from train.arena.config import KINDS, ArenaConfig
from train.arena.rows import GOAL_X, START_X
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.types import FloatArray
from worlds.motion.mover_columns import RADIUS, X
from worlds.motion.movers import TICK
from worlds.reachability import Crowd, Grid, earliest_arrival

_CHUNK = 50
"""Number of episodes whose movers' paths are held at once."""


@dataclass(frozen=True, slots=True)
class Solvable:
    """Whether each episode can be solved, (episodes,)."""

    solved: NDArray[np.bool_]
    time: FloatArray
    """Earliest arrival, ``inf`` if there is none in time [s]."""
    kind: NDArray[np.int64]
    """Kind of world, index into KINDS."""


def solvable(config: ArenaConfig, episodes: int, seed: int) -> Solvable:
    """Compute reachability in space and time through the very movers of ``Evaluation(config, ..., episodes, seed)``.

    The disc is the circle about the footprint, has no inertia and moves at up to the body's greatest speed. As in
    worlds.reachability everything errs on the side of "not solvable".

    Args:
        config: Settings of the arena.
        episodes: Number of episodes.
        seed: Seed of the episodes.
    """
    arena = Evaluation(config, ObservationConfig(), episodes, seed).arena
    (shard,) = arena.shards
    rows, bank, bodies = shard.rows, arena.bank, arena.bodies
    time = np.full(episodes, math.inf)
    for begin in tqdm(range(0, episodes, _CHUNK), desc="oracle", file=sys.stderr):
        chunk = np.arange(begin, min(begin + _CHUNK, episodes))
        ticks = int(rows.time_limit[chunk].max()) + 2
        tracks = np.empty((ticks + 1, len(chunk), rows.movers.shape[1], 2))
        tracks[0] = rows.movers[chunk, :, X : X + 2]
        for k in range(ticks):
            shard.move(chunk, 1)
            tracks[k + 1] = rows.movers[chunk, :, X : X + 2]
        for k, i in enumerate(chunk):
            radius, v_max = bodies.shape[rows.body[i], 0], bodies.limits[rows.body[i], 0, 1]
            layout, count, limit = rows.layout[i], rows.counts[i], rows.time_limit[i] * TICK
            begin_cell, height, width = bank.grid_shape[layout]
            x, y, cell = bank.grids[layout]
            pad = cell * math.sqrt(0.5)
            clearance = bank.clearance[begin_cell : begin_cell + height * width].reshape(height, width)
            start, goal = (
                (int((rows.task[i, at + 1] - y) / cell), int((rows.task[i, at] - x) / cell)) for at in (START_X, GOAL_X)
            )
            reaches = rows.constants[i, :count, RADIUS] + radius + pad
            crowd = Crowd(np.ascontiguousarray(tracks[:, k, :count]), reaches, TICK)
            arrival = earliest_arrival(
                clearance < radius + pad, Grid(float(x), float(y), float(cell)), crowd, start, 0.0, goal, float(v_max),
                math.ceil(limit * v_max / cell),
            )  # fmt: skip
            if arrival <= limit:
                time[i] = arrival
    return Solvable(np.isfinite(time), time, rows.kind.copy())


@dataclass(frozen=True)
class OracleArguments:
    """Count the evaluation's episodes that a disc with knowledge of all futures can solve."""

    kind: str = ""
    """Kind of world; all kinds if empty."""
    body: str = "tiago"
    """Body: tiago, go2 or random; a mixture of them if empty."""
    episodes: int = 200
    seed: int = 0
    speeds: tuple[float, float] = (0.2, 2.0)
    """Speeds of the movers, as multiples of the body's."""
    movers: tuple[int, int] = (6, 20)


def main(arguments: OracleArguments) -> None:
    """Print the shares.

    Raises:
        BadArgument: If there is no such kind or body, or a number is out of its range.
    """
    if arguments.episodes < 1 or arguments.seed < 0:
        raise BadArgument(
            f"--episodes must be 1 or more and --seed 0 or more, got {arguments.episodes} and {arguments.seed}"
        )
    config = replace(ArenaConfig(), mover_speeds=arguments.speeds, movers=arguments.movers)
    if arguments.body:
        config = config.driven_by(arguments.body)
    if arguments.kind:
        config = config.of(arguments.kind)
    result = solvable(config, arguments.episodes, arguments.seed)
    for kind, name in enumerate(KINDS):
        chosen = result.kind == kind
        if chosen.any():
            solved = result.solved[chosen]
            mean = result.time[chosen][solved].mean() if solved.any() else math.nan
            print(f"{name}: {solved.sum()} of {len(solved)} can be solved, after {mean:.1f} s on average")


if __name__ == "__main__":
    run_module("oracle", main, OracleArguments)
