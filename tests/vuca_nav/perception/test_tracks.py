import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.rooms import disc_body, ranges_to_boxes, room
from vuca_nav.geometry import compose, inverse, transform_points
from vuca_nav.perception.segments import WHOLE, _pair_legs
from vuca_nav.perception.tracks import (
    _MARGIN,
    DIRECTIONS,
    HORIZON,
    POSITION_SCALE,
    RADIUS_SCALE,
    SLOT_SIZE,
    SLOTS,
    SPEEDS,
    VELOCITY_SCALE,
    Tracker,
    _features,
)
from vuca_nav.policy.observation import BODY_SIZE, TWIST_SIZE, ObservationConfig, Observer
from vuca_nav.types import FloatArray, LidarSpec, Pose2

TRACKED = ObservationConfig(kind="tracked")
BODY = disc_body(0.3)
REACH = 6.3
HALL = room(10.0, 8.0)
NO_BOXES = np.zeros((0, 4))
ONE = np.arange(1)


def look(pose: Pose2, discs, boxes=HALL, beams: int = 180) -> FloatArray:
    """(beams,) ranges from a place to boxes and discs (x, y, radius)."""
    lidar = LidarSpec(num_beams=beams)
    ranges = ranges_to_boxes(boxes, pose, lidar) if len(boxes) else np.full(beams, np.inf)
    angles = lidar.angles_in_base() + pose.yaw
    for x, y, radius in discs:
        along = (x - pose.x) * np.cos(angles) + (y - pose.y) * np.sin(angles)
        aside = (y - pose.y) * np.cos(angles) - (x - pose.x) * np.sin(angles)
        with np.errstate(invalid="ignore"):
            enter = along - np.sqrt(radius**2 - aside**2)
        ranges = np.where(enter > 0.0, np.minimum(ranges, enter), ranges)  # NaN is no hit
    return ranges


def drive(observer, scene, seconds, rate=10.0, motion=(0.8, 0.0, 0.6), rng=None, beams=180):
    """Observe a scene (time to discs) while driving at a velocity; returns the last pose and observation."""
    pose, step = Pose2(2.0, 3.0, 0.2), Pose2(*(v / rate for v in motion))
    out = np.zeros((1, observer.size), np.float32)
    for tick in range(round(seconds * rate) + 1):
        ranges = look(pose, scene(tick / rate), beams=beams)
        if rng is not None:
            ranges = ranges + rng.normal(0.0, 0.02, beams)
            ranges[rng.random(beams) < 0.01] = np.inf
        observer.observe(ranges[None], np.array([[2.0, 1.0]]), np.array([motion]), np.array([step]), out)
        if tick < round(seconds * rate):
            pose = compose(pose, step)
    return pose, out[0]


def rest_of(observation):
    """Urgency of standing still, and the slots (SLOTS, SLOT_SIZE)."""
    at = TRACKED.goal_slice.stop + TWIST_SIZE + BODY_SIZE
    return observation[at], observation[at + 1 :].reshape(SLOTS, SLOT_SIZE)


def things(slots):
    """Positions, velocities and radii of the slots that are in use, in metres and seconds."""
    used = slots[slots[:, 5] > 0.0]
    return used[:, :2] * POSITION_SCALE, used[:, 2:4] * VELOCITY_SCALE, used[:, 4] * RADIUS_SCALE


def rotated(vector, yaw):
    return transform_points(Pose2(0.0, 0.0, yaw), np.array([vector]))[0]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("rate", "beams"), [(10.0, 180), (30.0, 360)])
def test_a_disc_is_found_where_it_is_and_as_fast_as_it_goes(rate, beams, seed):
    def scene(t):
        return [(4.0 + 0.5 * t, 4.5 - 1.0 * t, 0.3)]

    observer = Observer(TRACKED, [BODY], beams, rate)
    pose, seen = drive(observer, scene, 1.0, rate, rng=np.random.default_rng(seed), beams=beams)
    positions, velocities, radii = things(rest_of(seen)[1])
    true = transform_points(inverse(pose), np.array([scene(1.0)[0][:2]]))[0]
    nearest = np.argmin(np.hypot(*(positions - true).T))
    assert np.hypot(*(positions[nearest] - true)) < 0.15
    assert np.hypot(*(velocities[nearest] - rotated((0.5, -1.0), -pose.yaw))) < 0.25
    assert radii[nearest] == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("away", [1.2, 2.5])
