"""Interface of a run's telemetry: the base class ignores everything, a recorder overrides it.

The stack and the simulation call its methods unconditionally, with or without a recorder.
Arguments are borrowed: an implementation that keeps an array copies it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import FloatArray, Pose2, Scan, VelocityCommand


@dataclass(frozen=True, slots=True)
class SceneShape:
    """A coloured upright shape of the scene."""

    name: str
    kind: str
    """"box" or "cylinder"."""
    half_size: tuple[float, float, float]
    """Half sizes of a box along its own axes; radius, radius, half height of a cylinder [m]."""
    centre: tuple[float, float, float]
    """Centre in the world, or in the mover's frame [m]."""
    yaw: float
    """[rad]"""
    category: str
    """"wall", "block", "shelf", "pillar", "low" or a mover's kind: it decides the colour."""
    vanishes: bool = False
    """Whether it may be gone: then its place is infinite."""


@dataclass(frozen=True, slots=True)
class MeshPart:
    """A rigid visual of the robot."""

    name: str
    vertices: NDArray[np.float32]
    """(n, 3) vertices in the frame of the part's body [m]."""
    faces: NDArray[np.uint32]
    """(m, 3) indices of vertices."""
    colour: tuple[int, int, int]
    """RGB, 0-255."""


@dataclass(frozen=True, slots=True)
class FrontierView:
    """The candidates of one decision of the explorer, in any order."""

    points_in_map: FloatArray
    """(n, 2) candidates [m]."""
    goal_term: FloatArray
    """(n,) excess of D^h over the least [m]."""
    safety_term: FloatArray
    """(n,) gamma times the lack of V^h below the safest [m]."""
    score: FloatArray
    """(n,) sum of both terms, which is minimised [m]."""
    chosen: int
    """Index of the chosen candidate, -1 if none."""


class Telemetry:
    """Telemetry that ignores everything."""

    goal_tolerance: float = GOAL_TOLERANCE
    """Distance from the goal within which the mission counts it as reached [m]; set before the mission begins."""

    # -- the simulation's side: the true state -------------------------------------------------------

    def scene(
        self,
        shapes: Sequence[SceneShape],
        bounds: tuple[float, float, float, float],
        goal: tuple[float, float],
    ) -> None:
        """The static obstacles, once."""

    def robot_model(self, parts: Sequence[MeshPart]) -> None:
        """The robot's visuals, once."""

    def mover_model(self, parts: Sequence[SceneShape]) -> None:
        """The parts of the moving obstacles, once; their poses follow with ``movers``."""

    def time(self, seconds: float) -> None:
        """Set the time of everything that follows, by the simulation or robot clock [s]."""

    def robot_parts(self, positions: FloatArray, quaternions: FloatArray) -> None:
        """True poses of the robot's parts in the world: (n, 3) [m] and (n, 4) as w, x, y, z."""

    def true_pose(self, world_from_base: Pose2) -> None:
        """True pose of the robot."""

    def movers(self, poses: FloatArray) -> None:
        """True poses of the movers' parts: (n, 3) x, y, yaw in the world, ``inf`` for one that is not there now."""

    # -- the stack's side: estimates and decisions -------------------------------------------------

    def scan(self, scan: Scan, points_in_map: FloatArray) -> None:
        """The returns of one scan as the stack places them, (n, 2) [m]."""

    def estimated_pose(self, map_from_base: Pose2, map_from_base_by_odometry: Pose2) -> None:
        """Poses of the robot by SLAM and by dead reckoning."""

    def map_correction(self, map_correction: Pose2) -> None:
        """A correction of the map: everything drawn into it, trails too, moves by this transform."""

    def grid(self, grid: OccupancyGrid) -> None:
        """The present navigation grid; ``grid.probability()`` is meant for drawing."""

    def entropy(self, entropy: float) -> None:
        """Entropy of the map, against an unseen one (Zhang et al., Section III-C) [nat]."""

    def frontiers(self, view: FrontierView) -> None:
        """One decision of the explorer."""

    def path(self, points_in_map: FloatArray) -> None:
        """The planned path, (n, 2) [m]; empty if there is none."""

    def waypoint(self, point_in_map: tuple[float, float]) -> None:
        """The waypoint that the local policy heads for [m]."""

    def command(self, command: VelocityCommand) -> None:
        """The local policy's command to the body."""

    def gate(self, shares: FloatArray) -> None:
        """Shares of the local policy's experts in the command of this tick, (E,); they add up to 1."""

    def safety(self, rate: Callable[[FloatArray], FloatArray]) -> None:
        """The critic can be asked now, at a decision of the explorer.

        Args:
            rate: Gives V^h (n,) of points (n, 2) in the map [m]; valid until this returns.
        """

    def trajectory(self, points_in_map: FloatArray) -> None:
        """The robot's whole way as SLAM knows it by now, (n, 2) [m]; the trail of the estimate goes on from it."""

    def closures(self, ends_in_map: FloatArray) -> None:
        """All loop closures that SLAM goes by: the two submaps that each ties together, (n, 2, 2) [m]."""

    def scan_time(self, milliseconds: float) -> None:
        """Time that SLAM took for the scan of this tick [ms]."""

    def event(self, text: str, level: str = "INFO") -> None:
        """An event of interest to an engineer: a trigger, a recovery, a collision.

        Args:
            text: One line.
            level: "INFO", "WARN" or "ERROR".
        """

    def moment(self, seconds: float, point_in_world: tuple[float, float], text: str) -> None:
        """A moment that was found to matter when the run was over.

        Args:
            seconds: Its time, by the clock of ``time`` [s].
            point_in_world: Where it was [m].
            text: One line.
        """

    def wait(self) -> None:
        """Return once no viewer needs this process any more; call it after the run, before ``close``."""

    def close(self) -> None:
        """Flush and release."""
