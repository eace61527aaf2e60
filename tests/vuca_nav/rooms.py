"""Analytic scenes for tests of the stack: scans of axis-aligned boxes, computed here and nowhere else."""

import math

import numpy as np

from vuca_nav.geometry import compose
from vuca_nav.types import BodySpec, LidarSpec, Pose2, Scan

LIDAR = LidarSpec()


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


def scan_of(boxes: np.ndarray, pose: Pose2, stamp: float = 0.0, rng: np.random.Generator | None = None) -> Scan:
    """A clean scan, or with ``rng`` one with 2 cm noise and 1% dropouts."""
    ranges = ranges_to_boxes(boxes, pose)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, 0.02, len(ranges))
        ranges[rng.random(len(ranges)) < 0.01] = np.inf
    return Scan(stamp, ranges)


def moved(pose: Pose2, forward: float, turn: float) -> Pose2:
    return compose(pose, Pose2(forward, 0.0, turn))
