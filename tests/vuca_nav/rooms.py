"""Analytic scenes for tests of the stack: scans computed here and nowhere else, and their percepts."""

import math

import numpy as np

from vuca_nav.geometry import compose
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.perception import Perception, PerceptionConfig
from vuca_nav.types import STANDING, BodySpec, LidarSpec, Odometry, Pose2, Scan, Twist2

LIDAR = LidarSpec()
REST = Twist2(0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 1.0)
NO_BOXES = np.zeros((0, 4))
PERCEPTION = PerceptionConfig()
NOTHING = np.full(LIDAR.num_beams, np.inf)


def disc_body(radius: float = 0.28) -> BodySpec:
    angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    outline = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return BodySpec("disc", outline, 1.0, -0.2, 0.0, 1.0, 1.0, 0.0, 2.0)


def room(width: float, height: float) -> np.ndarray:
    """Four walls 0.2 m thick around [0, width] x [0, height], as boxes (n, 4) x_min, y_min, x_max, y_max."""
    t = 0.2
    return np.array(
        [
            [-t, -t, width + t, 0.0],
            [-t, height, width + t, height + t],
            [-t, -t, 0.0, height + t],
            [width, -t, width + t, height + t],
        ]
    )


def ranges_to_boxes(boxes: np.ndarray, pose: Pose2, lidar: LidarSpec = LIDAR) -> np.ndarray:
    """(num_beams,) [m] by the slab method; inf where nothing is within reach."""
    angles = lidar.angles_in_base() + pose.yaw
    directions = np.column_stack([np.cos(angles), np.sin(angles)])  # (beams, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (boxes[None, :, :2] - pose[:2]) / directions[:, None]
        high = (boxes[None, :, 2:] - pose[:2]) / directions[:, None]
    enter = np.minimum(low, high).max(axis=2)
    leave = np.maximum(low, high).min(axis=2)
    hit = np.where((enter < leave) & (enter > 0.0), enter, np.inf).min(axis=1)
    return np.where(hit < lidar.max_range, hit, np.inf)


def ranges_to_discs(discs, boxes: np.ndarray, pose: Pose2, lidar: LidarSpec = LIDAR) -> np.ndarray:
    """(num_beams,) [m] to the nearest of discs (x, y, radius) and boxes."""
    ranges = ranges_to_boxes(boxes, pose, lidar) if len(boxes) else np.full(lidar.num_beams, np.inf)
    angles = lidar.angles_in_base() + pose.yaw
    for x, y, radius in discs:
        along = (x - pose.x) * np.cos(angles) + (y - pose.y) * np.sin(angles)
        aside = (y - pose.y) * np.cos(angles) - (x - pose.x) * np.sin(angles)
        with np.errstate(invalid="ignore"):
            enter = along - np.sqrt(radius**2 - aside**2)
        ranges = np.where(enter > 0.0, np.minimum(ranges, enter), ranges)  # NaN is no hit
    return ranges


def scan_of(boxes: np.ndarray, pose: Pose2, stamp: float = 0.0, rng: np.random.Generator | None = None) -> Scan:
    """A clean scan, or with ``rng`` one with 2 cm noise and 1% dropouts."""
    ranges = ranges_to_boxes(boxes, pose)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, 0.02, len(ranges))
        ranges[rng.random(len(ranges)) < 0.01] = np.inf
    return Scan(stamp, ranges)


def moved(pose: Pose2, forward: float, turn: float) -> Pose2:
    return compose(pose, Pose2(forward, 0.0, turn))


class Sensors:
    """Gives a ``Perception`` one scan after the other, and odometry that has no error unless it is told one.

    Args:
        lidar: What is seen with.
        config: Of the perception.
    """

    def __init__(self, lidar: LidarSpec = LIDAR, config: PerceptionConfig = PERCEPTION):
        self.perception, self._period = Perception(lidar, config), 1.0 / lidar.rate
        self._tick, self._odom_from_base = 0, STANDING

    def see(
        self,
        ranges: np.ndarray,
        motion: Pose2 = STANDING,
        twist: Twist2 = REST,
        up: tuple[float, float, float] = UPRIGHT,
    ) -> Percept:
        """The percept of the next tick, after a motion since the last one in the base frame of then."""
        self._odom_from_base = compose(self._odom_from_base, motion)
        stamp = self._tick * self._period
        self._tick += 1
        return self.perception.update(Scan(stamp, ranges), Odometry(stamp, self._odom_from_base, twist, up))

    def skip(self, ticks: int) -> None:
        """Lose so many scans."""
        self._tick += ticks


def percept_of(ranges: np.ndarray, lidar: LidarSpec = LIDAR, up: tuple[float, float, float] = UPRIGHT) -> Percept:
    """The first percept of a mission."""
    return Sensors(lidar).see(ranges, up=up)
