"""Tracks: objects of a person's size followed over time, by alpha-beta filters in the frame of odometry.

A lidar sees surfaces, but motion is what threatens a robot. Each scan's detections (``vuca_nav.perception.detections``)
are associated with the tracks, the nearest pair first; each one left over begins a track. One class serves training
(hundreds of robots a call) and the robot (one row).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.detections import BEHIND, DETECTION_SIZE, LEG_RADIUS, WHOLE, find_detections
from vuca_nav.types import FloatArray

MAX_TRACKS = 16
X, Y, V_X, V_Y, RADIUS, CERTAINTY, HAS_LEFT = range(7)
"""Columns of a track as returned: centre and velocity over the ground in base_link, radius [m, m/s, m],
certainty from 0 to 1, and 1 once it has left the place that it was first seen at."""
TRACK_SIZE = 7

_X, _Y, _V_X, _V_Y, _RADIUS, _HITS, _MISSED, _STEADY, _ERROR_X, _ERROR_Y = range(10)
_FIRST_X, _FIRST_Y, _FIRST_YAW, _HAS_LEFT = range(10, 14)
_SEEN_X, _SEEN_Y, _BEFORE_X, _BEFORE_Y, _BETWEEN = range(14, 19)
"""Where the track was seen last and the time before, and the time between the two [s]; where it was seen in part, its
own place."""
_COLUMNS = 19
_FOR_GOOD = 2.0
"""Value of ``_HAS_LEFT`` that stays; 1 can still be withdrawn."""
_GATE = 0.4
"""Greatest distance of a detection from a track's expected place [m]: 0.1 s at 3 m/s, and the centre's error."""
_ALPHA = np.array([1.0, 1.0, 0.85, 0.7, 0.6, 0.5, 0.45])
_BETA = np.array([0.0, 0.8, 0.5, 0.35, 0.25, 0.18, 0.14])
"""Gains of position and velocity by the number of times that the prediction held; the last stays."""
_SURPRISE, _SURPRISE_SLOPE = 0.25, 0.02
"""Sum of a track's last two errors [m], and its growth by a share of the range, above which the object has turned:
its velocity is that between detections, and the gains begin anew."""
_PAIR, _IN_PART = 0.18, 0.3
"""Shares of the usual gains where a larger object shows only a leg, and where it is half hidden."""
_PART_GATE = 0.25
"""``_GATE`` of objects that are seen in part [m]."""
_LEFT = 1.2
"""Distance from its first place, in radii, at which a track has left it."""
_LEFT_FOR_GOOD = 1.0
"""Distance at which a track has left its first place for good [m]: a mover that comes back past there has not stopped.
Legs of one table are nearer to each other."""
_TURN_ERROR = 0.04
"""Addition to both distances, times the range, for each radian that the robot has turned since: odometry's error."""
_PATIENCE = 5
"""Number of updates for which an unseen track is kept."""
_FASTEST = 3.0
"""Greatest speed of a track [m/s]."""
_RADIUS_GAIN = 0.3


class _State(NamedTuple):
    """State of a tracker, n rows."""

    tracks: FloatArray
    """(n, MAX_TRACKS, 19) in the frame of odometry that begins where a row began anew."""
    odometry: FloatArray
    """(n, 3) the base's pose in that frame."""
    since: FloatArray
    """(n,) time since the last scan that was used [s]."""


class _Sight(NamedTuple):
    """Input of a tracker, n rows."""

    ranges: FloatArray
    """(n, num_beams) ranges of the scans [m]."""
    motions: FloatArray
    """(n, 3) displacements since the last call [m, m, rad]."""
    reaches: FloatArray
    """(n,) ranges from which on returns are left out [m]."""
    fresh: NDArray[np.bool_]
    """(n,) rows that begin anew."""


class _Workspace(NamedTuple):
    """Constants and scratch."""

    beams: FloatArray
    """(num_beams, 2) directions in base_link."""
    found: FloatArray
    taken: NDArray[np.bool_]
    period: float
    """Time between two calls [s]."""
    spacing: float
    """Time between two scans that are used [s]."""


