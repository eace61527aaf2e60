"""Rollouts: what may come of a command, the compiled part of the shield (``vuca_nav.shield.shield``)."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from vuca_nav.perception.distance_field import DistanceField, smooth_clearance_at
from vuca_nav.perception.tracks import CERTAINTY, HAS_LEFT, RADIUS, V_X, V_Y, X, Y
from vuca_nav.types import FloatArray

STAND, HEAD_OFF, BACK, AS_COMMANDED = 0.0, 1.0, 2.0, 3.0
"""Kinds of ways out."""
_HOPELESS = 0.1
"""So much clearance missing costs no less than more of it [m]; a little costs half as much."""
_MOST_NEAR = 6
"""Tracks that are reckoned with at a time, the nearest."""
_NEAR_MARGIN = 0.3
"""Tracks that come no nearer than the margin and this in any future are left out [m]."""
_OWN_RETURNS = 0.15
"""Returns this near to a moving track's circle are its own [m]."""
_TURN_GAIN = 4.0
"""Of the turn towards a way out [1/s]."""
_AT_HORIZON = 0.25
"""Harm at the horizon over the same harm now."""
_CHAMFER_LEAST = 0.98
"""A chamfered distance is at least this share of the true one (7/5 for a diagonal)."""
_MOST_POSES = 256
"""Of a braking rollout; it ends there."""


class ShieldSettings(NamedTuple):
    """What rollouts depend on of body and configuration; see ``ShieldConfig`` for the fields of the same names."""

    limits: FloatArray
    """(4,) max_v_x, min_v_x, max_v_y, max_w_z [m/s, m/s, m/s, rad/s]."""
    accelerations: FloatArray
    """(3,) [m/s^2, m/s^2, rad/s^2]"""
    discs: FloatArray
    """(k, 3) that cover the footprint: x, y, radius [m]."""
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
    moving: float
    certainty: float


class ShieldScene(NamedTuple):
    """What surrounds the robot at a tick."""

    static: DistanceField
    """Of the returns that stand."""
    whole: DistanceField
    """Of all returns."""
    tracks: FloatArray
    """(k, TRACK_SIZE) of the moving ones, where they are when the body answers."""
    futures: FloatArray
    """(scenarios, k, steps, 2) of them, in base_link [m]."""


class BodyState(NamedTuple):
    """Where the body is, in the present base_link, when it answers a command, and what it does then."""

    x: float
    y: float
    yaw: float
    v_x: float
    v_y: float
    w_z: float


class WaysOut(NamedTuple):
    """What the body may do after the first segment."""

    ways: FloatArray
    """(m, 2) kind and its number: a direction of the present base_link [rad], or the share of the greatest turn."""
    trajectories: FloatArray
    """(m, steps, 4) scratch: x, y, cosine and sine of the heading."""


@njit(cache=True)
def select_moving(tracks, settings, out):
    """Copy the tracks that surely move to ``out``; returns their number."""
    count = 0
    for track in tracks:
        speed_2 = track[V_X] * track[V_X] + track[V_Y] * track[V_Y]
        certain = track[CERTAINTY] > settings.certainty and track[HAS_LEFT] > 0.0
        if certain and speed_2 > settings.moving * settings.moving:
            out[count] = track
            count += 1
    return count


@njit(cache=True)
def without_tracks(ranges, beams, tracks, out):
    """The scan without the returns of these tracks, into ``out`` (num_beams,) [m]."""
    for b in range(len(ranges)):
        out[b] = ranges[b] if ranges[b] < np.inf else np.inf
        x, y = ranges[b] * beams[b, 0], ranges[b] * beams[b, 1]
        for track in tracks:
            near = track[RADIUS] + _OWN_RETURNS
            if (x - track[X]) ** 2 + (y - track[Y]) ** 2 < near * near:
                out[b] = np.inf


