"""Features of tracks for a policy: urgency of a meeting by direction, then the most threatening tracks in turn.

The kernels run on hundreds of rows in training and on one in a robot.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.tracks import CERTAINTY, MAX_TRACKS, RADIUS, TRACK_SIZE, V_X, V_Y, X, Y, tracks_in_base
from vuca_nav.types import FloatArray

DIRECTIONS = 24
"""Number of directions of motion that are judged, 15 degrees apart; k and 23 - k are mirror images."""
SPEEDS = (1.0, 0.5)
"""Speeds at which directions are judged, as shares of the greatest."""
HORIZON = 3.0
"""Time beyond which a meeting does not matter [s]: longer than a random walk keeps its heading."""
SLOTS = 6
"""Number of tracks that are shown one by one, the most threatening first."""
SLOT_SIZE = 6
"""Numbers of a slot: position 2, velocity 2, radius, certainty."""
MEETINGS_SIZE, SHOWN_SIZE = DIRECTIONS * len(SPEEDS), 1 + SLOTS * SLOT_SIZE
"""Numbers by direction; numbers for standing still and of the slots."""
POSITION_SCALE, VELOCITY_SCALE, RADIUS_SCALE = 4.0, 2.0, 0.5
"""Scales of position, velocity and radius [m, m/s, m]."""
_FARTHEST = 1.5
"""Bound that positions are clipped to, in scales."""
_MARGIN = 0.05
"""Clearance that counts as a meeting [m]."""


class TrackWorkspace(NamedTuple):
    """Constants and scratch of the features."""

    directions: FloatArray
    """(DIRECTIONS, 2) unit vectors in base_link."""
    tracks: FloatArray
    """(MAX_TRACKS, TRACK_SIZE) scratch for tracks."""
    shown: np.ndarray
    """(MAX_TRACKS,) scratch mask of the tracks that are left out or shown."""

    @classmethod
    def new(cls) -> "TrackWorkspace":
        """Make the directions and fresh scratch."""
        angles = -np.pi + (np.arange(DIRECTIONS) + 0.5) * (2.0 * np.pi / DIRECTIONS)
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        return cls(directions, np.zeros((MAX_TRACKS, TRACK_SIZE)), np.zeros(MAX_TRACKS, np.bool_))


@njit(cache=True, nogil=True)
def write_features_of_rows(rows, state, body_radii, max_speeds, workspace, meetings, shown):
    """Call ``write_features`` for rows of a tracker; ``meetings`` and ``shown`` have a row for each."""
    for i in rows:
        count = tracks_in_base(state, i, workspace.tracks)
        write_features(workspace.tracks[:count], np.inf, body_radii[i], max_speeds[i], workspace, meetings[i], shown[i])


@njit(cache=True, nogil=True)
def write_features(tracks, reach, body_radius, max_speed, workspace, meetings, shown):
    """Write the features of tracks for one body.

    Args:
        tracks: (k, TRACK_SIZE) in base_link.
        reach: Distance [m]; tracks wholly beyond are left out.
        body_radius: Mean radius of the footprint [m].
        max_speed: Greatest speed of the body [m/s].
        workspace: Constants and scratch.
        meetings: (MEETINGS_SIZE,), written to: 0 for a direction and speed without a meeting within ``HORIZON``,
            1 for one with a meeting now.
        shown: (SHOWN_SIZE,), written to: the urgency for standing still, then the slots, in base_link, velocities over
            the ground.
    """
    left_out = workspace.shown
    for k in range(len(tracks)):
        x, y = tracks[k, X], tracks[k, Y]
        left_out[k] = x * x + y * y >= (reach + tracks[k, RADIUS]) ** 2
    directions = workspace.directions
    num_directions = len(directions)
    for a in range(len(SPEEDS)):
        speed = SPEEDS[a] * max_speed
        for d in range(num_directions):
            meetings[a * num_directions + d] = _urgency(
                tracks, left_out, speed * directions[d, 0], speed * directions[d, 1], body_radius
            )
    shown[:] = 0.0
    shown[0] = _urgency(tracks, left_out, 0.0, 0.0, body_radius)
    for slot in range(SLOTS):
        # The tracks that will be nearest in a second if the body stands.
        best, nearest = -1, math.inf
        for k in range(len(tracks)):
            if left_out[k]:
                continue
            x, y = tracks[k, X], tracks[k, Y]
            away = math.sqrt(x * x + y * y)
            closing = -(x * tracks[k, V_X] + y * tracks[k, V_Y]) / max(away, 1e-6)
            gap = max(away - body_radius - tracks[k, RADIUS], 0.0) - closing
            if gap < nearest:
                best, nearest = k, gap
        if best < 0:
            return
        track, at = tracks[best], 1 + slot * SLOT_SIZE
        shown[at] = min(max(track[X] / POSITION_SCALE, -_FARTHEST), _FARTHEST)
        shown[at + 1] = min(max(track[Y] / POSITION_SCALE, -_FARTHEST), _FARTHEST)
        shown[at + 2] = track[V_X] / VELOCITY_SCALE
        shown[at + 3] = track[V_Y] / VELOCITY_SCALE
        shown[at + 4] = track[RADIUS] / RADIUS_SCALE
        shown[at + 5] = track[CERTAINTY]
        left_out[best] = True


@njit(cache=True, nogil=True)
def _urgency(tracks, left_out, u_x, u_y, body_radius):
    """Urgency of the first meeting at this velocity: 1 for one now, falling to 0 for none within HORIZON."""
    soonest = HORIZON
    for k in range(len(tracks)):
        if left_out[k]:
            continue
        track = tracks[k]
        reach = body_radius + track[RADIUS] + _MARGIN
        soonest = min(soonest, time_to_meeting(track[X], track[Y], track[V_X] - u_x, track[V_Y] - u_y, reach))
    return 1.0 - soonest / HORIZON


@njit(cache=True, nogil=True)
def time_to_meeting(x, y, w_x, w_y, reach):
    """Time until a point that moves straight on comes within a distance of the origin.

    Args:
        x: x of the point [m].
        y: y of the point [m].
        w_x: x of its velocity relative to the origin's [m/s].
        w_y: y of its velocity relative to the origin's [m/s].
        reach: The distance [m].

    Returns:
        The time [s]; 0 if it is within and comes nearer, ``inf`` if it never will be.
    """
    approach = x * w_x + y * w_y
    if approach >= 0.0:  # never nearer than now
        return math.inf
    gap = x * x + y * y - reach * reach
    if gap <= 0.0:
        return 0.0
    square = w_x * w_x + w_y * w_y
    discriminant = approach * approach - square * gap
    return (-approach - math.sqrt(discriminant)) / square if discriminant > 0.0 else math.inf
