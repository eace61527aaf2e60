"""What worlds that are brought in cost: ``python -m eval.analysis.brought FOLDER... --out FILE.md``.

Of each world its size, its shapes, how long it takes to load and to set up, and the real-time factor of a short run.
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import tyro
from tqdm import tqdm

from eval.episode import Episode, EpisodeConfig
from eval.tasks.reading import read_tasks
from vuca_nav.cli import run_module, show
from vuca_nav.errors import BadWorld
from vuca_nav.files import write_whole
from vuca_nav.provenance import commit, machine
from worlds.importers.sources import load_world
from worlds.registry import TRAINING_SEED


@dataclass(frozen=True, kw_only=True)
class BroughtArguments:
    """Load worlds, and run each for a few seconds: size, shapes, time to load, real-time factor."""

    sources: tyro.conf.Positional[tuple[Path, ...]]
    """Folders of worlds, or files of tasks."""
    out: Path | None = None
    """Markdown file of the table."""
    seconds: float = 5.0
    """Simulated time of each run [s]."""
    robot: str = "tiago"
    """A robot's name."""
    method: str = "dwa-dh"
    """A method's name."""


HEADER = "| world | size [m] | shapes | movers | load [s] | set up [s] | real-time factor |"


def main(arguments: BroughtArguments) -> None:
    """Print the table, and write it.

    Raises:
        BadWorld: A source is broken.
    """
    worlds = {each.task.world: each.name for source in arguments.sources for each in read_tasks(source)}
    lines = [HEADER, "|---|" + "---:|" * (HEADER.count("|") - 2)]
    # What is compiled on first use is compiled before anything is timed.
    _run(EpisodeConfig("square", robot=arguments.robot, method=arguments.method, seed=TRAINING_SEED - 1), 1.0)
    for world, name in tqdm(worlds.items(), file=sys.stderr, unit="world"):
        lines.append(_line(world, name, arguments))
    made = f"{arguments.robot}, {arguments.method}, {arguments.seconds:g} s each; commit {commit()}, {machine()['cpu']}"
    text = "\n".join([*lines, "", made, ""])
    show(text)
    if arguments.out is not None:
        write_whole(arguments.out, text)


def _line(world: str, name: str, arguments: BroughtArguments) -> str:
    began = time.perf_counter()
    try:
        loaded = load_world(world)
    except BadWorld as error:
        return f"| {name} | refused: {error} | | | | | |"
    seconds = time.perf_counter() - began
    x0, y0, x1, y1 = loaded.bounds
    size = f"{x1 - x0:.0f} x {y1 - y0:.0f}"
    head = f"| {name} | {size} | {len(loaded.obstacles)} | {len(loaded.movers)} | {seconds:.2f} |"
    try:
        set_up, factor = _run(EpisodeConfig(world, robot=arguments.robot, method=arguments.method), arguments.seconds)
    except BadWorld as error:
        return f"{head} refused: {error} | |"
    return f"{head} {set_up:.2f} | {factor:.1f} |"


def _run(config: EpisodeConfig, seconds: float) -> tuple[float, float]:
    """Time to set an episode up [s], and its real-time factor."""
    episode = Episode(config)
    episode.timeout = min(episode.timeout, seconds)
    result = episode.run()
    return result.set_up_time, result.real_time_factor


if __name__ == "__main__":
    run_module("brought", main, BroughtArguments)