@njit(cache=True)
def stops_clear(ranges, beams, command, state, settings, blur):
    """Whether the body surely has clearance to obey a command for ``hold`` and then to brake, by the scan alone.

    If so, ``_lack_of_clearance`` is 0 by any field of this scan; if not, the field has to tell.

    Args:
        ranges: (num_beams,) [m]
        beams: (num_beams, 2)
        command: v_x, v_y, w_z.
        state: A ``BodyState``.
        settings: ``ShieldSettings``.
        blur: How much nearer a return may be in a field, ``DistanceField.uncertainty`` [m].
    """
    poses = np.empty((_MOST_POSES, 4))
    farthest, count, t, body, dt = 0.0, 0, 0.0, state, 0.5 * settings.time_step
    while count < _MOST_POSES:
        body, stands = _brake(body, command, t < settings.hold, settings.accelerations, dt)
        if stands:
            break
        t += dt
        poses[count] = body.x, body.y, math.cos(body.yaw), math.sin(body.yaw)
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
def cheapest(candidates, state, scene, ways_out, settings):
    """Index of the cheapest candidate (n, 3); the first is the policy's command."""
    c, s = math.cos(state.yaw), math.sin(state.yaw)
    discs = settings.discs
    now = smooth_clearance_at(scene.static, discs, state.x, state.y, c, s) - settings.margin
    whole_now = smooth_clearance_at(scene.whole, discs, state.x, state.y, c, s) - settings.margin
    near = _what_may_be_met(scene, state, settings)
    change = _changes(candidates, settings)
    best, best_cost = 0, np.inf
    for n in np.argsort(change, kind="mergesort"):
        command, cost = candidates[n], change[n]
        if cost >= best_cost:
            break
        lack = _lack_of_clearance(command, state, scene, settings, now, whole_now)
        if lack > 0.0:
            cost += settings.risk_weight * min(0.5 + 0.5 * lack / _HOPELESS, 1.0)
        if len(near) and cost < best_cost:
            most = (best_cost - cost) / settings.risk_weight
            cost += settings.risk_weight * _risk(command, state, scene, near, ways_out, settings, now, most)
        if cost < best_cost:
            best, best_cost = n, cost
    return best


@njit(cache=True)
def _changes(candidates, settings):
    """What each candidate's difference from the first costs."""
    limits = settings.limits
    change = np.empty(len(candidates))
    for n in range(len(candidates)):
        u = candidates[n]
        change[n] = 4.0 * ((u[0] - candidates[0, 0]) / (limits[0] - limits[1])) ** 2
        change[n] += settings.turn_weight * ((u[2] - candidates[0, 2]) / limits[3]) ** 2
        if limits[2] > 0.0:
            change[n] += settings.side_weight * ((u[1] - candidates[0, 1]) / limits[2]) ** 2
    return change


@njit(cache=True)
def _what_may_be_met(scene, state, settings):
    """Indices of the tracks that in some future come so near that the body could meet them."""
    tracks, futures = scene.tracks, scene.futures
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
def _risk(command, state, scene, near, ways_out, settings, now, most):
    """Mean over the futures of the harm that comes even of what is best after the first segment.

    It is added up only as far as to ``most``: beyond it, another candidate is better anyway.
    """
    futures, ways, trajectories = scene.futures, ways_out.ways, ways_out.trajectories
    steps = futures.shape[2]
    first = min(int(round(settings.segment / settings.time_step)), steps)
    turned = _roll_out(
        AS_COMMANDED, 0.0, command, state, scene.static, settings, now, trajectories[0][:first]
    )  # fmt: skip
    known = np.zeros(len(ways), np.bool_)
    total, favourite = 0.0, 1
    for s in range(len(futures)):
        future = futures[s]
        so_far = _harm(future, scene.tracks, near, trajectories[0], 0, first, settings)
        least, begin_with = 1.0, favourite
        for attempt in range(len(ways)):
            if least <= so_far or so_far == 1.0:
                break
            m = (begin_with + attempt) % len(ways)
            if not known[m]:
                _roll_out(
                    ways[m, 0], ways[m, 1], command, turned, scene.static, settings, now, trajectories[m][first:]
                )  # fmt: skip
                known[m] = True
            harm = _harm(future, scene.tracks, near, trajectories[m], first, steps, settings)
            if harm < least:
                least, favourite = harm, m
        total += max(so_far, least)
        if total >= most * len(futures):
            break
    return total / len(futures)


