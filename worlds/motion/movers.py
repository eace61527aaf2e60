"""Positions of the moving obstacles, stepped by compiled kernels and determined by the world alone.

Decisions are taken at fixed ticks (30 a second) whatever the caller's time step, and between ticks everything
moves on straight lines: the motion is a function of time, the same for a physics step of 1/300 s and a planning
step of 1/10 s. Only the motion of movers that see the robot also depends on its place at each tick.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.arrays import ShapeArrays, pack_shapes
from worlds.motion.drivers import TICK, TICK_RATE, CrowdDriver, WalkDriver
from worlds.motion.interface import MotionDriver, gather
from worlds.motion.keyframes import KeyframeDriver
from worlds.motion.mover_columns import (
    KEYFRAMES,
    PATROL,
    RANDOM_WALK,
    SOCIAL_FORCE,
    USER_MOTION,
    V_X,
    V_Y,
    WALKED,
    YAW,
    X,
    Y,
)
from worlds.motion.user_motion import UserDriver
from worlds.world import STRIDE, World

DRIVERS: tuple[tuple[type[MotionDriver], tuple[int, ...]], ...] = (
    (KeyframeDriver, (KEYFRAMES,)),
    (UserDriver, (USER_MOTION,)),
    (WalkDriver, (RANDOM_WALK, PATROL)),
    (CrowdDriver, (SOCIAL_FORCE,)),
)
"""Who moves which kinds of motion, in the order in which they decide: those that react come last."""
TURN_RATE = 6.0
"""Greatest yaw rate of a mover's own shape towards its direction of motion [rad/s]."""


@njit(cache=True)
def _yaw_rate(state, i):
    """Yaw rate of a mover towards its direction of motion, until the next tick [rad/s]."""
    if state[i, V_X] == 0.0 and state[i, V_Y] == 0.0:
        return 0.0
    error = math.atan2(state[i, V_Y], state[i, V_X]) - state[i, YAW]
    error = (error + math.pi) % (2.0 * math.pi) - math.pi
    return min(max(error * TICK_RATE, -TURN_RATE), TURN_RATE)


@njit(cache=True)
def _move(state, dt):
    """Move all straight on for a whole tick."""
    for i in range(len(state)):
        state[i, YAW] += _yaw_rate(state, i) * dt
        state[i, X] += state[i, V_X] * dt
        state[i, Y] += state[i, V_Y] * dt
        state[i, WALKED] += math.sqrt(state[i, V_X] ** 2 + state[i, V_Y] ** 2) * dt


@njit(cache=True)
def _write_movers(since_tick, state, poses, velocities, walked):
    """Write poses, velocities and distances walked at a time after the last tick."""
    for i in range(len(state)):
        poses[i, 0] = state[i, X] + state[i, V_X] * since_tick
        poses[i, 1] = state[i, Y] + state[i, V_Y] * since_tick
        yaw = state[i, YAW] + _yaw_rate(state, i) * since_tick
        poses[i, 2] = (yaw + math.pi) % (2.0 * math.pi) - math.pi
        velocities[i, 0], velocities[i, 1] = state[i, V_X], state[i, V_Y]
        walked[i] = state[i, WALKED] + math.sqrt(state[i, V_X] ** 2 + state[i, V_Y] ** 2) * since_tick


@njit(cache=True)
def _write_parts(parts, part_mover, poses, walked, part_poses):
    """Write the poses of all parts."""
    for p in range(len(parts)):
        i = part_mover[p]
        px = parts[p, 0] + parts[p, 3] * math.sin(2.0 * math.pi / STRIDE * walked[i])
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        part_poses[p, 0] = poses[i, 0] + cos * px - sin * parts[p, 1]
        part_poses[p, 1] = poses[i, 1] + sin * px + cos * parts[p, 1]
        part_poses[p, 2] = poses[i, 2] + parts[p, 2]


