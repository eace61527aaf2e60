"""Share of a world's seeds that can be solved: ``python -m worlds.fairness factory --region 4 --radius 0.285``.

A seed counts as solvable if a disc with exact prediction of every mover can reach the goal within the time limit.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass

import tyro
from tqdm import tqdm

from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument
from vuca_nav.task import time_limit
from worlds.reachability import reachable
from worlds.registry import make_world
from worlds.shortest_path import shortest_path_length

RADII, RESOLUTIONS = (0.01, 2.0), (0.02, 2.0)
"""Accepted ranges [m]: a larger body has no way through any of the worlds, and a finer grid takes hours."""


@dataclass(frozen=True, slots=True)
class Fairness:
    """Result of :func:`fairness`: the seeds that can be solved, and the arrival times."""

    unsolved: tuple[int, ...]
    """Seeds whose goal cannot be reached before the time limit."""
    times: tuple[float, ...]
    """Earliest arrivals at the others [s]."""
    lengths: tuple[float, ...]
    """Shortest static paths of all seeds [m]."""

    @property
    def share(self) -> float:
        """Share of solvable seeds, 0 to 1."""
        return len(self.times) / (len(self.times) + len(self.unsolved))


def fairness(
    world: str,
    seeds: Iterable[int],
    *,
    radius: float,
    region: int | None = None,
    movers: int | None = None,
    v_max: float = 1.0,
    resolution: float = 0.2,
) -> Fairness:
    """Test the space-time reachability of the goal within an episode's time limit, over seeds.

    Args:
        world: Name of a world.
        seeds: Seeds of the worlds.
        radius: Radius of the disc and of the body that the worlds are made for [m]; the circle about TIAGo's
            footprint has 0.2843 m.
        region: Region of the factory, 1 to 4.
        movers: Number of moving obstacles, for the worlds that take it.
        v_max: Greatest speed of the disc [m/s]; TIAGo's is 1.0 m/s.
        resolution: Side of a cell of the grid in space [m].
    """
    unsolved, times, lengths = [], [], []
    for seed in seeds:
        scene = make_world(world, seed, region=region, movers=movers, footprint_radius=radius)
        length = shortest_path_length(scene, radius)
        result = reachable(scene, radius, v_max, time_limit(length, v_max), resolution)
        lengths.append(length)
        if result.reached:
            times.append(result.time)
        else:
            unsolved.append(seed)
    return Fairness(tuple(unsolved), tuple(times), tuple(lengths))


@dataclass(frozen=True)
class FairnessArguments:
    """The share of a world's seeds that a disc which knows all futures can solve."""

    world: tyro.conf.Positional[str]
    """Name of a world."""
    radius: float
    """Radius of the body [m]; 0.285 for TIAGo."""
    seeds: int = 100
    """Number of seeds, from 0."""
    region: int | None = None
    """Region of the factory."""
    movers: int | None = None
    """Number of moving obstacles, for the worlds that take it."""
    resolution: float = 0.2
    """Side of a cell of the grid in space [m]."""


def main(arguments: FairnessArguments) -> None:
    """Print the share.

    Raises:
        BadArgument: If a number is out of its range.
        UnknownName: If there is no such world.
    """
    world, seeds = arguments.world, arguments.seeds
    if seeds < 1:
        raise BadArgument(f"--seeds must be 1 or more, got {seeds}")
    for name, value, (low, high) in (
        ("radius", arguments.radius, RADII),
        ("resolution", arguments.resolution, RESOLUTIONS),
    ):
        if not low <= value <= high:
            raise BadArgument(f"--{name} must be {low:g} to {high:g} m, got {value}")
    progress = tqdm(range(seeds), file=sys.stderr)
    result = fairness(
        world, progress, radius=arguments.radius, region=arguments.region, movers=arguments.movers,
        resolution=arguments.resolution,
    )  # fmt: skip
    print(
        f"{world}: {len(result.times)} of {seeds} seeds can be solved; arrival at 1 m/s after "
        f"{sum(result.times) / max(len(result.times), 1):.1f} s on average over shortest paths of "
        f"{sum(result.lengths) / seeds:.1f} m; unsolved: {list(result.unsolved)}"
    )


if __name__ == "__main__":
    run_module("fairness", main, FairnessArguments)
