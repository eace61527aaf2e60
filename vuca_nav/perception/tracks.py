"""Things of a person's size in the scans, followed over time: where they are, how fast, and what that means.

A lidar sees surfaces, and what threatens a robot is motion. Here the scan is cut into segments where it jumps; a
segment in front of its surroundings and no wider than ``MAX_WIDTH`` is a thing, and things are followed by alpha-beta
filters in the odometry's frame. From them come, for each of a ring of directions that the body might go in, the time
until it would meet one of them. All of it runs on hundreds of rows in training and on one in a robot.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.perception.segments import BEHIND, FOUND_COLUMNS, LEG_RADIUS, WHOLE, find_things
from vuca_nav.types import FloatArray

MAX_TRACKS = 16
TRAINING_BEAMS = 180
DIRECTIONS = 24
"""Of motion that are judged, 15 degrees apart and mirror images of each other: k and 23 - k."""
SPEEDS = (1.0, 0.5)
"""They are judged at, as shares of the greatest."""
HORIZON = 3.0
"""Beyond which a meeting does not matter [s]: longer than a random walker keeps its mind."""
SLOTS = 6
"""Things that are shown one by one, the most threatening first."""
SLOT_SIZE = 6
"""Position 2, velocity 2, radius, certainty."""
POSITION_SCALE, VELOCITY_SCALE, RADIUS_SCALE = 4.0, 2.0, 0.5
"""[m], [m/s], [m]"""

_X, _Y, _V_X, _V_Y, _RADIUS, _HITS, _MISSED, _STEADY, _ERROR_X, _ERROR_Y = range(10)
_FIRST_X, _FIRST_Y, _FIRST_YAW, _HAS_LEFT = range(10, 14)
_COLUMNS = 14
_FOR_GOOD = 2.0
"""Of ``_HAS_LEFT``; 1 is for now."""
_GATE = 0.4
"""A thing is found again so near to where it was expected: 0.1 s at 3 m/s, and its centre's error [m]."""
_ALPHA = np.array([1.0, 1.0, 0.85, 0.7, 0.6, 0.5, 0.45])
_BETA = np.array([0.0, 0.8, 0.5, 0.35, 0.25, 0.18, 0.14])
"""Gains of position and velocity by the number of times that a thing was where it was expected; the last stays."""
_SURPRISE, _SURPRISE_SLOPE = 0.25, 0.02
"""Farther, and by this share of the range, from where it was expected, both of its last two errors added up, a thing
has turned: it is learnt anew [m]."""
_PAIR, _IN_PART = 0.18, 0.3
"""Where something of a larger radius was only a leg is seen, or what is half hidden: so much of the usual gains."""
_PART_GATE = 0.25
"""For these instead of ``_GATE`` [m]."""
_LEFT = 1.2
"""Times its radius that a thing must be from where it was first seen to have left ..."""
_LEFT_FOR_GOOD = 1.0
"""... and so far once to have left for good: who comes back past there has not stopped. Legs of one table are nearer to
each other [m] ..."""
_TURN_ERROR = 0.04
"""... and so much more, times its range, for each radian that the robot has turned since: odometry's error there."""
_PATIENCE = 5
"""Updates that a thing is remembered unseen."""
_MARGIN = 0.05
"""Room that counts as a meeting [m]."""
_FASTEST = 3.0
"""[m/s]"""


