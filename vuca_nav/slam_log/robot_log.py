"""A recorded log as SLAM takes it: the scans of one planar lidar, each with the odometry of its time."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vuca_nav.errors import BadLog
from vuca_nav.types import FloatArray, LidarSpec


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
    warnings: tuple[str, ...] = ()
    """What else is wrong with the log, a line each."""


def check_use(path: Path, kept: int, skipped: Counter[str]) -> None:
    """Raise BadLog if no scan of a log is kept, or fewer than are left out.

    Args:
        path: The log.
        kept: Number of scans that are kept.
        skipped: Number of those that are not, by cause.
    """
    if kept < skipped.total() or not kept:
        causes = ", ".join(f"{cause}: {number}" for cause, number in (+skipped).items())
        raise BadLog(f"{path}: of {kept + skipped.total()} scans most are of no use ({causes})")
