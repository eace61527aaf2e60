"""The one interface of every kind of motion: what the movers share, and who moves which of them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vuca_nav.types import FloatArray
from worlds.clearance import clearance_field, distance_to_wide_ways
from worlds.motion.mover_columns import (
    FIRST_WAYPOINT,
    KEYFRAMES,
    MOTION,
    PATROL,
    RADIUS,
    RANDOM_WALK,
    SOCIAL_FORCE,
    SPEED,
    STATE_SIZE,
    USER_MOTION,
    WAYPOINTS,
)
from worlds.scenes.parts.population import MOVER_WAY
from worlds.world import Keyframes, Patrol, RandomWalk, SocialForce, World

_KINDS = {
    RandomWalk: RANDOM_WALK,
    Patrol: PATROL,
    SocialForce: SOCIAL_FORCE,
    Keyframes: KEYFRAMES,
}
FAR = 1e9
"""Coordinate of a mover that is not there, for those that are [m]: finite, so that no difference becomes NaN."""


@dataclass(frozen=True)
class Movers:
    """All movers of a world as the drivers share them; only the contents of the arrays change."""

    world: World
    constants: FloatArray
    """(m, 5) columns of ``mover_columns``."""
    state: FloatArray
    """(m, STATE_SIZE) columns of ``mover_columns``; a mover that is not there is ``FAR`` away."""
    sees: NDArray[np.bool_]
    """(m,) whether each mover sees the robot."""
    present: NDArray[np.bool_]
    """(m,) whether each mover is there now."""
    waypoints: FloatArray
    """(n, 2) waypoints of patrols and pedestrians [m]."""
    clearance: NDArray[np.float32]
    """(rows, columns) distance of each cell's centre to the nearest wall [m]."""
    away: NDArray[np.float32]
    """(rows, columns) distance of each cell to the wide ways that random walks keep to [m]."""
    grid: FloatArray
    """Origin x, y and resolution of ``clearance`` and ``away`` [m]."""
    walked: FloatArray = field(init=False)
    """(m,) distance that each mover has walked [m]."""

    def __post_init__(self):
        object.__setattr__(self, "walked", np.zeros(len(self.state)))

    def rows(self, *kinds: int) -> NDArray[np.int64]:
        """Indices of the movers of some kinds."""
        return np.flatnonzero(np.isin(self.constants[:, MOTION], kinds))


class MotionDriver(ABC):
    """Moves the movers of some kinds. At each tick it decides on velocities; between ticks all go straight on.

    A copy of a driver (``copy.deepcopy``) goes on like the original: planners that know the future let one run ahead.
    """

    def __init__(self, movers: Movers):  # noqa: B027
        """Take the movers in; the arrays stay the same objects."""

    def reset(self, movers: Movers) -> None:  # noqa: B027  (most have nothing to forget)
        """Go back to the start. The state holds the start poses already."""

    @abstractmethod
    def decide(self, time: float, movers: Movers, robot: FloatArray) -> None:
        """Write the velocities of its movers until the next tick, and where it knows better their places.

        Args:
            time: Time since the start [s].
            movers: All movers.
            robot: x, y, radius of the robot [m]; a negative radius means none.
        """

    def locate(self, time: float, movers: Movers, poses: FloatArray, velocities: FloatArray) -> None:  # noqa: B027
        """Write the exact places at a time between ticks, where straight on from the last tick is not exact.

        Args:
            time: Time since the start [s].
            movers: All movers.
            poses: (m, 3) poses, straight on from the last tick; rows of its movers may be changed.
            velocities: (m, 2) velocities, likewise.
        """


def gather(world: World) -> Movers:
    """The movers of a world, at rest at their starts."""
    movers, m = world.movers, len(world.movers)
    constants, waypoints = np.zeros((m, 5)), []
    for i, mover in enumerate(movers):
        motion = mover.motion
        constants[i, MOTION] = _KINDS.get(type(motion), USER_MOTION)
        constants[i, SPEED], constants[i, RADIUS] = motion.speed, mover.radius
        if isinstance(motion, Patrol | SocialForce):
            constants[i, FIRST_WAYPOINT], constants[i, WAYPOINTS] = len(waypoints), len(motion.waypoints)
            waypoints += motion.waypoints
    away = clearance = np.zeros((1, 1), np.float32)
    grid = np.array([0.0, 0.0, 1.0])
    if any(not isinstance(mover.motion, Keyframes) for mover in movers):
        space = clearance_field(world.below(world.mover_height), world.bounds, is_open=world.open_borders)
        away = distance_to_wide_ways(space, MOVER_WAY).astype(np.float32)
        clearance = space.distance.astype(np.float32)
        grid = np.array([*space.origin, space.resolution])
    return Movers(
        world,
        constants,
        np.zeros((m, STATE_SIZE)),
        np.array([mover.sees_robot for mover in movers], np.bool_),
        np.ones(m, np.bool_),
        np.array(waypoints, float).reshape(-1, 2),
        clearance,
        away,
        grid,
    )