def test_two_legs_are_followed_as_one(away, seed):
    """Of somebody who walks past at 1 m/s, 0.7 m a step; one leg hides the other in the middle of each."""

    def scene(t):
        x, swing = -0.8 + 1.0 * t, 0.17 * math.sin(2.0 * math.pi * t / 1.4)
        return [(2.0 + x + swing, 3.0 + away + 0.1, 0.08), (2.0 + x - swing, 3.0 + away - 0.1, 0.08)]

    observer = Observer(TRACKED, [BODY], 180, 10.0)
    _, seen = drive(observer, scene, 1.6, motion=(0.0, 0.0, 0.0), rng=np.random.default_rng(seed))
    positions, velocities, radii = things(rest_of(seen)[1])
    true = transform_points(inverse(Pose2(2.0, 3.0, 0.2)), np.array([[2.8, 3.0 + away]]))[0]
    near = np.hypot(*(positions - true).T) < 0.5
    assert near.sum() == 1
    assert np.hypot(*(positions[near][0] - true)) < 0.15
    assert np.hypot(*(velocities[near][0] - rotated((1.0, 0.0), -0.2))) < 0.3
    assert radii[near][0] > 0.15


@pytest.mark.parametrize("seed", range(6))
def test_a_turn_is_believed_within_three_scans(seed):
    def scene(t):
        return [(3.0 + min(t, 1.0), 4.5 - max(t - 1.0, 0.0), 0.25)]

    observer = Observer(TRACKED, [BODY], 180, 10.0)
    _, seen = drive(observer, scene, 1.3, motion=(0.0, 0.0, 0.0), rng=np.random.default_rng(seed))
    positions, velocities, _ = things(rest_of(seen)[1])
    true = transform_points(inverse(Pose2(2.0, 3.0, 0.2)), np.array([[4.0, 4.2]]))[0]
    nearest = np.argmin(np.hypot(*(positions - true).T))
    assert np.hypot(*(velocities[nearest] - rotated((0.0, -1.0), -0.2))) < 0.35


@pytest.mark.parametrize("missed", [(), (1,), (1, 2), (8, 9, 10)])
def test_a_thing_that_was_missed_is_no_faster_when_it_is_found_again(missed):
    tracker, fresh, speeds = Tracker(1, 180, 0.1, 0.1), np.ones(1, np.bool_), []
    for k in range(15):
        discs = [] if k in missed else [(2.5, -0.5 + 0.1 * k, 0.25)]
        tracker.update(
            ONE, look(Pose2(0.0, 0.0, 0.0), discs, NO_BOXES)[None], np.zeros((1, 3)), np.full(1, REACH), fresh
        )
        fresh[:] = False
        known = tracker.tracks[0, tracker.tracks[0, :, 5] > 0.0]
        speeds += [np.hypot(*thing[2:4]) for thing in known]
    assert max(speeds) < 1.15  # it goes at 1
    assert speeds[-1] == pytest.approx(1.0, abs=0.1)


def test_posts_stand_however_the_robot_drives():
    posts = [(4.0, 4.4, 0.2), (3.2, 2.0, 0.15), (5.5, 3.0, 0.25)]
    pose, seen = drive(Observer(TRACKED, [BODY], 180, 10.0), lambda t: posts, 1.5, rng=np.random.default_rng(1))
    positions, velocities, _ = things(rest_of(seen)[1])
    for x, y, _ in posts:
        true = transform_points(inverse(pose), np.array([[x, y]]))[0]
        nearest = np.argmin(np.hypot(*(positions - true).T))
        assert np.hypot(*(positions[nearest] - true)) < 0.15
        assert np.hypot(*velocities[nearest]) < 0.2


def found(ranges):
    """Positions of what one scan holds, (k, 2) in base_link."""
    tracker = Tracker(1, 180, 0.1, 0.1)
    tracker.update(ONE, ranges[None], np.zeros((1, 3)), np.full(1, REACH), np.ones(1, np.bool_))
    return tracker.tracks[0, tracker.tracks[0, :, 5] > 0.0, :2]


@pytest.mark.parametrize("seed", range(20))
def test_legs_are_paired_whatever_their_order(seed):
    rng = np.random.default_rng(seed)
    people, posts = 3.0 * np.arange(1, 5), 3.0 * np.arange(5, 9)
    legs = [(x, side * 0.15, 0.1, WHOLE, 0.0) for x in people for side in (-1.0, 1.0)]
    found = np.array(legs + [(x, 0.0, 0.3, WHOLE, 0.0) for x in posts])[rng.permutation(12)]
    count = _pair_legs(found, 12)
    assert np.array_equal(np.sort(found[:count, 0]), [*people, *posts])
    assert found[:count, 1] == pytest.approx(0.0, abs=1e-12)
    assert np.sort(found[:count, 2]) == pytest.approx([0.25] * 4 + [0.3] * 4)


