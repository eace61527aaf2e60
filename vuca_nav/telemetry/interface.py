"""What a run tells about itself. One interface: this base class ignores everything, a recorder overrides it.

The stack and the simulation call these unconditionally; nothing in them asks whether anybody listens.
Arguments are borrowed: an implementation that keeps an array copies it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.types import FloatArray, Pose2, Scan, VelocityCommand


@dataclass(frozen=True, slots=True)
class SceneShape:
    """A coloured upright shape of the scene."""

    name: str
    kind: str
    """"box" or "cylinder"."""
    half_size: tuple[float, float, float]
    """Of a box along its own axes; radius, radius, half height of a cylinder [m]."""
    centre: tuple[float, float, float]
    """In the world, or in the mover's frame [m]."""
    yaw: float
    """[rad]"""
    category: str
    """"wall", "block", "shelf", "pillar", "low" or a mover's kind: it decides the colour."""


@dataclass(frozen=True, slots=True)
class MeshPart:
    """A rigid visual of the robot."""

    name: str
    vertices: NDArray[np.float32]
    """(n, 3) in the frame of the body it hangs on [m]."""
    faces: NDArray[np.uint32]
    """(m, 3) indices of vertices."""
    colour: tuple[int, int, int]
    """RGB, 0-255."""


@dataclass(frozen=True, slots=True)
class FrontierView:
    """The candidates of one decision of the explorer, best first is not required."""

    points_in_map: FloatArray
    """(n, 2) [m]"""
    goal_term: FloatArray
    """(n,) D^h more than the best has [m]."""
    safety_term: FloatArray
    """(n,) what V^h costs more than the safest, gamma times [m]."""
    score: FloatArray
    """(n,) their sum, what is minimised [m]."""
    chosen: int
    """Index of the chosen one, -1 if none."""


class Telemetry:
    """Ignores everything."""

    # -- the simulation's side: what is true -------------------------------------------------------

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
        """Everything that follows happened at this time of the simulation or robot clock [s]."""

    def robot_parts(self, positions: FloatArray, quaternions: FloatArray) -> None:
        """True poses of the robot's parts in the world: (n, 3) [m] and (n, 4) as w, x, y, z."""

    def true_pose(self, world_from_base: Pose2) -> None:
        """Where the robot really is."""

    def movers(self, poses: FloatArray) -> None:
        """True poses of the movers' parts: (n, 3) x, y, yaw in the world; centre heights are static."""

    # -- the stack's side: what it knows and wants -------------------------------------------------

    def scan(self, scan: Scan, points_in_map: FloatArray) -> None:
        """The returns of one scan as the stack places them, (n, 2) [m]."""

    def estimated_pose(self, map_from_base: Pose2, map_from_base_by_odometry: Pose2) -> None:
        """Where SLAM, and where dead reckoning, believes the robot is."""

    def map_correction(self, map_correction: Pose2) -> None:
        """The map has moved in itself: what was drawn into it, trails too, moves by this transform."""

    def grid(self, grid: OccupancyGrid) -> None:
        """The navigation grid as it is now; ``grid.probability()`` is what one would draw."""

    def entropy(self, entropy: float) -> None:
        """Of the map, against an unseen one (Section III-C) [nat]."""

    def frontiers(self, view: FrontierView) -> None:
        """One decision of the explorer."""

    def path(self, points_in_map: FloatArray) -> None:
        """The planned path, (n, 2) [m]; empty if there is none."""

    def waypoint(self, point_in_map: tuple[float, float]) -> None:
        """What the local policy heads for [m]."""

    def command(self, command: VelocityCommand) -> None:
        """What the local policy asks of the body."""

    def gate(self, shares: FloatArray) -> None:
        """Shares of the local policy's experts in the command of this tick, (E,); they add up to 1."""

    def safety(self, rate: Callable[[FloatArray], FloatArray]) -> None:
        """The critic can be asked now, at a decision of the explorer.

        Args:
            rate: Gives V^h (n,) of points (n, 2) in the map [m]; valid until this returns.
        """

    def event(self, text: str, level: str = "INFO") -> None:
        """Something an engineer will look for: a trigger, a recovery, a collision.

        Args:
            text: One line.
            level: "INFO", "WARN" or "ERROR".
        """

    def wait(self) -> None:
        """After the run, before ``close``: return once nobody watches it through this process any more."""

    def close(self) -> None:
        """Flush and release."""
