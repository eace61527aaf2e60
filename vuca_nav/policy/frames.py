"""The observation of Long et al. as publicly reproduced: frames of the scan ahead, goal and speed.

Theirs are 512 beams of the 180 degrees ahead, ``x / 6 - 0.5``, of this scan and the two before it; the goal in the
robot's frame [m]; forward speed and turn rate. Here a beam is a sector of the scan ahead (the least range of its
beams), its range is counted from the footprint's edge, and speeds are shares of the body's limits, so that one policy
drives every body. The goal is where SLAM believes it is, at most ``FARTHEST_GOAL`` away.
"""

import math

from vuca_nav.kernel_cache import njit

FARTHEST_GOAL = 10.0
"""Distance at which a goal is shown that is farther away [m]: the farthest in the reproduction's first stage."""
GOAL_SIZE, SPEED_SIZE = 2, 2
SPEED_LIMIT = 2.0
"""Multiple of the body's limits that speeds are clipped to: a bound for odometry glitches."""


@njit(cache=True, nogil=True)
def write_scan(ranges, outline, max_range, out):
    """Write the clearance of the sectors ahead, from [0, max_range] to [-0.5, 0.5].

    The beam on a border belongs to both sectors, which makes the mirror image of a scan that of its sectors.

    Args:
        ranges: (num_beams,) [m]; ``inf`` or NaN where nothing came back.
        outline: Distance to the footprint's edge along each beam, (num_beams,) [m].
        max_range: Greatest clearance [m].
        out: (sectors,), from right to left; written to.
    """
    num_beams, sectors = len(ranges), len(out)
    per_sector, first = num_beams // (2 * sectors), num_beams // 4
    for s in range(sectors):
        least = max_range
        for b in range(first + s * per_sector, first + (s + 1) * per_sector + 1):
            clearance = ranges[b] - outline[b]
            if clearance < least:  # neither inf nor NaN is
                least = clearance
        out[s] = max(least, 0.0) / max_range - 0.5


@njit(cache=True, nogil=True)
def write_goal_and_speed(goal, twist, limits, out):
    """Write the goal and the speeds.

    Args:
        goal: The goal in base_link, (2,) [m].
        twist: Measured velocity in base_link, (3,) [m/s, m/s, rad/s].
        limits: Limits as ``vuca_nav.policy.observation.limits_of`` gives them, (4,).
        out: (4,), written to.
    """
    away = math.sqrt(goal[0] * goal[0] + goal[1] * goal[1])
    scale = min(FARTHEST_GOAL / away, 1.0) if away > 0.0 else 1.0
    out[0], out[1] = goal[0] * scale, goal[1] * scale
    out[2] = min(max(twist[0] / limits[0], -SPEED_LIMIT), SPEED_LIMIT)
    out[3] = min(max(twist[2] / limits[3], -SPEED_LIMIT), SPEED_LIMIT)


@njit(cache=True, nogil=True)
def write_frames_of_rows(rows, ranges, goals, twists, bodies, ring, slot, max_range, out):
    """Write the observations of some rows, and remember their scans.

    Args:
        rows: Indices of the rows, (k,).
        ranges: (n, num_beams) [m].
        goals: Goals in base_link, (n, 2) [m].
        twists: Measured velocities, (n, 3).
        bodies: Named tuple of (n, num_beams) ``outline`` and (n, 4) ``limits``.
        ring: Named tuple of (n, depth, sectors) ``scans``, (n,) ``fresh`` and (frames - 1,) ``lags``; state.
        slot: Place of this scan in the ring.
        max_range: Greatest clearance [m].
        out: (n, size), written to.
    """
    depth, past, sectors = ring.scans.shape[1], len(ring.lags), ring.scans.shape[2]
    start = (past + 1) * sectors
    for i in rows:
        now = out[i, past * sectors : start]
        write_scan(ranges[i], bodies.outline[i], max_range, now)
        for s in range(sectors):
            if ring.fresh[i]:
                ring.scans[i, :, s] = now[s]
            ring.scans[i, slot, s] = now[s]
            for k in range(past):  # the oldest first
                out[i, (past - 1 - k) * sectors + s] = ring.scans[i, (slot - ring.lags[k]) % depth, s]
        write_goal_and_speed(goals[i], twists[i], bodies.limits[i], out[i, start:])


@njit(cache=True, nogil=True)
def write_frames(ranges, past, goal, twist, bodies, max_range, out):
    """Write the observation of one robot.

    Args:
        ranges: (num_beams,) [m].
        past: Scans before this one, the youngest first, (frames - 1, num_beams) [m].
        goal: Goal in base_link, (2,) [m].
        twist: Measured velocity, (3,).
        bodies: As ``write_frames_of_rows`` has them, of one row.
        max_range: Greatest clearance [m].
        out: (size,), written to.
    """
    count = len(past)
    sectors = (len(out) - 4) // (count + 1)
    for k in range(count):
        at = (count - 1 - k) * sectors
        write_scan(past[k], bodies.outline[0], max_range, out[at : at + sectors])
    write_scan(ranges, bodies.outline[0], max_range, out[count * sectors : (count + 1) * sectors])
    write_goal_and_speed(goal, twist, bodies.limits[0], out[(count + 1) * sectors :])
