"""Compiled steps of the arena: random numbers, new episodes, driving, and the errors of the sensors.

Each takes the rows it works on and touches no others; every row has a random stream of its own.
"""

import math
from typing import NamedTuple

import numpy as np

from train.arena.bodies import ACCELERATION as BODY_ACCELERATION
from train.arena.bodies import HIGHEST, RADIUS
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
from vuca_nav.kernel_cache import njit
from worlds.splitmix import next_uniform

_NUM_UNIFORM = 21
"""Number of uniform numbers that a new episode takes."""
_WORD = 9007199254740992.0
"""2^53: a number in [0, 1) times this is a seed."""
_MOST_GAIN_SPREAD = 0.1
"""Greatest relative spread of a body's gain: the part of the response that identification is surest of."""


class EpisodeSettings(NamedTuple):
    """Settings that episodes are drawn from."""

    shares: np.ndarray
    """Shares of the kinds of worlds, (kinds,)."""
    body_shares: np.ndarray
    """Shares of the kinds of bodies, (body kinds,)."""
    has_movers: np.ndarray
    """Whether each kind of world has movers, (kinds,)."""
    movers: tuple[int, int]
    """Fewest and most movers."""
    mover_speeds: tuple[float, float]
    """Slowest and fastest speed of a mover, as multiples of the body's greatest."""
    latency: tuple[int, int]
    """Shortest and longest latency [ticks]."""
    time_factor: float
    """Time limit as a multiple of the shortest path's time ..."""
    time_slack: float
    """... and the time added to it [s]."""
    keep_off: float
    """Distance between a mover and the robot's circle at its start [m]."""
    response_spread: float
    velocity_noise: float
    odometry_scale: float
    odometry_turn: float
    pose_sigma: float
    yaw_sigma: float
    """The last six fields are as ``train.arena.config.Imperfections`` has them."""


class EpisodeSource(NamedTuple):
    """The bodies and layouts that episodes are drawn from; see ``BodyColumns`` and ``Bank``."""

    body_first: np.ndarray
    body_shape: np.ndarray
    body_limits: np.ndarray
    body_response: np.ndarray
    kind_first: np.ndarray
    pairs: np.ndarray


class Wheels(NamedTuple):
    """Drive wheels, which limit the speed and turn rate that go together."""

    arm: np.ndarray
    """Half the distance of the drive wheels of each body, 0 if it has none, (b,) [m]."""
    speed: float
    """Greatest speed at the rim [m/s]."""


class Driven(NamedTuple):
    """Results of driving for a decision."""

    poses: np.ndarray
    """Poses after each tick, (n, ticks, 3)."""
    twist: np.ndarray
    """True twist in the last tick, (n, 3)."""
    motion: np.ndarray
    """Displacement by odometry in the decision's first base frame, (n, 3)."""
    way: np.ndarray
    """Length of the path driven, (n,) [m]."""


class Ends(NamedTuple):
    """Outcomes: whether and how episodes ended."""

    progress: np.ndarray
    collided: np.ndarray
    reached: np.ndarray
    timed_out: np.ndarray
    ended: np.ndarray
    """Tick within this decision after which each episode ended, from 1."""


class SensorFlaws(NamedTuple):
    """Errors of the sensors, as ``train.arena.config.Imperfections`` has them."""

    table: np.ndarray
    """Range noise of many beams in a row, infinite for a dropped one, (T,) [m]."""
    velocity_scale: np.ndarray
    """Velocities that the sigma of the twist is relative to, (b, 3)."""
    min_range: float
    """Least range of the lidar [m]."""
    max_range: float
    """Greatest range of the lidar [m]."""
    empty_scan: float
    twist_sigma: float
    pose_sigma: float
    yaw_sigma: float
    pose_time: float


class Sensed(NamedTuple):
    """Measurements that the stack is given."""

    ranges: np.ndarray
    """True ranges, which become the reported ones, (n, num_beams) [m]."""
    clearance: np.ndarray
    """Output: least true range beyond the footprint, ``inf`` if there is nothing, (n,) [m]."""
    nearest: np.ndarray
    """Output: least reported range, (n,) [m]."""
    goals: np.ndarray
    """Output: goals in base_link, (n, 2) [m]."""
    twist: np.ndarray
    """Output: measured twists, (n, 3)."""


@njit(cache=True, nogil=True)
def _normals(streams, i, out):
    """Fill an even number of standard normal numbers (Box and Muller)."""
    for k in range(0, len(out) - 1, 2):
        radius = math.sqrt(-2.0 * math.log(1.0 - next_uniform(streams.seeds, streams.drawn, i)))
        angle = 2.0 * math.pi * next_uniform(streams.seeds, streams.drawn, i)
        out[k], out[k + 1] = radius * math.cos(angle), radius * math.sin(angle)