def test_people_are_counted_by_what_they_are():
    people = [(2.0, -1.5), (3.0, 1.5), (-2.0, 2.0), (-1.5, -2.5)]
    legs = [(x + side * 0.02, y + side * 0.14, 0.08) for x, y in people for side in (-1.0, 1.0)]
    posts = [(4.0, 0.1, 0.25), (0.3, 3.0, 0.3), (-4.0, -0.2, 0.3)]
    centres = found(look(Pose2(0.0, 0.0, 0.0), legs + posts, NO_BOXES))
    assert len(centres) == len(people) + len(posts)
    for x, y in [*people, *(post[:2] for post in posts)]:
        assert np.hypot(*(centres - (x, y)).T).min() < 0.2


def test_bars_behind_do_not_hide_who_stands_in_front():
    ranges = look(Pose2(0.0, 0.0, 0.0), [(1.5, 0.0, 0.2)], NO_BOXES)
    behind = np.abs(LidarSpec(num_beams=180).angles_in_base()) > 0.5 * np.pi
    ranges[behind & (np.arange(180) % 2 == 0)] = 3.0
    assert np.hypot(*(found(ranges) - (1.5, 0.0)).T).min() < 0.1


def test_a_wall_is_no_thing():
    assert len(found(look(Pose2(4.0, 3.0, 0.3), []))) == 0
    # The end of a long wall sticks out, and is wide.
    assert len(found(look(Pose2(0.0, 0.0, 0.0), [], np.array([[2.0, -1.0, 2.2, 1.0]])))) == 0
    post = found(look(Pose2(0.0, 0.0, 0.0), [(2.0, 0.0, 0.3)], NO_BOXES))
    assert post == pytest.approx(np.array([[2.0, 0.0]]), abs=0.1)


def test_a_piece_of_wall_between_nearer_things_is_no_thing():
    wall = np.array([[4.0, -9.0, 4.2, 9.0]])
    posts = [(2.0, 0.5, 0.3), (2.0, -0.5, 0.3)]
    ranges = look(Pose2(0.0, 0.0, 0.0), posts, wall)
    between = ranges[90]  # straight ahead
    assert between == pytest.approx(4.0)
    positions = found(ranges)
    assert len(positions) == 2
    assert positions[np.argsort(positions[:, 1])] == pytest.approx(np.array([[2.0, -0.5], [2.0, 0.5]]), abs=0.1)


def test_one_lost_beam_does_not_cut_a_thing_in_two():
    ranges = look(Pose2(0.0, 0.0, 0.0), [(2.0, 0.0, 0.3)], NO_BOXES)
    ranges[90] = np.inf
    assert len(found(ranges)) == 1


def meaning(*tracks, speed=1.0):
    """Features of things x, y, v_x, v_y, radius that were seen often: meetings (speeds, directions), still, slots."""
    known = np.zeros_like(Tracker(1, 180, 0.1, 0.1).tracks)
    for k, track in enumerate(tracks):
        known[0, k, :5], known[0, k, 5] = track, 9.0
    angles = -np.pi + (np.arange(DIRECTIONS) + 0.5) * 2.0 * np.pi / DIRECTIONS
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    meetings = np.zeros((1, len(SPEEDS) * DIRECTIONS), np.float32)
    rest = np.zeros((1, 1 + SLOTS * SLOT_SIZE), np.float32)
    _features(
        ONE, known, np.zeros((1, 3)), np.zeros(1), directions, np.full(1, 0.3), np.full(1, speed),
        np.zeros((16, SLOT_SIZE)), meetings, rest,
    )  # fmt: skip
    return meetings.reshape(len(SPEEDS), DIRECTIONS), float(rest[0, 0]), rest[0, 1:].reshape(SLOTS, SLOT_SIZE)


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
    # What crosses is met by who waits in its way, not by who has gone on.
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


