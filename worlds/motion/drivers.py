"""Drivers of the motions that react: random walks and patrols, and pedestrians."""

import numpy as np

from vuca_nav.types import FloatArray
from worlds.motion.crowd import social_force_tick
from worlds.motion.interface import MotionDriver, Movers
from worlds.motion.mover_columns import (
    DIRECTION,
    PATROL,
    RANDOM_WALK,
    SINCE_TURN,
    SOCIAL_FORCE,
    TARGET,
    WAYPOINTS,
)
from worlds.motion.sighted import push_aside, recall_own_walk
from worlds.motion.walk import PATIENCE, decide
from worlds.world import RandomWalk

TICK_RATE = 30.0
"""Rate of decisions [Hz]."""
TICK = 1.0 / TICK_RATE
"""Time between two decisions [s]."""

# The kernels are called from the methods, not from another kernel: they live in other files, and Numba's cache would
# not see that they changed. Their arguments are bound once: only the arrays' contents change.


class WalkDriver(MotionDriver):
    """Random walks and patrols, of which sighted ones give way to the robot."""

    def __init__(self, movers: Movers):
        m = len(movers.state)
        rows = movers.rows(RANDOM_WALK, PATROL)
        self._rows = rows
        self._seeds, self._counters = np.zeros(m, np.uint64), np.zeros(m, np.uint64)
        for i in rows:
            motion = movers.world.movers[i].motion
            if isinstance(motion, RandomWalk):
                self._seeds[i] = motion.seed % 2**64
        sees = np.zeros(m, np.bool_)
        sees[rows] = movers.sees[rows]
        self._any_sees = bool(sees.any())
        self._aside, self._robot = np.zeros((m, 4)), np.zeros(3)
        ways = movers.clearance, movers.away, movers.grid
        self._decision = (
            TICK, movers.constants, movers.state, self._seeds, self._counters, movers.away, movers.grid,
            movers.waypoints,
        )  # fmt: skip
        self._own_walk = sees, movers.constants, movers.state, self._aside, movers.waypoints
        self._push = (TICK, *self._own_walk, ways, self._robot)

    def reset(self, movers: Movers) -> None:
        """Implements :class:`MotionDriver`."""
        self._counters[:], self._aside[:] = 0, 0.0
        movers.state[self._rows, SINCE_TURN] = PATIENCE
        movers.state[self._rows, DIRECTION] = 1.0
        movers.state[self._rows, TARGET] = movers.constants[self._rows, WAYPOINTS] > 1

    def decide(self, time: float, movers: Movers, robot: FloatArray) -> None:
        """Implements :class:`MotionDriver`."""
        self._robot[:] = robot
        if self._any_sees:
            recall_own_walk(*self._own_walk)
        decide(*self._decision)
        if self._any_sees:
            push_aside(*self._push)


class CrowdDriver(MotionDriver):
    """Pedestrians, by the social force model."""

    def __init__(self, movers: Movers):
        self._rows = movers.rows(SOCIAL_FORCE)
        self._robot = np.zeros(3)
        self._arguments = (
            TICK, movers.sees, movers.constants, movers.state, movers.clearance, movers.grid, movers.waypoints,
            np.zeros((len(movers.state), 2)), self._robot,
        )  # fmt: skip

    def reset(self, movers: Movers) -> None:
        """Implements :class:`MotionDriver`."""
        movers.state[self._rows, DIRECTION] = 1.0
        movers.state[self._rows, TARGET] = movers.constants[self._rows, WAYPOINTS] > 1

    def decide(self, time: float, movers: Movers, robot: FloatArray) -> None:
        """Implements :class:`MotionDriver`."""
        self._robot[:] = robot
        social_force_tick(*self._arguments)