class MoverField:
    """All moving obstacles of a world over time. The arrays are updated in place by each step.

    Each kind of motion has a driver (``DRIVERS``), all behind one interface (``worlds.motion.interface``).

    Movers on a random walk keep to the part of the free space that is at least 2.2 m wide. They turn away from
    other movers that come near; in a press they may brush through each other, rather than tremble on the spot. Patrols
    follow their line through anything. Of the robot all of them know only if they are sighted (``Mover.sees_robot``).
    What hangs above the tallest mover is in no mover's way. Movers by keyframes are where these say, at any time; one
    that is not there is infinitely far away, so that no beam, contact or clearance finds it.

    Attributes:
        poses: (m, 3) x, y, yaw of the movers in the world, ``inf`` where a mover is not there [m, rad].
        velocities: (m, 2) in the world [m/s].
        part_poses: (p, 3) x, y, yaw of every part's own centre in the world [m, rad].
        part_shapes: p shapes in their mover's frame, in the order of ``part_poses``.
        part_mover: (p,) index of the mover that a part belongs to.
        time: Time since the start [s].
    """

    def __init__(self, world: World):
        movers = world.movers
        m = len(movers)
        self.world = world
        self.time = 0.0
        self.poses: FloatArray = np.zeros((m, 3))
        self.velocities: FloatArray = np.zeros((m, 2))
        parts = [(i, part) for i, mover in enumerate(movers) for part in mover.parts]
        self.part_shapes: ShapeArrays = pack_shapes([part.shape for _, part in parts])
        self.part_mover = np.array([i for i, _ in parts], np.int64)
        self.part_poses: FloatArray = np.zeros((len(parts), 3))
        self._parts = np.array(
            [(*self.part_shapes.centre[p], self.part_shapes.yaw[p], part.swing) for p, (_, part) in enumerate(parts)]
        ).reshape(-1, 4)
        self._movers = gather(world)
        self._robot = np.array([0.0, 0.0, -1.0])
        # A driver per kind of motion that there is, each with the arrays that it shares with the others.
        self._drivers = [driver(self._movers) for driver, kinds in DRIVERS if len(self._movers.rows(*kinds))]
        self.reset()

    @property
    def present(self) -> NDArray[np.bool_]:
        """(m,) whether each mover is there now; one that is not has an infinite place."""
        return self._movers.present

    def reset(self) -> None:
        """Go back to the start, every random stream included."""
        self.time, self._ticks = 0.0, 0
        state = self._movers.state
        state[:] = 0.0
        for i, mover in enumerate(self.world.movers):
            state[i, : YAW + 1] = mover.start
        for driver in self._drivers:
            driver.reset(self._movers)
        self._decide(None)
        self._write_out(0.0)

    def step(self, dt: float, robot: tuple[float, float, float] | None = None) -> None:
        """Move all movers on.

        Args:
            dt: Any time step [s]; the motion does not depend on how the time is cut into steps.
            robot: x, y, radius of the robot [m], which sighted movers avoid; None if there is none.
        """
        self.time += dt
        # A millionth of a tick of slack: 10 steps of 1/300 s are one tick, whatever the rounding.
        due = int(self.time * TICK_RATE + 1e-6)
        while self._ticks < due:
            _move(self._movers.state, TICK)
            self._ticks += 1
            self._decide(robot)
        self._write_out(max(self.time - due * TICK, 0.0))

    def _decide(self, robot: tuple[float, float, float] | None) -> None:
        """Take one tick's decisions."""
        self._robot[:] = (0.0, 0.0, -1.0) if robot is None else robot
        for driver in self._drivers:
            driver.decide(self._ticks * TICK, self._movers, self._robot)

    def _write_out(self, since_tick: float) -> None:
        """Write where all are at a time after the last tick [s]."""
        movers, poses = self._movers, self.poses
        _write_movers(since_tick, movers.state, poses, self.velocities, movers.walked)
        for driver in self._drivers:
            driver.locate(self.time, movers, poses, self.velocities)
        if not movers.present.all():
            gone = ~movers.present
            poses[gone, :2], self.velocities[gone] = math.inf, 0.0
        _write_parts(self._parts, self.part_mover, poses, movers.walked, self.part_poses)
