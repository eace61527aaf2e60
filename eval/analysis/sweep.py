"""Success, or how often a way was taken, over a dial of the moving obstacles, from evaluations that varied it.

``python -m eval.analysis.sweep DIR... --out FILE.png``: the directories of ``vuca eval crowd`` or ``branches``, a
line for each robot and method in them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from eval.analysis.statistics import wilson_interval
from eval.analysis.summary import dials_in_words
from eval.episode import OUTCOMES
from eval.methods import title_of
from eval.store import Row
from vuca_nav.cli import run_module
from vuca_nav.data_files import read_json
from vuca_nav.errors import BadArgument, UnknownName


@dataclass(frozen=True)
class SweepArguments:
    """Draw a share of the episodes over a dial of the moving obstacles, with 95% intervals."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Directories of evaluations that are complete."""
    show: tuple[str, ...] = ("success",)
    """What to draw, a panel each: success, collision, timeout, fall, or a way's name, as quiet in the branches."""
    over: Literal["movers", "speed", "sighted"] = "movers"
    """The dial: number of moving obstacles, factor on their speeds, or share of them that see the robot."""
    out: Path = Path("movers.png")
    """PNG file, written over if it exists."""


Point = tuple[float, float, float, float]
"""Value of the dial, share of the episodes, lower and upper end of its interval."""
TITLES = {"movers": "moving obstacles", "speed": "factor on the movers' speeds", "sighted": "share of sighted movers"}


def lines_of(groups: list[Row], show: str = "success", over: str = "movers") -> dict[str, list[Point]]:
    """Points of each world, robot and method, by the value of a dial; groups of a world's own value are left out.

    Args:
        groups: Groups of summaries.
        show: Outcome, or name of a way; a way's share is of the episodes that entered any.
        over: The dial. Groups that differ in another one are lines of their own.
    """
    lines: dict[str, list[Point]] = {}
    for group in groups:
        share = _share(group, show)
        if group.get(over) is None or share["rate"] is None:
            continue
        method = title_of(group["method"], group)
        name = f"{group['world']}{dials_in_words({**group, over: None})}, {group['robot']}, {method}"
        lines.setdefault(name, []).append((group[over], share["rate"], *share["interval"]))
    return {name: sorted(points) for name, points in lines.items()}


def _share(group: Row, show: str) -> Row:
    if show in OUTCOMES:
        return group[show]
    ways = group.get("ways") or {}
    if show in ways:
        return ways[show]
    entered = sum(way["count"] for way in ways.values())
    return {"rate": 0.0 if entered else None, "interval": wilson_interval(0, entered) if entered else None}


def read_groups(folder: Path) -> list[Row]:
    """The groups of an evaluation's summary.

    Raises:
        BadArgument: There is none, or it cannot be read.
    """
    path = folder / "summary.json"
    try:
        return list(read_json(path, BadArgument)["groups"])
    except (BadArgument, KeyError, TypeError) as error:
        raise BadArgument(f"{folder} has not the summary of a complete evaluation: {error}") from error


def draw(panels: dict[str, dict[str, list[Point]]], path: Path, over: str = "movers") -> None:
    """Draw the lines, a panel for each share.

    Args:
        panels: Lines of each share.
        path: PNG file.
        over: The dial that they are over.

    Raises:
        BadArgument: If there is nothing to draw, or the file cannot be written.
    """
    if not any(panels.values()):
        raise BadArgument(f"none of the evaluations varied {over}; 'vuca eval SUITE --{over} ...' does")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0 * len(panels), 4.0), layout="constrained")
    for axes, (show, lines) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items()):
        for k, (name, points) in enumerate(sorted(lines.items())):
            dial, rate, low, high = (list(column) for column in zip(*points))
            below = [100 * max(r - a, 0.0) for r, a in zip(rate, low)]
            above = [100 * max(b - r, 0.0) for r, b in zip(rate, high)]
            aside = (0.25 if over == "movers" else 0.01) * (k - 0.5 * (len(lines) - 1))
            at = [value + aside for value in dial]  # side by side
            axes.errorbar(at, [100 * r for r in rate], yerr=[below, above], marker="o", capsize=3, label=name)
        axes.set(xlabel=TITLES[over], ylabel=f"{show} [%], 95% intervals", ylim=(0, 100))
        axes.grid(alpha=0.3)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, frameon=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=100)
    except OSError as error:
        raise BadArgument(f"--out {path} cannot be written: {error}") from error


def main(arguments: SweepArguments) -> None:
    """Draw the figure that the arguments ask for."""
    groups = [group for folder in arguments.folders for group in read_groups(folder)]
    known = {*OUTCOMES, *(way for group in groups for way in group.get("ways") or {})}
    for show in arguments.show:
        if show not in known:
            raise UnknownName("share", show, sorted(known))
    draw({show: lines_of(groups, show, arguments.over) for show in arguments.show}, arguments.out, arguments.over)
    print(f"drawn: {arguments.out}")


if __name__ == "__main__":
    run_module("sweep", main, SweepArguments)
