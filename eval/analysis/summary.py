"""Summaries of rows: rates with 95% intervals and means, one group for each place, robot and method."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields

from eval.analysis.statistics import mean, wilson_interval
from eval.checked import is_number
from eval.contact import CONTACT_CLASSES
from eval.episode import ADDED_FIELDS, OUTCOMES, REFUSED
from eval.failure import FAILURE_CLASSES
from eval.methods import MethodOptions, title_of
from eval.store import Row

OPTIONS = tuple(field.name for field in fields(MethodOptions))
GROUP_BY = ("world", "region", "without", "movers", "speed", "sighted", "robot", "method", *OPTIONS)
MEANS = (
    "arriving_time",
    "path_length",
    "spl",
    "arsps",
    "ansps",
    "min_clearance",
    "slam_ate",
    "slam_final_error",
    "odometry_ate",
    "odometry_final_error",
    "real_time_factor",
)
"""Fields averaged over a group's episodes, however they ended; ``arriving_time`` over those that arrived."""

_COLUMNS = (
    ("time s", "arriving_time", 1),
    ("way m", "path_length", 1),
    ("m/coll.", "way_per_collision", 0),
    ("SPL", "spl", 3),
    ("score", "score", 4),
    ("refused", "refused", 0),
    ("ARSPS", "arsps", 4),
    ("ANSPS", "ansps", 6),
    ("SLAM ATE", "slam_ate", 3),
    ("final", "slam_final_error", 3),
    ("odom ATE", "odometry_ate", 3),
    ("final", "odometry_final_error", 3),
    ("RTF", "real_time_factor", 1),
)
_ANYWHERE = {"region": None, "without": "", "movers": None, "speed": 1.0, "sighted": None}
OPTIONAL = ("score", "refused")
"""Columns that are left out where no row has them."""


def is_result(row: Row) -> bool:
    """Whether a row has all the fields that a summary needs."""
    return (
        row.get("outcome") in (*OUTCOMES, REFUSED)
        and all(name in row and (row[name] is None or is_number(row[name])) for name in MEANS)
        and all(name in row for name in GROUP_BY if name not in ADDED_FIELDS)
    )


def summarise(rows: Sequence[Row]) -> list[Row]:
    """A summary for each group, the groups in order; the rows' order does not matter."""
    groups: dict[tuple, list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.get(key, ADDED_FIELDS.get(key)) for key in GROUP_BY), []).append(row)
    ordered = sorted(groups.items(), key=lambda item: [(part is None, part) for part in item[0]])
    return [{**dict(zip(GROUP_BY, key)), **statistics_of(members)} for key, members in ordered]


def by_driver(rows: Sequence[Row], place: str) -> list[Row]:
    """A summary for each robot and method, over all tasks together.

    Args:
        rows: Rows of an evaluation.
        place: Name of all tasks together.
    """
    return summarise([{**row, **_ANYWHERE, "world": place} for row in rows])


def statistics_of(rows: Sequence[Row]) -> Row:
    """Rates and means of some rows; no rows give rates of None and the interval [0, 1].

    ``contacts`` counts the contacts of each class, and those in which the robot itself closed in; ``failures`` the
    classes of missions that did not arrive without one. ``way_per_collision`` is the way of all episodes together over
    the number of collisions [m], None if there is none. Refused tasks are counted as ``refused`` and in nothing else;
    ``score`` is the mean of the tasks' own score, if they have one.
    """
    refused = sum(row["outcome"] == REFUSED for row in rows)
    rows = [row for row in rows if row["outcome"] != REFUSED]
    scores = [row["score"] for row in rows if row.get("score") is not None]
    n = len(rows)
    counts = {outcome: sum(row["outcome"] == outcome for row in rows) for outcome in OUTCOMES}
    rates = {
        outcome: {"count": k, "rate": k / n if n else None, "interval": list(wilson_interval(k, n))}
        for outcome, k in counts.items()
    }
    taken = [row["way"] for row in rows if row.get("way") is not None]
    ways = {
        way: {"count": k, "rate": k / len(taken), "interval": list(wilson_interval(k, len(taken)))}
        for way, k in sorted(Counter(taken).items())
    }
    contacts = [row["contact"] for row in rows if row.get("contact")]
    failures = Counter(row["failure"]["class"] for row in rows if row.get("failure"))
    collisions, way = counts["collision"], math.fsum(row["path_length"] or 0.0 for row in rows)
    return {
        "n": n,
        **rates,
        "contacts": {
            "own": sum(contact["own"] for contact in contacts),
            **{name: sum(contact["class"] == name for contact in contacts) for name in CONTACT_CLASSES},
        },
        "failures": {name: failures[name] for name in FAILURE_CLASSES},
        "ways": ways,
        **{name: mean(row[name] for row in rows) for name in MEANS},
        "way_per_collision": way / collisions if collisions else None,
        **({"refused": refused} if refused else {}),
        **({"score": mean(scores)} if scores else {}),
    }


def table(groups: Sequence[Row], total: Row) -> str:
    """The summary for a terminal: counts with 95% Wilson intervals, means, lengths in metres; last of all rows.

    ``m/coll.`` is the way for each collision.
    """
    columns = [column for column in _COLUMNS if column[1] not in OPTIONAL or column[1] in total]
    header = ["episodes", "n", *OUTCOMES, "own", *(title for title, _, _ in columns)]
    lines = [header]
    for title, group in [*((_title(group), group) for group in groups), ("all", total)]:
        means = ("-" if group.get(name) is None else f"{group[name]:.{digits}f}" for _, name, digits in columns)
        lines.append([title, str(group["n"]), *(_rate(group[o]) for o in OUTCOMES), _own(group), *means])
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    return "\n".join(
        "  ".join(cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths)))
        for line in lines
    )


def _rate(outcome: Row) -> str:
    low, high = outcome["interval"]
    return f"{outcome['count']} [{100 * low:.0f}-{100 * high:.0f}%]"


def _own(group: Row) -> str:
    """How many of the contacts the robot closed in on itself."""
    contacts = group["contacts"]
    return f"{contacts['own']} of {sum(contacts[name] for name in CONTACT_CLASSES)}"


def _title(group: Row) -> str:
    region = "" if group["region"] is None else f" {group['region']}"
    without = f" without {group['without']}" if group["without"] else ""
    method = title_of(group["method"], group)
    return f"{group['world']}{region}{dials_in_words(group)}{without}, {group['robot']}, {method}"


def dials_in_words(row: Row) -> str:
    """The dials of the moving obstacles that a row's task turned, as ", 8 movers, speed x 1.5, 50% sighted"."""
    movers, speed, sighted = row.get("movers"), row.get("speed"), row.get("sighted")
    words = [
        "" if movers is None else f"{movers} movers",
        "" if speed in (None, 1.0) else f"speed x {speed:g}",
        "" if sighted is None else f"{100 * sighted:g}% sighted",
    ]
    return "".join(f", {word}" for word in words if word)
