"""What may come of a command: the compiled part of the shield (``vuca_nav.shield.shield``)."""

import math

import numpy as np
from numba import njit

from vuca_nav.perception.distance_field import smooth_room_around

_HOPELESS = 0.1
"""So much room missing costs no less than more of it [m]; a little costs half as much."""
_MOST_NEAR = 6
"""Things that are reckoned with at a time, the nearest."""
_OWN_RETURNS = 0.15
"""So near to a moving thing's circle a return is its own [m]."""
_TURN_GAIN = 4.0
"""Of the turn towards a way out [1/s]."""


@njit(cache=True)
def what_moves(things, moving, certain, out):
    """Copy what is sure enough to move to ``out``, (k, 6) as ``things``; returns how many."""
    count = 0
    for thing in things:
        if thing[5] > certain and thing[2] * thing[2] + thing[3] * thing[3] > moving * moving:
            out[count] = thing
            count += 1
    return count


@njit(cache=True)
def without_movers(ranges, beams, moving, out):
    """The scan without the returns of what moves."""
    for b in range(len(ranges)):
        out[b] = ranges[b] if ranges[b] < np.inf else np.inf
        x, y = ranges[b] * beams[b, 0], ranges[b] * beams[b, 1]
        for thing in moving:
            near = thing[4] + _OWN_RETURNS
            if (x - thing[0]) ** 2 + (y - thing[1]) ** 2 < near * near:
                out[b] = np.inf


@njit(cache=True)
def _towards(value, target, step):
    return value + min(max(target - value, -step), step)


@njit(cache=True)
def choose(
    field, whole_field, resolution, reach, discs, futures, things, ways, trajectories, candidates, last, start, limits,
    accelerations, dt, segment, hold, caution, margin, mover_margin, mover_growth, risk_weight, turn_weight,
    side_weight,
):  # fmt: skip
    """Index of the cheapest candidate."""
    c, s = math.cos(start[2]), math.sin(start[2])
    room_now = smooth_room_around(field, resolution, reach, discs, start[0], start[1], c, s) - margin
    whole_room_now = smooth_room_around(whole_field, resolution, reach, discs, start[0], start[1], c, s) - margin
    near = _what_may_be_met(futures, things, start, discs, limits, dt, mover_margin + 0.3)
    change = np.empty(len(candidates))
    for n in range(len(candidates)):
        u = candidates[n]
        change[n] = 4.0 * ((u[0] - candidates[0, 0]) / (limits[0] - limits[1])) ** 2
        change[n] += turn_weight * ((u[2] - candidates[0, 2]) / limits[3]) ** 2
        if limits[2] > 0.0:
            change[n] += side_weight * ((u[1] - candidates[0, 1]) / limits[2]) ** 2
    best, best_cost = 0, np.inf
    for n in np.argsort(change, kind="mergesort"):
        u, cost = candidates[n], change[n]
        if cost >= best_cost:
            break
        lack = _lack_of_room(
            field, whole_field, resolution, reach, discs, u, last, start, accelerations, 0.5 * dt, hold, caution,
            margin, room_now, whole_room_now,
        )  # fmt: skip
        if lack > 0.0:
            cost += risk_weight * min(0.5 + 0.5 * lack / _HOPELESS, 1.0)
        if len(near) and cost < best_cost:
            cost += risk_weight * _risk(
                field, resolution, reach, discs, futures, things, near, ways, trajectories, u, last, start, limits,
                accelerations, dt, segment, margin, mover_margin, mover_growth, room_now,
                (best_cost - cost) / risk_weight,
            )  # fmt: skip
        if cost < best_cost:
            best, best_cost = n, cost
    return best


@njit(cache=True)
def _what_may_be_met(futures, things, start, discs, limits, dt, margin):
    """Indices of the things that in some future come so near that the body could meet them."""
    size = 0.0
    for d in range(len(discs)):
        size = max(size, math.hypot(discs[d, 0], discs[d, 1]) + discs[d, 2])
    near, gaps = np.empty(len(things), np.int64), np.empty(len(things))
    count = 0
    for k in range(len(things)):
        gap = np.inf
        for s in range(len(futures)):
            for step in range(futures.shape[2]):
                apart = math.hypot(futures[s, k, step, 0] - start[0], futures[s, k, step, 1] - start[1])
                gap = min(gap, apart - limits[0] * (step + 1) * dt - size - things[k, 4] - margin)
        if gap < 0.0:
            near[count], gaps[count] = k, gap
            count += 1
    return near[:count][np.argsort(gaps[:count], kind="mergesort")][:_MOST_NEAR]


@njit(cache=True)
def _risk(
    field, resolution, reach, discs, futures, things, near, ways, trajectories, u, last, start, limits, accelerations,
    dt, segment, margin, mover_margin, mover_growth, room_now, most,
):  # fmt: skip
    """Mean over the futures of the harm that comes even of what is best after the first segment.

    It is added up only as far as to ``most``: beyond it, another candidate is better anyway.
    """
    steps = futures.shape[2]
    first = min(int(round(segment / dt)), steps)
    obeyed = np.array([3.0, 0.0])
    begin = np.array([start[0], start[1], start[2], last[0], last[1], last[2]])
    turned = _follow(
        field, resolution, reach, discs, obeyed, u, begin, limits, accelerations, dt, margin, room_now,
        trajectories[0], 0, first,
    )  # fmt: skip
    known = np.zeros(len(ways), np.bool_)
    total, favourite = 0.0, 1
    for s in range(len(futures)):
        so_far = _harm(futures[s], things, near, discs, trajectories[0], 0, first, dt, mover_margin, mover_growth)
        least, begin_with = 1.0, favourite
        for attempt in range(len(ways)):
            if least <= so_far or so_far == 1.0:
                break
            m = (begin_with + attempt) % len(ways)
            if not known[m]:
                _follow(
                    field, resolution, reach, discs, ways[m], u, turned, limits, accelerations, dt, margin,
                    room_now, trajectories[m], first, steps,
                )  # fmt: skip
                known[m] = True
            harm = _harm(futures[s], things, near, discs, trajectories[m], first, steps, dt, mover_margin, mover_growth)
            if harm < least:
                least, favourite = harm, m
        total += max(so_far, least)
        if total >= most * len(futures):
            break
    return total / len(futures)


