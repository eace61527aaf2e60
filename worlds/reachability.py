"""Whether a goal can be reached at all, through everything that moves, by a disc that knows all futures."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from vuca_nav.errors import BadWorld
from worlds.motion.movers import TICK_RATE, MoverField
from worlds.shortest_path import occupancy
from worlds.world import World


class ReachabilityResult(NamedTuple):
    """Whether and when the goal can be reached."""

    reached: bool
    time: float
    """Earliest arrival [s]; ``inf`` if not reached."""


@njit(cache=True)
def _mark_capsule(unsafe, stamp, x0, y0, x1, y1, reach, origin_x, origin_y, h):
    """Mark the cells whose centres are nearer than ``reach`` to a segment."""
    rows, columns = unsafe.shape
    first_column = max(int((min(x0, x1) - reach - origin_x) / h), 0)
    last_column = min(int((max(x0, x1) + reach - origin_x) / h) + 1, columns)
    first_row = max(int((min(y0, y1) - reach - origin_y) / h), 0)
    last_row = min(int((max(y0, y1) + reach - origin_y) / h) + 1, rows)
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    for row in range(first_row, last_row):
        y = origin_y + (row + 0.5) * h
        for column in range(first_column, last_column):
            x = origin_x + (column + 0.5) * h
            share = 0.0
            if length2 > 0.0:
                share = min(max(((x - x0) * dx + (y - y0) * dy) / length2, 0.0), 1.0)
            ex, ey = x0 + share * dx - x, y0 + share * dy - y
            if ex * ex + ey * ey < reach * reach:
                unsafe[row, column] = stamp


@njit(cache=True)
def earliest_arrival(blocked, tracks, reaches, tick, start, start_time, goal, v_max, layers, origin_x, origin_y, h):
    """Layer by layer of h / v_max seconds: when the disc can first be in each cell and has been safe there since."""
    rows, columns = blocked.shape
    dt = h / v_max
    arrival = np.full((rows, columns), np.inf)
    safe_since = np.zeros((rows, columns))
    unsafe = np.full((rows, columns), -1, np.int64)
    arrival[start] = start_time
    for layer in range(layers):
        begin, end = layer * dt, (layer + 1) * dt
        first, last = int(begin / tick + 1e-9), min(int(math.ceil(end / tick - 1e-9)), len(tracks) - 1)
        for i in range(tracks.shape[1]):
            for k in range(first, last):
                a, b = tracks[k, i], tracks[k + 1, i]
                _mark_capsule(unsafe, layer, a[0], a[1], b[0], b[1], reaches[i], origin_x, origin_y, h)
        for row in range(rows):
            for column in range(columns):
                if unsafe[row, column] == layer:
                    arrival[row, column] = np.inf
                    safe_since[row, column] = end
        # A hop takes at least one layer, so whoever hops into a cell now was in its own cell before this layer:
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


def reachable(world: World, radius: float, v_max: float, horizon: float, resolution: float = 0.2) -> ReachabilityResult:
    """Whether a disc that knows all futures can reach the goal, and when at the earliest.

    The disc moves over 8 neighbours at up to ``v_max``, waits as it likes, has no inertia, and is never where a
    mover's circle is. Everything errs on the side of "not reachable": ways off the eight directions are up to
    8% too long, and movers and walls are grown by half a diagonal of a cell, so that a hop between two free
    cells is free all along. A crowd behaves as if there were no robot.

    Args:
        world: Any.
        radius: Of the disc [m].
        v_max: Its greatest speed [m/s].
        horizon: The goal must be reached before this time [s].
        resolution: Of the grid [m]; the time step is ``resolution / v_max``.

    Raises:
        BadWorld: The start has no room for the disc.
    """
    pad = resolution * math.sqrt(0.5)
    grid = occupancy(world, resolution, radius + pad)
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
    reaches = np.array([mover.radius + radius + pad for mover in world.movers])
    arrival = earliest_arrival(
        grid.blocked, tracks, reaches, 1.0 / TICK_RATE, start, start_offset, goal, v_max, layers,
        *grid.origin, resolution,
    )  # fmt: skip
    time = float(arrival) + goal_offset
    return ReachabilityResult(bool(time <= horizon), time if time <= horizon else math.inf)