class Tracker:
    """Follows moving obstacles, a row for each robot.

    Args:
        n: Number of rows.
        num_beams: Beams of a scan; beam i points at ``-pi + i * 2 pi / num_beams``.
        period: Time between two calls [s].
        spacing: Time between two scans that are used [s], a multiple of the period: over less, range noise is too
            much of a velocity.
    """

    def __init__(self, n: int, num_beams: int, period: float, spacing: float):
        angles = -np.pi + np.arange(num_beams) * (2.0 * np.pi / num_beams)
        beams = np.column_stack([np.cos(angles), np.sin(angles)])
        found, taken = np.zeros((num_beams, DETECTION_SIZE)), np.zeros(MAX_TRACKS, np.bool_)
        self._workspace = _Workspace(beams, found, taken, period, spacing)
        self._state = _State(np.zeros((n, MAX_TRACKS, _COLUMNS)), np.zeros((n, 3)), np.zeros(n))

    def update(
        self,
        rows: NDArray[np.int64],
        ranges: FloatArray,
        motions: FloatArray,
        reaches: FloatArray,
        fresh: NDArray[np.bool_],
    ) -> None:
        """Take in a scan of each of these rows.

        Args:
            rows: Indices of the rows.
            ranges: (n, num_beams) [m]; ``inf`` or NaN where nothing came back.
            motions: (n, 3) displacement since the last call by odometry, in the base frame of then [m, m, rad].
            reaches: (n,) returns from here on are left out [m].
            fresh: (n,) rows that forget their tracks and their odometry.
        """
        _update(rows, _Sight(ranges, motions, reaches, fresh), self._state, self._workspace)

    def predict(self, rows: NDArray[np.int64], motions: FloatArray) -> None:
        """Let a call's time pass for these rows without a scan; motions as ``update`` takes them."""
        _predict(rows, motions, self._state, self._workspace.period)

    def tracks_in_base(self, row: int, out: FloatArray) -> int:
        """Tracks of a row as they are now.

        Args:
            row: Index of the row.
            out: (MAX_TRACKS, TRACK_SIZE), written to. A track that has not left its first place is most likely
                a static object: posts that are seen two by two, in changing pairs, seem to jump, and while the robot
                turns and its odometry overstates the turn, static objects seem to circle it.

        Returns:
            Their number.
        """
        return tracks_in_base(self._state, row, out)

    @property
    def state(self) -> _State:
        """The state, for kernels that work on many rows at once."""
        return self._state


@njit(cache=True, nogil=True)
def _predict(rows, motions, state, period):
    for i in rows:
        _move(state.odometry[i], motions[i])
        state.since[i] += period


