"""A recorded log as SLAM takes it: the scans of one planar lidar, each with the odometry of its time."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vuca_nav.errors import VucaError
from vuca_nav.types import FloatArray, LidarSpec


class BadLog(VucaError):
    """A log that cannot be read: another format, cut off, or without what SLAM needs."""


@dataclass(frozen=True, slots=True)
class RobotLog:
    """A log."""

    lidar: LidarSpec
    stamps: FloatArray
    """(n,) times of the scans, never falling [s]."""
    ranges: NDArray[np.float32]
    """(n, num_beams) [m]"""
    odometry: FloatArray
    """(n, 3) ``odom_from_base`` at these times: x, y [m], yaw [rad]."""
    skipped: dict[str, int] = field(default_factory=dict)
    """Number of scans that were left out, by cause."""
