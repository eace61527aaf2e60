"""Tracks in analytic scenes: where moving obstacles are, and how fast."""

import math

import numpy as np
import pytest

from tests.vuca_nav.rooms import NO_BOXES, Sensors, ranges_to_discs, room
from vuca_nav.geometry import compose, inverse, transform_points
from vuca_nav.perception.tracks import CERTAINTY, HAS_LEFT, MAX_TRACKS, RADIUS, TRACK_SIZE, V_X, V_Y, Tracker, X, Y
from vuca_nav.types import STANDING, LidarSpec, Pose2, Twist2

SLOW, FAST = LidarSpec(num_beams=180, rate=10.0), LidarSpec()
HALL = room(10.0, 8.0)
START = Pose2(2.0, 3.0, 0.2)
ONE, REACH = np.arange(1), np.array([6.3])


def drive(scene, seconds, lidar=SLOW, motion=(0.8, 0.0, 0.6), rng=None):
    """Tracks (k, TRACK_SIZE) of a scene (time to discs) after driving at a velocity, and the last pose."""
    sensors, pose, step = Sensors(lidar), START, Pose2(*(v / lidar.rate for v in motion))
    tracks = np.empty((0, TRACK_SIZE))
    for tick in range(round(seconds * lidar.rate) + 1):
        if tick:
            pose = compose(pose, step)
        ranges = ranges_to_discs(scene(tick / lidar.rate), HALL, pose, lidar)
        if rng is not None:
            ranges = ranges + rng.normal(0.0, 0.02, lidar.num_beams)
            ranges[rng.random(lidar.num_beams) < 0.01] = np.inf
        tracks = sensors.see(ranges, step, Twist2(*motion)).tracks.copy()
    return tracks, pose


def in_base(pose, x, y):
    return transform_points(inverse(pose), np.array([[x, y]]))[0]


def velocity_in_base(pose, v_x, v_y):
    return transform_points(Pose2(0.0, 0.0, -pose.yaw), np.array([[v_x, v_y]]))[0]


def nearest(tracks, point):
    return tracks[np.argmin(np.hypot(*(tracks[:, [X, Y]] - point).T))]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("lidar", [SLOW, FAST])
def test_a_disc_is_found_where_it_is_and_as_fast_as_it_goes(lidar, seed):
    def scene(t):
        return [(4.0 + 0.5 * t, 4.5 - 1.0 * t, 0.3)]

    tracks, pose = drive(scene, 1.0, lidar, rng=np.random.default_rng(seed))
    true = in_base(pose, 4.5, 3.5)
    track = nearest(tracks, true)
    assert np.hypot(*(track[[X, Y]] - true)) < 0.15
    assert np.hypot(*(track[[V_X, V_Y]] - velocity_in_base(pose, 0.5, -1.0))) < 0.25
    assert track[RADIUS] == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("away", [1.2, 2.5])
def test_two_legs_are_followed_as_one(away, seed):
    """Of a person who walks past at 1 m/s, 0.7 m a step; one leg hides the other in the middle of each."""

    def scene(t):
        x, swing = -0.8 + 1.0 * t, 0.17 * math.sin(2.0 * math.pi * t / 1.4)
        return [(2.0 + x + swing, 3.0 + away + 0.1, 0.08), (2.0 + x - swing, 3.0 + away - 0.1, 0.08)]

    tracks, pose = drive(scene, 1.6, motion=STANDING, rng=np.random.default_rng(seed))
    true = in_base(pose, 2.8, 3.0 + away)
    (track,) = tracks[np.hypot(*(tracks[:, [X, Y]] - true).T) < 0.5]
    assert np.hypot(*(track[[X, Y]] - true)) < 0.15
    assert np.hypot(*(track[[V_X, V_Y]] - velocity_in_base(pose, 1.0, 0.0))) < 0.3
    assert track[RADIUS] > 0.15


@pytest.mark.parametrize("seed", range(6))
def test_a_turn_is_believed_within_three_scans(seed):
    def scene(t):
        return [(3.0 + min(t, 1.0), 4.5 - max(t - 1.0, 0.0), 0.25)]

    tracks, pose = drive(scene, 1.3, motion=STANDING, rng=np.random.default_rng(seed))
    track = nearest(tracks, in_base(pose, 4.0, 4.2))
    assert np.hypot(*(track[[V_X, V_Y]] - velocity_in_base(pose, 0.0, -1.0))) < 0.35


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("speed", [0.45, 0.8, 1.1])
def test_what_turns_back_is_not_taken_to_be_faster_than_it_was(speed, seed):
    """The error of a track's place that has grown before the turn is believed is no velocity."""
    for later in (0.1, 0.2, 0.3, 0.4, 0.5):

        def scene(t):
            return [(3.4 + speed * (1.5 - abs(t - 1.5)), 4.5, 0.25)]

        tracks, pose = drive(scene, 1.5 + later, motion=STANDING, rng=np.random.default_rng(seed))
        track = nearest(tracks, in_base(pose, 3.4 + speed * (1.5 - later), 4.5))
        assert np.hypot(*track[[V_X, V_Y]]) < speed + 0.3
    assert np.hypot(*(track[[V_X, V_Y]] - velocity_in_base(pose, -speed, 0.0))) < 0.3


