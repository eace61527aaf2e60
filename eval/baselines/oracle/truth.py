"""The ground truth as the oracles are given it, and what is made of it: futures of the movers."""

import copy
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.bodies.body import Body
from robots.simulation import Simulation
from vuca_nav.types import FloatArray, Pose2
from worlds.arrays import ShapeArrays
from worlds.clearance import ClearanceField
from worlds.motion.movers import TICK_RATE, MoverField
from worlds.world import World

CROWD_FORESIGHT = 10.0
"""Time for which the motion of pedestrians is foreseen, the robot taken to stand where it is [s]."""


class Truth(NamedTuple):
    """All that there is to know of an episode."""

    world: World
    body: Body
    simulation: Simulation

    @property
    def pose(self) -> Pose2:
        """The robot's true pose in the world."""
        return self.simulation.true_pose

    @property
    def movers(self) -> MoverField:
        """The movers as they are now; stepping them is the simulation's part."""
        return self.simulation.movers

    @property
    def reacts(self) -> bool:
        """Whether a mover reacts to the robot, so that its future is not known."""
        return any(mover.sees_robot for mover in self.world.movers)


class Outlines(NamedTuple):
    """Shapes of all movers' parts, and which mover they belong to, for kernels."""

    is_cylinder: NDArray[np.bool_]
    """(p,)"""
    half: FloatArray
    """(p, 2) half length and half width, or the radius twice [m]; negative where the robot passes beneath."""
    first: NDArray[np.int64]
    """(m + 1,) index of each mover's first part, and p."""
    radii: FloatArray
    """(m,) radius of the circle that holds a mover [m]."""


class Future(NamedTuple):
    """Places of all movers at ticks of 1/30 s, the first being now; afterwards there are none."""

    movers: FloatArray
    """(ticks, m, 2) [m]"""
    parts: FloatArray
    """(ticks, p, 4) x, y [m], cosine and sine of the yaw."""


def outlines_of(movers: MoverField, height: float) -> Outlines:
    """Outlines of the parts that a robot of this height can touch."""
    shapes: ShapeArrays = movers.part_shapes
    within = (shapes.z[:, 0] < height) & (shapes.z[:, 1] > 0.0)
    half = np.where(within[:, None], shapes.half, -1.0)
    count = len(movers.world.movers)
    first = np.searchsorted(movers.part_mover, np.arange(count + 1))
    radii = np.array([mover.radius for mover in movers.world.movers], np.float64)
    return Outlines(shapes.is_cylinder, half, first.astype(np.int64), radii)


def foreseen(movers: MoverField, duration: float, robot: tuple[float, float, float] | None) -> Future:
    """The movers' future, by letting a copy of them go on.

    Args:
        movers: The movers now; they are left as they are.
        duration: Length of the future [s].
        robot: x, y, radius of a robot that stands [m]; None for none.
    """
    ahead = copy.deepcopy(movers)
    ticks = math.ceil(duration * TICK_RATE) + 1
    future = Future(np.empty((ticks, len(ahead.poses), 2)), np.empty((ticks, len(ahead.part_poses), 4)))
    for tick in range(ticks):
        _write(future, tick, ahead.poses, ahead.part_poses)
        ahead.step(1.0 / TICK_RATE, robot)
    return future


def straight_on(movers: MoverField, duration: float, static: ClearanceField, viewer: Pose2, sight: float) -> Future:
    """The future if the movers in sight go straight on; the others are left out.

    Args:
        movers: The movers now.
        duration: Length of the future [s].
        static: Clearance of the static obstacles, which hide movers.
        viewer: The robot's pose.
        sight: Range of the lidar [m].
    """
    ticks = math.ceil(duration * TICK_RATE) + 1
    future = Future(np.empty((ticks, len(movers.poses), 2)), np.empty((ticks, len(movers.part_poses), 4)))
    hidden = np.array([not _sees(static, viewer, pose, sight) for pose in movers.poses], np.bool_)
    poses, parts = movers.poses.copy(), movers.part_poses.copy()
    poses[hidden, :2] = parts[hidden[movers.part_mover], :2] = math.inf
    for tick in range(ticks):
        way = movers.velocities * (tick / TICK_RATE)
        _write(future, tick, poses + _padded(way), parts + _padded(way[movers.part_mover]))
    return future


def _write(future: Future, tick: int, poses: FloatArray, parts: FloatArray) -> None:
    future.movers[tick] = poses[:, :2]
    future.parts[tick, :, :2] = parts[:, :2]
    future.parts[tick, :, 2], future.parts[tick, :, 3] = np.cos(parts[:, 2]), np.sin(parts[:, 2])


def _padded(way: FloatArray) -> FloatArray:
    return np.column_stack([way, np.zeros(len(way))])


def _sees(static: ClearanceField, viewer: Pose2, pose: FloatArray, sight: float) -> bool:
    """Whether the straight line to a mover's centre is free."""
    away = math.hypot(pose[0] - viewer.x, pose[1] - viewer.y)
    if away > sight:
        return False
    shares = np.linspace(0.0, 1.0, max(2, math.ceil(away / static.resolution)))
    xs, ys = viewer.x + shares * (pose[0] - viewer.x), viewer.y + shares * (pose[1] - viewer.y)
    cells = [static.cell(x, y) for x, y in zip(xs.tolist(), ys.tolist())]
    return all(static.distance[cell] > 0.0 for cell in cells)
