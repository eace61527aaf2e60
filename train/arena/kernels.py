"""The arena's own compiled steps: random numbers, new episodes, driving, and what the sensors make of it.

Each takes the rows it works on and touches no others; every row has a random stream of its own.
"""

import math

import numpy as np
from numba import njit

from train.arena.rows import (
    ACCELERATION,
    DELAY,
    GAIN,
    GOAL_X,
    GOAL_Y,
    KEEP,
    NOISE,
    RING,
    SCALE_ODOMETRY,
    SHORTEST,
    START_X,
    START_Y,
    TURN_ODOMETRY,
)

NUM_UNIFORM = 21
"""Numbers that a new episode takes."""


@njit(cache=True, nogil=True)
def _next(stream, drawn, i):
    """Next number of row i's stream in [0, 1): splitmix64 of its seed and counter."""
    drawn[i] += np.uint64(1)
    z = stream[i] + drawn[i] * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0


@njit(cache=True, nogil=True)
def _normals(stream, drawn, i, out):
    """Fill an even number of standard normal numbers (Box and Muller)."""
    for k in range(0, len(out) - 1, 2):
        radius = math.sqrt(-2.0 * math.log(1.0 - _next(stream, drawn, i)))
        angle = 2.0 * math.pi * _next(stream, drawn, i)
        out[k], out[k + 1] = radius * math.cos(angle), radius * math.sin(angle)


@njit(cache=True, nogil=True)
def _pick(shares, u):
    """Index into shares that sum to 1."""
    for k in range(len(shares) - 1):
        if u < shares[k]:
            return k
        u -= shares[k]
    return len(shares) - 1


@njit(cache=True, nogil=True)
def draw_episodes(
    rows, tick, shares, body_shares, body_first, kind_first, pairs, has_movers, movers, mover_speeds,
    body_shape, body_limits, body_response, imperfect, latencies, time_factor, time_slack, keep_off,
    stream, drawn, row_kind, body, layout, task, pose, velocity, response, latency, commands, ticks, time_limit,
    distance, pose_error, odometry, wanted, speeds, row_keep_off, world_seed,
):  # fmt: skip
    """New episodes for these rows: body, layout, task, response, errors and what the movers follow from.

    ``imperfect``: spread of the response, factor of its noise, odometry's scale and turn, pose's position and yaw.
    """
    u, normal = np.empty(NUM_UNIFORM), np.empty(6)
    for r in range(len(rows)):
        i = rows[r]
        for k in range(NUM_UNIFORM):
            u[k] = _next(stream, drawn, i)
        _normals(stream, drawn, i, normal)
        kind = row_kind[i] = _pick(shares, u[0])
        layout[i] = kind_first[kind, 0] + int(u[1] * (kind_first[kind, 1] - kind_first[kind, 0]))
        task[i] = pairs[layout[i], int(u[2] * pairs.shape[1])]
        what = _pick(body_shares, u[3])
        b = body_first[what] + int(u[4] * (body_first[what + 1] - body_first[what]))
        body[i] = b
        pose[i, 0], pose[i, 1] = task[i, START_X], task[i, START_Y]
        pose[i, 2] = (2.0 * u[5] - 1.0) * math.pi
        velocity[i], commands[i], ticks[i] = 0.0, 0.0, 0
        distance[i] = math.hypot(task[i, GOAL_X] - pose[i, 0], task[i, GOAL_Y] - pose[i, 1])
        limit = time_factor * task[i, SHORTEST] / body_limits[b, 0, 1] + time_slack
        time_limit[i] = int(math.ceil(limit / tick))
        spread = imperfect[0]
        for axis in range(3):
            gain, lag, delay, noise = body_response[b, axis]
            response[i, axis, GAIN] = gain * (1.0 + min(spread, 0.1) * (2.0 * u[6 + axis] - 1.0))
            lag *= 1.0 + spread * (2.0 * u[9 + axis] - 1.0)
            delay *= 1.0 + spread * (2.0 * u[12 + axis] - 1.0)
            response[i, axis, KEEP] = math.exp(-tick / lag)
            response[i, axis, DELAY] = math.floor(delay / tick + 0.5)
            response[i, axis, NOISE] = noise * imperfect[1] * (1.0 + spread * (2.0 * u[15 + axis] - 1.0))
            response[i, axis, ACCELERATION] = body_limits[b, axis, 2]
        latency[i] = latencies[0] + int(u[18] * (latencies[1] - latencies[0] + 1))
        odometry[i, SCALE_ODOMETRY], odometry[i, TURN_ODOMETRY] = imperfect[2] * normal[0], imperfect[3] * normal[1]
        pose_error[i, 0], pose_error[i, 1] = imperfect[4] * normal[2], imperfect[4] * normal[3]
        pose_error[i, 2] = imperfect[5] * normal[4]
        wanted[i] = movers[0] + int(u[19] * (movers[1] - movers[0] + 1)) if has_movers[kind] else 0
        speeds[i, 0], speeds[i, 1] = mover_speeds[0] * body_limits[b, 0, 1], mover_speeds[1] * body_limits[b, 0, 1]
        row_keep_off[i] = keep_off + body_shape[b, 0]
        world_seed[i] = np.uint64(u[20] * 9007199254740992.0)


