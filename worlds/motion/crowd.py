"""The social force model of pedestrians: Helbing and Molnar, "Social force model for pedestrian dynamics" (1995).

A pedestrian accelerates towards its desired velocity and is pushed away, exponentially with the distance between
circles, by other movers, the robot and walls; those behind it count less. Two rules are added so that no pedestrian is
stuck for ever: a push is turned a little to the right, and a pedestrian without progress for a while goes back.
"""

import math

from vuca_nav.kernel_cache import njit
from worlds.motion.mover_columns import (
    DIRECTION,
    FIRST_WAYPOINT,
    MOTION,
    PROGRESS,
    RADIUS,
    SOCIAL_FORCE,
    SPEED,
    STUCK,
    TARGET,
    V_X,
    V_Y,
    WAYPOINTS,
    X,
    Y,
)

RELAXATION = 0.5
"""Time in which a pedestrian regains the desired velocity [s] (Helbing and Molnar 1995)."""
PUSH = 7.0
"""Acceleration of two pedestrians at contact [m/s^2]: V0 / sigma = 2.1 m^2/s^2 / 0.3 m (Helbing and Molnar 1995)."""
PUSH_RANGE = 0.3
"""Distance over which the push between pedestrians falls by e [m] (sigma, Helbing and Molnar 1995)."""
WALL_PUSH = 5.0
"""Acceleration of a pedestrian that touches a wall [m/s^2]. Helbing and Molnar have 50 m/s^2 over 0.2 m for points; of
circles it would bar doors of 1 m."""
WALL_RANGE = 0.1
"""Distance over which the push of a wall falls by e [m]."""
BEHIND = 0.5
"""Weight of a push from straight behind (c of Helbing and Molnar 1995, also 0.5)."""
SIDESTEP = 0.3
"""Share of a push that is turned to the right, so that two pedestrians that meet head on pass each other."""
MAX_SPEED_FACTOR = 1.3
"""Fastest walk over desired speed (Helbing and Molnar 1995)."""
SIGHT = 3.0
"""Distance beyond which others are ignored [m]; their push is below 0.003 m/s^2."""
ARRIVAL = 0.4
"""A waypoint counts as visited within this distance [m]."""
KEEP_OFF = 0.05
"""Least distance of a pedestrian's circle from a wall [m]: the error of a distance interpolated on 0.1 m cells."""
PATIENCE = 4.0
"""Time without progress after which a pedestrian turns round and walks its way backwards [s]."""
PROGRESS_STEP = 0.3
"""Approach to the waypoint that counts as progress [m]."""


@njit(cache=True)
def wall_distance(clearance, grid, x, y):
    """Distance to the nearest wall, bilinear between the centres of the grid's cells [m]."""
    rows, columns = clearance.shape
    u = min(max((x - grid[0]) / grid[2] - 0.5, 0.0), columns - 1.001)
    v = min(max((y - grid[1]) / grid[2] - 0.5, 0.0), rows - 1.001)
    column, row = int(u), int(v)
    right, up = min(column + 1, columns - 1), min(row + 1, rows - 1)
    fx, fy = u - column, v - row
    low = (1.0 - fx) * clearance[row, column] + fx * clearance[row, right]
    high = (1.0 - fx) * clearance[up, column] + fx * clearance[up, right]
    return (1.0 - fy) * low + fy * high


@njit(cache=True)
def _choose_waypoint(i, dt, constants, state, waypoints):
    """Unit vector to the next waypoint; on to the following one when there, back when there is no progress."""
    first, count = int(constants[i, FIRST_WAYPOINT]), int(constants[i, WAYPOINTS])
    target = first + int(state[i, TARGET])
    dx, dy = waypoints[target, 0] - state[i, X], waypoints[target, 1] - state[i, Y]
    gap = math.sqrt(dx * dx + dy * dy)
    turn = False
    if state[i, STUCK] == 0.0 or gap < state[i, PROGRESS] - PROGRESS_STEP:
        state[i, PROGRESS], state[i, STUCK] = gap, dt
    else:
        state[i, STUCK] += dt
        turn = state[i, STUCK] > PATIENCE
    if turn:
        state[i, DIRECTION] = -state[i, DIRECTION]
    if turn or gap < ARRIVAL:
        state[i, TARGET] = (state[i, TARGET] + state[i, DIRECTION]) % count
        state[i, STUCK] = 0.0
        target = first + int(state[i, TARGET])
        dx, dy = waypoints[target, 0] - state[i, X], waypoints[target, 1] - state[i, Y]
        gap = math.sqrt(dx * dx + dy * dy)
    if gap < 1e-6:
        return 0.0, 0.0
    return dx / gap, dy / gap


