"""The robot of a bundle, ``robot.yaml``: its body and lidar, its deceleration, its frames, topics and rates."""

import math
import re
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vuca_nav.checks import check_fields, check_not_negative, check_positive
from vuca_nav.errors import BadArgument
from vuca_nav.footprint import outline_ranges
from vuca_nav.types import BodySpec, LidarSpec

_NAME = re.compile(r"[A-Za-z_/][A-Za-z0-9_/]*")
"""A frame or a topic, as ROS 2 takes them."""
MOST_CORNERS, FARTHEST_CORNER = 1000, 10.0
"""Greatest number of a footprint's corners, and their greatest distance from base_link's axes [m]."""
FASTEST, STRONGEST, LONGEST_DELAY = 20.0, 200.0, 2.0
"""Bounds of a body's velocities [m/s, rad/s], accelerations [m/s^2, rad/s^2] and delay [s]: beyond those of any robot
that this stack could drive."""


def _check_names(config: object, names: tuple[str, ...]) -> None:
    right = "a name of letters, digits, _ and /, at most 200"
    check_fields(config, right, lambda name: len(name) <= 200 and _NAME.fullmatch(name) is not None, *names)


@dataclass(frozen=True, slots=True)
class Frames:
    """Names of the frames (REP-105)."""

    map: str = "map"
    odom: str = "odom"
    base: str = "base_link"
    lidar: str = "laser"
    """The lidar's own frame, in which a scan's angles are; ``LidarSpec.mount`` is its pose in base_link."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a name that ROS 2 does not take."""
        _check_names(self, ("map", "odom", "base", "lidar"))


@dataclass(frozen=True, slots=True)
class Topics:
    """Names of the topics, relative to the robot's namespace, as Nav2 has them."""

    scan: str = "scan"
    odom: str = "odom"
    imu: str = "imu"
    goal: str = "goal_pose"
    initial_pose: str = "initialpose"
    cmd_vel: str = "cmd_vel"
    map: str = "map"
    plan: str = "plan"
    tracks: str = "tracks"

    def __post_init__(self) -> None:
        """Raise BadArgument for a name that ROS 2 does not take."""
        _check_names(self, ("scan", "odom", "imu", "goal", "initial_pose", "cmd_vel", "map", "plan", "tracks"))


@dataclass(frozen=True, slots=True)
class Rates:
    """Rates of the topics that have to come in time; a scan's is ``LidarSpec.rate``."""

    odom: float = 30.0
    """Least rate of the odometry [Hz]: one reading for every tick."""
    cmd_vel: float = 30.0
    """Rate of the commands [Hz], that of the stack's ticks."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a rate that is not positive."""
        check_positive(self, "odom", "cmd_vel")


class Deceleration(NamedTuple):
    """Greatest deceleration that the body is sure to reach when it is told to stop."""

    v_x: float
    """[m/s^2]"""
    v_y: float
    """[m/s^2]; 0 for a body that does not go sideways."""
    w_z: float
    """[rad/s^2]"""


@dataclass(frozen=True, slots=True)
class RobotFile:
    """A robot as the stack has to know it."""

    body: BodySpec
    lidar: LidarSpec
    deceleration: Deceleration
    frames: Frames = field(default_factory=Frames)
    topics: Topics = field(default_factory=Topics)
    rates: Rates = field(default_factory=Rates)

    def __post_init__(self) -> None:
        """Raise BadArgument for a body that cannot be driven, or a deceleration that is not positive."""
        body, right = self.body, "above 0 and at most"
        right_name = "a text of 1 to 200 characters that can be printed"
        check_fields(body, right_name, lambda name: 1 <= len(name) <= 200 and name.isprintable(), "name")
        check_fields(body, f"{right} {FASTEST:g}", lambda v: 0.0 < v <= FASTEST, "max_v_x", "max_w_z")
        check_fields(body, f"0 to {FASTEST:g}", lambda v: 0.0 <= v <= FASTEST, "max_v_y")
        check_fields(body, f"-{FASTEST:g} to 0", lambda v: -FASTEST <= v <= 0.0, "min_v_x")
        check_fields(body, f"{right} {STRONGEST:g}", lambda a: 0.0 < a <= STRONGEST, "max_a_x", "max_a_w")
        check_fields(body, f"0 to {STRONGEST:g}", lambda a: 0.0 <= a <= STRONGEST, "max_a_y")
        check_fields(body, f"0 to {LONGEST_DELAY:g}", lambda delay: 0.0 <= delay <= LONGEST_DELAY, "delay")
        check_positive(self.deceleration, "v_x", "w_z")
        check_not_negative(self.deceleration, "v_y")
        shape = np.shape(body.footprint)
        if len(shape) != 2 or shape[1] != 2 or not 3 <= shape[0] <= MOST_CORNERS:
            raise BadArgument(f"footprint must be 3 to {MOST_CORNERS} points of two numbers")
        if not (np.abs(body.footprint) <= FARTHEST_CORNER).all():
            raise BadArgument(f"footprint must lie within {FARTHEST_CORNER:g} m of base_link")
        outline_ranges(body.footprint, 4)
        if not math.isclose(self.lidar.rate, min(max(self.lidar.rate, 1.0), 100.0)):
            raise BadArgument(f"the lidar's rate must be 1 to 100 Hz, got {self.lidar.rate}")


def robot_file_of(body: BodySpec, lidar: LidarSpec) -> RobotFile:
    """The robot of a body of the simulator, with the names that Nav2 uses.

    Args:
        body: The body. It slows down by its limits of acceleration, as it speeds up by them.
        lidar: The body's lidar.
    """
    return RobotFile(body, lidar, Deceleration(body.max_a_x, body.max_a_y, body.max_a_w))
