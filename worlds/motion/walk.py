"""Decisions of random walks and patrols. Their movers see walls and each other, never the robot."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from worlds.motion.mover_columns import (
    DIRECTION,
    FIRST_WAYPOINT,
    GO_TIME,
    GOAL_X,
    GOAL_Y,
    MOTION,
    PATROL,
    RADIUS,
    RANDOM_WALK,
    RUN,
    SINCE_TURN,
    SPEED,
    START_X,
    START_Y,
    STOP_TIME,
    STOPPED,
    TARGET,
    UNTIL_CHANGE,
    V_X,
    V_Y,
    WALKED,
    WAYPOINTS,
    X,
    Y,
)
from worlds.scenes.parts.population import MOVER_WAY, WAY_MARGIN
from worlds.splitmix import next_uniform
from worlds.world import STRIDE

MIN_RUN = 1.0
"""Length that must be free along a random walk's new heading, if one of the tries has it [m]."""
MAX_RUN = 8.0
"""Greatest length of a random walk along one heading [m]."""
PATIENCE = 0.7
"""Shortest time between two turns to let another mover pass [s]: no trembling in a press."""
TRIES = 24
"""Number of headings tried."""
PERSONAL_GAP = 0.15
"""Distance between circles at which movers on a random walk turn away from each other [m]."""
CROSSING = 0.5
"""Share of the patrols that are drawn across the straight way of the robot."""
MIN_PATROL, MAX_PATROL = 3.0, 20.0
"""Least and greatest length of a patrol that is drawn, from end to end and ahead of its start [m]."""


@njit(cache=True)
def free_run(away, grid, limit, x, y, cos, sin, longest):
    """Length straight on that stays within the mover's ways [m], in steps of half a cell."""
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
    best_run, best_free, best_cos, best_sin = -1.0, 0.0, 1.0, 0.0
    for _ in range(TRIES):
        angle = 2.0 * math.pi * next_uniform(seeds, counters, i)
        cos, sin = math.cos(angle), math.sin(angle)
        run = free = free_run(away, grid, limit, x, y, cos, sin, MAX_RUN)
        for j in range(len(state)):
            dx, dy = state[j, X] - x, state[j, Y] - y
            reach = r + constants[j, RADIUS] + PERSONAL_GAP
            along = dx * cos + dy * sin
            if j == i or along <= 0.0 or along > reach + MIN_RUN or abs(dx * sin - dy * cos) >= reach:
                continue
            run = min(run, max(along - reach, 0.0))
        if run > best_run:
            best_run, best_free, best_cos, best_sin = run, free, cos, sin
        if run >= MIN_RUN:
            break
    state[i, RUN] = best_free
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
    state[i, SINCE_TURN] += dt
    ends = state[i, RUN] < constants[i, SPEED] * dt
    turns = ends or (state[i, SINCE_TURN] >= PATIENCE and _meets_another(i, constants, state))
    _walk_on(i, dt, turns, constants, state, seeds, counters, away, grid)


@njit(cache=True)
def _walk_on(i, dt, turns, constants, state, seeds, counters, away, grid):
    speed = constants[i, SPEED]
    if turns:
        _new_heading(i, constants, state, seeds, counters, away, grid)
        if state[i, RUN] < speed * dt:  # walled in on all sides
            state[i, V_X] = state[i, V_Y] = 0.0
            return
    state[i, RUN] -= speed * dt


@njit(cache=True)
def _patrol_tick(i, dt, constants, state, waypoints):
    """Velocity that leads straight towards the next waypoint, or past it by the rest of this tick."""
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
    """Write new velocities of random walks and patrols until the next tick, from the present positions of all."""
    for i in range(len(state)):
        if constants[i, MOTION] == RANDOM_WALK:
            _random_walk_tick(i, dt, constants, state, seeds, counters, away, grid)
        elif constants[i, MOTION] == PATROL:
            _patrol_tick(i, dt, constants, state, waypoints)


# Many worlds at once ------------------------------------------------------------------------------------------------


class WideWays(NamedTuple):
    """The wide ways that movers keep to, on all layouts' grids."""

    away: np.ndarray
    """Distance of every cell to the wide ways, one layout after the other, (cells,) [m]."""
    shape: np.ndarray
    """Index at which each layout's cells begin, its rows and its columns, (layouts, 3)."""
    grids: np.ndarray
    """Origin x, y and resolution of each layout's grid, (layouts, 3) [m]."""


