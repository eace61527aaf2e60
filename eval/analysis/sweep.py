"""Success, or how often a way was taken, against the number of moving obstacles, from evaluations that varied it.

``python -m eval.analysis.sweep DIR... --out FILE.png``: the directories of ``vuca eval crowd`` or ``branches``, a
line for each robot and method in them.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import tyro

from eval.analysis.statistics import wilson_interval
from eval.episode import OUTCOMES
from eval.methods import title_of
from eval.store import Row
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument, UnknownName


@dataclass(frozen=True)
class SweepArguments:
    """Draw a share of the episodes over the number of moving obstacles, with 95% intervals."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Directories of evaluations that are complete."""
    show: tuple[str, ...] = ("success",)
    """What to draw, a panel each: success, collision, timeout, fall, or a way's name, as quiet in the branches."""
    out: Path = Path("movers.png")
    """PNG file, written over if it exists."""


Point = tuple[int, float, float, float]
"""Movers, share of the episodes, lower and upper end of its interval."""


def lines_of(groups: list[Row], show: str = "success") -> dict[str, list[Point]]:
    """Points of each world, robot and method, by number of movers; groups of a world's own number are left out.

    Args:
        groups: Groups of summaries.
        show: Outcome, or name of a way; a way's share is of the episodes that entered any.
    """
    lines: dict[str, list[Point]] = {}
    for group in groups:
        share = _share(group, show)
        if group["movers"] is None or share["rate"] is None:
            continue
        method = title_of(group["method"], group.get("options") or {})
        name = f"{group['world']}, {group['robot']}, {method}"
        lines.setdefault(name, []).append((group["movers"], share["rate"], *share["interval"]))
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
        summary = json.loads(path.read_text())
        return [{**group, "options": summary.get("options")} for group in summary["groups"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadArgument(f"{path} is not the summary of a complete evaluation: {error}") from error


def draw(panels: dict[str, dict[str, list[Point]]], path: Path) -> None:
    """Draw the lines, a panel for each share.

    Raises:
        BadArgument: If there is nothing to draw, or the file cannot be written.
    """
    if not any(panels.values()):
        raise BadArgument("none of the evaluations varied the number of movers; 'vuca eval crowd' does")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0 * len(panels), 4.0), layout="constrained")
    for axes, (show, lines) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels.items()):
        for k, (name, points) in enumerate(sorted(lines.items())):
            movers, rate, low, high = (list(column) for column in zip(*points))
            below = [100 * max(r - a, 0.0) for r, a in zip(rate, low)]
            above = [100 * max(b - r, 0.0) for r, b in zip(rate, high)]
            at = [m + 0.25 * (k - 0.5 * (len(lines) - 1)) for m in movers]  # side by side
            axes.errorbar(at, [100 * r for r in rate], yerr=[below, above], marker="o", capsize=3, label=name)
        axes.set(xlabel="moving obstacles", ylabel=f"{show} [%], 95% intervals", ylim=(0, 100))
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
    draw({show: lines_of(groups, show) for show in arguments.show}, arguments.out)
    print(f"drawn: {arguments.out}")


if __name__ == "__main__":
    run_module("sweep", main, SweepArguments)