@njit(cache=True, nogil=True)
def _move(pose, motion):
    """Add a displacement, in the base frame, to a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    pose[0] += c * motion[0] - s * motion[1]
    pose[1] += s * motion[0] + c * motion[1]
    pose[2] += motion[2]


@njit(cache=True, nogil=True)
def _update(rows, sight, state, workspace):
    for i in rows:
        pose = state.odometry[i]
        if sight.fresh[i]:
            state.tracks[i] = 0.0
            pose[:] = 0.0
            state.since[i] = workspace.spacing
        else:
            _move(pose, sight.motions[i])
            state.since[i] += workspace.period
        if state.since[i] < workspace.spacing - 1e-6:
            continue
        dt, state.since[i] = state.since[i], 0.0
        count = find_detections(sight.ranges[i], workspace.beams, sight.reaches[i], workspace.found)
        _associate(state.tracks[i], workspace.found[:count], pose, dt, workspace.taken)


@njit(cache=True, nogil=True)
def _associate(tracks, found, pose, dt, taken):
    """Associate detections with tracks, the nearest pair first; drop tracks that have not been seen for long."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for k in range(len(tracks)):
        tracks[k, _X] += tracks[k, _V_X] * dt
        tracks[k, _Y] += tracks[k, _V_Y] * dt
        taken[k] = tracks[k, _HITS] == 0.0
    for f in range(len(found)):
        x, y = found[f, 0], found[f, 1]
        found[f, 0], found[f, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
        found[f, 4] = math.sqrt(x * x + y * y)
    left = len(found)
    while left > 0:
        best, best_f, nearest = -1, -1, _GATE
        for f in range(left):
            gate = nearest if found[f, 3] == WHOLE else min(nearest, _PART_GATE)
            for k in range(len(tracks)):
                dx, dy = tracks[k, _X] - found[f, 0], tracks[k, _Y] - found[f, 1]
                if not taken[k] and dx * dx + dy * dy < gate * gate:
                    best, best_f, nearest = k, f, math.sqrt(dx * dx + dy * dy)
                    gate = nearest
        if best < 0:
            break
        taken[best] = True
        _correct(tracks[best], found[best_f], dt, pose[2])
        left -= 1
        found[best_f] = found[left]
    for k in range(len(tracks)):
        if tracks[k, _HITS] == 0.0:  # space for new tracks, the nearest first
            best_f, nearest = -1, math.inf
            for f in range(left):
                if found[f, 3] == WHOLE and found[f, 4] < nearest:
                    best_f, nearest = f, found[f, 4]
            if best_f < 0:
                break
            tracks[k] = 0.0
            tracks[k, _X], tracks[k, _Y], tracks[k, _RADIUS] = found[best_f, :3]
            tracks[k, _FIRST_X], tracks[k, _FIRST_Y] = found[best_f, :2]
            tracks[k, _SEEN_X], tracks[k, _SEEN_Y] = found[best_f, :2]
            tracks[k, _FIRST_YAW] = pose[2]
            tracks[k, _HITS], tracks[k, _STEADY], tracks[k, _MISSED] = 1.0, 1.0, -1.0
            left -= 1
            found[best_f] = found[left]
    for k in range(len(tracks)):
        if tracks[k, _HITS] > 0.0:
            tracks[k, _MISSED] += 1.0
            if tracks[k, _MISSED] > _PATIENCE:
                tracks[k] = 0.0


@njit(cache=True, nogil=True)
def _correct(track, found, dt, yaw):
    """Correct a track by its detection: an alpha-beta filter whose gains fall while the prediction holds."""
    error_x, error_y = found[0] - track[_X], found[1] - track[_Y]
    share, turned, since = 1.0, False, dt * (1.0 + track[_MISSED])
    if found[3] == BEHIND or (found[2] <= LEG_RADIUS and track[_RADIUS] > _PAIR):
        share = _IN_PART
    elif track[_STEADY] > 1.0:
        astray = math.hypot(error_x + track[_ERROR_X], error_y + track[_ERROR_Y])
        if astray > _SURPRISE + _SURPRISE_SLOPE * found[4]:
            track[_STEADY] = 1.0
            turned = track[_BETWEEN] > 0.0
    track[_ERROR_X], track[_ERROR_Y] = error_x, error_y
    seen = min(int(track[_STEADY]), len(_ALPHA) - 1)
    alpha, beta = share * _ALPHA[seen], share * _BETA[seen] / since
    track[_X] += alpha * error_x
    track[_Y] += alpha * error_y
    if turned:  # its place has gone astray for longer than since the last scan: the error would make it too fast
        track[_V_X] = (found[0] - track[_BEFORE_X]) / (since + track[_BETWEEN])
        track[_V_Y] = (found[1] - track[_BEFORE_Y]) / (since + track[_BETWEEN])
    else:
        track[_V_X] += beta * error_x
        track[_V_Y] += beta * error_y
    track[_BEFORE_X], track[_BEFORE_Y], track[_BETWEEN] = track[_SEEN_X], track[_SEEN_Y], since
    whole = share == 1.0  # the middle of a part is elsewhere
    track[_SEEN_X], track[_SEEN_Y] = found[0] if whole else track[_X], found[1] if whole else track[_Y]
    speed = math.hypot(track[_V_X], track[_V_Y])
    if speed > _FASTEST:
        track[_V_X] *= _FASTEST / speed
        track[_V_Y] *= _FASTEST / speed
    if found[3] == WHOLE:
        track[_RADIUS] += _RADIUS_GAIN * share * (found[2] - track[_RADIUS])
    track[_HITS] += 1.0
    track[_STEADY] += 1.0
    gone = math.hypot(track[_X] - track[_FIRST_X], track[_Y] - track[_FIRST_Y])
    gone -= _TURN_ERROR * abs(yaw - track[_FIRST_YAW]) * found[4]
    if gone >= _LEFT_FOR_GOOD:
        track[_HAS_LEFT] = _FOR_GOOD
    elif track[_HAS_LEFT] != _FOR_GOOD:
        track[_HAS_LEFT] = 1.0 if gone >= _LEFT * track[_RADIUS] else 0.0
    track[_MISSED] = -1.0  # counted up by the caller


@njit(cache=True, nogil=True)
def tracks_in_base(state, row, out):
    """Tracks of a row in its base_link now; returns their number. See ``Tracker.tracks_in_base``."""
    tracks, pose, t = state.tracks[row], state.odometry[row], state.since[row]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    count = 0
    for k in range(len(tracks)):
        track = tracks[k]
        if track[_HITS] == 0.0:
            continue
        dx, dy = track[_X] + t * track[_V_X] - pose[0], track[_Y] + t * track[_V_Y] - pose[1]
        row_out = out[count]
        row_out[X], row_out[Y] = c * dx + s * dy, -s * dx + c * dy
        v_x, v_y = track[_V_X], track[_V_Y]
        row_out[V_X], row_out[V_Y] = c * v_x + s * v_y, -s * v_x + c * v_y
        row_out[RADIUS], row_out[CERTAINTY] = track[_RADIUS], min(track[_HITS], 4.0) / (4.0 + track[_MISSED])
        row_out[HAS_LEFT] = 1.0 if track[_HAS_LEFT] > 0.0 else 0.0
        count += 1
    return count


@njit(cache=True, nogil=True)
def select_moving(tracks, speed, certainty, out):
    """Copy the tracks that surely move to ``out``; returns their number.

    Args:
        tracks: (k, TRACK_SIZE).
        speed: A slower track is taken to stand [m/s].
        certainty: A track of less is taken to stand.
        out: (k or more, TRACK_SIZE), written to.
    """
    count = 0
    for track in tracks:
        speed_2 = track[V_X] * track[V_X] + track[V_Y] * track[V_Y]
        if track[HAS_LEFT] > 0.0 and track[CERTAINTY] > certainty and speed_2 > speed * speed:
            out[count] = track
            count += 1
    return count


@njit(cache=True, nogil=True)
def is_of_track(x, y, tracks, margin):
    """Whether a return at a point is within a margin of the circle of one of these tracks (k, TRACK_SIZE)."""
    for track in tracks:
        near = track[RADIUS] + margin
        if (x - track[X]) ** 2 + (y - track[Y]) ** 2 < near * near:
            return True
    return False