def test_a_mirrored_world_gives_the_mirrored_observation():
    def world(t):
        return [(4.0 + 0.5 * t, 4.5 - 1.0 * t, 0.3), (3.3, 1.7, 0.2), (5.0 - t, 2.0, 0.25)]

    def image(t):
        return [(x, 8.0 - y, radius) for x, y, radius in world(t)]

    order, signs = TRACKED.mirror()
    left, right = (Observer(TRACKED, [BODY], 180, 10.0) for _ in range(2))
    goal, sign = np.array([[2.0, 1.0]]), np.array([1.0, -1.0, -1.0])
    pose, step, velocity = Pose2(2.0, 3.0, 0.2), Pose2(0.08, 0.02, 0.06), np.array([[0.8, 0.2, 0.6]])
    here, there = (np.zeros((1, TRACKED.size), np.float32) for _ in range(2))
    for tick in range(15):
        motion = np.array([step])
        left.observe(look(pose, world(0.1 * tick))[None], goal, velocity, motion, here)
        mirrored = look(Pose2(pose.x, 8.0 - pose.y, -pose.yaw), image(0.1 * tick))
        right.observe(mirrored[None], goal * sign[:2], velocity * sign, motion * sign, there)
        assert there[0] == pytest.approx(here[0][order] * signs, abs=1e-5)
        pose = compose(pose, step)
    assert not np.allclose(here, there, atol=0.1)
    assert np.array_equal(here[0][order][order], here[0])
    assert len(things(rest_of(here[0])[1])[0]) == 3


def test_rows_equal_robots_alone():
    bodies = [replace(disc_body(radius), max_v_x=1.0 + radius) for radius in (0.2, 0.3, 0.5)]
    together, alone = Observer(TRACKED, bodies, 180, 10.0), [Observer(TRACKED, [body], 180, 10.0) for body in bodies]
    rng = np.random.default_rng(4)
    out = np.zeros((3, TRACKED.size), np.float32)
    for tick in range(16):
        discs = [(4.0 + 0.05 * tick, 4.5 - 0.1 * tick, 0.3), (6.0 - 0.1 * tick, 2.0, 0.2)]
        ranges = np.stack([look(Pose2(2.0 + k, 3.0, 0.02 * tick * k), discs) for k in range(3)])
        ranges += rng.normal(0.0, 0.02, ranges.shape)
        motions = np.array([[0.0, 0.0, 0.02 * k] for k in range(3)])
        goals, twists = rng.normal(size=(3, 2)), rng.normal(size=(3, 3))
        if tick == 8:
            together.reset(np.array([1]))
            alone[1].reset()
        together.observe(ranges, goals, twists, motions, out)
        for k in range(3):
            row, one = slice(k, k + 1), np.zeros((1, TRACKED.size), np.float32)
            alone[k].observe(ranges[row], goals[row], twists[row], motions[row], one)
            assert np.array_equal(out[row], one)


def test_a_fast_observer_sees_what_a_slow_one_sees():
    def scene(t):
        return [(5.0 - 1.0 * t, 3.6, 0.3), (3.0, 2.0, 0.2)]

    slow, fast = (drive(Observer(TRACKED, [BODY], 180, rate), scene, 1.5, rate)[1] for rate in (10.0, 30.0))
    # Straight steps of other lengths along a curve end a little apart: an edge may be in the next sector of O_L.
    assert fast[TRACKED.sectors :] == pytest.approx(slow[TRACKED.sectors :], abs=0.08)
    still, slots = rest_of(fast)
    assert still > 0.5
    assert len(things(slots)[0]) == 2
    # Between two scans that are looked at, things go on and so does the body.
    between = drive(Observer(TRACKED, [BODY], 180, 30.0), scene, 1.5 + 2 / 30, 30.0)[1]
    later = drive(Observer(TRACKED, [BODY], 180, 10.0), scene, 1.6, 10.0)[1]
    x_then, x_between, x_later = (rest_of(o)[1][0, 0] for o in (slow, between, later))
    assert x_then > x_between > x_later


@pytest.mark.parametrize("empty", [math.inf, math.nan, 0.0, -math.inf])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_scans_with_nothing_in_them_are_finite(empty, share):
    observer, rng = Observer(TRACKED, [BODY], 180, 10.0), np.random.default_rng(0)
    out = np.full((1, TRACKED.size), np.nan, np.float32)
    for _ in range(30):
        ranges = look(Pose2(2.0, 3.0, 0.0), [(4.0, 3.0, 0.3), (3.0, 4.0, 0.2)])
        ranges[rng.random(180) < share] = empty
        observer.observe(ranges[None], np.zeros((1, 2)), np.zeros((1, 3)), np.zeros((1, 3)), out)
        assert np.isfinite(out).all()
        if share == 1.0:
            assert (rest_of(out[0])[1] == 0.0).all()