def test_posts_stand_however_the_robot_drives():
    posts = [(4.0, 4.4, 0.2), (3.2, 2.0, 0.15), (5.5, 3.0, 0.25)]
    tracks, pose = drive(lambda t: posts, 1.5, rng=np.random.default_rng(1))
    for x, y, _ in posts:
        true = in_base(pose, x, y)
        track = nearest(tracks, true)
        assert np.hypot(*(track[[X, Y]] - true)) < 0.15
        assert np.hypot(*track[[V_X, V_Y]]) < 0.2
        assert track[HAS_LEFT] == 0.0


def follow(tracker, discs, beams=180, boxes=NO_BOXES, pose=STANDING, fresh=False):
    """Tracks (k, TRACK_SIZE) of a robot that stands, after one scan more."""
    ranges, out = ranges_to_discs(discs, boxes, pose, LidarSpec(num_beams=beams)), np.zeros((MAX_TRACKS, TRACK_SIZE))
    tracker.update(ONE, ranges[None], np.zeros((1, 3)), REACH, np.array([fresh]))
    return out[: tracker.tracks_in_base(0, out)]


@pytest.mark.parametrize("missed", [(), (1,), (1, 2), (8, 9, 10)])
def test_a_track_that_was_missed_is_no_faster_when_it_is_found_again(missed):
    tracker, speeds = Tracker(1, 180, 0.1, 0.1), []
    for k in range(15):
        tracks = follow(tracker, [] if k in missed else [(2.5, -0.5 + 0.1 * k, 0.25)], fresh=k == 0)
        speeds += np.hypot(*tracks[:, [V_X, V_Y]].T).tolist()
    assert max(speeds) < 1.15  # it goes at 1
    assert speeds[-1] == pytest.approx(1.0, abs=0.1)


def test_a_tracker_tells_where_moving_obstacles_are_and_how_fast():
    tracker, tracks = Tracker(1, 360, 1.0 / 30.0, 0.1), np.empty((0, TRACK_SIZE))
    for k in range(60):
        y = 1.0 + 0.8 * k / 30.0
        boxes = np.vstack([room(30.0, 10.0), [[5.8, y - 0.2, 6.2, y + 0.2]]])
        tracks = follow(tracker, [], 360, boxes, Pose2(4.0, 2.6, 0.0), fresh=k == 0)
    (track,) = tracks
    assert track[[X, Y]] == pytest.approx((2.0, 1.0 + 0.8 * 59 / 30.0 - 2.6), abs=0.12)
    assert track[[V_X, V_Y]] == pytest.approx((0.0, 0.8), abs=0.15)
    assert 0.1 <= track[RADIUS] <= 0.3
    assert track[CERTAINTY] == 1.0
    assert track[HAS_LEFT] == 1.0


def test_a_fresh_row_forgets_its_tracks_and_the_others_keep_theirs():
    tracker, out = Tracker(2, 180, 0.1, 0.1), np.zeros((MAX_TRACKS, TRACK_SIZE))
    post, other = (ranges_to_discs([(x, 0.0, 0.3)], NO_BOXES, STANDING, SLOW) for x in (2.0, 3.0))
    rows = np.arange(2)
    for fresh in (True, False, False):
        tracker.update(rows, np.stack([post, post]), np.zeros((2, 3)), np.tile(REACH, 2), np.full(2, fresh))
    tracker.update(rows, np.stack([other, post]), np.zeros((2, 3)), np.tile(REACH, 2), np.array([True, False]))
    assert tracker.tracks_in_base(0, out) == 1
    assert out[0, [X, Y, CERTAINTY]] == pytest.approx((3.0, 0.0, 0.25), abs=0.15)
    assert tracker.tracks_in_base(1, out) == 1
    assert out[0, [X, Y, CERTAINTY]] == pytest.approx((2.0, 0.0, 1.0), abs=0.15)


def test_between_two_scans_that_are_used_tracks_go_on_and_so_does_the_body():
    def scene(t):
        return [(6.0 - 1.0 * t, 3.4, 0.3)]

    errors = []
    for ticks in (45, 46, 47):  # of 30 Hz; every third is used
        tracks, pose = drive(scene, ticks / 30.0, FAST, motion=(0.8, 0.0, 0.2))
        true = in_base(pose, 6.0 - ticks / 30.0, 3.4)
        errors.append(nearest(tracks, true)[[X, Y]] - true)
    assert np.hypot(*errors[0]) < 0.1  # a surface is seen, not a centre
    assert errors[1:] == pytest.approx(np.array([errors[0]] * 2), abs=0.02)  # 0.06 m a tick, were it to stand
