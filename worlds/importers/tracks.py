"""Recorded people: a table of time, person, x and y becomes movers that appear, walk and vanish as they did."""

import csv
import io
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from vuca_nav.data_files import read_text, shown
from vuca_nav.errors import BadWorld
from vuca_nav.types import Pose2
from worlds.checks import MAX_EXTENT, check_world
from worlds.importers.fields import FARTHEST, LONGEST, world_name
from worlds.motion.keyframes import place_of
from worlds.world import MAX_MOVER_SPEED, Cylinder, Keyframes, Mover, MoverPart, World

HEADERS = {
    "time": ("t_s", "time", "t", "time_s"),
    "person": ("ped_id", "id", "person", "agent_id"),
    "x": ("x_m", "x"),
    "y": ("y_m", "y"),
}
"""Names of the columns; others are left out."""
RADIUS = 0.25
"""Radius of a person [m], half the breadth of the shoulders: a table has only the middles."""
HEIGHT = 1.7
"""Height of a person [m]."""
GAP = 1.5
"""Time between two rows of a person, over the usual one of the table, from which on a row is missing."""
MOST_ROWS, MOST_PEOPLE = 200_000, 1000
MARGIN = 1.0
"""Distance of the bounds from everybody [m]; they are open."""
ROOM = 1.5
"""Distance of the start from everybody while the episode begins, if the ground has such a place [m]."""
BEGINNING = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Times at which an episode begins [s]."""


class _Row(NamedTuple):
    line: int
    time: float
    person: str
    x: float
    y: float


def load_people(path: str | Path, radius: float = RADIUS) -> tuple[Mover, ...]:
    """The people of a table (CSV), in real time: each is there from its first row to its last.

    A person is a cylinder that goes straight on between two rows. Times are kept as they are: the episode begins at 0.

    Args:
        path: CSV with a header: time [s], person, x and y [m], by one of ``HEADERS``.
        radius: Radius of everybody [m].

    Raises:
        BadWorld: The file cannot be read, a column or a number is missing, times are not in order, a row is missing in
            the middle, a person is at two places at one time, or moves faster than 5 m/s.
    """
    rows = list(_rows(Path(path)))
    people: dict[str, list[_Row]] = {}
    for row in rows:
        people.setdefault(row.person, []).append(row)
    if len(people) > MOST_PEOPLE:
        raise BadWorld(f"{path}: {len(people)} people; at most {MOST_PEOPLE} would be right")
    for person, own in people.items():
        _check_order(path, person, own)
    in_order = all(a.time <= b.time for a, b in pairwise(rows))
    by_person = sum(a.person != b.person for a, b in pairwise(rows)) == len(people) - 1
    if not (in_order or by_person):
        late = next(b for a, b in pairwise(rows) if b.time < a.time)
        raise BadWorld(
            f"{path}: line {late.line}: {late.time:g} s comes after a later time; rows in the order of their times, or "
            "person by person, would be right"
        )
    _check_gaps(path, people)
    parts = (MoverPart(Cylinder(0.0, 0.0, radius, HEIGHT)),)
    movers = []
    for own in people.values():
        motion = Keyframes(tuple(r.time for r in own), tuple((r.x, r.y) for r in own), vanishes=True)
        movers.append(Mover("person", parts, radius, place_of(motion)[0], motion))
    return tuple(movers)


def load_tracks(path: str | Path, radius: float = RADIUS) -> World:
    """An open ground with the people of a table; the robot has to cross it along its longer side.

    Raises:
        BadWorld: As by :func:`load_people`; or the ground is too large.
    """
    movers = load_people(path, radius)
    points = [point for m in movers if isinstance(m.motion, Keyframes) for point in m.motion.points]
    xs, ys = zip(*points)
    reach = MARGIN + radius
    bounds = min(xs) - reach, min(ys) - reach, max(xs) + reach, max(ys) + reach
    if max(bounds[2] - bounds[0], bounds[3] - bounds[1]) > MAX_EXTENT:
        raise BadWorld(f"{path}: people are more than {MAX_EXTENT:g} m apart; less would be right")
    start, goal = _task(bounds, movers)
    world = World(world_name(path), 0, bounds, (), movers, start, goal, open_borders=True)
    check_world(world, str(path))
    return world


def _task(bounds: tuple[float, float, float, float], movers: tuple[Mover, ...]) -> tuple[Pose2, tuple[float, float]]:
    """Start and goal at the two ends of the ground, where nobody comes near while the episode begins."""
    x0, y0, x1, y1 = bounds
    early = [place_of(m.motion, t) for m in movers if isinstance(m.motion, Keyframes) for t in BEGINNING]
    there = [place[:2] for place, is_there in early if is_there]
    along_x = x1 - x0 >= y1 - y0
    best, least = (Pose2(0.0, 0.0, 0.0), (0.0, 0.0)), -1.0
    for share in (0.5, 0.35, 0.65, 0.2, 0.8):
        across = y0 + share * (y1 - y0) if along_x else x0 + share * (x1 - x0)
        ends = (x0 + MARGIN, x1 - MARGIN) if along_x else (y0 + MARGIN, y1 - MARGIN)
        for a, b in (ends, ends[::-1]):
            start, goal = ((a, across), (b, across)) if along_x else ((across, a), (across, b))
            room = min((math.dist(start, place) for place in there), default=math.inf)
            if room > least:
                yaw = math.atan2(goal[1] - start[1], goal[0] - start[0])
                best, least = (Pose2(*start, yaw), goal), room
            if room >= ROOM:
                return best
    return best


def _rows(path: Path) -> Iterator[_Row]:
    """The rows of the table, each checked by itself."""
    reader = csv.reader(io.StringIO(read_text(path, BadWorld)))
    try:
        header = [name.strip().lower() for name in next(reader, [])]
        columns = {what: _column(path, header, what) for what in HEADERS}
        count = 0
        for words in reader:
            if not any(words):
                continue
            count += 1
            if count > MOST_ROWS:
                raise BadWorld(f"{path}: more than {MOST_ROWS} rows; fewer would be right")
            if len(words) < len(header):
                raise BadWorld(f"{path}: line {reader.line_num}: {len(words)} columns; {len(header)} would be right")
            where = f"{path}: line {reader.line_num}"
            if not words[columns["person"]].strip():
                raise BadWorld(f"{where}: the person is missing; a number or a name would be right")
            yield _Row(
                reader.line_num,
                _number(words[columns["time"]], f"{where}: the time", LONGEST),
                words[columns["person"]].strip(),
                _number(words[columns["x"]], f"{where}: x", FARTHEST),
                _number(words[columns["y"]], f"{where}: y", FARTHEST),
            )
        if not count:
            raise BadWorld(f"{path}: no rows; time, person, x and y below a header would be right")
    except csv.Error as error:
        raise BadWorld(f"{path}: line {reader.line_num}: not a table: {error}") from error


def _column(path: Path, header: list[str], what: str) -> int:
    if not any(header):
        raise BadWorld(
            f"{path}: it is empty; a header with {', '.join(names[0] for names in HEADERS.values())} is right"
        )
    found = [header.index(name) for name in HEADERS[what] if name in header]
    if not found:
        raise BadWorld(
            f"{path}: no column of the {what} in its first line, {shown(','.join(header))}; {HEADERS[what][0]} or "
            f"{HEADERS[what][1]} would be right"
        )
    return found[0]


def _number(text: str, what: str, most: float) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not abs(number) <= most:
        raise BadWorld(f"{what} is {shown(repr(text))}; a number up to {most:g} would be right")
    return number


def _check_order(path: str | Path, person: str, rows: list[_Row]) -> None:
    """Refuse a person's rows that are not in the order of their times, or too far apart to be walked."""
    for before, row in pairwise(rows):
        where = f"{path}: line {row.line}: person {shown(person)}"
        if row.time == before.time:
            raise BadWorld(f"{where} is there twice at {row.time:g} s, as in line {before.line}; one place is right")
        if row.time < before.time:
            raise BadWorld(f"{where} at {row.time:g} s comes after {before.time:g} s; times in order would be right")
        speed = math.dist((row.x, row.y), (before.x, before.y)) / (row.time - before.time)
        if speed > MAX_MOVER_SPEED:
            raise BadWorld(f"{where} comes at {speed:.1f} m/s; {MAX_MOVER_SPEED:g} m/s or less would be right")


def _check_gaps(path: str | Path, people: dict[str, list[_Row]]) -> None:
    """Refuse a person that is missing for a while: where it was, nobody knows."""
    steps = sorted(b.time - a.time for rows in people.values() for a, b in pairwise(rows))
    usual = steps[len(steps) // 2] if steps else 0.0
    for person, rows in people.items():
        for before, row in pairwise(rows):
            if row.time - before.time > GAP * usual:
                raise BadWorld(
                    f"{path}: line {row.line}: person {shown(person)} is missing from {before.time:g} s to "
                    f"{row.time:g} s, where rows are {usual:g} s apart; rows in between, or another number "
                    "afterwards, would be right"
                )
