"""What the sensors may say, and what it is taken for."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vuca_nav.rooms import LIDAR, REST, disc_body, ranges_to_boxes, room
from vuca_nav.errors import BadArgument
from vuca_nav.perception.perception import Perception
from vuca_nav.perception.readings import OdometryCheck, ScanCheck
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan, Twist2

DT = 1.0 / 30.0
MEANINGS = [
    (math.nan, math.nan), (math.inf, math.inf), (12.0, math.inf), (65.533, math.inf), (0.0, math.inf), (-1.0, math.inf),
    (-0.0, math.inf), (-math.inf, 0.05), (0.07, 0.07), (0.1, 0.1), (3.0, 3.0), (11.999, 11.999), (5e-324, 5e-324),
]  # fmt: skip


def checked(values, lidar=LIDAR, footprint=None):
    ranges = np.full(lidar.num_beams, 2.0)
    ranges[: len(values)] = values
    return ScanCheck(lidar, footprint).check(Scan(0.0, ranges))


@pytest.mark.parametrize(("given", "meant"), MEANINGS)
def test_every_range_has_one_meaning(given, meant):
    np.testing.assert_array_equal(checked([given]).scan.ranges[:2], [meant, 2.0])


@given(st.lists(st.sampled_from([pair[0] for pair in MEANINGS]) | st.floats(), min_size=1, max_size=LIDAR.num_beams))
@settings(max_examples=60, deadline=None)
def test_a_checked_scan_has_no_other_numbers_and_is_its_own_check(values):
    first = checked(values)
    ranges = first.scan.ranges
    assert (np.isnan(ranges) | (ranges == np.inf) | ((ranges > 0.0) & (ranges < 12.0))).all()
    assert first.invalid == np.isnan(values).sum()
    assert first.returns == (ranges < 12.0).sum()
    again = ScanCheck(LIDAR, None).check(first.scan)
    assert again.scan is first.scan
    assert again[1:] == first[1:]


@pytest.mark.parametrize(
    "ranges",
    [
        [2.5] * 360, tuple([2.5] * 360), np.full(360, 2.5, np.float32), np.full(360, 2.5, ">f8"),
        np.full(720, 2.5)[::2], np.full(360, 2.5).astype(np.float16), np.ma.masked_array(np.full(360, 2.5)),
        np.broadcast_to(2.5, 360),
    ],
)  # fmt: skip
def test_ranges_in_other_containers_are_taken_as_doubles(ranges: Any):
    percept = Perception(LIDAR).update(Scan(0.0, ranges), Odometry(0.0, STANDING, REST))
    assert type(percept.scan.ranges) is np.ndarray
    assert percept.scan.ranges.dtype == np.float64
    assert percept.scan.ranges.flags.writeable
    np.testing.assert_array_equal(percept.ring, 2.5)


@pytest.mark.parametrize(
    "ranges",
    [
        None, 3.0, "scan", [2.0] * 359, np.full((360, 1), 2.0), np.full((1, 360), 2.0), np.zeros(0),
        [[2.0], [1.0, 3.0]], np.full(360, 2.0 + 1j), np.full(360, "2.0"), np.full(360, None), np.full(360, True),
    ],
)  # fmt: skip
def test_what_is_no_scan_of_the_lidar_is_refused(ranges: Any):
    perception = Perception(LIDAR)
    with pytest.raises(BadArgument, match="the scan"):
        perception.update(Scan(0.0, ranges), Odometry(0.0, STANDING, REST))
    assert perception.update(Scan(0.0, np.full(360, 2.0)), Odometry(0.0, STANDING, REST)).is_valid


def test_a_return_deep_inside_the_footprint_is_the_bodys_own():
    body = disc_body(0.28)
    found = checked([0.15, 0.17, 0.19, 0.25, 0.27], footprint=body.footprint)
    assert np.isnan(found.scan.ranges[:2]).all()
    np.testing.assert_array_equal(found.scan.ranges[2:5], [0.19, 0.25, 0.27])  # what touches it is not
    assert (found.invalid, found.unknown) == (0, 2)
    # A lidar at the front edge sees the body behind it, from 0.08 m on.
    front = LidarSpec(num_beams=4, min_range=0.01, angle_min=-math.pi, mount=Pose2(0.26, 0.0, 0.0))
    seen = [ScanCheck(front, body.footprint).check(Scan(0.0, np.full(4, r))).scan.ranges for r in (0.07, 0.1, 0.4, 0.5)]
    np.testing.assert_array_equal(np.isnan(seen)[:, 0], [False, True, True, False])
    assert not np.isnan(seen)[:, 1:].any()


def test_the_bodys_own_posts_do_not_hold_it():
    perception, ranges = Perception(LIDAR, body=disc_body()), ranges_to_boxes(room(8.0, 6.0), Pose2(2.0, 3.0, 0.0))
    with_posts = ranges.copy()
    with_posts[[40, 41, 130, 131]] = 0.15
    percept = perception.update(Scan(0.0, with_posts), Odometry(0.0, STANDING, REST))
    assert percept.is_valid
    assert np.nanmin(percept.ring) == ranges.min()


def follow(poses, stamps=None, body=None):
    check = OdometryCheck(disc_body() if body is None else body, 30.0)
    stamps = [k * DT for k in range(len(poses))] if stamps is None else stamps
    return [check.check(Odometry(stamp, Pose2(*pose), REST)) for stamp, pose in zip(stamps, poses, strict=True)]


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 1e300, 20000.0, 2.0])
def test_the_pose_goes_on_through_a_fault(wrong):
    way = [(0.03 * k, 0.0, 0.01 * k) for k in range(30)]
    way[10] = (wrong, 0.0, 0.1)
    found = follow(way)
    assert not found[10].is_known
    assert found[10].fault is not None
    assert found[10].odom_from_base == found[9].odom_from_base
    assert found[10].motion == STANDING
    assert all(one.is_known for one in found[12:])
    steps = np.diff([one.odom_from_base[:2] for one in found], axis=0)
    assert np.hypot(*steps.T).max() < 0.07
    assert found[-1].odom_from_base[:2] == pytest.approx(way[-1][:2], abs=0.1)


def test_a_body_that_really_moves_while_readings_are_lost_is_there_afterwards():
    found = follow([(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), *[(math.nan,) * 3] * 8, (0.33, 0.0, 0.0)])
    assert found[-1].is_known
    assert found[-1].odom_from_base == (0.33, 0.0, 0.0)


def test_the_greatest_step_grows_with_the_time_but_not_for_ever():
    assert follow([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [0.0, 0.8])[-1].is_known
    assert not follow([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [0.0, 0.1])[-1].is_known
    assert not follow([(0.0, 0.0, 0.0), (50.0, 0.0, 0.0)], [0.0, 1e6])[-1].is_known
    for stamp in (0.0, -5.0, math.nan, math.inf):
        assert not follow([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [0.0, stamp])[-1].is_known
        assert follow([(0.0, 0.0, 0.0), (0.03, 0.0, 0.0)], [0.0, stamp])[-1].is_known
    assert not follow([(0.0, 0.0, 0.0), (0.0, 0.0, 3.0)], [0.0, DT])[-1].is_known


@pytest.mark.parametrize("up", [(0.0, 0.0, 0.0), (5.0, 5.0, 5.0), (math.nan, 0.0, 1.0), (0.0, 0.0, 1e200)])
def test_a_vertical_that_is_no_direction_is_a_fault(up):
    percept = Perception(LIDAR).update(Scan(0.0, np.full(360, 2.0)), Odometry(0.0, STANDING, REST, up))
    assert not percept.is_valid
    assert "vertical" in str(percept.fault)


@pytest.mark.parametrize("lean", [59.0, 61.0, 90.0, 180.0])
def test_a_body_that_lies_is_a_fault(lean):
    up = (math.sin(math.radians(lean)), 0.0, math.cos(math.radians(lean)))
    checked = OdometryCheck(None, 30.0).check(Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0), up))
    assert (checked.fault is not None and "has fallen" in checked.fault) == (lean > 60.0)


@pytest.mark.parametrize("twist", [(1e300, 0.0, 0.0), (0.0, -21.0, 0.0), (0.0, 0.0, 51.0), (math.nan, 0.0, 0.0)])
def test_a_velocity_of_no_body_is_a_fault(twist):
    checked = OdometryCheck(None, 30.0).check(Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(*twist)))
    assert checked.fault is not None
    assert "velocity" in checked.fault


def test_whole_numbers_are_numbers():
    whole: Any = Odometry(0, Pose2(0, 0, 0), Twist2(0, 0, 0), (0, 0, 1))
    percept = Perception(LIDAR).update(Scan(0, np.full(360, 2)), whole)
    assert percept.is_valid
    assert all(isinstance(value, float) for value in (*percept.twist, *percept.odom_from_base))


def test_a_stamp_that_is_not_finite_is_a_fault_and_the_next_one_is_not():
    perception = Perception(LIDAR)
    for k, stamp in enumerate((0.0, math.nan, math.inf, 3 * DT, 4 * DT)):
        percept = perception.update(Scan(stamp, np.full(360, 2.0)), Odometry(k * DT, STANDING, REST))
        assert math.isfinite(percept.stamp)
    assert percept.is_valid


def test_a_scan_that_stays_the_same_makes_the_body_stand():
    perception, valid = Perception(LIDAR), []
    for k in range(8):
        percept = perception.update(Scan(0.0, np.full(360, 2.0)), Odometry(k * DT, STANDING, REST))
        valid.append(percept.is_valid)
    assert valid == [True] * 3 + [False] * 5
    assert "no new scan" in str(percept.fault)
    assert perception.update(Scan(1.0, np.full(360, 2.0)), Odometry(1.0, STANDING, REST)).is_valid


@pytest.mark.parametrize(
    "wrong",
    [{"stamp": None}, {"odom_from_base": ("a", 0.0, 0.0)}, {"odom_from_base": (10**400, 0, 0)}, {"twist": (0.0,)},
     {"up": (0.0, 1.0)}],
)  # fmt: skip
def test_odometry_that_is_no_numbers_is_refused(wrong: Any):
    reading: Any = {"stamp": 0.0, "odom_from_base": STANDING, "twist": REST, **wrong}
    with pytest.raises(BadArgument, match="is no numbers"):
        OdometryCheck(disc_body(), 30.0).check(Odometry(**reading))


@pytest.mark.parametrize(
    "wrong", [{"num_beams": True}, {"max_range": "a"}, {"mount": None}, {"mount": (1.0, 2.0)}, {"angle_min": "x"}]
)
def test_a_lidar_of_other_types_is_refused(wrong: Any):
    with pytest.raises(BadArgument, match=f"{next(iter(wrong))} must be"):
        LidarSpec(**wrong)
