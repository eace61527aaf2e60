"""Rollouts of commands: the compiled part of the shield (``vuca_nav.shield.shield``)."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.distance_field import DistanceField, smooth_clearance_at
from vuca_nav.perception.tracks import RADIUS, is_of_track
from vuca_nav.types import FloatArray

STAND, HEAD_OFF, BACK, AS_COMMANDED = 0.0, 1.0, 2.0, 3.0
"""Kinds of ways out."""
_FORWARD_WEIGHT = 4.0
"""Cost of changing v_x by its whole range, to which the other weights relate."""
_LEAST_LACK = 0.5
"""Share of the full cost that the least lack of clearance has."""
_HOPELESS = 0.1
"""Lack of clearance from which on more costs no more [m]; a little lack costs half as much."""
_MOST_NEAR = 6
"""Number of tracks that are taken into account at a time, the nearest."""
_NEAR_MARGIN = 0.3
"""Distance beyond the margin within which a track must come in some future to be taken into account [m]."""
_OWN_RETURNS = 0.15
"""Returns this near to a moving track's circle are its own [m]."""
_TURN_GAIN = 4.0
"""Gain of the turn towards a way out [1/s]."""
_AT_HORIZON = 0.25
"""Harm at the horizon over the same harm now."""
_CHAMFER_LEAST = 0.98
"""A chamfered distance is at least this share of the true one (7/5 for a diagonal)."""
_TIE = 1e-9
"""Costs that differ by less are alike."""
_NEARER = 1e-3
"""Loss of clearance from now on at which an obstacle is in the way [m]."""
_OBEY = np.array([AS_COMMANDED, 0.0, 1.0, 0.0])
_MOST_POSES = 256
"""Greatest number of poses of a braking rollout; it ends there."""


class ShieldSettings(NamedTuple):
    """Settings of rollouts, from body and configuration; see ``ShieldConfig`` for the fields of the same names."""

    limits: FloatArray
    """(4,) limits max_v_x, min_v_x, max_v_y, max_w_z [m/s, m/s, m/s, rad/s]."""
    accelerations: FloatArray
    """(3,) greatest accelerations [m/s^2, m/s^2, rad/s^2]."""
    discs: FloatArray
    """(k, 3) discs that cover the footprint: x, y, radius [m]."""
    size: float
    """Radius of the circle about base_link that encloses the discs [m]."""
    time_step: float
    segment: float
    hold: float
    caution: float
    margin: float
    mover_margin: float
    mover_growth: float
    risk_weight: float
    turn_weight: float
    side_weight: float


class ShieldScene(NamedTuple):
    """Obstacles and tracks about the robot at a tick."""

    static: DistanceField
    """Distance field of the static returns."""
    whole: DistanceField
    """Distance field of all returns."""
    tracks: FloatArray
    """(k, TRACK_SIZE) moving tracks at the moment when the body answers."""
    futures: FloatArray
    """(scenarios, k, steps, 2) futures of the tracks, in base_link [m]."""
    near: np.ndarray
    """Indices of the tracks that may be met, as ``what_may_be_met`` gives them."""


class BodyState(NamedTuple):
    """Pose, in the present base_link, and velocity of the body when it answers a command."""

    x: float
    y: float
    yaw: float
    cos: float
    """Cosine of the yaw."""
    sin: float
    """Sine of the yaw."""
    v_x: float
    v_y: float
    w_z: float


class WaysOut(NamedTuple):
    """Motions that the body may choose from after the first segment."""

    ways: FloatArray
    """(m, 4) kind, its number (a direction of the present base_link [rad], or the share of the greatest turn), and the
    number's cosine and sine."""
    trajectories: FloatArray
    """(m, steps, 4) scratch: x, y, cosine and sine of the heading."""


@njit(cache=True)
def without_tracks(ranges, level, tracks, out):
    """The scan without the returns of these tracks, into ``out`` (num_beams,) [m].

    Args:
        ranges: (num_beams,) [m]
        level: The same scan over ground, a ``LevelScan``, as the tracks are.
        tracks: (k, TRACK_SIZE)
        out: Written to: ``inf`` where nothing came back, or only a track.
    """
    for b in range(len(ranges)):
        r = level.ranges[b]
        own = r < np.inf and is_of_track(r * level.beams[b, 0], r * level.beams[b, 1], tracks, _OWN_RETURNS)
        out[b] = ranges[b] if ranges[b] < np.inf and not own else np.inf


