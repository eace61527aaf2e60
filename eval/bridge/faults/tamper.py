"""Faults of the sensors and of the clock: readings as they come to the wire, changed as the fault has it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from eval.bridge.robot_wire import Readings
from vuca_nav.types import Odometry, Pose2, Scan, Twist2
from vuca_nav.wire import NANOSECONDS

JUMP = 5 * NANOSECONDS
"""How far stamps and clocks jump [ns]."""
FAR = 3.0
"""How far the odometry's pose jumps [m]."""


class Tamper:
    """Readings of a robot, one of whose parts is faulty for a while.

    Attributes:
        fault: Name of the fault that goes on; None while all is well.
    """

    def __init__(self) -> None:
        self.fault: str | None = None
        self._shift = 0
        self._jumped = 0.0
        self._last: Readings | None = None
        self._last_scan: Scan | None = None
        self._last_scan_stamp = 0

    def begin(self, fault: str) -> None:
        """Begin a fault; what jumps once jumps now.

        Args:
            fault: One of ``NAMES``.
        """
        self.fault = fault
        if fault == "clock_back":
            self._shift -= JUMP
        elif fault == "clock_ahead":
            self._shift += JUMP
        elif fault == "odometry_jump":
            self._jumped += FAR

    def end(self) -> None:
        """End the fault; what has jumped stays where it is."""
        self.fault = None

    def new_mission(self) -> None:
        """Begin anew: the odometry does, too."""
        self.fault, self._jumped, self._last = None, 0.0, None

    def __call__(self, readings: Readings) -> Readings:
        """The readings as they come to the wire."""
        scan_stamp, odometry_stamp, clock = (time + self._shift for time in readings[2:])
        readings = Readings(readings.scan, self._moved(readings.odometry), scan_stamp, odometry_stamp, clock)
        if self._last is None or self.fault not in _CHANGES:
            self._last = readings
            if readings.scan is not None:
                self._last_scan, self._last_scan_stamp = readings.scan, scan_stamp
            return readings
        last = self._last._replace(scan=self._last_scan, scan_stamp=self._last_scan_stamp)
        return _CHANGES[self.fault](readings, last)

    def _moved(self, odometry: Odometry | None) -> Odometry | None:
        if odometry is None or not self._jumped:
            return odometry
        pose = odometry.odom_from_base
        return replace(odometry, odom_from_base=pose._replace(x=pose.x + self._jumped))


def _with_ranges(readings: Readings, ranges: np.ndarray) -> Readings:
    return readings._replace(scan=None if readings.scan is None else Scan(readings.scan.stamp, ranges))


def _all_nan(readings: Readings, last: Readings) -> Readings:
    assert last.scan is not None
    return _with_ranges(readings, np.full_like(last.scan.ranges, np.nan))


def _resized(readings: Readings, _last: Readings) -> Readings:
    return readings if readings.scan is None else _with_ranges(readings, readings.scan.ranges[::2].copy())


def _frozen(readings: Readings, last: Readings) -> Readings:
    assert last.scan is not None
    return _with_ranges(readings, last.scan.ranges)


def _odometry_nan(readings: Readings, last: Readings) -> Readings:
    assert last.odometry is not None
    pose, twist = Pose2(math.nan, math.nan, math.nan), Twist2(math.nan, math.nan, math.nan)
    return readings._replace(odometry=replace(last.odometry, odom_from_base=pose, twist=twist))


_CHANGES: Mapping[str | None, Callable[[Readings, Readings], Readings]] = {
    "lidar_silent": lambda now, last: now._replace(scan=None),
    "lidar_malformed": lambda now, last: now._replace(scan=None),
    "lidar_repeated": lambda now, last: now._replace(scan=last.scan, scan_stamp=last.scan_stamp),
    "lidar_frozen": _frozen,
    "lidar_nan": _all_nan,
    "lidar_resized": _resized,
    "lidar_time_back": lambda now, last: now._replace(scan_stamp=now.scan_stamp - JUMP),
    "lidar_time_ahead": lambda now, last: now._replace(scan_stamp=now.scan_stamp + JUMP),
    "odometry_silent": lambda now, last: now._replace(odometry=None),
    "odometry_repeated": lambda now, last: now._replace(odometry=last.odometry, odometry_stamp=last.odometry_stamp),
    "odometry_frozen": lambda now, last: now._replace(odometry=last.odometry),
    "odometry_nan": _odometry_nan,
    "odometry_time_back": lambda now, last: now._replace(odometry_stamp=now.odometry_stamp - JUMP),
    "odometry_time_ahead": lambda now, last: now._replace(odometry_stamp=now.odometry_stamp + JUMP),
}
"""What becomes of readings, given those before the fault."""
NAMES = (*(name for name in _CHANGES if name is not None), "clock_back", "clock_ahead", "odometry_jump")
"""The faults that are made here."""
