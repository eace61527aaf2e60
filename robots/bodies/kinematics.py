"""Compiled conversions between MuJoCo's arrays and poses, called several times a tick."""

import math

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray

AWAY = 1e5
"""Coordinate of movers that are not there [m]: worlds end at 10,000 m."""
APART = 10.0
"""Distance between them [m]: bodies at one place would be tested against each other."""
STEEPEST = 0.1
"""Squared cosine of the greatest pitch at which a heading is defined: 72 degrees."""


def heading_rate(gyro: FloatArray, up: FloatArray) -> float:
    """Turn rate of base_link's x axis seen from above [rad/s].

    On a leaning body it is not the spin about the vertical.

    Args:
        gyro: Angular velocity in base_link (3,) [rad/s].
        up: The vertical in base_link (3,).
    """
    return float(gyro[1] * up[1] + gyro[2] * up[2]) / max(1.0 - float(up[0]) ** 2, STEEPEST)


@njit(cache=True)
def planar_pose(qpos):
    """Compute x, y, yaw of a free joint's position (7,): x, y, z and a unit quaternion w, x, y, z."""
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    return qpos[0], qpos[1], math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@njit(cache=True)
def place_planar(qpos, qvel, x, y, yaw):
    """Move a free joint's body (7,), (6,) to x, y, yaw; its height, its tilt and its speed over ground stay."""
    _, _, yaw0 = planar_pose(qpos)
    half = 0.5 * (yaw - yaw0)
    c, s = math.cos(half), math.sin(half)
    w, i, j, k = qpos[3], qpos[4], qpos[5], qpos[6]
    qpos[0], qpos[1] = x, y
    qpos[3], qpos[4], qpos[5], qpos[6] = c * w - s * k, c * i - s * j, c * j + s * i, c * k + s * w
    cos, sin = math.cos(yaw - yaw0), math.sin(yaw - yaw0)
    qvel[0], qvel[1] = cos * qvel[0] - sin * qvel[1], sin * qvel[0] + cos * qvel[1]


@njit(cache=True)
def rotation_of(qpos, height, rotation, origin):
    """Compute a free joint's (7,) rotation matrix (3, 3), and the point ``height`` up its z axis (3,)."""
    w, x, y, z = qpos[3], qpos[4], qpos[5], qpos[6]
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    for i in range(3):
        origin[i] = qpos[i] + height * rotation[i, 2]


@njit(cache=True)
def place_mocap(part_poses, positions, quaternions):
    """Move mocap bodies to x, y, yaw (n, 3); their heights stay. Those that are not there stand far away, and apart."""
    for i in range(len(part_poses)):
        if math.isfinite(part_poses[i, 0]):
            positions[i, 0], positions[i, 1] = part_poses[i, 0], part_poses[i, 1]
        else:
            positions[i, 0], positions[i, 1] = AWAY + APART * i, AWAY
        half = 0.5 * part_poses[i, 2]
        quaternions[i, 0], quaternions[i, 3] = math.cos(half), math.sin(half)
        quaternions[i, 1] = quaternions[i, 2] = 0.0