@njit(cache=True)
def stops_clear(ranges, beams, command, state, settings, blur):
    """Whether the body surely has clearance to obey a command for ``hold`` and then to brake, by the scan alone.

    If so, ``_lack_of_clearance`` is 0 by any field of this scan; if not, the field decides.

    Args:
        ranges: (num_beams,) ranges of the scan [m].
        beams: (num_beams, 2) directions in base_link.
        command: v_x, v_y, w_z.
        state: A ``BodyState``.
        settings: A ``ShieldSettings``.
        blur: Greatest error of a field, ``DistanceField.uncertainty`` [m].
    """
    poses = np.empty((_MOST_POSES, 4))
    farthest, count, t, body, dt = 0.0, 0, 0.0, state, 0.5 * settings.time_step
    while count < _MOST_POSES:
        body, stands = _brake(body, command, t < settings.hold, settings.accelerations, dt)
        if stands:
            break
        t += dt
        poses[count] = body.x, body.y, body.cos, body.sin
        farthest = max(farthest, math.hypot(body.x, body.y))
        count += 1
    if count == _MOST_POSES:
        return False
    discs = settings.discs
    reach = farthest + (settings.size + settings.margin + blur) / _CHAMFER_LEAST
    for b in range(len(ranges)):
        if not ranges[b] < reach:
            continue
        x, y = ranges[b] * beams[b, 0], ranges[b] * beams[b, 1]
        for d in range(len(discs)):
            least = (discs[d, 2] + settings.margin + blur) / _CHAMFER_LEAST
            for k in range(count):
                away_x = x - poses[k, 0] - poses[k, 2] * discs[d, 0] + poses[k, 3] * discs[d, 1]
                away_y = y - poses[k, 1] - poses[k, 3] * discs[d, 0] - poses[k, 2] * discs[d, 1]
                if away_x * away_x + away_y * away_y < least * least:
                    return False
    return True


@njit(cache=True)
def cheapest(candidates, state, scene, ways_out, settings, guess):
    """Index of the cheapest candidate; the one nearest to the first if several are.

    Args:
        candidates: (n, 3) commands; the first is the policy's.
        state: A ``BodyState``.
        scene: A ``ShieldScene``.
        ways_out: A ``WaysOut``.
        settings: A ``ShieldSettings``.
        guess: A candidate that is probably cheap: those that cost more need no closer look.
    """
    now = _clearance(scene.static, settings, state)
    whole_now = _clearance(scene.whole, settings, state)
    change = _changes(candidates, settings)
    cost = _cost(candidates[0], 0.0, np.inf, state, scene, ways_out, settings, (now, whole_now))
    if cost <= 0.0:
        return 0
    best, best_cost = 0, cost
    if guess > 0 and change[guess] < best_cost:
        cost = _cost(candidates[guess], change[guess], best_cost, state, scene, ways_out, settings, (now, whole_now))
        if cost < best_cost:
            best, best_cost = guess, cost + _TIE
    for n in np.argsort(change, kind="mergesort")[1:]:
        if change[n] >= best_cost:
            break
        cost = _cost(candidates[n], change[n], best_cost, state, scene, ways_out, settings, (now, whole_now))
        if cost < best_cost:
            best, best_cost = n, cost
    return best


@njit(cache=True)
def _clearance(field, settings, state):
    """Clearance of the body beyond the margin [m]."""
    return smooth_clearance_at(field, settings.discs, state.x, state.y, state.cos, state.sin) - settings.margin


@njit(cache=True)
def _cost(command, change, most, state, scene, ways_out, settings, clearances_now):
    """Cost of a candidate; a cost of ``most`` or more is only some number of at least ``most``."""
    cost = change
    lack = _lack_of_clearance(command, state, scene, settings, clearances_now)
    if lack > 0.0:
        cost += settings.risk_weight * min(_LEAST_LACK + (1.0 - _LEAST_LACK) * lack / _HOPELESS, 1.0)
    if len(scene.near) and cost < most:
        limit = (most - cost) / settings.risk_weight
        cost += settings.risk_weight * _risk(command, state, scene, ways_out, settings, clearances_now[0], limit)
    return cost


