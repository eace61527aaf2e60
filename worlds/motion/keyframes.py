"""Motion by keyframes: a place for every time, straight on between two of them, whatever the time step."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, Pose2
from worlds.motion.interface import FAR, MotionDriver, Movers
from worlds.motion.mover_columns import KEYFRAMES, V_X, V_Y, YAW, X, Y
from worlds.world import Keyframes

SLACK = 1e-6
"""Time before its first and after its last keyframe at which a mover is still there [s]: steps of 1/60 s add up to a
whole second only but for rounding."""


class Courses(NamedTuple):
    """Keyframes of k movers, one after the other."""

    rows: np.ndarray
    """Indices of the movers among all, (k,)."""
    first: np.ndarray
    """Index of each mover's first keyframe, and the number of all, (k + 1,)."""
    times: np.ndarray
    """(n,) by the motion's own clock [s]."""
    points: np.ndarray
    """(n, 2) [m]"""
    walked: np.ndarray
    """(n,) way from the mover's first keyframe [m]."""
    clock: np.ndarray
    """Reading at the start [s], rate, and period [s], ``inf`` for none, (k, 3)."""
    vanishes: np.ndarray
    """(k,)"""


def courses_of(motions: list[Keyframes], rows: np.ndarray) -> Courses:
    """Keyframes as arrays; a phase that is yet to be drawn is 0."""
    courses = [motion.course for motion in motions]
    first = np.cumsum([0, *(len(times) for times, _ in courses)])
    points = np.array([point for _, points in courses for point in points], float).reshape(-1, 2)
    walked = np.zeros(len(points))
    for a, b in pairwise(first.tolist()):
        walked[a + 1 : b] = np.hypot(*np.diff(points[a:b], axis=0).T).cumsum()
    return Courses(
        np.asarray(rows, np.int64),
        first.astype(np.int64),
        np.array([time for times, _ in courses for time in times], float),
        points,
        walked,
        np.array([(m.phase or 0.0, m.pace, math.inf if m.period is None else m.period) for m in motions]).reshape(
            -1, 3
        ),
        np.array([motion.vanishes for motion in motions], np.bool_),
    )


@njit(cache=True, error_model="numpy")
def place_all(time, courses, places, present):
    """Write where all are at a time.

    Args:
        time: Time since the start [s].
        courses: A ``Courses``.
        places: Output x, y [m], velocity [m/s] and distance walked [m], (k, 5).
        present: Output: whether each is there, (k,).
    """
    for k in range(len(courses.rows)):
        begin, end = courses.first[k], courses.first[k + 1]
        times = courses.times[begin:end]
        last = len(times) - 1
        phase, pace, period = courses.clock[k]
        now, rounds = phase + pace * time, 0.0
        if period < math.inf:
            rounds = math.floor((now - times[0]) / period)
            now = times[0] + (now - times[0]) % period
        v_x = v_y = 0.0
        present[k] = not courses.vanishes[k] or times[0] - SLACK <= now <= times[last] + SLACK
        at = min(max(int(np.searchsorted(times, now, side="right")) - 1, 0), max(last - 1, 0))
        x, y, walked = courses.points[begin + at, 0], courses.points[begin + at, 1], courses.walked[begin + at]
        if last > 0 and now > times[0]:
            dx, dy = courses.points[begin + at + 1, 0] - x, courses.points[begin + at + 1, 1] - y
            share = (now - times[at]) / (times[at + 1] - times[at])
            if share >= 1.0:
                share = 1.0
            else:
                v_x, v_y = pace * dx / (times[at + 1] - times[at]), pace * dy / (times[at + 1] - times[at])
            x, y = x + share * dx, y + share * dy
            walked += share * (courses.walked[begin + at + 1] - walked)
        elif last > 0 and now == times[0]:
            dt = times[1] - times[0]
            v_x = pace * (courses.points[begin + 1, 0] - x) / dt
            v_y = pace * (courses.points[begin + 1, 1] - y) / dt
        places[k, 0], places[k, 1], places[k, 2], places[k, 3] = x, y, v_x, v_y
        places[k, 4] = walked + rounds * courses.walked[end - 1]


def place_of(motion: Keyframes, time: float = 0.0) -> tuple[Pose2, bool]:
    """Pose of a mover at a time since the start [s], facing where it goes, and whether it is there."""
    places, present = np.zeros((1, 5)), np.zeros(1, np.bool_)
    place_all(time, courses_of([motion], np.zeros(1, np.int64)), places, present)
    x, y, v_x, v_y, _ = places[0].tolist()
    return Pose2(x, y, math.atan2(v_y, v_x) if v_x or v_y else 0.0), bool(present[0])


class KeyframeDriver(MotionDriver):
    """Movers by keyframes: exact at any time, gone while they are not there."""

    def __init__(self, movers: Movers):
        rows = movers.rows(KEYFRAMES)
        motions = [motion for i in rows if isinstance(motion := movers.world.movers[i].motion, Keyframes)]
        self._courses = courses_of(motions, rows)
        self._places, self._present = np.zeros((len(rows), 5)), np.zeros(len(rows), np.bool_)

    def reset(self, movers: Movers) -> None:
        """Implements :class:`MotionDriver`."""
        movers.present[self._courses.rows] = False  # those who are there appear, facing where they go

    def decide(self, time: float, movers: Movers, robot: FloatArray) -> None:
        """Implements :class:`MotionDriver`."""
        place_all(time, self._courses, self._places, self._present)
        _take_over(self._courses.rows, self._places, self._present, movers.present, movers.state)

    def locate(self, time: float, movers: Movers, poses: FloatArray, velocities: FloatArray) -> None:
        """Implements :class:`MotionDriver`."""
        place_all(time, self._courses, self._places, self._present)
        _write(self._courses.rows, self._places, poses, velocities, movers.walked)
        movers.present[self._courses.rows] = self._present


@njit(cache=True)
def _take_over(rows, places, present, was_present, state):
    """Write places and velocities into the movers' state; one that appears faces where it goes."""
    for k in range(len(rows)):
        i = rows[k]
        if not present[k]:
            state[i, X] = state[i, Y] = FAR
            state[i, V_X] = state[i, V_Y] = 0.0
        else:
            state[i, X], state[i, Y], state[i, V_X], state[i, V_Y] = (
                places[k, 0],
                places[k, 1],
                places[k, 2],
                places[k, 3],
            )
            if not was_present[i] and (state[i, V_X] != 0.0 or state[i, V_Y] != 0.0):
                state[i, YAW] = math.atan2(state[i, V_Y], state[i, V_X])
        was_present[i] = present[k]


@njit(cache=True)
def _write(rows, places, poses, velocities, walked):
    for k in range(len(rows)):
        i = rows[k]
        poses[i, 0], poses[i, 1] = places[k, 0], places[k, 1]
        velocities[i, 0], velocities[i, 1], walked[i] = places[k, 2], places[k, 3], places[k, 4]
