"""The state that each robot of the arena carries from decision to decision."""

from typing import NamedTuple

import numpy as np

from train.arena.bank import MAX_PARTS
from worlds.level_raycast import LEVEL_COLUMNS
from worlds.motion.mover_columns import GOAL_X, GOAL_Y, START_X, START_Y, STATE_SIZE
from worlds.motion.walk import MoverRequest, MoverRows, PartRows

RING = 16
"""Number of past commands that are remembered [ticks]: more than the longest delay."""
SCALE_ODOMETRY, TURN_ODOMETRY = 0, 1
"""Columns of odometry's errors."""
SHORTEST = 4
"""Column of a task, after ``START_X`` to ``GOAL_Y``."""
GAIN, KEEP, DELAY, NOISE, ACCELERATION = range(5)
"""Columns of an episode's response: KEEP is exp(-dt / lag), DELAY is in ticks."""


__all__ = ["GOAL_X", "GOAL_Y", "START_X", "START_Y"]


class Streams(NamedTuple):
    """Random number streams of n rows."""

    seeds: np.ndarray
    """Seed of each stream, (n,) uint64."""
    drawn: np.ndarray
    """Number of numbers drawn from each stream, (n,) uint64."""


class Episodes(NamedTuple):
    """Tasks of n rows."""

    kind: np.ndarray
    layout: np.ndarray
    task: np.ndarray
    ticks: np.ndarray
    time_limit: np.ndarray
    distance: np.ndarray


class Robots(NamedTuple):
    """Bodies of n rows, and their motion."""

    body: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray
    response: np.ndarray
    latency: np.ndarray
    commands: np.ndarray
    pose_error: np.ndarray
    odometry: np.ndarray


class Rows(NamedTuple):
    """State of n robots and their worlds; SI units."""

    kind: np.ndarray
    """Kind of world, index into KINDS, (n,)."""
    body: np.ndarray
    """Index of the body, (n,)."""
    layout: np.ndarray
    """Index of the layout, (n,)."""
    task: np.ndarray
    """Start x, y, goal x, y and length of the shortest path, (n, 5) [m]."""
    pose: np.ndarray
    """x, y, yaw in the world, (n, 3) [m, rad]."""
    velocity: np.ndarray
    """Velocity in base_link without the response's noise, (n, 3)."""
    response: np.ndarray
    """Columns GAIN to ACCELERATION of each axis, (n, 3, 5)."""
    latency: np.ndarray
    """Delay of a command, (n,) [ticks]."""
    commands: np.ndarray
    """Ring of past commands, (n, RING, 3)."""
    ticks: np.ndarray
    """Ticks since the episode's start, (n,)."""
    time_limit: np.ndarray
    """Time limit of the episode, (n,) [ticks]."""
    distance: np.ndarray
    """Distance to the goal, (n,) [m]."""
    pose_error: np.ndarray
    """Error of the pose that the goal is given by, in the world, (n, 3)."""
    odometry: np.ndarray
    """Relative errors of this episode's odometry, (n, 2)."""
    wanted: np.ndarray
    """Number of movers asked for, (n,)."""
    speeds: np.ndarray
    """Slowest and fastest speed of the movers, (n, 2) [m/s]."""
    keep_off: np.ndarray
    """Distance between a mover and the robot at its start, (n,) [m]."""
    world_seed: np.ndarray
    """Seed of the movers, (n,) uint64."""
    counts: np.ndarray
    """Number of movers, (n,)."""
    kinds: np.ndarray
    """(n, m)"""
    constants: np.ndarray
    """(n, m, 5)"""
    movers: np.ndarray
    """(n, m, STATE_SIZE)"""
    headings: np.ndarray
    """cos, sin of the movers' headings, (n, m, 2)."""
    seeds: np.ndarray
    """(n, m)"""
    counters: np.ndarray
    """(n, m)"""
    pauses: np.ndarray
    """(n, m, 4)"""
    waypoints: np.ndarray
    """(n, 2 m, 2)"""
    num_parts: np.ndarray
    """Number of the movers' parts, (n,)."""
    parts: np.ndarray
    """(n, p, LEVEL_COLUMNS)"""
    part_local: np.ndarray
    """(n, p, 5)"""
    part_mover: np.ndarray
    """(n, p)"""
    stream: np.ndarray
    """Seed of the row's random numbers, (n,) uint64."""
    drawn: np.ndarray
    """Number of numbers drawn from them, (n,) uint64."""

    @classmethod
    def zeros(cls, n: int, movers: int) -> "Rows":
        """Make rows that will all be reset."""
        m = max(movers, 1)
        p = m * MAX_PARTS

        def floats(*shape: int) -> np.ndarray:
            return np.zeros((n, *shape))

        def ints(*shape: int) -> np.ndarray:
            return np.zeros((n, *shape), np.int64)

        def words(*shape: int) -> np.ndarray:
            return np.zeros((n, *shape), np.uint64)

        return cls(
            kind=ints(), body=ints(), layout=ints(), task=floats(5), pose=floats(3), velocity=floats(3),
            response=floats(3, 5), latency=ints(), commands=floats(RING, 3), ticks=ints(), time_limit=ints(),
            distance=floats(), pose_error=floats(3), odometry=floats(2), wanted=ints(), speeds=floats(2),
            keep_off=floats(), world_seed=words(), counts=ints(), kinds=ints(m), constants=floats(m, 5),
            movers=floats(m, STATE_SIZE), headings=floats(m, 2), seeds=words(m), counters=words(m),
            pauses=floats(m, 4), waypoints=floats(2 * m, 2), num_parts=ints(), parts=floats(p, LEVEL_COLUMNS),
            part_local=floats(p, 5), part_mover=ints(p), stream=words(), drawn=words(),
        )  # fmt: skip

    def streams(self) -> Streams:
        """The random number streams; these and the following are views, as kernels take them."""
        return Streams(self.stream, self.drawn)

    def episodes(self) -> Episodes:
        """The episodes."""
        return Episodes(self.kind, self.layout, self.task, self.ticks, self.time_limit, self.distance)

    def robots(self) -> Robots:
        """The robots."""
        return Robots(
            self.body, self.pose, self.velocity, self.response, self.latency, self.commands, self.pose_error,
            self.odometry,
        )  # fmt: skip

    def mover_request(self) -> MoverRequest:
        """The request for movers."""
        return MoverRequest(self.wanted, self.task, self.keep_off, self.speeds, self.world_seed)

    def mover_rows(self) -> MoverRows:
        """The movers."""
        return MoverRows(
            self.counts, self.kinds, self.constants, self.movers, self.headings, self.seeds, self.counters,
            self.pauses, self.waypoints,
        )  # fmt: skip

    def part_rows(self, poses: np.ndarray) -> PartRows:
        """The movers' parts.

        Args:
            poses: x, y, cos, sin in the world after each tick, (n, ticks, p, 4) [m].
        """
        return PartRows(self.num_parts, self.part_local, self.part_mover, poses)