@njit(cache=True)
def _changes(candidates, settings):
    """Cost of each candidate's difference from the first."""
    limits = settings.limits
    change = np.empty(len(candidates))
    for n in range(len(candidates)):
        u = candidates[n]
        change[n] = _FORWARD_WEIGHT * ((u[0] - candidates[0, 0]) / (limits[0] - limits[1])) ** 2
        change[n] += settings.turn_weight * ((u[2] - candidates[0, 2]) / limits[3]) ** 2
        if limits[2] > 0.0:
            change[n] += settings.side_weight * ((u[1] - candidates[0, 1]) / limits[2]) ** 2
    return change


@njit(cache=True)
def what_may_be_met(tracks, futures, state, settings):
    """Indices of the tracks (k, TRACK_SIZE) that in some future come so near that the body could meet them."""
    margin = settings.mover_margin + _NEAR_MARGIN
    near, gaps = np.empty(len(tracks), np.int64), np.empty(len(tracks))
    count = 0
    for k in range(len(tracks)):
        gap = np.inf
        for s in range(len(futures)):
            for step in range(futures.shape[2]):
                apart = math.hypot(futures[s, k, step, 0] - state.x, futures[s, k, step, 1] - state.y)
                driven = settings.limits[0] * (step + 1) * settings.time_step
                gap = min(gap, apart - driven - settings.size - tracks[k, RADIUS] - margin)
        if gap < 0.0:
            near[count], gaps[count] = k, gap
            count += 1
    return near[:count][np.argsort(gaps[:count], kind="mergesort")][:_MOST_NEAR]


@njit(cache=True)
def _risk(command, state, scene, ways_out, settings, now, most):
    """Mean over the futures of the harm of the best way out after the first segment.

    The sum stops at ``most``: beyond it, another candidate is better anyway.
    """
    futures, ways, trajectories, near = scene.futures, ways_out.ways, ways_out.trajectories, scene.near
    steps = futures.shape[2]
    first = min(int(round(settings.segment / settings.time_step)), steps)
    turned = _roll_out(_OBEY, command, state, scene.static, settings, now, trajectories[0][:first])
    so_far_of = np.empty(len(futures))
    total = 0.0
    for s in range(len(futures)):
        so_far_of[s] = _harm(futures[s], scene.tracks, near, trajectories[0], 0, first, settings)
        total += so_far_of[s]
    known = np.zeros(len(ways), np.bool_)
    favourite = 1
    for s in range(len(futures)):
        if total >= most * len(futures):
            break
        future, so_far = futures[s], so_far_of[s]
        least, begin_with = 1.0, favourite
        for attempt in range(len(ways)):
            if least <= so_far or so_far == 1.0:
                break
            m = (begin_with + attempt) % len(ways)
            if not known[m]:
                _roll_out(ways[m], command, turned, scene.static, settings, now, trajectories[m][first:])
                known[m] = True
            harm = _harm(future, scene.tracks, near, trajectories[m], first, steps, settings)
            if harm < least:
                least, favourite = harm, m
        total += max(least - so_far, 0.0)
    return total / len(futures)


@njit(cache=True)
def _towards(value, target, step):
    return value + min(max(target - value, -step), step)


@njit(cache=True)
def _advance(state, v_x, v_y, w_z, dt):
    """The state after a time step at these velocities."""
    half = 0.5 * w_z * dt
    # To 1e-9 for half of 0.2 rad, a turn of 4 rad/s.
    square = half * half
    cos_half = 1.0 - 0.5 * square * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    sin_half = half * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    c, s = state.cos * cos_half - state.sin * sin_half, state.sin * cos_half + state.cos * sin_half
    x, y = state.x + (v_x * c - v_y * s) * dt, state.y + (v_x * s + v_y * c) * dt
    cos, sin = c * cos_half - s * sin_half, s * cos_half + c * sin_half
    return BodyState(x, y, state.yaw + w_z * dt, cos, sin, v_x, v_y, w_z)


