"""Public lists of maps with their tasks: a JSON list of maps, each with ``third_party_tasks`` and ``auto_tasks``.

Each entry has ``set``, ``name`` and ``yaml``, the map's file; each of its tasks ``start`` [x, y] or [x, y, yaw],
``goal`` [x, y, ...] and, where the source has them, ``dynamic``: people by keyframes [t, x, y], over and over.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vuca_nav.data_files import read_json, shown
from vuca_nav.errors import BadWorld
from worlds.importers.fields import LONGEST, Fields
from worlds.importers.tracks import HEIGHT
from worlds.motion.keyframes import place_of
from worlds.world import Cylinder, Keyframes, Mover, MoverPart

ROLES = ("third_party_tasks", "auto_tasks")
MOST = 10_000


def tasks_in(source: Path, content: Any) -> Iterator[tuple[str, Fields, Fields]]:
    """Name, map and fields of each task in a list of maps.

    Raises:
        BadField: A field is missing or of another kind.
    """
    for k, each in enumerate(content):
        entry = Fields(str(source), each, f"[{k}]")
        for role in ROLES:
            for n, fields in enumerate(entry.mappings(role, MOST)):
                own = fields.text("name") if "name" in fields else f"{role.removesuffix('_tasks')}-{n}"
                yield f"{entry.text('set')}-{entry.text('name')}-{own}", entry, fields


def map_of(source: Path, entry: Fields) -> Path:
    """Path of an entry's map, beneath the list's folder.

    Raises:
        BadField: There is none.
    """
    name = entry.text("yaml")
    path = source.parent / name
    if Path(name).is_absolute() or ".." in Path(name).parts or not path.is_file():
        raise entry.error("yaml", f"there is no {shown(name)} in {source.parent}")
    return path


def load_walkers(source: Path, task: str, radius: float) -> tuple[Mover, ...]:
    """The people of a task, by its name as :func:`tasks_in` gives it.

    Args:
        source: The list.
        task: Name of the task.
        radius: Radius of everybody [m].

    Raises:
        BadWorld: There is no such task in the list, or its keyframes are broken.
    """
    content = read_json(source, BadWorld)
    if not isinstance(content, list):
        raise BadWorld(f"{source}: a list of maps would be right")
    fields = next((fields for name, _, fields in tasks_in(source, content) if name == task), None)
    if fields is None:
        raise BadWorld(f"{source}: it has no task {shown(task)}")
    return tuple(_walker(mover, radius) for mover in fields.mappings("dynamic", 1000))


def _walker(mover: Fields, radius: float) -> Mover:
    rows = mover.rows("keyframes", 3, MOST, LONGEST)
    if not rows:
        raise mover.error("keyframes", "none; [time, x, y] would be right")
    times, points = tuple(t for t, _, _ in rows), tuple((x, y) for _, x, y in rows)
    loops = mover.flag("loop") if "loop" in mover else True
    period = times[-1] - times[0] if loops and len(times) > 1 else None
    motion = Keyframes(times, points, period, jumps=points[0] != points[-1])
    return Mover("person", (MoverPart(Cylinder(0.0, 0.0, radius, HEIGHT)),), radius, place_of(motion)[0], motion)
