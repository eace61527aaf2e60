"""The metrics of an episode, accumulated tick by tick from the true state. Nothing here reaches the stack."""

import math
from dataclasses import dataclass

from vuca_nav.geometry import compose, distance
from vuca_nav.task import GOAL_TOLERANCE, risk_score
from vuca_nav.types import Pose2, Scan

TIMING_FIELDS = ("real_time_factor", "wall_time", "set_up_time")
"""The fields of a result that depend on the computer: all others are the same bits for the same seed."""

ESTIMATE_DIGITS = 9
"""Digits of the errors of an estimate: one that comes over a wire, as the transform of map to odom, differs from the
stack's own in the last bits. To a nanometre they are the same numbers."""


def success_weighted_path_length(
    success: bool, shortest: float, path_length: float, tolerance: float = GOAL_TOLERANCE
) -> float:
    """SPL of one episode (Anderson et al. 2018, "On Evaluation of Embodied Navigation Agents").

    A start within the tolerance of its goal asks for no way at all: then any success is 1.

    Args:
        success: Whether the goal was reached.
        shortest: Length of the shortest way from start to goal [m].
        path_length: Length of the way taken [m].
        tolerance: Distance from the goal within which it counts as reached [m].
    """
    if not success:
        return 0.0
    return 1.0 if shortest <= tolerance else shortest / max(shortest, path_length)


@dataclass(frozen=True, slots=True)
class Metrics:
    """Measurements of one episode."""

    steps: int
    """Control steps, 30 a second."""
    path_length: float
    """Length of the true path [m]."""
    spl: float
    """1 for the shortest way, 0 for a failure."""
    arsps: float
    """Average risk score per step; less is better."""
    ansps: float
    """Average navigation score per step: the share of the straight-line distance covered, over the steps."""
    min_clearance: float
    """Least true clearance of the footprint, in the plane, to any obstacle or mover below the robot's height [m]. It is
    that of the prism over the footprint, as tall as the robot, which holds the body: a body that is narrower at some
    height keeps farther off than this, and 0 need not be a contact."""
    slam_ate: float
    """Root mean square of the online estimate's position error over the episode [m]. Nothing is aligned: the
    start pose is given."""
    slam_final_error: float
    """Position error of the last online estimate [m]."""
    odometry_ate: float
    """Root mean square position error of dead reckoning: odometry alone, from the same start [m]."""
    odometry_final_error: float
    """Position error of dead reckoning at the end [m]."""


class MetricsRecorder:
    """Accumulates the metrics of one episode in constant memory.

    Args:
        start: Pose at the start, which is given to the stack.
        goal: The goal [m].
        shortest: Length of the shortest way [m].
        tolerance: Distance from the goal within which it counts as reached [m].
    """

    def __init__(self, start: Pose2, goal: tuple[float, float], shortest: float, tolerance: float = GOAL_TOLERANCE):
        self._start = start
        self._goal = goal
        self._shortest, self._tolerance = shortest, tolerance
        self._last = start
        self._steps = 0
        self._path_length = 0.0
        self._risk = 0.0
        self._min_clearance = math.inf
        self._slam_squares = self._odometry_squares = 0.0
        self._slam_error = self._odometry_error = 0.0

    def add(self, scan: Scan, odom_from_base: Pose2, true_pose: Pose2, estimate: Pose2, clearance: float) -> None:
        """Add one step, after it was made.

        Args:
            scan: The scan that this step was decided on.
            odom_from_base: Odometry at that moment, the identity at the start.
            true_pose: True pose at that moment.
            estimate: The stack's estimate of the pose, from that scan and that odometry.
            clearance: True clearance of the footprint at that moment [m].
        """
        self._steps += 1
        self._risk += float(risk_score(float(scan.ranges.min())))
        self._path_length += distance(self._last, true_pose)
        self._last = true_pose
        self._min_clearance = min(self._min_clearance, clearance)
        self._slam_error = distance(estimate, true_pose)
        self._odometry_error = distance(compose(self._start, odom_from_base), true_pose)
        self._slam_squares += self._slam_error**2
        self._odometry_squares += self._odometry_error**2

    def finish(self, end: Pose2, clearance: float, success: bool) -> Metrics:
        """The episode's metrics.

        Args:
            end: True pose after the last step.
            clearance: True clearance at that moment [m].
            success: Whether the goal was reached.

        Raises:
            ValueError: There was no step.
        """
        if self._steps == 0:
            raise ValueError("an episode without steps has no metrics")
        n = self._steps
        path_length = self._path_length + distance(self._last, end)
        at_start, at_end = distance(self._start, self._goal), distance(end, self._goal)
        return Metrics(
            steps=n,
            path_length=path_length,
            spl=success_weighted_path_length(success, self._shortest, path_length, self._tolerance),
            arsps=self._risk / n,
            ansps=(at_start - at_end) / (at_start * n) if at_start > 0.0 else 0.0,
            min_clearance=min(self._min_clearance, clearance),
            slam_ate=round(math.sqrt(self._slam_squares / n), ESTIMATE_DIGITS),
            slam_final_error=round(self._slam_error, ESTIMATE_DIGITS),
            odometry_ate=math.sqrt(self._odometry_squares / n),
            odometry_final_error=self._odometry_error,
        )
