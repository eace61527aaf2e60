import math

import numpy as np
import pytest

from eval.metrics import MetricsRecorder, success_weighted_path_length
from vuca_nav.types import Pose2, Scan


def scan_of(*ranges: float) -> Scan:
    return Scan(0.0, np.array(ranges))


def test_spl():
    assert success_weighted_path_length(True, 10.0, 10.0) == 1.0
    assert success_weighted_path_length(True, 10.0, 25.0) == 0.4
    assert success_weighted_path_length(False, 10.0, 10.0) == 0.0
    # A way shorter than the reference, which is planned on a grid, is not rewarded beyond 1.
    assert success_weighted_path_length(True, 10.0, 9.0) == 1.0
    # Where no way is asked for, any success is 1: the robot may have moved a little before it was judged.
    assert success_weighted_path_length(True, 0.0, 0.0) == 1.0
    assert success_weighted_path_length(True, 0.0, 0.02) == 1.0
    assert success_weighted_path_length(True, 0.3, 0.4) == 1.0
    assert success_weighted_path_length(True, 0.4, 0.5) == pytest.approx(0.8)
    assert success_weighted_path_length(False, 0.0, 0.0) == 0.0


def test_recorder_by_hand():
    """Start (1, 0) facing +y, goal 4 m ahead; two steps of 1 m, then one into the end at 3 m."""
    start = Pose2(1.0, 0.0, math.pi / 2.0)
    recorder = MetricsRecorder(start, (1.0, 4.0), shortest=4.0)
    recorder.add(scan_of(0.3), Pose2(0.0, 0.0, 0.0), start, start, clearance=0.5)
    recorder.add(
        scan_of(2.0),
        Pose2(1.3, 0.0, 0.0),  # 1.3 m ahead is (1, 1.3) in the map: 0.3 m off
        Pose2(1.0, 1.0, 0.0),
        Pose2(1.0, 1.1, 0.0),  # 0.1 m off
        clearance=0.2,
    )
    recorder.add(
        scan_of(0.5),
        Pose2(2.0, -0.4, 0.0),  # 0.4 m to the right is +x
        Pose2(1.0, 2.0, 0.0),
        Pose2(1.2, 2.0, 0.0),  # 0.2 m off
        clearance=0.9,
    )
    metrics = recorder.finish(Pose2(1.0, 3.0, 0.0), clearance=0.4, success=False)
    assert metrics.steps == 3
    assert metrics.path_length == pytest.approx(3.0)
    assert metrics.arsps == pytest.approx((1.0 + 0.0 + 0.2) / 3.0)
    assert metrics.ansps == pytest.approx((4.0 - 1.0) / (4.0 * 3))
    assert metrics.spl == 0.0
    assert metrics.min_clearance == 0.2
    assert metrics.slam_ate == pytest.approx(math.sqrt((0.0 + 0.01 + 0.04) / 3.0))
    assert metrics.slam_final_error == pytest.approx(0.2)
    assert metrics.odometry_ate == pytest.approx(math.sqrt((0.0 + 0.09 + 0.16) / 3.0))
    assert metrics.odometry_final_error == pytest.approx(0.4)


def test_the_last_step_counts_for_clearance():
    recorder = MetricsRecorder(Pose2(0.0, 0.0, 0.0), (1.0, 0.0), 1.0)
    recorder.add(scan_of(1.0), Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.0, 0.0), 1.0)
    assert recorder.finish(Pose2(0.5, 0.0, 0.0), clearance=-0.01, success=False).min_clearance == -0.01


def test_no_steps_no_metrics():
    with pytest.raises(ValueError, match="without steps"):
        MetricsRecorder(Pose2(0.0, 0.0, 0.0), (1.0, 0.0), 1.0).finish(Pose2(0.0, 0.0, 0.0), 1.0, False)


def test_errors_of_the_estimate_are_told_to_a_nanometre():
    """What a transform over a wire loses of an estimate, some 1e-16 m, does not show."""
    results = []
    for error in (1.0 / 3.0, 1.0 / 3.0 + 2e-16):
        recorder = MetricsRecorder(Pose2(0.0, 0.0, 0.0), (4.0, 0.0), shortest=4.0)
        recorder.add(scan_of(1.0), Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.0, 0.0), Pose2(error, 0.0, 0.0), clearance=0.5)
        metrics = recorder.finish(Pose2(1.0, 0.0, 0.0), 0.5, success=False)
        results.append((metrics.slam_ate, metrics.slam_final_error))
    assert results == [(0.333333333, 0.333333333)] * 2
