"""Planar rigid motions: composition, inverse, points. Plain Python on ``Pose2``; NumPy on arrays of points."""

import math

import numpy as np

from vuca_nav.types import FloatArray, Pose2


def wrap_angle(angle: float) -> float:
    """Wrap an angle to [-pi, pi) [rad]."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def compose(a_from_b: Pose2, b_from_c: Pose2) -> Pose2:
    """``a_from_c``, the two transforms one after the other."""
    c, s = math.cos(a_from_b.yaw), math.sin(a_from_b.yaw)
    return Pose2(
        a_from_b.x + c * b_from_c.x - s * b_from_c.y,
        a_from_b.y + s * b_from_c.x + c * b_from_c.y,
        wrap_angle(a_from_b.yaw + b_from_c.yaw),
    )


def inverse(a_from_b: Pose2) -> Pose2:
    """The inverse transform, ``b_from_a``."""
    c, s = math.cos(a_from_b.yaw), math.sin(a_from_b.yaw)
    return Pose2(-c * a_from_b.x - s * a_from_b.y, s * a_from_b.x - c * a_from_b.y, wrap_angle(-a_from_b.yaw))


def between(a_from_b: Pose2, a_from_c: Pose2) -> Pose2:
    """``b_from_c``: the motion that leads from the first pose to the second."""
    return compose(inverse(a_from_b), a_from_c)


def transform_points(a_from_b: Pose2, points_in_b: FloatArray) -> FloatArray:
    """Points (n, 2) in frame b, given in frame a."""
    c, s = math.cos(a_from_b.yaw), math.sin(a_from_b.yaw)
    points_along_a = multiplied(np.array([[c, -s], [s, c]]), points_in_b)
    return points_along_a + np.array([a_from_b.x, a_from_b.y])


def multiplied(matrix: FloatArray, points: FloatArray) -> FloatArray:
    """Points or vectors (n, 2), each multiplied by a matrix (2, 2).

    Not by ``@``: BLAS adds and rounds in the way of the processor's type.
    """
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([row[0] * x + row[1] * y for row in matrix])


def distance(a: Pose2 | tuple[float, float], b: Pose2 | tuple[float, float]) -> float:
    """Euclidean distance of two positions [m]."""
    return math.hypot(a[0] - b[0], a[1] - b[1])


def levelling(up: tuple[float, float, float]) -> FloatArray:
    """Projection of a leaning body's scan plane onto the floor: (2, 2) from x, y in base_link to ahead and left.

    Ahead is where base_link's x axis points, seen from above (the yaw of ``Pose2``).

    Args:
        up: The vertical in base_link, a unit vector.
    """
    ahead = math.sqrt(max(1.0 - up[0] * up[0], 1e-6))
    return np.array([[ahead, -up[0] * up[1] / ahead], [0.0, up[2] / ahead]])
