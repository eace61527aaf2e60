"""Doors and goals with little room: the worlds, and the table of what arrives in them.

``python -m eval.analysis.measurements.tight --out DIR`` writes the worlds and their tasks. Then
``vuca eval --tasks DIR/tasks.yaml --robot tiago,go2,rover --method ours-dh,dwa-dh --seeds 3000:3001 --out RESULTS``
runs them, and ``python -m eval.analysis.measurements.tight --of RESULTS --out FILE.md`` makes the table.

Each door is in a wall of 0.15 m across a room of 12 by 8 m, its place, the start and the goal drawn anew. Each goal is
0.30 to 0.50 m from a wall, from both walls of a corner, or from a pillar of a mover's size that stands.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml

from eval.analysis.compare import read_run_and_refused
from eval.analysis.statistics import wilson_interval
from eval.store import Row
from eval.tasks.reading import FORMAT
from vuca_nav.cli import optional, run_module
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_file
from vuca_nav.types import Pose2
from worlds import save_scene
from worlds.world import Box, Cylinder, Obstacle, World

DOORS = (0.50, 0.55, 0.60, 0.65, 0.70, 0.75, 0.80, 0.90)
"""Widths of the doors [m]."""
AWAY = (0.30, 0.35, 0.40, 0.45, 0.50)
"""Distances of the goals [m]."""
PLACES = ("wall", "corner", "pillar")
LAYOUTS = 10
"""Number of worlds of each door."""
GOALS = 4
"""Number of worlds of each kind of goal."""
WALL = 0.15
"""Thickness of the wall with the door [m]."""
WIDTH, HEIGHT, OUTER = 12.0, 8.0, 0.2
PILLAR = 0.3
"""Radius of the pillar [m]."""


def _room(name: str, start: Pose2, goal: tuple[float, float], more: tuple[Obstacle, ...]) -> World:
    sides = ((6.0, 0.1, WIDTH, OUTER), (6.0, 7.9, WIDTH, OUTER), (0.1, 4.0, OUTER, HEIGHT), (11.9, 4.0, OUTER, HEIGHT))
    walls = tuple(Obstacle("wall", Box(*side, 0.0, 2.0)) for side in sides)
    return World(name, 0, (0.0, 0.0, WIDTH, HEIGHT), walls + more, (), start, goal)


def door(width: float, layout: int) -> World:
    """A room with a door.

    Args:
        width: Width of the door [m].
        layout: Number of the layout, the same for all widths.
    """
    rng = np.random.default_rng([1, layout])
    middle, start, goal = (round(float(y), 3) for y in rng.uniform((2.5, 1.5, 1.5), (5.5, 6.5, 6.5)))
    low, high = middle - 0.5 * width, middle + 0.5 * width
    parts = (
        Obstacle("wall", Box(6.0, 0.5 * low, WALL, low, 0.0, 2.0)),
        Obstacle("wall", Box(6.0, 0.5 * (high + HEIGHT), WALL, HEIGHT - high, 0.0, 2.0)),
    )
    return _room(f"door-{width:.2f}-{layout}", Pose2(3.0, start, 0.0), (9.5, goal), parts)


def goal_beside(place: str, away: float, layout: int) -> World:
    """A room with a goal beside something.

    Args:
        place: One of ``PLACES``.
        away: Distance of the goal from it [m].
        layout: Number of the layout, the same for all distances.
    """
    rng = np.random.default_rng([2, PLACES.index(place), layout])
    name, start = f"{place}-{away:.2f}-{layout}", Pose2(2.0, round(float(rng.uniform(1.5, 6.5)), 3), 0.0)
    right, top = WIDTH - OUTER, HEIGHT - OUTER
    if place == "wall":
        return _room(name, start, (right - away, round(float(rng.uniform(1.5, 6.5)), 3)), ())
    if place == "corner":
        return _room(name, start, (right - away, top - away), ())
    x, y, angle = (round(float(value), 3) for value in rng.uniform((5.5, 3.0, -math.pi), (8.5, 5.0, math.pi)))
    reach = PILLAR + away
    goal = x + reach * math.cos(angle), y + reach * math.sin(angle)
    return _room(name, start, goal, (Obstacle("pillar", Cylinder(x, y, PILLAR, 1.7)),))


def worlds() -> Iterator[World]:
    """All of them."""
    for width in DOORS:
        yield from (door(width, layout) for layout in range(LAYOUTS))
    for place in PLACES:
        for away in AWAY:
            yield from (goal_beside(place, away, layout) for layout in range(GOALS))


def write(folder: Path) -> Path:
    """Write the worlds and their tasks; returns the tasks' file."""
    path = folder / "tasks.yaml"
    prepare_file(path)
    tasks = []
    for world in worlds():
        save_scene(world, str(folder / f"{world.name}.yaml"))
        tasks.append({"name": world.name, "world": f"{world.name}.yaml", "time_limit": 90.0})
    path.write_text(yaml.safe_dump({"format": FORMAT, "tasks": tasks}, sort_keys=False))
    return path


def table(rows: list[Row]) -> str:
    """Arrivals by the kind of place, its width or distance, robot and method, with 95% intervals, in Markdown."""
    cells = defaultdict(list)
    drivers = sorted({(row["robot"], row["method"]) for row in rows})
    for row in rows:
        place, size, _ = row["task"].split("-")
        cells[place, size, row["robot"], row["method"]].append(row["outcome"])
    places = sorted({key[:2] for key in cells}, key=lambda key: (("door", *PLACES).index(key[0]), key[1]))
    lines = ["| place | room, m | " + " | ".join(f"{robot}, `{method}`" for robot, method in drivers) + " |"]
    lines.append("|---|---|" + "---|" * len(drivers))
    for place, size in places:
        shown = []
        for driver in drivers:
            outcomes = cells[(place, size, *driver)]
            driven = [outcome for outcome in outcomes if outcome != "refused"]
            if not driven:
                shown.append("refused" if outcomes else "-")
                continue
            arrived = sum(outcome == "success" for outcome in driven)
            low, high = wilson_interval(arrived, len(driven))
            touched = sum(outcome == "collision" for outcome in driven)
            shown.append(
                f"{arrived} of {len(driven)} [{100 * low:.0f}-{100 * high:.0f}%]"
                + (f", {touched} touched" if touched else "")
            )
        lines.append(f"| {place} | {size} | " + " | ".join(shown) + " |")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True)
class TightArguments:
    """Write the worlds with little room, or make the table of an evaluation in them."""

    out: Path
    """Folder of the worlds; with --of the Markdown file of the table."""
    of: Annotated[Path | None, optional("RESULTS")] = None
    """Directory of the evaluation's results."""


def main(arguments: TightArguments) -> None:
    """Write the worlds or the table.

    Raises:
        BadArgument: The results are of other tasks, or a file cannot be written.
    """
    if arguments.of is None:
        print(write(arguments.out))
        return
    run, refused = read_run_and_refused(arguments.of)
    rows, known = [*run, *refused], {world.name for world in worlds()}
    if not rows or any(row.get("task") not in known for row in rows):
        raise BadArgument(f"{arguments.of}: not an evaluation of the tasks that this command writes")
    prepare_file(arguments.out)
    arguments.out.write_text(table(rows))


if __name__ == "__main__":
    run_module("tight", main, TightArguments)
