"""Tasks of public lists of maps (``worlds.importers.map_lists``), for ``vuca eval --tasks``."""

import sys
from pathlib import Path
from typing import Any

from eval.suites import Task
from eval.tasks.job import NamedTask
from vuca_nav.errors import BadWorld
from worlds.importers.fields import Fields
from worlds.importers.map_lists import MOST, map_of, tasks_in


def tasks_of_list(source: Path, content: list[Any]) -> tuple[NamedTask, ...]:
    """The tasks of a list of maps; those without a goal are left out, and it says how many.

    Raises:
        BadWorld: A field is missing or of another kind, or no task has a goal.
    """
    found, without_goal = [], 0
    for name, entry, fields in tasks_in(source, content):
        if "goal" not in fields:
            without_goal += 1
            continue
        optimum = fields.number("shortest_m", 1e-3) if "shortest_m" in fields else None
        found.append(NamedTask(name, _task(source, name, entry, fields), optimum))
    if without_goal:
        print(f"{source}: {without_goal} tasks have no goal and are left out", file=sys.stderr, flush=True)
    if not found:
        raise BadWorld(f"{source}: no tasks with a start and a goal")
    return tuple(found)


def _task(source: Path, name: str, entry: Fields, fields: Fields) -> Task:
    """The task: one that gives no heading begins facing its goal, as far as the body fits so."""
    start, goal = fields.listed("start", 2, 3), fields.listed("goal", 2, 3)
    yaw = start[2] if len(start) == 3 else None
    people = f"keyframes:{source}#{name}" if fields.mappings("dynamic", MOST) else None
    return Task(
        f"map:{map_of(source, entry)}", start=(start[0], start[1], yaw), goal=(goal[0], goal[1]), obstacles=people
    )
