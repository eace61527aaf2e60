"""How random walkers and patrols decide where to go. They see walls and each other, never the robot."""

import math

import numpy as np
from numba import njit

from worlds.mover_columns import (
    DIRECTION,
    FIRST_WAYPOINT,
    MOTION,
    PATROL,
    RADIUS,
    RANDOM_WALK,
    RUN,
    SINCE_TURN,
    SPEED,
    TARGET,
    V_X,
    V_Y,
    WAYPOINTS,
    X,
    Y,
)
from worlds.population import MOVER_WAY, WAY_MARGIN

MIN_RUN = 1.0
"""A random walker picks a heading that is free for so far, if one of its tries is [m]."""
MAX_RUN = 8.0
"""It picks a new one after at most this [m]."""
PATIENCE = 0.7
"""Shortest time between two turns to let another mover pass [s]: no trembling in a press."""
TRIES = 24
"""Headings tried."""
PERSONAL_GAP = 0.15
"""Random walkers turn away from each other at this distance between their circles [m]."""


@njit(cache=True)
def _uniform(seeds, counters, i):
    """Next number of mover i's own stream in [0, 1): splitmix64 of its seed and counter."""
    counters[i] += np.uint64(1)
    z = seeds[i] + counters[i] * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True)
def _free_run(away, grid, limit, x, y, cos, sin, longest):
    """How far from here straight on stays within the mover's ways [m], in steps of half a cell."""
    rows, columns = away.shape
    step = 0.5 * grid[2]
    run = 0.0
    while run < longest:
        ahead = run + step
        column = int((x + ahead * cos - grid[0]) / grid[2])
        row = int((y + ahead * sin - grid[1]) / grid[2])
        if row < 0 or column < 0 or row >= rows or column >= columns or away[row, column] > limit:
            break
        run = ahead
    return run


@njit(cache=True)
def _new_heading(i, constants, state, seeds, counters, away, grid):
    """The first of a few random headings that is free for MIN_RUN and leads away from near movers, or the longest."""
    x, y, r = state[i, X], state[i, Y], constants[i, RADIUS]
    limit = 0.5 * MOVER_WAY - r - WAY_MARGIN
    best_run, best_cos, best_sin = -1.0, 1.0, 0.0
    for _ in range(TRIES):
        angle = 2.0 * math.pi * _uniform(seeds, counters, i)
        cos, sin = math.cos(angle), math.sin(angle)
        run = _free_run(away, grid, limit, x, y, cos, sin, MAX_RUN)
        for j in range(len(state)):
            dx, dy = state[j, X] - x, state[j, Y] - y
            reach = r + constants[j, RADIUS] + PERSONAL_GAP
            along = dx * cos + dy * sin
            if j == i or along <= 0.0 or along > reach + MIN_RUN or abs(dx * sin - dy * cos) >= reach:
                continue
            run = min(run, max(along - reach, 0.0))
        if run > best_run:
            best_run, best_cos, best_sin = run, cos, sin
        if run >= MIN_RUN:
            break
    state[i, RUN] = _free_run(away, grid, limit, x, y, best_cos, best_sin, MAX_RUN)
    state[i, V_X], state[i, V_Y] = constants[i, SPEED] * best_cos, constants[i, SPEED] * best_sin
    state[i, SINCE_TURN] = 0.0


@njit(cache=True)
def _meets_another(i, constants, state):
    """Whether another mover is within arm's reach of mover i and in its way."""
    for j in range(len(state)):
        if j == i:
            continue
        dx, dy = state[j, X] - state[i, X], state[j, Y] - state[i, Y]
        reach = constants[i, RADIUS] + constants[j, RADIUS] + PERSONAL_GAP
        if dx * dx + dy * dy < reach * reach and dx * state[i, V_X] + dy * state[i, V_Y] > 0.0:
            return True
    return False


@njit(cache=True)
def _random_walk_tick(i, dt, constants, state, seeds, counters, away, grid):
    speed = constants[i, SPEED]
    state[i, SINCE_TURN] += dt
    ends = state[i, RUN] < speed * dt
    if ends or (state[i, SINCE_TURN] >= PATIENCE and _meets_another(i, constants, state)):
        _new_heading(i, constants, state, seeds, counters, away, grid)
        if state[i, RUN] < speed * dt:  # walled in on all sides
            state[i, V_X] = state[i, V_Y] = 0.0
            return
    state[i, RUN] -= speed * dt


@njit(cache=True)
def _patrol_tick(i, dt, constants, state, waypoints):
    """Velocity that leads straight towards the next waypoint, or past it by what is left of this tick."""
    first, count = int(constants[i, FIRST_WAYPOINT]), int(constants[i, WAYPOINTS])
    left = constants[i, SPEED] * dt
    x, y = state[i, X], state[i, Y]
    for _ in range(2 * count):
        target = first + int(state[i, TARGET])
        dx, dy = waypoints[target, 0] - x, waypoints[target, 1] - y
        gap = math.sqrt(dx * dx + dy * dy)
        if gap > left:
            x += dx / gap * left
            y += dy / gap * left
            break
        x, y, left = waypoints[target, 0], waypoints[target, 1], left - gap
        following = state[i, TARGET] + state[i, DIRECTION]
        if following < 0 or following >= count:
            state[i, DIRECTION] = -state[i, DIRECTION]
            following = state[i, TARGET] + state[i, DIRECTION]
        state[i, TARGET] = following
    state[i, V_X], state[i, V_Y] = (x - state[i, X]) / dt, (y - state[i, Y]) / dt


@njit(cache=True)
def decide(dt, constants, state, seeds, counters, away, grid, waypoints):
    """New velocities of walkers and patrols, from the present positions of all, until the next tick."""
    for i in range(len(state)):
        if constants[i, MOTION] == RANDOM_WALK:
            _random_walk_tick(i, dt, constants, state, seeds, counters, away, grid)
        elif constants[i, MOTION] == PATROL:
            _patrol_tick(i, dt, constants, state, waypoints)