@njit(cache=True)
def _towards(value, target, step):
    return value + min(max(target - value, -step), step)


@njit(cache=True)
def _advance(state, v_x, v_y, w_z, dt):
    """The state after a time step at these velocities."""
    c, s = math.cos(state.yaw + 0.5 * w_z * dt), math.sin(state.yaw + 0.5 * w_z * dt)
    x, y = state.x + (v_x * c - v_y * s) * dt, state.y + (v_x * s + v_y * c) * dt
    return BodyState(x, y, state.yaw + w_z * dt, v_x, v_y, w_z)


@njit(cache=True)
def _brake(state, command, held, accelerations, dt):
    """The state after a time step of obeying a command, or of braking; and whether it had come to a stand before."""
    v_x = _towards(state.v_x, command[0] if held else 0.0, accelerations[0] * dt)
    v_y = _towards(state.v_y, command[1] if held else 0.0, accelerations[1] * dt)
    w_z = _towards(state.w_z, command[2] if held else 0.0, accelerations[2] * dt)
    stands = not held and v_x == 0.0 and v_y == 0.0 and w_z == 0.0
    return _advance(state, v_x, v_y, w_z, dt), stands


@njit(cache=True)
def _roll_out(kind, number, command, state, static, settings, now, trajectory):
    """Positions, cosine and sine of the heading on a way, into ``trajectory``; the body stands before what stands.

    Returns:
        The state at the end.
    """
    limits, accelerations, dt = settings.limits, settings.accelerations, settings.time_step
    stands = False
    for step in range(len(trajectory)):
        if not stands:
            if kind == HEAD_OFF:
                error = (number - state.yaw + math.pi) % (2.0 * math.pi) - math.pi
                wanted_x = limits[0] * max(math.cos(error), 0.0)
                wanted_y = limits[2] * math.sin(error)
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
            clearance = smooth_clearance_at(
                static, settings.discs, following.x, following.y, math.cos(following.yaw), math.sin(following.yaw)
            ) - settings.margin  # fmt: skip
            stands = clearance < min(0.0, now) - 1e-3
            if stands:
                state = BodyState(state.x, state.y, state.yaw, 0.0, 0.0, 0.0)
            else:
                state = following
        trajectory[step, 0], trajectory[step, 1] = state.x, state.y
        trajectory[step, 2], trajectory[step, 3] = math.cos(state.yaw), math.sin(state.yaw)
    return state


@njit(cache=True, fastmath=True)
def _harm(future, tracks, near, trajectory, first, end, settings):
    """What comes of it from one step to another: 1 for touching now, less the later, and less for only coming near."""
    discs, dt = settings.discs, settings.time_step
    harm = 0.0
    for step in range(first, end):
        x, y, c, s = trajectory[step]
        margin = settings.mover_margin + settings.mover_growth * (step + 1) * dt
        weight = 1.0 - (1.0 - _AT_HORIZON) * step / future.shape[1]
        for k in near:
            there_x, there_y = future[k, step, 0] - x, future[k, step, 1] - y
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
def _lack_of_clearance(command, state, scene, settings, now, whole_now):
    """How much clearance is missing to go on so for ``hold`` and then come to a stand, 0 if none is [m]."""
    body, dt = state, 0.5 * settings.time_step
    t, lack = 0.0, 0.0
    while True:
        body, stands = _brake(body, command, t < settings.hold, settings.accelerations, dt)
        if stands:
            return lack
        t += dt
        c, s = math.cos(body.yaw), math.sin(body.yaw)
        # Too near an obstacle the body may stay as it is, or move away from it.
        clearance = smooth_clearance_at(scene.static, settings.discs, body.x, body.y, c, s) - settings.margin
        lack = max(lack, min(0.0, now) - clearance)
        if t <= settings.caution:
            clearance = smooth_clearance_at(scene.whole, settings.discs, body.x, body.y, c, s) - settings.margin
            lack = max(lack, min(0.0, whole_now) - clearance)