@njit(cache=True, nogil=True)
def _pick(shares, u):
    """Find the index that a number in [0, 1) picks from shares that sum to 1."""
    for k in range(len(shares) - 1):
        if u < shares[k]:
            return k
        u -= shares[k]
    return len(shares) - 1


@njit(cache=True, nogil=True)
def draw_episodes(rows, tick, settings, source, streams, episodes, robots, request):
    """Draw new episodes for these rows: body, layout, task, response, errors and the request for movers.

    Args:
        rows: Indices of the rows, (k,).
        tick: Duration of a tick [s].
        settings: An ``EpisodeSettings``.
        source: An ``EpisodeSource``.
        streams: ``Streams`` of the rows; state.
        episodes: Output, an ``Episodes``.
        robots: Output, a ``Robots``.
        request: Output, a ``MoverRequest``.
    """
    task, pose, response = episodes.task, robots.pose, robots.response
    u, normal = np.empty(_NUM_UNIFORM), np.empty(6)
    for r in range(len(rows)):
        i = rows[r]
        for k in range(_NUM_UNIFORM):
            u[k] = next_uniform(streams.seeds, streams.drawn, i)
        _normals(streams, i, normal)
        kind = episodes.kind[i] = _pick(settings.shares, u[0])
        first, end = source.kind_first[kind]
        layout = episodes.layout[i] = first + int(u[1] * (end - first))
        task[i] = source.pairs[layout, int(u[2] * source.pairs.shape[1])]
        what = _pick(settings.body_shares, u[3])
        b = source.body_first[what] + int(u[4] * (source.body_first[what + 1] - source.body_first[what]))
        robots.body[i] = b
        fastest = source.body_limits[b, 0, HIGHEST]
        pose[i, 0], pose[i, 1] = task[i, START_X], task[i, START_Y]
        pose[i, 2] = (2.0 * u[5] - 1.0) * math.pi
        robots.velocity[i], robots.commands[i], episodes.ticks[i] = 0.0, 0.0, 0
        episodes.distance[i] = math.hypot(task[i, GOAL_X] - pose[i, 0], task[i, GOAL_Y] - pose[i, 1])
        limit = settings.time_factor * task[i, SHORTEST] / fastest + settings.time_slack
        episodes.time_limit[i] = int(math.ceil(limit / tick))
        spread = settings.response_spread
        for axis in range(3):
            gain, lag, delay, noise = source.body_response[b, axis]
            response[i, axis, GAIN] = gain * (1.0 + min(spread, _MOST_GAIN_SPREAD) * (2.0 * u[6 + axis] - 1.0))
            lag *= 1.0 + spread * (2.0 * u[9 + axis] - 1.0)
            delay *= 1.0 + spread * (2.0 * u[12 + axis] - 1.0)
            response[i, axis, KEEP] = math.exp(-tick / lag)
            response[i, axis, DELAY] = math.floor(delay / tick + 0.5)
            response[i, axis, NOISE] = noise * settings.velocity_noise * (1.0 + spread * (2.0 * u[15 + axis] - 1.0))
            response[i, axis, ACCELERATION] = source.body_limits[b, axis, BODY_ACCELERATION]
        shortest, longest = settings.latency
        robots.latency[i] = shortest + int(u[18] * (longest - shortest + 1))
        robots.odometry[i, SCALE_ODOMETRY] = settings.odometry_scale * normal[0]
        robots.odometry[i, TURN_ODOMETRY] = settings.odometry_turn * normal[1]
        error = robots.pose_error[i]
        error[0], error[1] = settings.pose_sigma * normal[2], settings.pose_sigma * normal[3]
        error[2] = settings.yaw_sigma * normal[4]
        fewest, most = settings.movers
        request.wanted[i] = fewest + int(u[19] * (most - fewest + 1)) if settings.has_movers[kind] else 0
        slow, fast = settings.mover_speeds
        request.speeds[i, 0], request.speeds[i, 1] = slow * fastest, fast * fastest
        request.keep_off[i] = settings.keep_off + source.body_shape[b, RADIUS]
        request.seeds[i] = np.uint64(u[20] * _WORD)


