"""Values that flow between the stages: poses, scans, odometry, commands, and the description of the body.

SI units and radians throughout; frames after REP-103/105: ``map`` is fixed, ``odom`` drifts, ``base`` is the
robot's base_link with x forward and y to the left.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.checks import check_fields, check_not_negative, check_positive
from vuca_nav.errors import BadArgument

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


MOST_BEAMS = 100_000
"""Greatest number of a lidar's beams: thirty times that of the finest planar lidars, and it bounds the memory."""


def _is_whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


@dataclass(frozen=True, slots=True)
class LidarSpec:
    """A planar lidar. By default it stands on base_link's z axis, and its beams go once round it, counter-clockwise.

    Raises:
        BadArgument: If a field is out of its range, or the beams go more than once round.
    """

    num_beams: int = 360
    min_range: float = 0.1
    """Least distance that can be measured; an obstacle below it is there, but not mapped [m]."""
    max_range: float = 12.0
    """Greatest distance that can be measured; a range from here on is no return [m]."""
    rate: float = 30.0
    """Rate of the scans [Hz]."""
    height: float = 0.1
    """Height of the scan plane above the floor when the body stands level [m]."""
    angle_min: float = -math.pi
    """Direction of the first beam in the lidar's own frame [rad]."""
    angle_increment: float | None = None
    """Angle from each beam to the next, negative for a lidar that turns clockwise; None for a full circle [rad]."""
    mount: Pose2 = STANDING
    """Pose of the lidar in base_link."""

    def __post_init__(self) -> None:
        right = f"a whole number from 1 to {MOST_BEAMS}"
        check_fields(self, right, lambda n: _is_whole(n) and 1 <= int(n) <= MOST_BEAMS, "num_beams")
        check_positive(self, "max_range", "rate")
        check_not_negative(self, "min_range", "height")
        check_fields(self, "finite", math.isfinite, "angle_min", "pitch")
        check_fields(
            self, "a Pose2 of finite numbers", lambda p: isinstance(p, Pose2) and math.isfinite(sum(p)), "mount"
        )
        if not self.min_range < self.max_range:
            raise BadArgument(f"min_range must be below max_range, got {self.min_range} and {self.max_range}")
        if not 0.0 < (self.num_beams - 1) * abs(self.pitch) <= 2.0 * math.pi + 1e-3 and self.num_beams > 1:
            raise BadArgument(
                f"{self.num_beams} beams, each {self.angle_increment} rad from the next, must go round once at most: "
                f"{2.0 * math.pi / self.num_beams:.6f} rad would make a full circle"
            )

    @property
    def pitch(self) -> float:
        """Angle from each beam to the next, counter-clockwise [rad]."""
        return 2.0 * math.pi / self.num_beams if self.angle_increment is None else self.angle_increment

    @property
    def sees_all_round(self) -> bool:
        """Whether the beams go all the way round, so that the first one is the last one's neighbour."""
        return self.num_beams * abs(self.pitch) > 2.0 * math.pi - 0.5 * abs(self.pitch)

    @property
    def is_centred_ring(self) -> bool:
        """Whether the beams go all the way round base_link, from behind it, counter-clockwise and evenly."""
        full = 2.0 * math.pi / self.num_beams
        return self.mount == STANDING and self.angle_min == -math.pi and abs(self.pitch - full) < 1e-9

    def angles_in_base(self) -> FloatArray:
        """Beam directions in base_link [rad], shape (num_beams,)."""
        first = self.mount.yaw + self.angle_min
        return first + np.arange(self.num_beams, dtype=np.float64) * self.pitch


@dataclass(frozen=True, slots=True)
class Scan:
    """One revolution of the lidar."""

    stamp: float
    """Time of the scan; a scan with the stamp of the last one is the same scan [s]."""
    ranges: FloatArray
    """(num_beams,) ranges from the lidar [m]. ``inf``, from the lidar's ``max_range`` on, 0.0 or negative: nothing came
    back, which a dropped beam looks like too. Below its ``min_range`` or ``-inf``: something too near to be measured.
    NaN: a fault (REP-117)."""


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