class Tracker:
    """Follows things, a row for each robot.

    Args:
        n: Rows.
        num_beams: Of the scans; beam i points at ``-pi + i * 2 pi / num_beams``.
        period: Between two calls [s].
        spacing: Between two scans that are looked at [s], a multiple of the period.
        most_beams: A scan of twice or more as many is thinned, to each second, third, ... beam; by default by what
            training has.

    Attributes:
        tracks: (n, MAX_TRACKS, 14) position, velocity, radius, times seen, updates unseen, times seen since it
            turned, last error of position, where it was first seen, the robot's heading then, whether it has left
            that place; in the frame of odometry that begins where a row began anew [m, m/s, m, rad]. What was
            never seen is no track.
    """

    def __init__(self, n: int, num_beams: int, period: float, spacing: float, most_beams: int = TRAINING_BEAMS):
        self._step = max(num_beams // most_beams, 1)
        angles = -np.pi + np.arange(0, num_beams, self._step) * (2.0 * np.pi / num_beams)
        self._beams = np.column_stack([np.cos(angles), np.sin(angles)])
        self._period, self._spacing = period, spacing
        self.tracks: FloatArray = np.zeros((n, MAX_TRACKS, _COLUMNS))
        self._odometry, self._since = np.zeros((n, 3)), np.zeros(n)
        self._found, self._taken = np.zeros((len(self._beams), FOUND_COLUMNS)), np.zeros(MAX_TRACKS, np.bool_)
        directions = -np.pi + (np.arange(DIRECTIONS) + 0.5) * (2.0 * np.pi / DIRECTIONS)
        self._directions = np.column_stack([np.cos(directions), np.sin(directions)])
        self._here = np.zeros((MAX_TRACKS, SLOT_SIZE))

    def update(
        self,
        rows: NDArray[np.int64],
        ranges: NDArray[np.floating],
        motions: NDArray[np.floating],
        reaches: FloatArray,
        fresh: NDArray[np.bool_],
    ) -> None:
        """Take in a scan of each of these rows.

        Args:
            rows: Which.
            ranges: (n, num_beams) [m]; ``inf`` or NaN where nothing came back.
            motions: (n, 3) displacement since the last call by odometry, in the base frame of then [m, m, rad].
            reaches: (n,) from there on nothing is looked at [m].
            fresh: (n,) rows that forget what they know, and where they were.
        """
        _update(
            rows, ranges, self._step, motions, reaches, fresh, self._beams, self._period, self._spacing,
            self.tracks, self._odometry, self._since, self._found, self._taken,
        )  # fmt: skip

    def things(self, row: int, out: FloatArray) -> int:
        """What a row knows of now; what has not yet left the place that it was first seen at stands.

        That is for posts: seen two by two, now these and now those, they would seem to jump; and while the robot
        turns, and its odometry overstates it, whatever stands seems to go round it.

        Args:
            row: Which.
            out: (MAX_TRACKS, SLOT_SIZE), written to: position, velocity over the ground, in base_link, radius,
                certainty from 0 to 1 [m, m/s, m].

        Returns:
            How many there are.
        """
        return _in_base(self.tracks[row], self._odometry[row], self._since[row], out, False)

    def features(
        self,
        rows: NDArray[np.int64],
        body_radius: FloatArray,
        max_speed: FloatArray,
        meetings: NDArray[np.float32],
        rest: NDArray[np.float32],
    ) -> None:
        """What the things mean to each of these rows.

        Args:
            rows: Which.
            body_radius: Mean radius of the footprint (n,) [m].
            max_speed: (n,) [m/s].
            meetings: (n, len(SPEEDS) * DIRECTIONS), written to: 0 for a direction in which nothing is met within
                ``HORIZON``, 1 for one in which it is now.
            rest: (n, 1 + SLOTS * SLOT_SIZE), written to: the same for standing still, then the slots, in base_link,
                velocities over the ground.
        """
        _features(
            rows, self.tracks, self._odometry, self._since, self._directions, body_radius, max_speed, self._here,
            meetings, rest,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _update(
    rows, ranges, step, motions, reaches, fresh, beams, period, spacing, tracks, odometry, since, found, taken
):  # fmt: skip
    for i in rows:
        pose = odometry[i]
        if fresh[i]:
            tracks[i] = 0.0
            pose[:] = 0.0
            since[i] = spacing
        else:
            c, s = math.cos(pose[2]), math.sin(pose[2])
            pose[0] += c * motions[i, 0] - s * motions[i, 1]
            pose[1] += s * motions[i, 0] + c * motions[i, 1]
            pose[2] += motions[i, 2]
            since[i] += period
        if since[i] < spacing - 1e-6:
            continue
        dt, since[i] = since[i], 0.0
        count = find_things(ranges[i], step, beams, reaches[i], found)
        _follow(tracks[i], found[:count], pose, dt, taken)


@njit(cache=True, nogil=True)
def _follow(things, found, pose, dt, taken):
    """Match what was found to what is known, the nearest pair first; forget what has not been seen for long."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(things)):
        things[k, _X] += things[k, _V_X] * dt
        things[k, _Y] += things[k, _V_Y] * dt
        taken[k] = things[k, _HITS] == 0.0
    for f in range(len(found)):
        x, y = found[f, 0], found[f, 1]
        found[f, 0], found[f, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
        found[f, 4] = math.sqrt(x * x + y * y)
    left = len(found)
    while left > 0:
        best, best_f, nearest = -1, -1, _GATE
        for f in range(left):
            gate = nearest if found[f, 3] == WHOLE else min(nearest, _PART_GATE)
            for k in range(len(things)):
                dx, dy = things[k, _X] - found[f, 0], things[k, _Y] - found[f, 1]
                if not taken[k] and dx * dx + dy * dy < gate * gate:
                    best, best_f, nearest = k, f, math.sqrt(dx * dx + dy * dy)
                    gate = nearest
        if best < 0:
            break
        taken[best] = True
        _learn(things[best], found[best_f], dt, pose[2])
        left -= 1
        found[best_f] = found[left]
    for k in range(len(things)):
        if things[k, _HITS] == 0.0:  # room for something new, the nearest first
            best_f, nearest = -1, math.inf
            for f in range(left):
                if found[f, 3] == WHOLE and found[f, 4] < nearest:
                    best_f, nearest = f, found[f, 4]
            if best_f < 0:
                break
            things[k] = 0.0
            things[k, _X], things[k, _Y], things[k, _RADIUS] = found[best_f, :3]
            things[k, _FIRST_X], things[k, _FIRST_Y] = found[best_f, :2]
            things[k, _FIRST_YAW] = pose[2]
            things[k, _HITS], things[k, _STEADY], things[k, _MISSED] = 1.0, 1.0, -1.0
            left -= 1
            found[best_f] = found[left]
    for k in range(len(things)):
        if things[k, _HITS] > 0.0:
            things[k, _MISSED] += 1.0
            if things[k, _MISSED] > _PATIENCE:
                things[k] = 0.0


@njit(cache=True, nogil=True)
def _learn(thing, found, dt, yaw):
    """What is known of a thing after it was found again."""
    error_x, error_y = found[0] - thing[_X], found[1] - thing[_Y]
    share = 1.0
    if found[3] == BEHIND or (found[2] <= LEG_RADIUS and thing[_RADIUS] > _PAIR):
        share = _IN_PART
    elif thing[_STEADY] > 1.0:
        astray = math.hypot(error_x + thing[_ERROR_X], error_y + thing[_ERROR_Y])
        if astray > _SURPRISE + _SURPRISE_SLOPE * found[4]:
            thing[_STEADY] = 1.0
    thing[_ERROR_X], thing[_ERROR_Y] = error_x, error_y
    seen = min(int(thing[_STEADY]), len(_ALPHA) - 1)
    alpha, beta = share * _ALPHA[seen], share * _BETA[seen] / (dt * (1.0 + thing[_MISSED]))
    thing[_X] += alpha * error_x
    thing[_Y] += alpha * error_y
    thing[_V_X] += beta * error_x
    thing[_V_Y] += beta * error_y
    speed = math.hypot(thing[_V_X], thing[_V_Y])
    if speed > _FASTEST:
        thing[_V_X] *= _FASTEST / speed
        thing[_V_Y] *= _FASTEST / speed
    if found[3] == WHOLE:
        thing[_RADIUS] += 0.3 * share * (found[2] - thing[_RADIUS])
    thing[_HITS] += 1.0
    thing[_STEADY] += 1.0
    gone = math.hypot(thing[_X] - thing[_FIRST_X], thing[_Y] - thing[_FIRST_Y])
    gone -= _TURN_ERROR * abs(yaw - thing[_FIRST_YAW]) * found[4]
    if gone >= _LEFT_FOR_GOOD:
        thing[_HAS_LEFT] = _FOR_GOOD
    elif thing[_HAS_LEFT] != _FOR_GOOD:
        thing[_HAS_LEFT] = 1.0 if gone >= _LEFT * thing[_RADIUS] else 0.0
    thing[_MISSED] = -1.0  # counted up by who calls


@njit(cache=True, nogil=True)
def _in_base(things, pose, t, out, all_move):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    count = 0
    for k in range(len(things)):
        thing = things[k]
        if thing[_HITS] == 0.0:
            continue
        dx, dy = thing[_X] + t * thing[_V_X] - pose[0], thing[_Y] + t * thing[_V_Y] - pose[1]
        row = out[count]
        row[0], row[1] = c * dx + s * dy, -s * dx + c * dy
        v_x, v_y = (thing[_V_X], thing[_V_Y]) if all_move or thing[_HAS_LEFT] > 0.0 else (0.0, 0.0)
        row[2], row[3] = c * v_x + s * v_y, -s * v_x + c * v_y
        row[4], row[5] = thing[_RADIUS], min(thing[_HITS], 4.0) / (4.0 + thing[_MISSED])
        count += 1
    return count


@njit(cache=True, nogil=True)
def _features(rows, tracks, odometry, since, directions, body_radius, max_speed, here, meetings, rest):
    num_directions = len(directions)
    for i in rows:
        count = _in_base(tracks[i], odometry[i], since[i], here, True)
        for a in range(len(SPEEDS)):
            speed = SPEEDS[a] * max_speed[i]
            for d in range(num_directions):
                meetings[i, a * num_directions + d] = _urgency(
                    here, count, speed * directions[d, 0], speed * directions[d, 1], body_radius[i]
                )
        rest[i, :] = 0.0
        rest[i, 0] = _urgency(here, count, 0.0, 0.0, body_radius[i])
        for slot in range(min(SLOTS, count)):
            # What will be nearest in a second, were we to stand; what has been shown has a certainty below 0.
            best, nearest = -1, math.inf
            for k in range(count):
                x, y = here[k, 0], here[k, 1]
                if here[k, 5] < 0.0:
                    continue
                away = math.sqrt(x * x + y * y)
                closing = -(x * here[k, 2] + y * here[k, 3]) / max(away, 1e-6)
                gap = max(away - body_radius[i] - here[k, 4], 0.0) - closing
                if gap < nearest:
                    best, nearest = k, gap
            at = 1 + slot * SLOT_SIZE
            row = here[best]
            rest[i, at] = min(max(row[0] / POSITION_SCALE, -1.5), 1.5)
            rest[i, at + 1] = min(max(row[1] / POSITION_SCALE, -1.5), 1.5)
            rest[i, at + 2] = row[2] / VELOCITY_SCALE
            rest[i, at + 3] = row[3] / VELOCITY_SCALE
            rest[i, at + 4] = row[4] / RADIUS_SCALE
            rest[i, at + 5] = row[5]
            row[5] = -1.0


@njit(cache=True, nogil=True)
def _urgency(here, count, u_x, u_y, body_radius):
    """1 if something is met at once by going on at this velocity, falling to 0 if within HORIZON nothing is."""
    soonest = HORIZON
    for k in range(count):
        x, y = here[k, 0], here[k, 1]
        w_x, w_y = here[k, 2] - u_x, here[k, 3] - u_y
        reach = body_radius + here[k, 4] + _MARGIN
        approach = x * w_x + y * w_y
        if approach >= 0.0:  # never nearer than now
            continue
        gap = x * x + y * y - reach * reach
        if gap <= 0.0:
            return 1.0
        square = w_x * w_x + w_y * w_y
        discriminant = approach * approach - square * gap
        if discriminant > 0.0:
            soonest = min(soonest, (-approach - math.sqrt(discriminant)) / square)
    return 1.0 - soonest / HORIZON
