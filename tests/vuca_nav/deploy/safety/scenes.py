"""Scenes of discs and walls with a kinematic body in them: what the safety layer's tests drive through."""

import math
from collections import deque
from dataclasses import replace

import numpy as np

from vuca_nav.types import STANDING, BodySpec, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand

TICK = 1.0 / 30.0
STEPS = 5
"""Steps of the body in a tick."""


def box_body(length=0.6, width=0.4, **changes) -> BodySpec:
    """A box that drives like a differential base, unless changed."""
    x, y = 0.5 * length, 0.5 * width
    outline = np.array([[x, y], [-x, y], [-x, -y], [x, -y]])
    return replace(BodySpec("box", outline, 1.0, -0.5, 0.0, 1.0, 1.0, 0.0, 2.0), **changes)


def cast(lidar: LidarSpec, pose: Pose2, discs: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Exact ranges (num_beams,) to discs (n, 3) x, y, radius and half-planes (m, 3) n_x, n_y, offset, n p >= offset."""
    angles = lidar.angles_in_base() + pose.yaw
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    x, y = pose.x + c * lidar.mount.x - s * lidar.mount.y, pose.y + s * lidar.mount.x + c * lidar.mount.y
    ranges = np.full(lidar.num_beams, np.inf)
    beams = np.column_stack([np.cos(angles), np.sin(angles)])
    for cx, cy, radius in discs:
        along = beams[:, 0] * (cx - x) + beams[:, 1] * (cy - y)
        off = (cx - x) ** 2 + (cy - y) ** 2 - along**2
        hit = (along > 0.0) & (off < radius**2)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(radius**2 - off[hit]))
    for nx, ny, offset in walls:
        towards = beams @ np.array([nx, ny])
        hit = towards > 1e-9
        ranges[hit] = np.minimum(ranges[hit], (offset - nx * x - ny * y) / towards[hit])
    return np.where(ranges < lidar.max_range, ranges, np.inf)


def gap(footprint: np.ndarray, pose: Pose2, discs: np.ndarray, walls: np.ndarray) -> float:
    """Distance of the footprint to the nearest disc or wall, by brute force over points of its outline [m]."""
    share = np.linspace(0.0, 1.0, 25)[:, None, None]
    outline = (footprint * (1 - share) + np.roll(footprint, -1, axis=0) * share).reshape(-1, 2)
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    points = outline @ np.array([[c, s], [-s, c]]) + np.array([pose.x, pose.y])
    least = math.inf
    for cx, cy, radius in discs:
        least = min(least, float(np.hypot(points[:, 0] - cx, points[:, 1] - cy).min()) - radius)
    for nx, ny, offset in walls:
        least = min(least, offset - float((points @ np.array([nx, ny])).max()))
    return least


class Base:
    """A body that answers each command after its delay, as fast as its limits of acceleration allow."""

    def __init__(self, spec: BodySpec, pose: Pose2 = STANDING):
        self.spec, self.pose, self.time = spec, pose, 0.0
        self.velocity = np.zeros(3)
        self._steps = 0
        self._waiting: deque[tuple[float, np.ndarray]] = deque()
        self._obeyed = np.zeros(3)

    def odometry(self) -> Odometry:
        """Exact odometry."""
        v_x, v_y, w_z = self.velocity.tolist()
        return Odometry(self.time, self.pose, Twist2(v_x, v_y, w_z))

    def scan(self, lidar: LidarSpec, discs: np.ndarray, walls: np.ndarray) -> Scan:
        """Exact scan."""
        return Scan(self.time, cast(lidar, self.pose, discs, walls))

    def step(self, command: VelocityCommand) -> list[Pose2]:
        """Hold a command for a tick; poses on the way."""
        self.give(command)
        return [self.advance() for _ in range(STEPS)]

    def give(self, command: VelocityCommand) -> None:
        """Take in a command."""
        self._waiting.append((self.time + self.spec.delay, np.array(command)))

    def advance(self) -> Pose2:
        """Move on by a step of a tick."""
        a = np.array([self.spec.max_a_x, self.spec.max_a_y, self.spec.max_a_w])
        dt = TICK / STEPS
        while self._waiting and self._waiting[0][0] <= self.time + 1e-9:
            self._obeyed = self._waiting.popleft()[1]
        before = self.velocity
        self.velocity = before + np.clip(self._obeyed - before, -a * dt, a * dt)
        v_x, v_y, w_z = (0.5 * (before + self.velocity)).tolist()
        middle = self.pose.yaw + 0.5 * w_z * dt
        c, s = math.cos(middle), math.sin(middle)
        x, y = self.pose.x + (v_x * c - v_y * s) * dt, self.pose.y + (v_x * s + v_y * c) * dt
        self.pose = Pose2(x, y, self.pose.yaw + w_z * dt)
        self._steps += 1
        self.time = self._steps * dt
        return self.pose