@njit(cache=True, nogil=True)
def assign_parts(rows, movers, shapes, local, part_count, parts, columns):
    """Fill in the columns of the parts of each row's movers.

    Args:
        rows: Indices of the rows, (k,).
        movers: A ``MoverRows``.
        shapes: Shapes of the parts of each kind of mover, (b, MAX_PARTS, LEVEL_COLUMNS).
        local: Poses of the parts in their mover's frame, (b, MAX_PARTS, 5).
        part_count: Number of parts of each kind, (b,).
        parts: Output, a ``PartRows``.
        columns: Output, shapes of the rows' parts, (n, p, LEVEL_COLUMNS).
    """
    for r in range(len(rows)):
        i = rows[r]
        p = 0
        for m in range(movers.counts[i]):
            kind = movers.kinds[i, m]
            for q in range(part_count[kind]):
                columns[i, p], parts.local[i, p], parts.mover[i, p] = shapes[kind, q], local[kind, q], m
                p += 1
        parts.counts[i] = p


@njit(cache=True, nogil=True)
def drive(rows, tick, wanted, wheels, streams, ticks, robots, driven):
    """Carry a command out for some ticks.

    Args:
        rows: Indices of the rows, (k,).
        tick: Duration of a tick [s].
        wanted: Commands within the body's limits, (n, 3).
        wheels: A ``Wheels``.
        streams: ``Streams`` of the rows; state.
        ticks: Ticks since the episode's start, (n,); state.
        robots: A ``Robots``; state.
        driven: Output, a ``Driven``.
    """
    body, pose, velocity, response, latency, commands, _, odometry = robots
    poses, twist, motion, way = driven
    count = poses.shape[1]
    normal, command = np.empty(4), np.empty(3)
    for r in range(len(rows)):
        i = rows[r]
        x, y, yaw = pose[i]
        x0, y0, yaw0 = x, y, yaw
        command[:] = wanted[i]
        arm = wheels.arm[body[i]]
        if arm > 0.0:  # no wheel turns faster than it can: the arc stays, both speeds shrink (robots.bodies.tiago)
            fastest = abs(command[0]) + abs(command[2]) * arm
            if fastest > wheels.speed:
                command *= wheels.speed / fastest
        length = 0.0
        for t in range(count):
            at = ticks[i]
            ticks[i] += 1
            commands[i, at % RING] = command
            _normals(streams, i, normal)
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
def judge(rows, poses, hit, tolerance, episodes, ends):
    """Judge which episodes ended and how.

    Args:
        rows: Indices of the rows, (k,).
        poses: Poses after each tick of the decision, (n, ticks, 3).
        hit: First tick at which the footprint overlapped something, -1 if there is none, (n,).
        tolerance: Distance from the goal within which it is reached [m].
        episodes: An ``Episodes``; the distances are changed.
        ends: Output, an ``Ends``.
    """
    _, _, task, ticks, time_limit, distance = episodes
    progress, collided, reached, timed_out, ended = ends
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
def sense(rows, period, flaws, streams, robots, task, true_twist, outline, sensed):
    """Compute the measurements that the stack is given from the truth.

    Args:
        rows: Indices of the rows, (k,).
        period: Time between decisions [s].
        flaws: A ``SensorFlaws``.
        streams: ``Streams`` of the rows; state.
        robots: A ``Robots``; the errors of the pose are changed.
        task: Tasks, (n, 5).
        true_twist: True twists, (n, 3).
        outline: Radius of the footprint along each beam, (n, num_beams) [m].
        sensed: A ``Sensed``; written.
    """
    ranges, clearance, nearest, goals_in_base, twist_measured = sensed
    table, min_range, max_range = flaws.table, flaws.min_range, flaws.max_range
    body, pose, pose_error = robots.body, robots.pose, robots.pose_error
    num_beams = ranges.shape[1]
    normal = np.empty(6)
    keep = math.exp(-period / flaws.pose_time)
    renew = math.sqrt(1.0 - keep * keep)
    for r in range(len(rows)):
        i = rows[r]
        begin = int(next_uniform(streams.seeds, streams.drawn, i) * (len(table) - num_beams))
        empty = next_uniform(streams.seeds, streams.drawn, i) < flaws.empty_scan
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
        _normals(streams, i, normal)
        for axis in range(3):
            sigma = flaws.yaw_sigma if axis == 2 else flaws.pose_sigma
            pose_error[i, axis] = keep * pose_error[i, axis] + renew * sigma * normal[axis]
            sigma = flaws.twist_sigma * flaws.velocity_scale[body[i], axis]
            twist_measured[i, axis] = true_twist[i, axis] + sigma * normal[3 + axis]
        yaw = pose[i, 2] + pose_error[i, 2]
        dx = task[i, GOAL_X] - pose[i, 0] - pose_error[i, 0]
        dy = task[i, GOAL_Y] - pose[i, 1] - pose_error[i, 1]
        cos, sin = math.cos(yaw), math.sin(yaw)
        goals_in_base[i, 0], goals_in_base[i, 1] = cos * dx + sin * dy, cos * dy - sin * dx