@njit(cache=True)
def _follow(
    field, resolution, reach, discs, way, u, begin, limits, accelerations, dt, margin, room_now, trajectory, first, end
):  # fmt: skip
    """Positions, cosine and sine of the heading on a way; the body stands before what stands.

    ``way`` is one of ``shield.ways_out``, or of kind 3: as commanded by ``u``.

    Returns:
        x, y, yaw and velocity at the end.
    """
    x, y, yaw, v_x, v_y, w_z = begin
    stands = False
    for step in range(first, end):
        if not stands:
            if way[0] == 1.0:
                error = (way[1] - yaw + math.pi) % (2.0 * math.pi) - math.pi
                wanted_x = limits[0] * max(math.cos(error), 0.0)
                wanted_y = limits[2] * math.sin(error)
                wanted_w = min(max(_TURN_GAIN * error, -limits[3]), limits[3])
            elif way[0] == 2.0:
                wanted_x, wanted_y, wanted_w = limits[1], 0.0, way[1] * limits[3]
            elif way[0] == 3.0:
                wanted_x, wanted_y, wanted_w = u[0], u[1], u[2]
            else:
                wanted_x, wanted_y, wanted_w = 0.0, 0.0, 0.0
            v_x = _towards(v_x, wanted_x, accelerations[0] * dt)
            v_y = _towards(v_y, wanted_y, accelerations[1] * dt)
            w_z = _towards(w_z, wanted_w, accelerations[2] * dt)
            c, s = math.cos(yaw + 0.5 * w_z * dt), math.sin(yaw + 0.5 * w_z * dt)
            next_x, next_y, next_yaw = x + (v_x * c - v_y * s) * dt, y + (v_x * s + v_y * c) * dt, yaw + w_z * dt
            room = smooth_room_around(
                field, resolution, reach, discs, next_x, next_y, math.cos(next_yaw), math.sin(next_yaw)
            ) - margin  # fmt: skip
            stands = room < min(0.0, room_now) - 1e-3
            if stands:
                v_x = v_y = w_z = 0.0
            else:
                x, y, yaw = next_x, next_y, next_yaw
        trajectory[step, 0], trajectory[step, 1] = x, y
        trajectory[step, 2], trajectory[step, 3] = math.cos(yaw), math.sin(yaw)
    return np.array([x, y, yaw, v_x, v_y, w_z])


@njit(cache=True, fastmath=True)
def _harm(future, things, near, discs, trajectory, first, end, dt, mover_margin, mover_growth):
    """What comes of it from one step to another: 1 for touching now, less the later, and less for only coming near."""
    harm = 0.0
    for step in range(first, end):
        x, y, c, s = trajectory[step]
        margin = mover_margin + mover_growth * (step + 1) * dt
        weight = 1.0 - 0.75 * step / future.shape[1]
        for k in near:
            there_x, there_y = future[k, step, 0] - x, future[k, step, 1] - y
            for d in range(len(discs)):
                away_x = there_x - (c * discs[d, 0] - s * discs[d, 1])
                away_y = there_y - (s * discs[d, 0] + c * discs[d, 1])
                touching = discs[d, 2] + things[k, 4]
                square = away_x * away_x + away_y * away_y
                if square < (touching + margin) ** 2:
                    gap = max(math.sqrt(square) - touching, 0.0)
                    harm = max(harm, weight * (1.0 - gap / margin))
    return harm


@njit(cache=True)
def _lack_of_room(
    field, whole_field, resolution, reach, discs, u, last, start, accelerations, dt, hold, caution, margin, room_now,
    whole_room_now,
):  # fmt: skip
    """How much room is missing to go on so for ``hold`` and then come to a stand, 0 if none is [m]."""
    x, y, yaw = start[0], start[1], start[2]
    v_x, v_y, w_z = last[0], last[1], last[2]
    t, lack = 0.0, 0.0
    while True:
        held = t < hold
        v_x = _towards(v_x, u[0] if held else 0.0, accelerations[0] * dt)
        v_y = _towards(v_y, u[1] if held else 0.0, accelerations[1] * dt)
        w_z = _towards(w_z, u[2] if held else 0.0, accelerations[2] * dt)
        if not held and v_x == 0.0 and v_y == 0.0 and w_z == 0.0:
            return lack
        c, s = math.cos(yaw + 0.5 * w_z * dt), math.sin(yaw + 0.5 * w_z * dt)
        x += (v_x * c - v_y * s) * dt
        y += (v_x * s + v_y * c) * dt
        yaw += w_z * dt
        t += dt
        c, s = math.cos(yaw), math.sin(yaw)
        # Too near an obstacle one may stay as one is, or move away from it.
        room = smooth_room_around(field, resolution, reach, discs, x, y, c, s) - margin
        lack = max(lack, min(0.0, room_now) - room)
        if t <= caution:
            room = smooth_room_around(whole_field, resolution, reach, discs, x, y, c, s) - margin
            lack = max(lack, min(0.0, whole_room_now) - room)
