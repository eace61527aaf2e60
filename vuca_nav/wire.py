"""Readings as messages carry them: rounded so that both sides of a wire hold the same numbers.

A LaserScan has ranges of single precision, a stamp has whole nanoseconds, and an orientation is a quaternion, which
gives an angle back with an error of some 1e-16 rad. Angles are therefore rounded to a nanoradian on both sides: a
reading that becomes a message and a reading again is the same to the bit.
"""

import math

import numpy as np

from vuca_nav.types import FloatArray, Odometry, Pose2, Scan

NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""
_GREATEST_YAW = 3.141592653
"""Greatest yaw of nine digits that is below pi [rad]."""
_LEVEL = (0.0, 0.0, 1.0)

Quaternion = tuple[float, float, float, float]
"""A unit quaternion x, y, z, w, in the order of geometry_msgs/Quaternion."""


def seconds(nanoseconds: int) -> float:
    """Time of a stamp [s]."""
    return nanoseconds / NANOSECONDS


def nanoseconds(time: float) -> int:
    """Stamp of a time [ns]; the inverse of ``seconds`` within eleven days."""
    return round(time * NANOSECONDS)


def tick_nanoseconds(tick: int, rate: int) -> int:
    """Stamp of a tick of a loop [ns].

    Args:
        tick: Number of the tick from 0 on.
        rate: Rate of the loop [Hz].
    """
    return (2 * tick * NANOSECONDS + rate) // (2 * rate)


def round_yaw(yaw: float) -> float:
    """Round a yaw within [-pi, pi] to a nanoradian; it stays there."""
    return min(max(_rounded(yaw), -_GREATEST_YAW), _GREATEST_YAW)


def tilt_of(up: tuple[float, float, float]) -> tuple[float, float]:
    """Roll and pitch of a body to a nanoradian [rad].

    Args:
        up: The vertical in base_link.
    """
    x, y, z = up
    return _rounded(math.atan2(y, z)), _rounded(math.atan2(-x, math.hypot(y, z)))


def vertical_of(roll: float, pitch: float) -> tuple[float, float, float]:
    """The vertical in base_link of a body with roll and pitch [rad]."""
    c = math.cos(pitch)
    return 0.0 - math.sin(pitch), c * math.sin(roll), c * math.cos(roll)


def quaternion_of(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Orientation of a body turned by yaw, then pitch, then roll [rad]."""
    c_r, s_r = math.cos(0.5 * roll), math.sin(0.5 * roll)
    c_p, s_p = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    c_y, s_y = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        s_r * c_p * c_y - c_r * s_p * s_y,
        c_r * s_p * c_y + s_r * c_p * s_y,
        c_r * c_p * s_y - s_r * s_p * c_y,
        c_r * c_p * c_y + s_r * s_p * s_y,
    )


def yaw_of(orientation: Quaternion) -> float:
    """Yaw of an orientation to a nanoradian [rad]."""
    x, y, z, w = orientation
    return round_yaw(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def up_of(orientation: Quaternion) -> tuple[float, float, float]:
    """The vertical in base_link of an orientation, its roll and pitch rounded to a nanoradian."""
    x, y, z, w = orientation
    up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return vertical_of(*tilt_of(up))


def round_ranges(ranges: FloatArray) -> FloatArray:
    """Ranges as a LaserScan carries them: single precision, in an array of doubles (n,) [m]."""
    return ranges.astype(np.float32).astype(np.float64)


def round_scan(scan: Scan) -> Scan:
    """A scan as a LaserScan carries it."""
    return Scan(seconds(nanoseconds(scan.stamp)), round_ranges(scan.ranges))


def round_pose(pose: Pose2) -> Pose2:
    """A pose as a message carries it, its yaw within [-pi, pi]."""
    return Pose2(pose.x, pose.y, round_yaw(pose.yaw))


def round_odometry(odometry: Odometry) -> Odometry:
    """Odometry as an Odometry message and an Imu message carry it, its stamp aside."""
    up = odometry.up if odometry.up == _LEVEL else vertical_of(*tilt_of(odometry.up))
    return Odometry(odometry.stamp, round_pose(odometry.odom_from_base), odometry.twist, up)


def _rounded(angle: float) -> float:
    """A finite angle to a nanoradian, without a negative zero, whose sign would not come back."""
    return round(angle * NANOSECONDS) / NANOSECONDS