@njit(cache=True, nogil=True)
def assign_parts(rows, counts, kinds, shapes, local, part_count, num_parts, parts, part_local, part_mover):
    """The columns of the parts of each row's movers."""
    for r in range(len(rows)):
        i = rows[r]
        p = 0
        for m in range(counts[i]):
            kind = kinds[i, m]
            for q in range(part_count[kind]):
                parts[i, p], part_local[i, p], part_mover[i, p] = shapes[kind, q], local[kind, q], m
                p += 1
        num_parts[i] = p


@njit(cache=True, nogil=True)
def drive(
    rows, tick, wanted, body, wheel_arm, wheel_speed, stream, drawn, pose, velocity, response, latency, commands,
    ticks, odometry, poses, twist, motion, way,
):  # fmt: skip
    """Carry a command out for some ticks.

    Args:
        rows: Which, (k,).
        tick: [s].
        wanted: Commands within the body's limits, (n, 3).
        body: (n,).
        wheel_arm: Of each body, 0 if it has no drive wheels, (b,) [m].
        wheel_speed: Greatest at the rim [m/s].
        stream: State, as all that follow up to ``odometry``; see ``Rows``.
        drawn: State.
        pose: State.
        velocity: State.
        response: State.
        latency: State.
        commands: State.
        ticks: State.
        odometry: State.
        poses: Output, after each tick, (n, ticks, 3).
        twist: Output, true, in the last tick, (n, 3).
        motion: Output, the displacement by odometry in the base frame before, (n, 3).
        way: Output, length of the way (n,) [m].
    """
    count = poses.shape[1]
    normal, command = np.empty(4), np.empty(3)
    for r in range(len(rows)):
        i = rows[r]
        x, y, yaw = pose[i]
        x0, y0, yaw0 = x, y, yaw
        command[:] = wanted[i]
        arm = wheel_arm[body[i]]
        if arm > 0.0:  # no wheel turns faster than it can: the arc stays, both speeds shrink (robots.bodies.tiago)
            fastest = abs(command[0]) + abs(command[2]) * arm
            if fastest > wheel_speed:
                command *= wheel_speed / fastest
        length = 0.0
        for t in range(count):
            at = ticks[i]
            ticks[i] += 1
            commands[i, at % RING] = command
            _normals(stream, drawn, i, normal)
            for axis in range(3):
                late = int(response[i, axis, DELAY]) + latency[i]
                target = response[i, axis, GAIN] * commands[i, (at - late) % RING, axis] if at >= late else 0.0
                change = (1.0 - response[i, axis, KEEP]) * (target - velocity[i, axis])
                limit = response[i, axis, ACCELERATION] * tick
                velocity[i, axis] += min(max(change, -limit), limit)
                twist[i, axis] = velocity[i, axis] + response[i, axis, NOISE] * normal[axis]
            middle = yaw + 0.5 * tick * twist[i, 2]
            cos, sin = math.cos(middle), math.sin(middle)
            dx = (cos * twist[i, 0] - sin * twist[i, 1]) * tick
            dy = (sin * twist[i, 0] + cos * twist[i, 1]) * tick
            x, y, yaw = x + dx, y + dy, yaw + tick * twist[i, 2]
            length += math.sqrt(dx * dx + dy * dy)
            poses[i, t, 0], poses[i, t, 1], poses[i, t, 2] = x, y, yaw
        pose[i, 0], pose[i, 1] = x, y
        pose[i, 2] = (yaw + math.pi) % (2.0 * math.pi) - math.pi
        cos, sin = math.cos(yaw0), math.sin(yaw0)
        scale = 1.0 + odometry[i, SCALE_ODOMETRY]
        motion[i, 0] = (cos * (x - x0) + sin * (y - y0)) * scale
        motion[i, 1] = (cos * (y - y0) - sin * (x - x0)) * scale
        motion[i, 2] = (yaw - yaw0) * (1.0 + odometry[i, TURN_ODOMETRY])
        way[i] = length


