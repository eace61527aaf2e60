"""Positions of the moving obstacles, stepped by compiled kernels and determined by the world alone.

Decisions are taken at fixed ticks (30 a second) whatever the caller's time step, and between ticks everything
moves on straight lines: the motion is a function of time, the same for a physics step of 1/300 s and a planning
step of 1/10 s. Only the motion of movers that see the robot also depends on its place at each tick.
"""

import math

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.arrays import ShapeArrays, pack_shapes
from worlds.clearance import clearance_field, distance_to_wide_ways
from worlds.motion.crowd import social_force_tick
from worlds.motion.mover_columns import (
    DIRECTION,
    FIRST_WAYPOINT,
    MOTION,
    PATROL,
    RADIUS,
    RANDOM_WALK,
    SINCE_TURN,
    SOCIAL_FORCE,
    SPEED,
    STATE_SIZE,
    TARGET,
    V_X,
    V_Y,
    WALKED,
    WAYPOINTS,
    YAW,
    X,
    Y,
)
from worlds.motion.sighted import push_aside, recall_own_walk
from worlds.motion.walk import PATIENCE, decide
from worlds.scenes.parts.population import MOVER_WAY
from worlds.world import STRIDE, Patrol, RandomWalk, World

TICK_RATE = 30.0
"""Rate of decisions [Hz]."""
TICK = 1.0 / TICK_RATE
"""Time between two decisions [s]."""
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
def _write_out(since_tick, state, parts, part_mover, poses, velocities, part_poses):
    """Write poses and velocities at a time after the last tick."""
    for i in range(len(state)):
        poses[i, 0] = state[i, X] + state[i, V_X] * since_tick
        poses[i, 1] = state[i, Y] + state[i, V_Y] * since_tick
        yaw = state[i, YAW] + _yaw_rate(state, i) * since_tick
        poses[i, 2] = (yaw + math.pi) % (2.0 * math.pi) - math.pi
        velocities[i, 0], velocities[i, 1] = state[i, V_X], state[i, V_Y]
    for p in range(len(parts)):
        i = part_mover[p]
        walked = state[i, WALKED] + math.sqrt(state[i, V_X] ** 2 + state[i, V_Y] ** 2) * since_tick
        px = parts[p, 0] + parts[p, 3] * math.sin(2.0 * math.pi / STRIDE * walked)
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        part_poses[p, 0] = poses[i, 0] + cos * px - sin * parts[p, 1]
        part_poses[p, 1] = poses[i, 1] + sin * px + cos * parts[p, 1]
        part_poses[p, 2] = poses[i, 2] + parts[p, 2]


class MoverField:
    """All moving obstacles of a world over time. The arrays are updated in place by each step.

    Movers on a random walk keep to the part of the free space that is at least 2.2 m wide. They turn away from
    other movers that come near; in a press they may brush through each other, rather than tremble on the spot. Patrols
    follow their line through anything. Of the robot all of them know only if they are sighted (``Mover.sees_robot``).
    What hangs above the tallest mover is in no mover's way.

    Attributes:
        poses: (m, 3) x, y, yaw of the movers in the world [m, rad].
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
        self._constants = np.zeros((m, 5))
        self._seeds = np.zeros(m, np.uint64)
        waypoints: list[tuple[float, float]] = []
        for i, mover in enumerate(movers):
            motion = mover.motion
            self._constants[i, SPEED], self._constants[i, RADIUS] = motion.speed, mover.radius
            if isinstance(motion, RandomWalk):
                self._constants[i, MOTION] = RANDOM_WALK
                self._seeds[i] = motion.seed % 2**64
            else:
                self._constants[i, MOTION] = PATROL if isinstance(motion, Patrol) else SOCIAL_FORCE
                self._constants[i, FIRST_WAYPOINT] = len(waypoints)
                self._constants[i, WAYPOINTS] = len(motion.waypoints)
                waypoints += motion.waypoints
        self._waypoints = np.array(waypoints, float).reshape(-1, 2)
        field = clearance_field(world.below(world.mover_height), world.bounds) if m else None
        if field is None:
            self._away = self._clearance = np.zeros((1, 1), np.float32)
            self._grid = np.array([0.0, 0.0, 1.0])
        else:
            self._away = distance_to_wide_ways(field, MOVER_WAY).astype(np.float32)
            self._clearance = field.distance.astype(np.float32)
            self._grid = np.array([*field.origin, field.resolution])
        self._state = np.zeros((m, STATE_SIZE))
        self._counters = np.zeros(m, np.uint64)
        self._robot = np.zeros(3)
        crowd = self._constants[:, MOTION] == SOCIAL_FORCE
        sees = np.array([mover.sees_robot for mover in movers], np.bool_)
        self._has_crowd, self._has_sighted_walks = bool(crowd.any()), bool((sees & ~crowd).any())
        self._aside = np.zeros((m, 4))
        # Only the contents of the kernels' arguments change: bound once, a step looks nothing up.
        self._decision = (
            TICK, self._constants, self._state, self._seeds, self._counters, self._away, self._grid,
            self._waypoints,
        )  # fmt: skip
        self._crowd = (
            TICK, sees, self._constants, self._state, self._clearance, self._grid, self._waypoints, np.zeros((m, 2)),
            self._robot,
        )  # fmt: skip
        self._own_walk = sees, self._constants, self._state, self._aside, self._waypoints
        self._push = (TICK, *self._own_walk, (self._clearance, self._away, self._grid), self._robot)
        self._output = (
            self._state, self._parts, self.part_mover, self.poses, self.velocities, self.part_poses,
        )  # fmt: skip
        self.reset()

    def reset(self) -> None:
        """Go back to the start, every random stream included."""
        self.time, self._ticks = 0.0, 0
        self._state[:] = 0.0
        self._counters[:] = 0
        for i, mover in enumerate(self.world.movers):
            self._state[i, : YAW + 1] = mover.start
            self._state[i, SINCE_TURN] = PATIENCE
            self._state[i, DIRECTION] = 1.0
            if self._constants[i, MOTION] != RANDOM_WALK and self._constants[i, WAYPOINTS] > 1:
                self._state[i, TARGET] = 1.0
        self._aside[:] = 0.0
        self._decide(None)
        _write_out(0.0, *self._output)

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
            _move(self._state, TICK)
            self._decide(robot)
            self._ticks += 1
        _write_out(max(self.time - due * TICK, 0.0), *self._output)

    def _decide(self, robot: tuple[float, float, float] | None) -> None:
        """Take one tick's decisions."""
        # The kernels are called from here, not from another kernel: they live in other files, and Numba's cache
        # would not see that they changed.
        self._robot[:] = (0.0, 0.0, -1.0) if robot is None else robot
        if self._has_sighted_walks:
            recall_own_walk(*self._own_walk)
        decide(*self._decision)
        if self._has_sighted_walks:
            push_aside(*self._push)
        if self._has_crowd:
            social_force_tick(*self._crowd)