class MoverRows(NamedTuple):
    """The movers of n worlds, at most m in each."""

    counts: np.ndarray
    """Number of movers in each world, (n,)."""
    kinds: np.ndarray
    """Kind of each mover's shape, (n, m)."""
    constants: np.ndarray
    """Constants of the movers, (n, m, 5)."""
    state: np.ndarray
    """State of the movers, (n, m, STATE_SIZE); the yaw is not kept."""
    headings: np.ndarray
    """cos and sin of the movers' own yaw, (n, m, 2)."""
    seeds: np.ndarray
    """Seeds of the movers' random streams, (n, m) uint64."""
    counters: np.ndarray
    """Numbers drawn of each stream, (n, m) uint64."""
    pauses: np.ndarray
    """Pauses, (n, m, 4): mean times of going and of standing [s], 0 for a mover that never stops; then state."""
    waypoints: np.ndarray
    """Waypoints, (n, w, 2) [m]."""


class PartRows(NamedTuple):
    """The movers' parts in n worlds, at most p in each."""

    counts: np.ndarray
    """Number of movers in each world, (n,)."""
    local: np.ndarray
    """Places x, y, cos, sin in the mover's frame, and swing, (n, p, 5) [m]."""
    mover: np.ndarray
    """Index of each part's mover, (n, p)."""
    poses: np.ndarray
    """Poses x, y, cos, sin in the world after each tick, (n, output ticks, p, 4) [m]."""


class MoverRequest(NamedTuple):
    """Movers that n worlds ask for."""

    wanted: np.ndarray
    """Number of movers, (n,)."""
    tasks: np.ndarray
    """The robot's start x, y and goal x, y; further columns are ignored, (n, 4 or more) [m]."""
    keep_off: np.ndarray
    """Least distance from the robot's start to a mover's circle, (n,) [m]."""
    speeds: np.ndarray
    """Least and greatest speed, (n, 2) [m/s]."""
    seeds: np.ndarray
    """Seeds, (n,) uint64: everything about the movers follows from them."""


class Population(NamedTuple):
    """Distribution that movers are drawn from."""

    radius: np.ndarray
    """Radius of the circle about each kind of mover, (b,) [m]."""
    patrols: float
    """Share of movers that patrol a straight line."""
    pausing: float
    """Share of movers that stop and go."""
    go_time: float
    """Mean time of going [s]."""
    stop_time: float
    """Mean time of standing [s]."""
    places: np.ndarray
    """Places where movers may start in all layouts, (q, 2) [m]."""
    places_of: np.ndarray
    """Index at which each layout's places begin, and the end of the last one's, (layouts + 1,)."""


@njit(cache=True, error_model="numpy", nogil=True)
def walk_batch(rows, dt, ticks, turn, layout, ways, movers, parts):
    """Move random walks and patrols of many worlds over some ticks, equal to ``MoverField`` to rounding.

    Args:
        rows: Indices of the worlds, (k,).
        dt: Time of a tick [s].
        ticks: Number of ticks; each moves all movers on, then decides. 0 decides once and writes out, as a start.
        turn: cos and sin of the most that a mover's own shape turns in a tick.
        layout: Layout of each world, (n,).
        ways: A ``WideWays``.
        movers: A ``MoverRows``; changed.
        parts: A ``PartRows``; its poses are written, the last ones if ``ticks`` is 0.
    """
    counts, _, constants, state, headings, seeds, counters, pauses, waypoints = movers
    num_parts, part_local, part_mover, part_poses = parts
    most = state.shape[1]
    x, y, radius = np.empty(most), np.empty(most), np.empty(most)
    for r in range(len(rows)):
        i = rows[r]
        count, place = counts[i], layout[i]
        begin, height, width = ways.shape[place]
        field, grid = ways.away[begin : begin + height * width].reshape(height, width), ways.grids[place]
        constant, moving, own_seeds, own_counters = constants[i, :count], state[i, :count], seeds[i], counters[i]
        pause, heading, way = pauses[i], headings[i], waypoints[i]
        part, owner, part_pose, here = part_local[i], part_mover[i], part_poses[i], num_parts[i]
        for m in range(count):
            x[m], y[m], radius[m] = moving[m, X], moving[m, Y], constant[m, RADIUS] + PERSONAL_GAP
        for tick in range(max(ticks, 1)):
            if ticks > 0:
                _advance(dt, turn, moving, heading, x, y)
                _place_parts(here, part, owner, moving, heading, part_pose[tick])
            for m in range(count):
                # A call with arrays costs more than most movers' whole tick: only the rare cases are calls.
                if pause[m, GO_TIME] > 0.0:
                    pause[m, UNTIL_CHANGE] -= dt
                    if pause[m, UNTIL_CHANGE] <= 0.0:
                        _stop_or_go(m, moving, own_seeds, own_counters, pause)
                    if pause[m, STOPPED] != 0.0:
                        moving[m, V_X] = moving[m, V_Y] = 0.0
                        continue
                speed = constant[m, SPEED]
                if constant[m, MOTION] == PATROL:
                    _patrol_tick(m, dt, constant, moving, way)
                    continue
                moving[m, SINCE_TURN] += dt
                turns = moving[m, RUN] < speed * dt
                if not turns and moving[m, SINCE_TURN] >= PATIENCE:
                    # Whether another is within arm's reach and in the way; the mover itself, at no distance, is not.
                    v_x, v_y, own_x, own_y, own = moving[m, V_X], moving[m, V_Y], x[m], y[m], constant[m, RADIUS]
                    near = 0
                    for j in range(count):
                        dx, dy, reach = x[j] - own_x, y[j] - own_y, own + radius[j]
                        near += (dx * dx + dy * dy < reach * reach) & (dx * v_x + dy * v_y > 0.0)
                    turns = near > 0
                if turns:
                    _walk_on(m, dt, turns, constant, moving, own_seeds, own_counters, field, grid)
                else:
                    moving[m, RUN] -= speed * dt
        if ticks == 0:
            _place_parts(here, part, owner, moving, heading, part_pose[part_pose.shape[0] - 1])


