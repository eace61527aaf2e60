"""Values that flow between the stages: poses, scans, odometry, commands, and the description of the body.

SI units and radians throughout; frames after REP-103/105: ``map`` is fixed, ``odom`` drifts, ``base`` is the
robot's base_link with x forward and y to the left.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Pose2(NamedTuple):
    """A planar pose, also read as the transform from its own frame into the frame it is given in."""

    x: float
    """[m]"""
    y: float
    """[m]"""
    yaw: float
    """Angle, counter-clockwise [rad]."""


STANDING = Pose2(0.0, 0.0, 0.0)
"""No motion."""


class Twist2(NamedTuple):
    """A planar velocity in base_link."""

    v_x: float
    """Forward velocity [m/s]."""
    v_y: float
    """Lateral velocity, positive to the left [m/s]."""
    w_z: float
    """Yaw rate, positive counter-clockwise [rad/s]."""


class VelocityCommand(NamedTuple):
    """Velocity that the stack asks of a body, in base_link. A differential base ignores ``v_y``."""

    v_x: float
    """Forward velocity [m/s]."""
    v_y: float
    """Lateral velocity, positive to the left [m/s]."""
    w_z: float
    """Yaw rate, positive counter-clockwise [rad/s]."""


STOP = VelocityCommand(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class LidarSpec:
    """A planar lidar. Beam ``i`` points at ``-pi + i * 2 pi / num_beams`` in base_link's x-y plane."""

    num_beams: int = 360
    min_range: float = 0.1
    """[m]"""
    max_range: float = 12.0
    """[m]"""
    rate: float = 30.0
    """[Hz]"""
    height: float = 0.1
    """Height of the scan plane above the floor when the body stands level [m]."""

    def angles_in_base(self) -> FloatArray:
        """Beam directions in base_link [rad], shape (num_beams,)."""
        return -np.pi + np.arange(self.num_beams, dtype=np.float64) * (2.0 * np.pi / self.num_beams)


@dataclass(frozen=True, slots=True)
class Scan:
    """One revolution of the lidar, its origin at base_link's z axis."""

    stamp: float
    """[s]"""
    ranges: FloatArray
    """(num_beams,) [m]; ``inf`` where nothing came back (REP-117), which a dropped beam looks like too."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """The body's own estimate of its motion. It drifts."""

    stamp: float
    """[s]"""
    odom_from_base: Pose2
    """Motion integrated since the start, where it was the identity."""
    twist: Twist2
    """Measured velocity in base_link."""
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """The vertical in base_link as the IMU shows it; a base that cannot lean leaves it."""


@dataclass(frozen=True, slots=True)
class BodySpec:
    """Description of the body that the navigation stack drives."""

    name: str
    footprint: FloatArray
    """Convex outline in base_link, counter-clockwise, (n, 2) [m]."""
    max_v_x: float
    """[m/s]"""
    min_v_x: float
    """Greatest backward velocity, negative or 0 [m/s]."""
    max_v_y: float
    """Greatest lateral velocity, 0 for a differential base [m/s]."""
    max_w_z: float
    """[rad/s]"""
    max_a_x: float
    """[m/s^2]"""
    max_a_y: float
    """[m/s^2]"""
    max_a_w: float
    """[rad/s^2]"""
    delay: float = 0.0
    """Delay of the body's answer to a linear velocity command, beyond what the acceleration limits cause [s]."""

    def __post_init__(self) -> None:
        """Hold every limit as a float: kernels are compiled for each type that they meet."""
        for name in ("max_v_x", "min_v_x", "max_v_y", "max_w_z", "max_a_x", "max_a_y", "max_a_w", "delay"):
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def radius(self) -> float:
        """Radius of the footprint's circumscribed circle about base_link [m]."""
        return float(np.hypot(self.footprint[:, 0], self.footprint[:, 1]).max())
