"""Speed of the arena: ``python -m train.analysis.bench.arena --threads 2``."""

import json
import math
import time
from dataclasses import dataclass, replace

import numpy as np

from train.arena.arena import Arena
from train.arena.config import ArenaConfig
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig

BENCHMARKS = [
    {"name": "training worlds, 12 movers", "config": replace(ArenaConfig(), movers=(12, 12)), "goal": 200_000},
    {"name": "open ground, 40 movers", "config": replace(ArenaConfig(), movers=(40, 40)).of("dynamic"), "goal": 80_000},
]
"""Configurations to measure, with their goals in decisions a second on two cores."""


@dataclass(frozen=True)
class Arguments:
    """Measure decisions a second with random actions."""

    threads: int = 2
    rows: int = 512
    seconds: float = 5.0
    """Wall time of each measurement."""
    kind: str = "paper"
    """Kind of observation."""


def measure(config: ArenaConfig, arguments: Arguments) -> dict[str, float]:
    """Measure decisions a second of wall time, and a second of processor time of one core."""
    observed = ObservationConfig(kind=arguments.kind)  # type: ignore[arg-type]
    arena = Arena(config, observed, arguments.rows, 0, arguments.threads)
    arena.reset()
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (64, arguments.rows, 3)).astype(np.float32)
    for action in actions[:8]:
        arena.step(action)
    steps, began, used = 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - began < arguments.seconds:
        arena.step(actions[steps % len(actions)])
        steps += 1
    wall, processor = time.perf_counter() - began, time.process_time() - used
    movers = float(arena.gather("counts").mean())
    arena.close()
    decisions = steps * arguments.rows
    return {"per_second": decisions / wall, "per_core_second": decisions / processor, "movers": movers}


def main(arguments: Arguments) -> None:
    """Print one JSON object a line.

    Raises:
        BadArgument: If there is no such kind of observation, or a number is out of its range.
    """
    if arguments.threads < 1 or arguments.rows < 1 or not 0.0 < arguments.seconds < math.inf:
        raise BadArgument(
            f"--threads and --rows must be 1 or more, --seconds positive and finite, got {arguments.threads}, "
            f"{arguments.rows} and {arguments.seconds}"
        )
    for benchmark in BENCHMARKS:
        result = measure(benchmark["config"], arguments)
        figures = {name: round(value, 1) for name, value in result.items()}
        print(
            json.dumps({"name": benchmark["name"], "threads": arguments.threads, **figures, "goal": benchmark["goal"]})
        )


if __name__ == "__main__":
    run_module("bench", main, Arguments)
