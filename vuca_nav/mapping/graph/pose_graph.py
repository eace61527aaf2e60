"""The pose graph: nodes are submaps, edges what is known of the displacement between two of them.

Least squares by Gauss-Newton on the normal equations, as a sparse system (Grisetti et al. 2010, "A tutorial on
graph-based SLAM"); loop closures have a Cauchy kernel, so that a wrong one loses its say. The kernel is wide at first
and narrows from step to step (graduated non-convexity, Yang et al. 2020): the first closure of a large loop is as far
off as a wrong one, until the loop has bent.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from vuca_nav.types import FloatArray, Pose2

KERNEL = 3.0
"""Deviations at which a closure's weight has fallen to a half."""
ITERATIONS = 20
"""Greatest number of steps of an optimisation."""
NARROWING = 0.5
"""Factor on the kernel's width from one step to the next."""
CONVERGED = 1e-4
"""Step below which an optimisation ends [m, rad]."""


class Edge(NamedTuple):
    """A pose that two nodes know of: it lies at ``in_first`` in the frame of one, at ``in_second`` in the other's."""

    first: int
    second: int
    in_first: Pose2
    in_second: Pose2
    information: FloatArray
    """(3, 3) inverse covariance of their difference in the frame of that pose [1 / m^2, ...]."""
    is_closure: bool


class PoseGraph:
    """Nodes and edges; node 0 is where it is."""

    def __init__(self):
        self.poses: list[Pose2] = []
        self.edges: list[Edge] = []

    def add_node(self, pose: Pose2) -> int:
        """Add a node and return its number."""
        self.poses.append(pose)
        return len(self.poses) - 1

    def optimise(self) -> None:
        """Move the nodes to where the edges agree best."""
        for _ in self.steps():
            pass

    def steps(self) -> Iterator[None]:
        """Optimise in pieces; the nodes move with the last one. No nodes or edges may come meanwhile."""
        poses = np.array(self.poses)
        if not self.edges or len(poses) < 2:
            return
        arrays = _Arrays.of(self.edges)
        width = max(self._widest(poses, arrays), KERNEL)
        for _ in range(ITERATIONS):
            step = _step(poses, arrays, width)
            poses += step
            if width <= KERNEL and abs(step).max() < CONVERGED:
                break
            width = max(NARROWING * width, KERNEL)
            yield
        self.poses = [Pose2(x, y, _wrapped(yaw)) for x, y, yaw in poses.tolist()]

    def _widest(self, poses: FloatArray, arrays: "_Arrays") -> float:
        """Greatest deviation of a closure."""
        errors, _, _ = _residuals(poses, arrays)
        squared = _quadratic(errors, arrays.information)[arrays.is_closure]
        return math.sqrt(float(squared.max())) if len(squared) else 0.0

    def deviations(self) -> FloatArray:
        """Deviations of each edge from what the nodes say: square roots of the quadratic forms (n,)."""
        arrays = _Arrays.of(self.edges)
        errors, _, _ = _residuals(np.array(self.poses), arrays)
        return np.sqrt(_quadratic(errors, arrays.information))


class _Arrays(NamedTuple):
    """Edges as arrays."""

    first: np.ndarray
    second: np.ndarray
    in_first: FloatArray
    in_second: FloatArray
    information: FloatArray
    is_closure: np.ndarray

    @classmethod
    def of(cls, edges: list[Edge]) -> "_Arrays":
        first, second, in_first, in_second, information, is_closure = zip(*edges)
        return cls(
            np.array(first),
            np.array(second),
            np.array(in_first),
            np.array(in_second),
            np.array(information),
            np.array(is_closure),
        )


def _wrapped(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _quadratic(errors: FloatArray, information: FloatArray) -> FloatArray:
    return (errors[:, :, None] * information * errors[:, None, :]).sum(axis=(1, 2))


def _residuals(poses: FloatArray, arrays: _Arrays) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors (n, 3) and their Jacobians by the first and second node (n, 3, 3)."""
    first, second = poses[arrays.first], poses[arrays.second]
    lever_first = _turned(first[:, 2], arrays.in_first[:, :2])
    lever_second = _turned(second[:, 2], arrays.in_second[:, :2])
    yaw = first[:, 2] + arrays.in_first[:, 2]
    off = _turned(-yaw, second[:, :2] + lever_second - first[:, :2] - lever_first)
    turn = _wrapped(second[:, 2] + arrays.in_second[:, 2] - yaw)
    c, s = np.cos(yaw), np.sin(yaw)
    by_first, by_second = np.zeros((len(yaw), 3, 3)), np.zeros((len(yaw), 3, 3))
    by_second[:, 0, 0], by_second[:, 0, 1], by_second[:, 1, 0], by_second[:, 1, 1] = c, s, -s, c
    by_second[:, :2, 2] = _turned(-yaw, _left(lever_second))
    by_second[:, 2, 2] = 1.0
    by_first[:, :2, :2] = -by_second[:, :2, :2]
    by_first[:, :2, 2] = -_turned(-yaw, _left(lever_first)) - _left(off)
    by_first[:, 2, 2] = -1.0
    return np.column_stack([off, turn]), by_first, by_second


def _turned(yaw: FloatArray, points: FloatArray) -> FloatArray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]])


def _left(points: FloatArray) -> FloatArray:
    """Points turned by a quarter."""
    return np.column_stack([-points[:, 1], points[:, 0]])


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of matrices (n, 3, 3), transposed the first, added in a fixed order."""
    return (a[:, :, :, None] * b[:, :, None, :]).sum(axis=1)


def _step(poses: FloatArray, arrays: _Arrays, width: float) -> FloatArray:
    """One step of Gauss-Newton (n, 3), with a kernel of this width."""
    errors, by_first, by_second = _residuals(poses, arrays)
    squared = _quadratic(errors, arrays.information)
    weights = np.where(arrays.is_closure, 1.0 / (1.0 + squared / width**2), 1.0)
    information = arrays.information * weights[:, None, None]
    n = len(poses)
    rows, columns, values = [], [], []
    gradient = np.zeros(3 * n)
    sides = ((arrays.first, by_first), (arrays.second, by_second))
    index = np.arange(3)
    for at, jacobian in sides:
        weighted = _product(information, jacobian)  # information is symmetric
        np.add.at(gradient, 3 * at[:, None] + index, -(weighted * errors[:, :, None]).sum(axis=1))
        for other, other_jacobian in sides:
            block = _product(weighted, other_jacobian)
            rows.append(np.broadcast_to(3 * at[:, None, None] + index[:, None], block.shape).ravel())
            columns.append(np.broadcast_to(3 * other[:, None, None] + index, block.shape).ravel())
            values.append(block.ravel())
    matrix = sparse.coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(3 * n, 3 * n)
    ).tocsc()
    free = matrix[3:, 3:] + 1e-9 * sparse.identity(3 * n - 3, format="csc")
    step = np.zeros((n, 3))
    step[1:] = splu(free).solve(gradient[3:]).reshape(-1, 3)
    return step
