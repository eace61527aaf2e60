"""Lidars of all kinds see the same room."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vuca_nav.rooms import LIDAR, REST, disc_body, ranges_to_boxes, room
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose, inverse, transform_points
from vuca_nav.perception.perception import Perception
from vuca_nav.perception.ring import find_gaps, ring_of
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan

DT = 1.0 / 30.0
HALL, HERE = room(8.0, 6.0), Pose2(3.0, 2.5, 0.4)
RING = LIDAR.angles_in_base()


def seen_by(lidar: LidarSpec, pose: Pose2 = HERE, boxes: np.ndarray = HALL) -> np.ndarray:
    """Ranges from where the lidar is; its directions are in base_link, mount included."""
    x, y, _ = compose(pose, lidar.mount)
    return ranges_to_boxes(boxes, Pose2(x, y, pose.yaw), lidar)


def first_percept(lidar: LidarSpec, ranges: np.ndarray | None = None, body=None):
    ranges = seen_by(lidar) if ranges is None else ranges
    return Perception(lidar, body=body, rate=30.0).update(Scan(0.0, ranges), Odometry(0.0, STANDING, REST))


lidars = st.builds(
    lambda beams, share, turn, first, x, y, yaw: LidarSpec(
        num_beams=beams, angle_min=first, angle_increment=turn * share * 2.0 * math.pi / beams, mount=Pose2(x, y, yaw)
    ),
    beams=st.integers(90, 1500),
    share=st.floats(0.3, 1.0),
    turn=st.sampled_from([-1.0, 1.0]),
    first=st.floats(-7.0, 7.0),
    x=st.floats(-0.4, 0.4),
    y=st.floats(-0.3, 0.3),
    yaw=st.floats(-4.0, 4.0),
)


@given(lidars)
@settings(max_examples=60, deadline=None)
def test_a_wall_is_at_the_same_place_through_any_lidar(lidar):
    percept = first_percept(lidar)
    level = percept.level
    seen = level.ranges < np.inf
    points = transform_points(HERE, level.origin + level.ranges[seen, None] * level.beams[seen])
    to_wall = np.minimum(np.minimum(points[:, 0], 8.0 - points[:, 0]), np.minimum(points[:, 1], 6.0 - points[:, 1]))
    np.testing.assert_allclose(to_wall, 0.0, atol=1e-9)
    # The ring puts each of them into a whole direction, and stretches it over half a beam to either side: across a
    # corner or along a slanting wall that errs by so much. No direction reads farther than the wall.
    expected = ranges_to_boxes(HALL, HERE)
    slack = 2.0 * math.pi / 360 + abs(lidar.pitch)
    slack_of = np.maximum.reduce([abs(expected - np.roll(expected, d)) for d in (-3, -2, -1, 1, 2, 3)])
    ring = percept.ring
    there = ~np.isnan(ring)
    assert (ring[there] <= expected[there] + slack_of[there] + slack * 8.0).all()
    assert np.isfinite(ring[there]).all()


@given(lidars)
@settings(max_examples=40, deadline=None)
def test_what_the_lidar_does_not_look_at_is_not_free(lidar):
    """Without a body around it nothing but 0.2 m about base_link is known before the first scan."""
    ring = first_percept(lidar, np.full(lidar.num_beams, np.inf)).ring
    if lidar.num_beams * abs(lidar.pitch) < 2.0 * math.pi - 1.5:
        middle = lidar.mount.yaw + lidar.angle_min + (lidar.num_beams - 1) * lidar.pitch / 2.0
        behind = round((middle % (2.0 * math.pi)) / (2.0 * math.pi) * 360) % 360  # the ring begins opposite to 0
        assert ring[behind] < 1.5


@pytest.mark.parametrize("beams", [60, 180, 360, 720, 1440])
def test_a_full_circle_about_base_link_is_its_own_ring(beams):
    lidar = LidarSpec(num_beams=beams)
    scan = Scan(0.0, seen_by(lidar))
    percept = Perception(lidar).update(scan, Odometry(0.0, STANDING, REST))
    assert ring_of(lidar) is lidar
    assert percept.scan is scan
    assert percept.ring is scan.ranges
    assert percept.ring_level is percept.level


@pytest.mark.parametrize("beams", [181, 270, 361, 541, 1081])
def test_a_number_of_beams_that_sixty_does_not_divide_is_brought_into_a_ring(beams):
    ring = first_percept(LidarSpec(num_beams=beams)).ring
    assert ring.shape == (360,)
    np.testing.assert_allclose(ring, ranges_to_boxes(HALL, HERE), rtol=0.06)


def test_a_lidar_that_turns_the_other_way_sees_the_same():
    clockwise = LidarSpec(angle_min=math.pi, angle_increment=-2.0 * math.pi / 360)
    np.testing.assert_allclose(first_percept(clockwise).ring, ranges_to_boxes(HALL, HERE), rtol=1e-9)


def test_half_a_circle_is_not_half_invalid():
    half = LidarSpec(num_beams=181, angle_min=-math.pi / 2.0, angle_increment=math.pi / 180)
    percept = first_percept(half)
    assert percept.is_valid
    few = seen_by(half)
    few[:91] = np.nan
    assert not first_percept(half, few).is_valid


def test_gaps_are_runs_of_missing_beams_also_across_the_back():
    ring, gaps = np.full(12, 2.0), np.zeros(12, np.bool_)
    ring[[1, 3, 4, 5, 6, 7]] = np.nan
    assert not find_gaps(ring, gaps)
    assert not gaps.any()
    ring[:] = 2.0
    ring[[8, 9, 10, 11, 0, 1]] = np.nan
    assert find_gaps(ring, gaps)
    assert gaps.nonzero()[0].tolist() == [0, 1, 8, 9, 10, 11]
    assert find_gaps(np.full(12, np.nan), gaps)
    assert gaps.all()


def test_between_scans_the_ring_moves_by_odometry():
    """A lidar of 10 Hz in a loop of 30 Hz: at the ticks between its scans the body has gone on."""
    lidar = replace(LIDAR, rate=10.0)
    perception, pose, errors = Perception(lidar, rate=30.0), HERE, []
    scan = Scan(0.0, seen_by(lidar))
    for k in range(30):
        if k % 3 == 0:
            scan = Scan(k * DT, seen_by(lidar, pose))
        percept = perception.update(scan, Odometry(k * DT, compose(inverse(HERE), pose), REST))
        assert percept.is_new == (k % 3 == 0)
        assert percept.is_valid
        errors.append(np.nanmedian(abs(percept.ring - ranges_to_boxes(HALL, pose))))
        pose = compose(pose, Pose2(0.033, 0.0, 0.03))
    assert max(errors) < 0.02


@pytest.mark.parametrize("rate", [5.0, 7.0, 10.0, 12.0, 15.0, 20.0, 30.0, 40.0])
def test_a_mover_is_tracked_at_any_rate_of_the_lidar(rate):
    lidar = replace(LIDAR, rate=rate)
    perception, scan, taken = Perception(lidar, rate=30.0), Scan(-1.0, np.full(360, np.inf)), -1
    for k in range(75):
        y = 1.5 + 0.8 * k * DT
        due = math.floor(k * rate / 30.0 + 1e-9)
        if due != taken:
            boxes = np.vstack([room(30.0, 10.0), [[5.8, y - 0.2, 6.2, y + 0.2]]])
            taken, scan = due, Scan(k * DT, ranges_to_boxes(boxes, Pose2(4.0, 3.5, 0.0)))
        percept = perception.update(scan, Odometry(k * DT, STANDING, REST))
    (mover,) = percept.moving
    assert mover[:2] == pytest.approx((2.0, y - 3.5), abs=0.2)


@pytest.mark.parametrize(
    "bad",
    [
        {"num_beams": 0}, {"num_beams": -3}, {"num_beams": 10**9}, {"num_beams": 2.5}, {"max_range": math.inf},
        {"rate": 0.0}, {"min_range": -1.0}, {"min_range": 20.0}, {"angle_min": math.nan}, {"angle_increment": 0.0},
        {"angle_increment": 0.1}, {"mount": Pose2(0.0, math.inf, 0.0)}, {"angle_increment": math.nan},
    ],
)  # fmt: skip
def test_a_lidar_that_cannot_be_is_refused(bad):
    with pytest.raises(BadArgument):
        LidarSpec(**bad)


def test_a_wide_fault_is_a_gap_also_of_a_full_circle():
    ranges = ranges_to_boxes(HALL, HERE)
    ranges[150:210] = np.nan  # ahead
    percept = first_percept(LIDAR, ranges, disc_body())
    assert percept.is_valid
    assert percept.ring[180] < 1.0
