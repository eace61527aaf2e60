"""What tracks mean to a policy, by hand-worked cases."""

import math

import numpy as np
import pytest

from vuca_nav.perception.tracks import TRACK_SIZE
from vuca_nav.policy.track_features import (
    _MARGIN,
    DIRECTIONS,
    HORIZON,
    MEETINGS_SIZE,
    POSITION_SCALE,
    SHOWN_SIZE,
    SLOT_SIZE,
    SLOTS,
    SPEEDS,
    VELOCITY_SCALE,
    TrackWorkspace,
    write_features,
)


def meaning(*tracks, speed=1.0, reach=math.inf):
    """Features of tracks x, y, v_x, v_y, radius that were seen often: meetings (speeds, directions), still, slots."""
    known = np.ones((len(tracks), TRACK_SIZE))
    known[:, :5] = tracks
    meetings, shown = np.full(MEETINGS_SIZE, np.nan, np.float32), np.full(SHOWN_SIZE, np.nan, np.float32)
    write_features(known, reach, 0.3, speed, TrackWorkspace.new(), meetings, shown)
    return meetings.reshape(len(SPEEDS), DIRECTIONS), float(shown[0]), shown[1:].reshape(SLOTS, SLOT_SIZE)


def test_urgency_is_the_time_to_the_meeting():
    reach = 0.3 + 0.2 + _MARGIN
    # It comes head on at 1 m/s: standing, in (2 - reach) s.
    assert meaning((2.0, 0.0, -1.0, 0.0, 0.2))[1] == pytest.approx(1.0 - (2.0 - reach) / HORIZON, abs=1e-6)
    # A post along direction 12, 7.5 degrees to the left, driven at with 1 and with 0.5 m/s; never met going back.
    angle = math.radians(7.5)
    meetings, still, _ = meaning((1.5 * math.cos(angle), 1.5 * math.sin(angle), 0.0, 0.0, 0.2))
    assert meetings[0, 12] == pytest.approx(1.0 - (1.5 - reach) / HORIZON, abs=1e-5)
    assert meetings[1, 12] == pytest.approx(1.0 - (1.5 - reach) / 0.5 / HORIZON, abs=1e-5)
    assert still == 0.0
    assert (meetings[:, [0, 1, 22, 23]] == 0.0).all()


def test_what_passes_by_or_comes_late_is_not_urgent():
    assert meaning((2.0, 0.6, -1.0, 0.0, 0.2))[1] == 0.0
    assert meaning((4.0, 0.0, -1.0, 0.0, 0.2))[1] == 0.0  # in 3.45 s
    assert meaning((2.0, 0.0, 1.0, 0.0, 0.2))[1] == 0.0  # it goes
    # What crosses is met by a body that waits in its way, not by one that has gone on.
    meetings, still, _ = meaning((0.0, 1.5, 0.0, -1.0, 0.2), speed=2.0)
    assert still > 0.5
    assert meetings[0, 12] == 0.0


def test_what_is_upon_the_body_is_most_urgent_unless_it_goes():
    assert meaning((0.4, 0.0, -0.1, 0.0, 0.2))[1] == 1.0
    assert meaning((0.4, 0.0, 0.1, 0.0, 0.2))[1] == 0.0


def test_slots_begin_with_what_threatens_most():
    far_and_fast, near, leaving = (3.0, 0.0, -2.5, 0.0, 0.2), (0.0, 2.0, 0.0, 0.0, 0.2), (-1.5, 0.0, -2.0, 0.0, 0.2)
    slots = meaning(leaving, near, far_and_fast)[2]
    # Gaps in a second, 0.3 and 0.2 m taken off: 0, 1.5 and 3.
    assert slots[:3, 0] * POSITION_SCALE == pytest.approx([3.0, 0.0, -1.5], abs=1e-6)
    assert slots[:3, 2] * VELOCITY_SCALE == pytest.approx([-2.5, 0.0, -2.0], abs=1e-6)
    assert (slots[3:] == 0.0).all()
    many = [(1.0 + 0.4 * k, 0.5, 0.0, 0.0, 0.2) for k in range(9)]
    assert meaning(*many[::-1])[2][:, 0] * POSITION_SCALE == pytest.approx(1.0 + 0.4 * np.arange(SLOTS), abs=1e-5)


def test_a_track_wholly_out_of_reach_is_left_out():
    far, near = (4.0, 0.0, -2.0, 0.0, 0.3), (2.0, 2.0, 0.5, 0.0, 0.2)
    for reach, shown in ((3.69, 1), (3.71, 2)):  # its edge is 3.7 m off
        meetings, still, slots = meaning(far, near, reach=reach)
        assert (slots[:, 5] > 0.0).sum() == shown
        assert (still > 0.0) == (meetings[0, 12] > 0.0) == (shown == 2)