@njit(cache=True, nogil=True)
def judge(
    rows, poses, hit, task, ticks, time_limit, tolerance, distance, progress, collided, reached, timed_out, ended
):
    """Which episodes ended and how; ``ended``: the tick within this decision after which they did, from 1."""
    for r in range(len(rows)):
        i = rows[r]
        count = poses.shape[1]
        collided[i], reached[i], ended[i] = False, False, count
        for t in range(count):
            if hit[i] == t:
                collided[i], ended[i] = True, t + 1
                break
            away = math.hypot(task[i, GOAL_X] - poses[i, t, 0], task[i, GOAL_Y] - poses[i, t, 1])
            if away < tolerance:
                reached[i], ended[i] = True, t + 1
                break
        away = math.hypot(task[i, GOAL_X] - poses[i, count - 1, 0], task[i, GOAL_Y] - poses[i, count - 1, 1])
        progress[i] = distance[i] - away
        distance[i] = away
        timed_out[i] = ticks[i] >= time_limit[i] and not (collided[i] or reached[i])


@njit(cache=True, nogil=True)
def sense(
    rows, period, table, imperfect, velocity_scale, body, pose, task, twist, stream, drawn, outline, pose_error,
    min_range, max_range, ranges, clearance, nearest, goals_in_base, twist_measured,
):  # fmt: skip
    """What the stack is given of the truth.

    Args:
        rows: Which, (k,).
        period: Of decisions [s].
        table: Range noise of many beams in a row, infinite for a dropped one (T,) [m].
        imperfect: Share of empty scans, sigma of the twist, of the pose's position and of its yaw, and its time.
        velocity_scale: The sigma of the twist is relative to this, (b, 3).
        body: (n,).
        pose: True, (n, 3).
        task: (n, 5).
        twist: True, (n, 3).
        stream: State.
        drawn: State.
        outline: Of the footprint along each beam, (n, num_beams) [m].
        pose_error: State, (n, 3).
        min_range: Of the lidar [m].
        max_range: [m]
        ranges: True ranges, which become the reported ones, (n, num_beams) [m].
        clearance: Output, least true range beyond the footprint, ``inf`` if there is nothing, (n,) [m].
        nearest: Output, least reported range, (n,) [m].
        goals_in_base: Output, (n, 2) [m].
        twist_measured: Output, (n, 3).
    """
    num_beams = ranges.shape[1]
    normal = np.empty(6)
    keep = math.exp(-period / imperfect[4])
    renew = math.sqrt(1.0 - keep * keep)
    for r in range(len(rows)):
        i = rows[r]
        begin = int(_next(stream, drawn, i) * (len(table) - num_beams))
        empty = _next(stream, drawn, i) < imperfect[0]
        least, seen = math.inf, math.inf
        for k in range(num_beams):
            least = min(least, ranges[i, k] - outline[i, k])
            value = ranges[i, k] + table[begin + k]
            if not min_range <= value <= max_range:
                value = math.inf
            seen = min(seen, value)
            ranges[i, k] = value
        clearance[i] = max(least, 0.0)
        if empty:
            ranges[i] = math.inf
            seen = math.inf
        nearest[i] = seen
        _normals(stream, drawn, i, normal)
        for axis in range(3):
            sigma = imperfect[3] if axis == 2 else imperfect[2]
            pose_error[i, axis] = keep * pose_error[i, axis] + renew * sigma * normal[axis]
            twist_measured[i, axis] = twist[i, axis] + imperfect[1] * velocity_scale[body[i], axis] * normal[3 + axis]
        yaw = pose[i, 2] + pose_error[i, 2]
        dx = task[i, GOAL_X] - pose[i, 0] - pose_error[i, 0]
        dy = task[i, GOAL_Y] - pose[i, 1] - pose_error[i, 1]
        cos, sin = math.cos(yaw), math.sin(yaw)
        goals_in_base[i, 0], goals_in_base[i, 1] = cos * dx + sin * dy, cos * dy - sin * dx