@njit(cache=True)
def _brake(state, command, held, accelerations, dt):
    """The state after a time step of obeying a command, or of braking; and whether it had come to a stand before."""
    v_x = _towards(state.v_x, command[0] if held else 0.0, accelerations[0] * dt)
    v_y = _towards(state.v_y, command[1] if held else 0.0, accelerations[1] * dt)
    w_z = _towards(state.w_z, command[2] if held else 0.0, accelerations[2] * dt)
    stands = not held and v_x == 0.0 and v_y == 0.0 and w_z == 0.0
    return _advance(state, v_x, v_y, w_z, dt), stands


@njit(cache=True)
def _roll_out(way, command, state, static, settings, now, trajectory):
    """Write positions, cosine and sine of the heading on a way to ``trajectory``; the body stops before obstacles.

    Returns:
        The state at the end.
    """
    kind, number = way[0], way[1]
    limits, accelerations, dt = settings.limits, settings.accelerations, settings.time_step
    stands = False
    for step in range(len(trajectory)):
        if not stands:
            if kind == HEAD_OFF:
                error = (number - state.yaw + math.pi) % (2.0 * math.pi) - math.pi
                wanted_x = limits[0] * max(way[2] * state.cos + way[3] * state.sin, 0.0)
                wanted_y = limits[2] * (way[3] * state.cos - way[2] * state.sin)
                wanted_w = min(max(_TURN_GAIN * error, -limits[3]), limits[3])
            elif kind == BACK:
                wanted_x, wanted_y, wanted_w = limits[1], 0.0, number * limits[3]
            elif kind == AS_COMMANDED:
                wanted_x, wanted_y, wanted_w = command[0], command[1], command[2]
            else:
                wanted_x, wanted_y, wanted_w = 0.0, 0.0, 0.0
            v_x = _towards(state.v_x, wanted_x, accelerations[0] * dt)
            v_y = _towards(state.v_y, wanted_y, accelerations[1] * dt)
            w_z = _towards(state.w_z, wanted_w, accelerations[2] * dt)
            following = _advance(state, v_x, v_y, w_z, dt)
            stands = _clearance(static, settings, following) < min(0.0, now) - _NEARER
            if stands:
                state = BodyState(state.x, state.y, state.yaw, state.cos, state.sin, 0.0, 0.0, 0.0)
            else:
                state = following
        trajectory[step, 0], trajectory[step, 1] = state.x, state.y
        trajectory[step, 2], trajectory[step, 3] = state.cos, state.sin
    return state


@njit(cache=True)
def _harm(future, tracks, near, trajectory, first, end, settings):
    """Harm from one step to another: 1 for touching now, less the later, and less for only coming near."""
    discs, dt = settings.discs, settings.time_step
    harm = 0.0
    for step in range(first, end):
        x, y, c, s = trajectory[step]
        margin = settings.mover_margin + settings.mover_growth * (step + 1) * dt
        weight = 1.0 - (1.0 - _AT_HORIZON) * step / future.shape[1]
        for k in near:
            there_x, there_y = future[k, step, 0] - x, future[k, step, 1] - y
            if there_x * there_x + there_y * there_y >= (settings.size + tracks[k, RADIUS] + margin) ** 2:
                continue
            for d in range(len(discs)):
                away_x = there_x - (c * discs[d, 0] - s * discs[d, 1])
                away_y = there_y - (s * discs[d, 0] + c * discs[d, 1])
                touching = discs[d, 2] + tracks[k, RADIUS]
                square = away_x * away_x + away_y * away_y
                if square < (touching + margin) ** 2:
                    gap = max(math.sqrt(square) - touching, 0.0)
                    harm = max(harm, weight * (1.0 - gap / margin))
    return harm


@njit(cache=True)
def _lack_of_clearance(command, state, scene, settings, clearances_now):
    """Clearance that is missing to obey a command for ``hold`` and then brake, 0 if none is [m]."""
    now, whole_now = clearances_now
    body, dt = state, 0.5 * settings.time_step
    t, lack = 0.0, 0.0
    while True:
        body, stands = _brake(body, command, t < settings.hold, settings.accelerations, dt)
        if stands:
            return lack
        t += dt
        # Too near an obstacle the body may stay as it is, or move away from it.
        lack = max(lack, min(0.0, now) - _clearance(scene.static, settings, body))
        if t <= settings.caution:
            lack = max(lack, min(0.0, whole_now) - _clearance(scene.whole, settings, body))
