"""The display of a single run: a line on a terminal while it drives, a table at the end."""

import time
from typing import Any, TextIO

from eval.methods import title_of

ON_A_TERMINAL = 0.2
"""Time between two updates of the line [s]."""
IN_A_LOG = 10.0
"""Time between two lines where there is no terminal [s]."""


class ProgressLine:
    """A line of simulated time, distance to the goal and real-time factor. Use it as a context manager.

    Args:
        stream: Stream to write to; on a terminal the line is rewritten in place.
    """

    def __init__(self, stream: TextIO):
        self._stream = stream
        self._in_place = stream.isatty()
        self._interval = ON_A_TERMINAL if self._in_place else IN_A_LOG
        self._began = self._last = time.perf_counter()
        self._written = False

    def __enter__(self) -> "ProgressLine":
        """Start the clock."""
        self._began = self._last = time.perf_counter()
        return self

    def __call__(self, simulated: float, to_goal: float) -> None:
        """Write the line if it is due.

        Args:
            simulated: Time of the simulation [s].
            to_goal: True distance to the goal [m].
        """
        now = time.perf_counter()
        if now - self._last < self._interval:
            return
        self._last = now
        factor = simulated / (now - self._began)
        line = f"{simulated:7.1f} s  {to_goal:6.2f} m to the goal  {factor:5.1f} x real time"
        self._stream.write(f"\r{line}" if self._in_place else f"{line}\n")
        self._stream.flush()
        self._written = True

    def __exit__(self, *_: object) -> None:
        """End the terminal's line."""
        if self._in_place and self._written:
            self._stream.write("\n")


_TABLE = (
    ("duration", "s", 2),
    ("steps", "", 0),
    ("path_length", "m", 2),
    ("shortest_path", "m", 2),
    ("spl", "", 3),
    ("arsps", "", 4),
    ("ansps", "", 6),
    ("min_clearance", "m", 3),
    ("slam_ate", "m", 3),
    ("slam_final_error", "m", 3),
    ("odometry_ate", "m", 3),
    ("odometry_final_error", "m", 3),
    ("real_time_factor", "", 1),
)


def result_table(row: dict[str, Any]) -> str:
    """A result as text: the configuration, the outcome, the figures with their units."""
    turned = {"speed": 1.0}  # what says nothing if it is as here
    options = (
        f"{key} {row[key]}"
        for key in ("region", "movers", "speed", "sighted", "without")
        if row[key] not in (None, "", turned.get(key))
    )
    what = ", ".join([row["world"], *options, row["robot"], title_of(row["method"], row), f"seed {row['seed']}"])
    outcome = row["outcome"] + (f" with {row['collided_with']}" if row["collided_with"] else "")
    why = row.get("contact") or row.get("failure")
    outcome += f" ({why['class'].replace('_', ' ')})" if why else ""
    outcome += f"; it says: {row['why']}" if row.get("why") else ""
    figures = (
        f"  {name:20} {'-' if row[name] is None else format(row[name], f'.{digits}f'):>10} {unit}".rstrip()
        for name, unit, digits in _TABLE
    )
    return "\n".join([what, f"  {'outcome':20} {outcome}", *figures])
