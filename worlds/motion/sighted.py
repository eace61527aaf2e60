"""Walks and patrols that see the robot: the crowd model's push from the robot, added to a mover's own walk.

A blind mover goes at its own velocity. A sighted one adds a velocity w to it, with w' = push - w / relaxation: on a
straight line that is the social force model with the mover's own velocity as the desired one, its constants unchanged
(``worlds.motion.crowd``). Out of the robot's reach w fades, and the mover is back on its own walk: a patrol on its
line, a random walk on its heading.
"""

import math

from vuca_nav.kernel_cache import njit
from worlds.motion.crowd import (
    ARRIVAL,
    KEEP_OFF,
    MAX_SPEED_FACTOR,
    PATIENCE,
    PROGRESS_STEP,
    RELAXATION,
    push_from_disc,
    wall_distance,
)
from worlds.motion.mover_columns import (
    DIRECTION,
    FIRST_WAYPOINT,
    MOTION,
    PATROL,
    PROGRESS,
    RADIUS,
    RUN,
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
from worlds.motion.walk import free_run
from worlds.scenes.parts.population import MOVER_WAY, WAY_MARGIN

STILL = 1e-3
"""Velocity that a push out of reach has left, below which it is over [m/s]."""
RETURN_AHEAD = 1.0
"""Distance along its line at which a patrol that was pushed off it heads back to it [m]."""
OWN_X, OWN_Y, PUSH_X, PUSH_Y = range(4)
"""Columns of a sighted mover's own velocity and of the velocity that pushes add to it."""


@njit(cache=True)
def recall_own_walk(sees, constants, state, aside, waypoints):
    """Give sighted walks and patrols their own velocities back, before they decide on the next ones.

    Args:
        sees: (m,) whether each mover sees the robot.
        constants: (m, 5) constants of the movers.
        state: (m, STATE_SIZE) state of the movers.
        aside: (m, 4) own velocities and those of pushes [m/s].
        waypoints: (n, 2) waypoints of all movers [m].
    """
    for i in range(len(state)):
        if sees[i] and constants[i, MOTION] != SOCIAL_FORCE:
            state[i, V_X], state[i, V_Y] = aside[i, OWN_X], aside[i, OWN_Y]
            if constants[i, MOTION] == PATROL and (aside[i, PUSH_X] != 0.0 or aside[i, PUSH_Y] != 0.0):
                _visit(i, constants, state, waypoints)


@njit(cache=True)
def _visit(i, constants, state, waypoints):
    """Take a waypoint as visited that a patrol was kept from only just."""
    target = int(constants[i, FIRST_WAYPOINT] + state[i, TARGET])
    dx, dy = waypoints[target, 0] - state[i, X], waypoints[target, 1] - state[i, Y]
    if dx * dx + dy * dy < ARRIVAL * ARRIVAL:
        following = state[i, TARGET] + state[i, DIRECTION]
        if following < 0 or following >= constants[i, WAYPOINTS]:
            state[i, DIRECTION] = -state[i, DIRECTION]
            following = state[i, TARGET] + state[i, DIRECTION]
        if 0 <= following < constants[i, WAYPOINTS]:
            state[i, TARGET], state[i, STUCK] = following, 0.0


@njit(cache=True)
def _back_to_line(i, dt, pushed, constants, state, waypoints):
    """Point a patrol that was pushed off its line back to it; without progress for a while it turns round."""
    count = constants[i, WAYPOINTS]
    previous = state[i, TARGET] - state[i, DIRECTION]
    if count < 2 or previous < 0 or previous >= count:
        return
    first = int(constants[i, FIRST_WAYPOINT])
    a, b = first + int(previous), first + int(state[i, TARGET])
    ex, ey = waypoints[b, 0] - waypoints[a, 0], waypoints[b, 1] - waypoints[a, 1]
    length = math.sqrt(ex * ex + ey * ey)
    rx, ry = state[i, X] - waypoints[a, 0], state[i, Y] - waypoints[a, 1]
    if length < 1e-6 or (not pushed and abs(ex * ry - ey * rx) < 1e-6 * length):
        state[i, STUCK] = 0.0
        return
    gap = math.sqrt((waypoints[b, 0] - state[i, X]) ** 2 + (waypoints[b, 1] - state[i, Y]) ** 2)
    if state[i, STUCK] == 0.0 or gap < state[i, PROGRESS] - PROGRESS_STEP:
        state[i, PROGRESS], state[i, STUCK] = gap, dt
    else:
        state[i, STUCK] += dt
    if state[i, STUCK] > PATIENCE:
        state[i, DIRECTION], state[i, TARGET], state[i, STUCK] = -state[i, DIRECTION], previous, 0.0
        return
    along = min(max((rx * ex + ry * ey) / length + RETURN_AHEAD, 0.0), length)
    dx, dy = along / length * ex - rx, along / length * ey - ry
    away = math.sqrt(dx * dx + dy * dy)
    speed = min(constants[i, SPEED], away / dt)
    if away > 1e-6:
        state[i, V_X], state[i, V_Y] = speed * dx / away, speed * dy / away


@njit(cache=True)
def _may_step(i, dt, v_x, v_y, constants, state, ways):
    """Whether a step at this velocity keeps the mover off the walls, and a random walk in its ways."""
    clearance, away, grid = ways
    x, y = state[i, X], state[i, Y]
    if constants[i, MOTION] == PATROL:  # its own line may lead nearer to a wall than a pedestrian goes
        least = min(constants[i, RADIUS] + KEEP_OFF, wall_distance(clearance, grid, x, y))
        return wall_distance(clearance, grid, x + v_x * dt, y + v_y * dt) >= least - 1e-9
    limit = 0.5 * MOVER_WAY - constants[i, RADIUS] - WAY_MARGIN
    row, column = int((y + v_y * dt - grid[1]) / grid[2]), int((x + v_x * dt - grid[0]) / grid[2])
    return 0 <= row < away.shape[0] and 0 <= column < away.shape[1] and away[row, column] <= limit


@njit(cache=True)
def push_aside(dt, sees, constants, state, aside, waypoints, ways, robot):
    """Add the push from the robot to the velocities of sighted walks and patrols, which they have just decided on.

    Args:
        dt: Time until the next tick [s].
        sees: (m,) whether each mover sees the robot.
        constants: (m, 5) constants of the movers.
        state: (m, STATE_SIZE) state of the movers; the velocities are changed.
        aside: (m, 4) own velocities and those of pushes [m/s]; changed.
        waypoints: (n, 2) waypoints of all movers [m].
        ways: (rows, columns) distance to the nearest wall [m], the same to the wide ways [m], and origin x, y and
            resolution of both [m].
        robot: x, y, radius [m]; a negative radius means none.
    """
    for i in range(len(state)):
        if not sees[i] or constants[i, MOTION] == SOCIAL_FORCE:
            continue
        pushed = aside[i, PUSH_X] != 0.0 or aside[i, PUSH_Y] != 0.0
        if constants[i, MOTION] == PATROL:
            _back_to_line(i, dt, pushed, constants, state, waypoints)
        elif pushed:
            # The run was measured along the line that the mover has been pushed off.
            x, y, v_x, v_y = state[i, X], state[i, Y], state[i, V_X], state[i, V_Y]
            speed = math.sqrt(v_x * v_x + v_y * v_y)
            if speed > 0.0:
                limit = 0.5 * MOVER_WAY - constants[i, RADIUS] - WAY_MARGIN
                ahead = free_run(ways[1], ways[2], limit, x, y, v_x / speed, v_y / speed, max(state[i, RUN], 0.0))
                state[i, RUN] = min(state[i, RUN], ahead)
        own_x, own_y = state[i, V_X], state[i, V_Y]
        aside[i, OWN_X], aside[i, OWN_Y] = own_x, own_y
        ax, ay = -aside[i, PUSH_X] / RELAXATION, -aside[i, PUSH_Y] / RELAXATION
        fx = fy = 0.0
        if robot[2] >= 0.0:
            speed = math.sqrt(own_x * own_x + own_y * own_y)
            ex, ey = (own_x / speed, own_y / speed) if speed > 0.0 else (0.0, 0.0)
            fx, fy = push_from_disc(state, i, constants[i, RADIUS], ex, ey, robot[0], robot[1], robot[2])
            ax, ay = ax + fx, ay + fy
        within_reach = fx != 0.0 or fy != 0.0
        if not pushed and not within_reach:
            continue
        v_x, v_y = own_x + aside[i, PUSH_X] + ax * dt, own_y + aside[i, PUSH_Y] + ay * dt
        speed, fastest = math.sqrt(v_x * v_x + v_y * v_y), MAX_SPEED_FACTOR * constants[i, SPEED]
        if speed > fastest:
            v_x, v_y = v_x * fastest / speed, v_y * fastest / speed
        # As in the crowd: the velocity, or its part along a wall where it leads into one.
        if not _may_step(i, dt, v_x, v_y, constants, state, ways):
            if _may_step(i, dt, v_x, 0.0, constants, state, ways):
                v_y = 0.0
            elif _may_step(i, dt, 0.0, v_y, constants, state, ways):
                v_x = 0.0
            else:
                v_x = v_y = 0.0
        push_x, push_y = v_x - own_x, v_y - own_y
        if not within_reach and math.sqrt(push_x * push_x + push_y * push_y) < STILL:
            aside[i, PUSH_X] = aside[i, PUSH_Y] = 0.0
            continue
        aside[i, PUSH_X], aside[i, PUSH_Y] = push_x, push_y
        state[i, V_X], state[i, V_Y] = v_x, v_y