@njit(cache=True, error_model="numpy", nogil=True)
def _advance(dt, turn, state, headings, x, y):
    """Move straight on for a tick; the movers' shapes turn towards their direction of motion."""
    for m in range(len(state)):
        v_x, v_y = state[m, V_X], state[m, V_Y]
        if v_x == 0.0 and v_y == 0.0:
            continue
        x[m] += v_x * dt
        y[m] += v_y * dt
        state[m, X], state[m, Y] = x[m], y[m]
        speed = math.sqrt(v_x * v_x + v_y * v_y)
        state[m, WALKED] += speed * dt
        cos, sin = headings[m, 0], headings[m, 1]
        along, across = cos * v_x + sin * v_y, cos * v_y - sin * v_x
        if along >= turn[0] * speed:
            headings[m, 0], headings[m, 1] = v_x / speed, v_y / speed
        else:
            by = turn[1] if across >= 0.0 else -turn[1]
            headings[m, 0], headings[m, 1] = cos * turn[0] - sin * by, sin * turn[0] + cos * by


@njit(cache=True, nogil=True)
def _place_parts(count, parts, part_mover, state, headings, poses):
    for p in range(count):
        m = part_mover[p]
        px, py, cos, sin = parts[p, 0], parts[p, 1], headings[m, 0], headings[m, 1]
        if parts[p, 4] != 0.0:
            px += parts[p, 4] * math.sin(2.0 * math.pi / STRIDE * state[m, WALKED])
        poses[p, 0] = state[m, X] + cos * px - sin * py
        poses[p, 1] = state[m, Y] + sin * px + cos * py
        poses[p, 2] = cos * parts[p, 2] - sin * parts[p, 3]
        poses[p, 3] = sin * parts[p, 2] + cos * parts[p, 3]


@njit(cache=True, nogil=True)
def _stop_or_go(m, state, seeds, counters, pauses):
    """Change between going and standing, for a time drawn anew."""
    pauses[m, STOPPED] = 1.0 - pauses[m, STOPPED]
    mean = pauses[m, STOP_TIME] if pauses[m, STOPPED] != 0.0 else pauses[m, GO_TIME]
    pauses[m, UNTIL_CHANGE] = -mean * math.log(1.0 - next_uniform(seeds, counters, m))
    state[m, RUN] = 0.0  # a new heading when it goes again


