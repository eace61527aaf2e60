import gzip
import math

import numpy as np
import pytest

from tests.vuca_nav.slam_log.carmen_lines import front_laser, robot_laser
from vuca_nav.errors import BadLog
from vuca_nav.slam_log.carmen import read_carmen
from vuca_nav.types import STANDING, Pose2

RANGES = np.linspace(1.0, 4.0, 180)


def line(stamp: float, x: float = 0.0, ranges=RANGES, **options) -> str:
    return robot_laser(stamp, ranges, Pose2(x, 0.0, 0.1), fov=math.pi, start=-math.pi / 2, **options)


def write(tmp_path, text: str | bytes):
    path = tmp_path / "a.clf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize("packed", [False, True])
def test_a_log_is_lidar_times_ranges_and_odometry(tmp_path, packed):
    text = ("# a comment\nPARAM x 1\n" + line(1.0) + line(1.5, 0.2) + line(1.5, 0.3)).encode()
    log = read_carmen(write(tmp_path, gzip.compress(text) if packed else text))
    assert log.stamps.tolist() == [1.0, 1.5, 1.5]
    assert log.odometry[:, 0].tolist() == [0.0, 0.2, 0.3]
    assert log.odometry[0, 2] == pytest.approx(0.1)
    np.testing.assert_allclose(log.ranges[1], RANGES, atol=1e-4)
    assert (log.lidar.num_beams, log.lidar.max_range) == (180, 30.0)
    assert log.lidar.angle_min == pytest.approx(-math.pi / 2, abs=1e-5)
    assert log.lidar.pitch == pytest.approx(math.pi / 180, abs=1e-6)
    assert log.lidar.mount == STANDING
    assert log.skipped == {}


def test_the_lidars_place_on_the_robot_is_found(tmp_path):
    text = line(1.0, lidar=Pose2(0.2 * math.cos(0.1), 0.2 * math.sin(0.1), 0.1))
    assert read_carmen(write(tmp_path, text)).lidar.mount == pytest.approx((0.2, 0.0, 0.0), abs=1e-5)


def test_front_laser_lines_cover_half_a_circle(tmp_path):
    log = read_carmen(write(tmp_path, front_laser(1.0, np.full(361, 2.0), Pose2(1.0, 2.0, 0.5))))
    assert log.lidar.pitch == pytest.approx(math.pi / 360)
    assert log.odometry[0].tolist() == [1.0, 2.0, 0.5]


def test_front_laser_lines_without_a_pose_take_the_odometry_lines(tmp_path):
    text = ""
    for k in range(4):
        text += f"ODOM {0.5 * k:.3f} 0 0 0 0 0 {k:.1f} host {k:.1f}\n"
        text += front_laser(k + 0.01, RANGES, STANDING)
    assert read_carmen(write(tmp_path, text)).odometry[:, 0].tolist() == [0.0, 0.5, 1.0, 1.5]


@pytest.mark.parametrize(
    ("broken", "cause"),
    [
        (line(2.0)[:300], "incomplete"),
        (line(2.0, ranges=np.ones(90)), "another size"),
        (line(0.5), "time runs backwards"),
        (line(math.nan), "no finite pose or time"),
        (line(2.0, x=math.inf), "no finite pose or time"),
        (line(2.0, ranges=np.full(180, math.nan)), "more than half of the ranges NaN"),
    ],
)
def test_scans_of_no_use_are_left_out_and_counted(tmp_path, broken, cause):
    text = line(1.0) + line(1.1, 0.1) + broken.rstrip("\n") + "\n" + line(3.0, 0.2)
    log = read_carmen(write(tmp_path, text))
    assert log.skipped == {cause: 1}
    assert log.odometry[:, 0].tolist() == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"hello\nworld\n", "no scan"),
        (b"", "no scan"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "no text"),
        (gzip.compress(line(1.0).encode() * 50)[:-40], "cut off"),
        (b"x" * 4_000_000, "longer than"),
        ((line(1.0) + line(0.5) * 3).encode(), "backwards: 3"),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(tmp_path, content, says):
    with pytest.raises(BadLog, match=says) as error:
        read_carmen(write(tmp_path, content))
    assert "\n" not in str(error.value)


def test_a_range_at_which_a_log_saturates_is_no_return(tmp_path):
    ranges = np.where(np.arange(180) < 40, 8.19, RANGES)
    log = read_carmen(write(tmp_path, line(1.0, ranges=ranges)))
    assert 8.0 < log.lidar.max_range < 8.19
