"""Success against the number of moving obstacles, from evaluations that varied it.

``python -m eval.sweep DIR... --out FILE.png``: the directories of ``vuca eval crowd`` or ``branches``, a line for each
robot and method in them.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro

from eval.store import Row
from vuca_nav.errors import BadArgument, VucaError


@dataclass(frozen=True)
class SweepArguments:
    """Draw success over the number of moving obstacles, with 95% intervals."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Of evaluations that are complete."""
    out: Path = Path("movers.png")
    """PNG file, written over if it exists."""


Point = tuple[int, float, float, float]
"""Movers, share of successes, lower and upper end of its interval."""


def lines_of(groups: list[Row]) -> dict[str, list[Point]]:
    """Points of each world, robot and method, by number of movers; groups of a world's own number are left out."""
    lines: dict[str, list[Point]] = {}
    for group in groups:
        if group["movers"] is None or group["success"]["rate"] is None:
            continue
        name = f"{group['world']}, {group['robot']}, {group['method']}"
        success = group["success"]
        lines.setdefault(name, []).append((group["movers"], success["rate"], *success["interval"]))
    return {name: sorted(points) for name, points in lines.items()}


def read_groups(folder: Path) -> list[Row]:
    """The groups of an evaluation's summary.

    Raises:
        BadArgument: There is none, or it cannot be read.
    """
    path = folder / "summary.json"
    try:
        return json.loads(path.read_text())["groups"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadArgument(f"{path} is not the summary of a complete evaluation: {error}") from error


def draw(lines: dict[str, list[Point]], path: Path) -> None:
    """Draw them.

    Raises:
        BadArgument: If there is nothing to draw, or the file cannot be written.
    """
    if not lines:
        raise BadArgument("none of the evaluations varied the number of movers; 'vuca eval crowd' does")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    for k, (name, points) in enumerate(sorted(lines.items())):
        movers, rate, low, high = (list(column) for column in zip(*points))
        below = [100 * (r - a) for r, a in zip(rate, low)]
        above = [100 * (b - r) for r, b in zip(rate, high)]
        at = [m + 0.25 * (k - 0.5 * (len(lines) - 1)) for m in movers]  # side by side
        axes.errorbar(at, [100 * r for r in rate], yerr=[below, above], marker="o", capsize=3, label=name)
    axes.set(xlabel="moving obstacles", ylabel="success [%], 95% intervals", ylim=(0, 100))
    axes.grid(alpha=0.3)
    axes.legend()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=100)
    except OSError as error:
        raise BadArgument(f"--out {path} cannot be written: {error}") from error


def main(arguments: SweepArguments) -> None:
    """Read, draw."""
    groups = [group for folder in arguments.folders for group in read_groups(folder)]
    draw(lines_of(groups), arguments.out)
    print(f"drawn: {arguments.out}")


if __name__ == "__main__":
    try:
        main(tyro.cli(SweepArguments))
    except VucaError as error:
        print(f"sweep: {error}", file=sys.stderr)
        sys.exit(2)
