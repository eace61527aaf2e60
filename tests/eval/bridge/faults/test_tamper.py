import math
from typing import Any

import numpy as np
import pytest

from eval.bridge.faults.tamper import FAR, JUMP, NAMES, Tamper
from eval.bridge.robot_wire import Readings
from vuca_nav.deploy.safety.faults import FAULTS
from vuca_nav.types import Odometry, Pose2, Scan, Twist2


def readings(tick):
    stamp = 1_000_000_000 + tick
    scan = Scan(float(tick), np.full(6, 1.0 + tick))
    return Readings(scan, Odometry(float(tick), Pose2(tick, 0.0, 0.0), Twist2(1.0, 0.0, 0.0)), stamp, stamp, stamp)


def under(fault, before=3, ticks=3) -> Any:
    """Readings as they came in, and as they go out, while a fault goes on."""
    tamper = Tamper()
    for tick in range(before):
        tamper(readings(tick))
    tamper.begin(fault)
    inside = [readings(before + tick) for tick in range(ticks)]
    return inside, [tamper(each) for each in inside], tamper


def test_all_faults_of_sensors_and_clocks_are_made_here():
    wanted = {name for name, fault in FAULTS.items() if fault.target in ("scan", "odometry", "clock")}
    assert set(NAMES) == wanted - {"lidar_beside"}


def test_nothing_is_changed_without_a_fault():
    tamper = Tamper()
    for tick in range(3):
        assert tamper(readings(tick))[2:] == readings(tick)[2:]
    assert tamper(readings(4)).odometry == readings(4).odometry


@pytest.mark.parametrize("fault", NAMES)
def test_after_its_end_all_is_as_it_was_but_what_has_jumped(fault):
    _, _, tamper = under(fault)
    tamper.end()
    now, out = readings(9), tamper(readings(9))
    shift = {"clock_back": -JUMP, "clock_ahead": JUMP}.get(fault, 0)
    assert out[2:] == (now.scan_stamp + shift, now.odometry_stamp + shift, now.clock + shift)
    assert out.odometry is not None
    assert out.odometry.odom_from_base.x == 9.0 + (FAR if fault == "odometry_jump" else 0.0)
    assert out.scan is not None
    assert out.scan.ranges[0] == 10.0
    tamper.new_mission()
    assert tamper(readings(0)).odometry == readings(0).odometry


def test_silence():
    assert all(out.scan is None and out.odometry is not None for out in under("lidar_silent")[1])
    assert all(out.odometry is None and out.scan is not None for out in under("odometry_silent")[1])


def test_repeated_has_the_stamp_of_before_and_frozen_that_of_now():
    inside, out, _ = under("lidar_repeated")
    assert [(r.scan.ranges[0], r.scan_stamp) for r in out] == 3 * [(3.0, 1_000_000_002)]
    inside, out, _ = under("lidar_frozen")
    assert [(r.scan.ranges[0], r.scan_stamp) for r in out] == [(3.0, r.scan_stamp) for r in inside]
    inside, out, _ = under("odometry_repeated")
    assert [(r.odometry.odom_from_base.x, r.odometry_stamp) for r in out] == 3 * [(2.0, 1_000_000_002)]
    inside, out, _ = under("odometry_frozen")
    assert [(r.odometry.odom_from_base.x, r.odometry_stamp) for r in out] == [(2.0, r.odometry_stamp) for r in inside]


def test_nan_and_size():
    assert np.isnan(under("lidar_nan")[1][0].scan.ranges).all()
    odometry = under("odometry_nan")[1][0].odometry
    assert all(map(math.isnan, (*odometry.odom_from_base, *odometry.twist)))
    assert len(under("lidar_resized")[1][0].scan.ranges) == 3


@pytest.mark.parametrize(("fault", "jump"), [("clock_back", -JUMP), ("clock_ahead", JUMP)])
def test_a_clock_jumps_with_all_its_stamps(fault, jump):
    inside, out, _ = under(fault)
    assert [r[2:] for r in out] == [tuple(t + jump for t in r[2:]) for r in inside]


@pytest.mark.parametrize(("fault", "jump"), [("time_back", -JUMP), ("time_ahead", JUMP)])
def test_stamps_of_one_sensor_jump_alone(fault, jump):
    inside, out, _ = under(f"lidar_{fault}")
    assert [r[2:] for r in out] == [(r.scan_stamp + jump, r.odometry_stamp, r.clock) for r in inside]
    inside, out, _ = under(f"odometry_{fault}")
    assert [r[2:] for r in out] == [(r.scan_stamp, r.odometry_stamp + jump, r.clock) for r in inside]
