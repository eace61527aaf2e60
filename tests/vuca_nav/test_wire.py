import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vuca_nav.types import Odometry, Pose2, Scan, Twist2
from vuca_nav.wire import (
    nanoseconds,
    quaternion_of,
    round_odometry,
    round_scan,
    round_yaw,
    seconds,
    tick_nanoseconds,
    tilt_of,
    up_of,
    yaw_of,
)

YAWS = st.floats(-math.pi, math.pi)
LEANS = st.floats(-1.0, 1.0)


def up_of_lean(roll, pitch):
    return -math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)


def test_known_angles():
    assert yaw_of((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))) == 1.570796327
    assert quaternion_of(0.0, 0.0, math.pi) == pytest.approx((0.0, 0.0, 1.0, 0.0))
    assert quaternion_of(0.2, 0.0, 0.0) == pytest.approx((math.sin(0.1), 0.0, 0.0, math.cos(0.1)))
    assert up_of(quaternion_of(0.2, 0.0, 1.0)) == pytest.approx((0.0, math.sin(0.2), math.cos(0.2)))
    assert tilt_of((-math.sin(0.3), 0.0, math.cos(0.3))) == (0.0, 0.3)  # nose down


@pytest.mark.parametrize("yaw", [math.pi, -math.pi, math.nextafter(math.pi, 0.0)])
def test_a_rounded_yaw_stays_within_half_a_turn(yaw):
    assert abs(round_yaw(yaw)) < math.pi
    assert round_yaw(yaw) == pytest.approx(yaw, abs=1e-9)


@given(yaw=YAWS, roll=LEANS, pitch=LEANS)
def test_odometry_becomes_a_quaternion_and_odometry_again_to_the_bit(yaw, roll, pitch):
    raw = Odometry(1.5, Pose2(1.25, -3.0, yaw), Twist2(0.1, 0.0, 0.2), up_of_lean(roll, pitch))
    sent = round_odometry(raw)
    orientation = quaternion_of(*tilt_of(sent.up), sent.odom_from_base.yaw)
    assert yaw_of(orientation) == sent.odom_from_base.yaw
    assert up_of(orientation) == sent.up
    assert round_odometry(sent) == sent
    np.testing.assert_allclose(sent.up, raw.up, atol=2e-9)
    assert sent.odom_from_base.yaw == pytest.approx(yaw, abs=1.1e-9)


def test_a_base_that_cannot_lean_stays_exactly_upright():
    sent = round_odometry(Odometry(0.0, Pose2(0.0, 0.0, 0.5), Twist2(0.0, 0.0, 0.0)))
    assert repr(sent.up) == repr(up_of(quaternion_of(0.0, 0.0, -0.5))) == "(0.0, 0.0, 1.0)"  # not -0.0
    assert repr(yaw_of(quaternion_of(0.0, 0.0, -0.0))) == "0.0"


@given(ranges=st.lists(st.floats(0.0, 40.0) | st.just(math.inf), min_size=1, max_size=9), stamp=st.floats(0.0, 1e5))
def test_a_scan_becomes_single_precision_and_doubles_again_to_the_bit(ranges, stamp):
    sent = round_scan(Scan(stamp, np.array(ranges)))
    received = np.array(sent.ranges, np.float32).astype(np.float64)
    assert received.tobytes() == sent.ranges.tobytes()
    assert seconds(nanoseconds(sent.stamp)) == sent.stamp
    np.testing.assert_allclose(sent.ranges, ranges, rtol=1e-7, atol=1e-38)


@given(tick=st.integers(0, 10_000_000), rate=st.sampled_from([1, 7, 30, 60]))
def test_the_stamp_of_a_tick_is_the_nearest_nanosecond(tick, rate):
    stamp = tick_nanoseconds(tick, rate)
    assert abs(stamp * rate - tick * 1_000_000_000) * 2 <= rate
    assert nanoseconds(seconds(stamp)) == stamp
