"""Reachability of a goal in space and time, for a disc with exact prediction of every moving obstacle."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.errors import BadWorld
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.motion.movers import TICK_RATE, MoverField
from worlds.shortest_path import occupancy
from worlds.world import TALLEST, World


class ReachabilityResult(NamedTuple):
    """Result of :func:`reachable`."""

    reached: bool
    """Whether the goal can be reached before the horizon."""
    time: float
    """Earliest arrival [s]; ``inf`` if not reached."""


class Grid(NamedTuple):
    """A grid of square cells."""

    x: float
    """Lower-left corner of cell (0, 0) in the world [m]."""
    y: float
    """[m]"""
    resolution: float
    """Side of a cell [m]."""


class Crowd(NamedTuple):
    """Future positions of every moving obstacle, and the least distances of a disc to them."""

    tracks: FloatArray
    """x, y at each tick (ticks + 1, m, 2) [m]."""
    reaches: FloatArray
    """Least distance between its centre and the disc's (m,) [m]."""
    tick: float
    """Time between two rows of ``tracks``, between which everything moves straight on [s]."""


@njit(cache=True)
def _mark_capsule(unsafe, stamp, begin, end, reach, grid):
    """Mark the cells whose centres are nearer than ``reach`` to the segment from ``begin`` to ``end``."""
    x0, y0, x1, y1 = begin[0], begin[1], end[0], end[1]
    if not math.isfinite(x0):  # it is not there yet: only its end counts, if it appears in between
        x0, y0 = x1, y1
    if not math.isfinite(x1):
        x1, y1 = x0, y0
    if not math.isfinite(x0):
        return
    h = grid.resolution
    rows, columns = unsafe.shape
    first_column = max(int((min(x0, x1) - reach - grid.x) / h), 0)
    last_column = min(int((max(x0, x1) + reach - grid.x) / h) + 1, columns)
    first_row = max(int((min(y0, y1) - reach - grid.y) / h), 0)
    last_row = min(int((max(y0, y1) + reach - grid.y) / h) + 1, rows)
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    for row in range(first_row, last_row):
        y = grid.y + (row + 0.5) * h
        for column in range(first_column, last_column):
            x = grid.x + (column + 0.5) * h
            share = 0.0
            if length2 > 0.0:
                share = min(max(((x - x0) * dx + (y - y0) * dy) / length2, 0.0), 1.0)
            ex, ey = x0 + share * dx - x, y0 + share * dy - y
            if ex * ex + ey * ey < reach * reach:
                unsafe[row, column] = stamp


@njit(cache=True)
def earliest_arrival(blocked, grid, crowd, start, start_time, goal, v_max, layers):
    """Earliest time at which a disc can be in the goal's cell [s], given all movers' paths; ``inf`` if it never can.

    Time goes by layers of one cell's side at full speed. After each layer every cell has the earliest time at which
    the disc can be in it, and since when it has been safe there.

    Args:
        blocked: Cells that the disc's centre must keep out of (rows, columns).
        grid: The :class:`Grid` of these cells.
        crowd: A :class:`Crowd`.
        start: Row and column of the start.
        start_time: Time at which the disc is at the centre of the start's cell [s].
        goal: Row and column of the goal.
        v_max: Greatest speed of the disc [m/s].
        layers: Number of layers to look ahead.
    """
    rows, columns = blocked.shape
    tracks, tick = crowd.tracks, crowd.tick
    dt = grid.resolution / v_max
    arrival = np.full((rows, columns), np.inf)
    safe_since = np.zeros((rows, columns))
    unsafe = np.full((rows, columns), -1, np.int64)
    arrival[start] = start_time
    for layer in range(layers):
        begin, end = layer * dt, (layer + 1) * dt
        first, last = int(begin / tick + 1e-9), min(int(math.ceil(end / tick - 1e-9)), len(tracks) - 1)
        for i in range(tracks.shape[1]):
            for k in range(first, last):
                _mark_capsule(unsafe, layer, tracks[k, i], tracks[k + 1, i], crowd.reaches[i], grid)
        for row in range(rows):
            for column in range(columns):
                if unsafe[row, column] == layer:
                    arrival[row, column] = np.inf
                    safe_since[row, column] = end
        # A hop takes at least one layer, so a hop into a cell now began before this layer:
        # the order in which cells are looked at does not matter.
        for row in range(rows):
            for column in range(columns):
                if blocked[row, column] or unsafe[row, column] == layer or arrival[row, column] <= end:
                    continue
                earliest = np.inf
                for dr in range(-1, 2):
                    for dc in range(-1, 2):
                        r, c = row + dr, column + dc
                        if r < 0 or c < 0 or r >= rows or c >= columns or (dr == 0 and dc == 0):
                            continue
                        if arrival[r, c] > begin + 1e-9:
                            continue
                        hop = dt * math.sqrt(dr * dr + dc * dc)
                        earliest = min(earliest, max(arrival[r, c], safe_since[row, column]) + hop)
                if earliest <= end + 1e-9:
                    arrival[row, column] = earliest
        if arrival[goal] <= end + 1e-9:
            return arrival[goal]
    return np.inf