@njit(cache=True)
def push_from_disc(state, i, radius, ex, ey, other_x, other_y, other_r):
    """Acceleration of pedestrian i by a disc, its share to the right included."""
    dx, dy = state[i, X] - other_x, state[i, Y] - other_y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > SIGHT or distance < 1e-6:
        return 0.0, 0.0
    nx, ny = dx / distance, dy / distance
    facing = BEHIND + (1.0 - BEHIND) * 0.5 * (1.0 - nx * ex - ny * ey)
    size = PUSH * facing * math.exp(min((radius + other_r - distance) / PUSH_RANGE, 1.5))
    # A disc ahead has n = -e; its right-hand normal (-ny, nx) then points to the pedestrian's right.
    return size * (nx - SIDESTEP * ny), size * (ny + SIDESTEP * nx)


@njit(cache=True)
def social_force_tick(dt, sees, constants, state, clearance, grid, waypoints, force, robot):
    """Write new velocities of all pedestrians, from the present positions of all movers.

    Args:
        dt: Time until the next tick [s].
        sees: (m,) whether each mover sees the robot.
        constants: (m, 5) constants of the movers.
        state: (m, 12) state of the movers; the velocities are written.
        clearance: (rows, columns) distance to the nearest wall [m].
        grid: Origin x, y and resolution of ``clearance`` [m].
        waypoints: (n, 2) waypoints of all movers [m].
        force: (m, 2) scratch.
        robot: x, y, radius [m]; a negative radius means none.
    """
    h = grid[2]
    for i in range(len(state)):
        if constants[i, MOTION] != SOCIAL_FORCE:
            continue
        x, y, r = state[i, X], state[i, Y], constants[i, RADIUS]
        ex, ey = _choose_waypoint(i, dt, constants, state, waypoints)
        ax = (constants[i, SPEED] * ex - state[i, V_X]) / RELAXATION
        ay = (constants[i, SPEED] * ey - state[i, V_Y]) / RELAXATION
        for j in range(len(state)):
            if j != i:
                fx, fy = push_from_disc(state, i, r, ex, ey, state[j, X], state[j, Y], constants[j, RADIUS])
                ax, ay = ax + fx, ay + fy
        if robot[2] >= 0.0 and sees[i]:
            fx, fy = push_from_disc(state, i, r, ex, ey, robot[0], robot[1], robot[2])
            ax, ay = ax + fx, ay + fy
        gap = wall_distance(clearance, grid, x, y) - r
        gx = (wall_distance(clearance, grid, x + h, y) - wall_distance(clearance, grid, x - h, y)) / (2.0 * h)
        gy = (wall_distance(clearance, grid, x, y + h) - wall_distance(clearance, grid, x, y - h)) / (2.0 * h)
        size = WALL_PUSH * math.exp(-gap / WALL_RANGE)
        force[i, 0], force[i, 1] = ax + size * gx, ay + size * gy
    for i in range(len(state)):
        if constants[i, MOTION] == SOCIAL_FORCE:
            vx, vy = state[i, V_X] + force[i, 0] * dt, state[i, V_Y] + force[i, 1] * dt
            speed, fastest = math.sqrt(vx * vx + vy * vy), MAX_SPEED_FACTOR * constants[i, SPEED]
            if speed > fastest:
                vx, vy = vx * fastest / speed, vy * fastest / speed
            state[i, V_X], state[i, V_Y] = _slide(i, dt, vx, vy, constants, state, clearance, grid)


@njit(cache=True)
def _slide(i, dt, vx, vy, constants, state, clearance, grid):
    """The velocity, or its part along a wall where it leads into one."""
    x, y, least = state[i, X], state[i, Y], constants[i, RADIUS] + KEEP_OFF
    here = wall_distance(clearance, grid, x, y)
    for k in range(3):
        wx = 0.0 if k == 2 else vx
        wy = 0.0 if k == 1 else vy
        there = wall_distance(clearance, grid, x + wx * dt, y + wy * dt)
        if there >= least or there > here:
            return wx, wy
    return 0.0, 0.0
