"""The robot's activity in words: the text of a recording's *Now* panel."""

import math
from dataclasses import dataclass

import numpy as np

from vuca_nav.geometry import inverse, transform_points
from vuca_nav.telemetry.interface import FrontierView
from vuca_nav.telemetry.rerun.blueprint import CLOSE_RANGE
from vuca_nav.types import FloatArray, Pose2, VelocityCommand

_TURNING = 0.05
"""Yaw rate below which the robot counts as going straight on [rad/s]."""
_STANDING = 0.02
"""Speed below which the robot counts as standing [m/s]."""


@dataclass(slots=True)
class Status:
    """Latest values of everything that the text mentions; None where there is none yet."""

    time: float = 0.0
    """[s]"""
    map_from_base: Pose2 | None = None
    goal: tuple[float, float] | None = None
    """[m]"""
    waypoint_in_map: tuple[float, float] | None = None
    """[m]"""
    command: VelocityCommand | None = None
    nearest_in_map: FloatArray | None = None
    """(2,) nearest return of the last scan [m]."""
    decision: FrontierView | None = None
    decision_time: float = 0.0
    """[s]"""
    errors: tuple[float, float] | None = None
    """Distance of the true pose to the one of SLAM and to the one of dead reckoning [m]."""
    entropy: float | None = None
    """[nat]"""
    scan_time: float | None = None
    """Time that SLAM took for the last scan of a log [ms]."""
    event: str | None = None
    """The last event, with its time."""


def describe(status: Status) -> str:
    """Describe as Markdown: motion, aim, nearest return, localisation errors, the last event, the last decision."""
    facts = []
    pose = status.map_from_base
    if pose is not None:
        if status.waypoint_in_map is not None:
            facts.append(f"**Heads for** the waypoint {_where(status.waypoint_in_map, pose)}")
        if status.nearest_in_map is not None:
            facts.append(_nearest(status.nearest_in_map, pose))
        if status.goal is not None:
            facts.append(f"**Goal** {_where(status.goal, pose)}")
    if status.errors is not None:
        facts.append(f"**Pose error** {status.errors[0]:.2f} m; dead reckoning {status.errors[1]:.2f} m")
    if status.entropy is not None:
        facts.append(f"**Entropy of the map** {status.entropy:.0f} nat")
    if status.event is not None:
        facts.append(f"**Last event** {status.event}")
    took = None if status.scan_time is None else f"SLAM took {status.scan_time:.1f} ms"
    paragraphs = [f"### {status.time:.1f} s: {took or _motion(status.command)}"]
    if facts:
        paragraphs.append("\n".join(f"- {fact}" for fact in facts))
    if status.decision is not None:
        paragraphs.append(_decision(status.decision, status.decision_time))
    return "\n\n".join(paragraphs)


def best_first(view: FrontierView, count: int) -> list[int]:
    """Indices of the ``count`` candidates with the lowest score; the chosen one is always among them."""
    order = [int(i) for i in np.argsort(view.score, kind="stable")[:count]]
    if view.chosen >= 0 and view.chosen not in order:
        order = [*order[: count - 1], view.chosen]
    return order


def _motion(command: VelocityCommand | None) -> str:
    if command is None:
        return "no command yet"
    speed = math.hypot(command.v_x, command.v_y)
    turning = abs(command.w_z) >= _TURNING
    side = "left" if command.w_z > 0.0 else "right"
    if speed < _STANDING:
        return f"turning {side} on the spot ({command.w_z:+.2f} rad/s)" if turning else "standing"
    going = "backing up" if command.v_x < -_STANDING else "driving"
    way = f"turning {side} ({command.w_z:+.2f} rad/s)" if turning else "straight on"
    return f"{going} at {speed:.2f} m/s, {way}"


def _where(point_in_map: tuple[float, float] | FloatArray, map_from_base: Pose2) -> str:
    x, y = transform_points(inverse(map_from_base), np.asarray(point_in_map, dtype=np.float64)[None, :])[0]
    bearing = math.degrees(math.atan2(y, x))
    side = "ahead" if abs(bearing) < 5.0 else f"{abs(bearing):.0f}° to the {'left' if bearing > 0 else 'right'}"
    return f"({point_in_map[0]:.1f}, {point_in_map[1]:.1f}): {math.hypot(x, y):.1f} m, {side}"


def _nearest(nearest_in_map: FloatArray, map_from_base: Pose2) -> str:
    distance = math.hypot(nearest_in_map[0] - map_from_base.x, nearest_in_map[1] - map_from_base.y)
    warning = f", **closer than {CLOSE_RANGE} m**" if distance < CLOSE_RANGE else ""
    return f"**Nearest return** {_where(nearest_in_map, map_from_base)}{warning}"


def _decision(view: FrontierView, time: float) -> str:
    count = len(view.score)
    if count == 0:
        return f"**Decision of {time:.1f} s**: no frontier is left."
    rows = [
        f"| {'**chosen**' if i == view.chosen else rank} | ({view.points_in_map[i, 0]:.1f}, "
        f"{view.points_in_map[i, 1]:.1f}) | {view.goal_term[i]:.1f} | {view.safety_term[i]:.1f} "
        f"| {view.score[i]:.1f} |"
        for rank, i in enumerate(best_first(view, 5), start=1)
    ]
    head = "| | frontier | goal [m] | safety [m] | score [m] |\n|---|---|---|---|---|\n"
    return f"**Decision of {time:.1f} s** among {count} (least score is best)\n\n{head}" + "\n".join(rows)