def reachable(
    world: World,
    radius: float,
    v_max: float,
    horizon: float,
    resolution: float = 0.2,
    height: float = TALLEST,
) -> ReachabilityResult:
    """Decide whether a disc can reach the goal, given all movers' paths, and at what earliest time.

    The disc moves between the 8 neighbours of a cell at up to ``v_max``, waits as it likes, has no inertia, and is
    never inside a mover's circle. Every approximation errs on the side of "not reachable": ways off the eight
    directions are up to 8% too long, and movers and walls are inflated by half a diagonal of a cell, so that a hop
    between two free cells is free all along. A crowd behaves as if there were no robot.

    Args:
        world: Any world.
        radius: Radius of the disc [m].
        v_max: Greatest speed of the disc [m/s].
        horizon: Time before which the goal must be reached [s].
        resolution: Side of a cell [m]; the time step is ``resolution / v_max``.
        height: Height of the disc's body [m]; obstacles and movers that hang above it are not in its way.

    Raises:
        BadWorld: The disc does not fit at the start.
    """
    pad = resolution * math.sqrt(0.5)
    grid = occupancy(world, resolution, radius + pad, height)
    start, goal = grid.cell(*world.start[:2]), grid.cell(*world.goal)
    if grid.blocked[start]:
        raise BadWorld(
            f"start: no room for a disc of radius {radius:g} m on cells of {resolution:g} m; a finer resolution, "
            "or a free start, would be right"
        )
    start_offset = math.dist(grid.centre(*start), world.start[:2]) / v_max
    goal_offset = math.dist(grid.centre(*goal), world.goal) / v_max
    movers = MoverField(world)
    layers = math.ceil(horizon * v_max / resolution)
    ticks = math.ceil(layers * resolution / v_max * TICK_RATE) + 1 if world.movers else 0
    tracks = np.empty((ticks + 1, len(world.movers), 2))
    tracks[0] = movers.poses[:, :2]
    for k in range(ticks):
        movers.step(1.0 / TICK_RATE)
        tracks[k + 1] = movers.poses[:, :2]
    low = [i for i, mover in enumerate(world.movers) if mover.base < height]
    tracks = np.ascontiguousarray(tracks[:, low])
    reaches = np.array([world.movers[i].radius + radius + pad for i in low])
    cells, crowd = Grid(*grid.origin, resolution), Crowd(tracks, reaches, 1.0 / TICK_RATE)
    arrival = earliest_arrival(grid.blocked, cells, crowd, start, start_offset, goal, v_max, layers)
    time = float(arrival) + goal_offset
    return ReachabilityResult(bool(time <= horizon), time if time <= horizon else math.inf)