@njit(cache=True, nogil=True)
def place_batch(rows, request, population, layout, ways, movers):
    """Draw and place the movers of many worlds: random walks, patrols straight through, and some that stop and go.

    Every mover starts in a wide way, ``keep_off`` and its own radius away from the robot, and apart from the
    others; where there is no space for more, a world has fewer.

    Args:
        rows: Indices of the worlds, (k,).
        request: A ``MoverRequest``.
        population: A ``Population``.
        layout: Layout of each world, (n,).
        ways: A ``WideWays``.
        movers: A ``MoverRows``; written.
    """
    counts, kinds, constants, state, headings, seeds, counters, pauses, waypoints = movers
    tasks, speeds, places = request.tasks, request.speeds, population.places
    master, drawn = np.empty(1, np.uint64), np.empty(1, np.uint64)
    for r in range(len(rows)):
        i = rows[r]
        master[0], drawn[0] = request.seeds[i], np.uint64(0)
        place = layout[i]
        begin, height, width = ways.shape[place]
        field, grid = ways.away[begin : begin + height * width].reshape(height, width), ways.grids[place]
        low, high = population.places_of[place], population.places_of[place + 1]
        count = 0
        for _ in range(request.wanted[i]):
            kind = int(next_uniform(master, drawn, 0) * len(population.radius))
            radius = population.radius[kind]
            limit = 0.5 * MOVER_WAY - radius - WAY_MARGIN
            found, x, y = False, 0.0, 0.0
            for _ in range(TRIES):
                if low == high:
                    break
                at = low + int(next_uniform(master, drawn, 0) * (high - low))
                x = places[at, 0] + (next_uniform(master, drawn, 0) - 0.5) * grid[2]
                y = places[at, 1] + (next_uniform(master, drawn, 0) - 0.5) * grid[2]
                row, column = int((y - grid[1]) / grid[2]), int((x - grid[0]) / grid[2])
                if row >= height or column >= width or field[row, column] > limit:
                    continue
                dx, dy = x - tasks[i, START_X], y - tasks[i, START_Y]
                reach = request.keep_off[i] + radius
                if dx * dx + dy * dy < reach * reach:
                    continue
                found = True
                for j in range(count):
                    dx, dy = x - state[i, j, X], y - state[i, j, Y]
                    reach = radius + constants[i, j, RADIUS] + PERSONAL_GAP
                    if dx * dx + dy * dy < reach * reach:
                        found = False
                        break
                if found:
                    break
            if not found:
                continue
            m, count = count, count + 1
            kinds[i, m] = kind
            constants[i, m] = 0.0
            constants[i, m, MOTION], constants[i, m, RADIUS] = RANDOM_WALK, radius
            constants[i, m, SPEED] = speeds[i, 0] + next_uniform(master, drawn, 0) * (speeds[i, 1] - speeds[i, 0])
            state[i, m] = 0.0
            state[i, m, X], state[i, m, Y] = x, y
            yaw = (2.0 * next_uniform(master, drawn, 0) - 1.0) * math.pi
            headings[i, m, 0], headings[i, m, 1] = math.cos(yaw), math.sin(yaw)
            state[i, m, SINCE_TURN], state[i, m, DIRECTION] = PATIENCE, 1.0
            seeds[i, m] = np.uint64(next_uniform(master, drawn, 0) * 9007199254740992.0)
            counters[i, m] = np.uint64(0)
            pauses[i, m] = 0.0
            style, pausing = next_uniform(master, drawn, 0), next_uniform(master, drawn, 0)
            if pausing < population.pausing:
                pauses[i, m, GO_TIME], pauses[i, m, STOP_TIME] = population.go_time, population.stop_time
                pauses[i, m, UNTIL_CHANGE] = population.go_time * next_uniform(master, drawn, 0)
            if style < population.patrols:
                angle = 2.0 * math.pi * next_uniform(master, drawn, 0)
                if style < CROSSING * population.patrols:  # across the straight way of the robot
                    share = next_uniform(master, drawn, 0)
                    angle = math.atan2(
                        tasks[i, START_Y] + share * (tasks[i, GOAL_Y] - tasks[i, START_Y]) - y,
                        tasks[i, START_X] + share * (tasks[i, GOAL_X] - tasks[i, START_X]) - x,
                    )
                cos, sin = math.cos(angle), math.sin(angle)
                ahead = free_run(field, grid, limit, x, y, cos, sin, MAX_PATROL)
                behind = free_run(field, grid, limit, x, y, -cos, -sin, MAX_PATROL)
                if ahead + behind >= MIN_PATROL:
                    constants[i, m, MOTION], constants[i, m, FIRST_WAYPOINT] = PATROL, 2 * m
                    constants[i, m, WAYPOINTS], state[i, m, TARGET] = 2, 1.0
                    waypoints[i, 2 * m, 0], waypoints[i, 2 * m, 1] = x - behind * cos, y - behind * sin
                    waypoints[i, 2 * m + 1, 0], waypoints[i, 2 * m + 1, 1] = x + ahead * cos, y + ahead * sin
        counts[i] = count
