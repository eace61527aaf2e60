"""The body's motion under a command and while it brakes, and how near it comes to points: compiled."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray

MOST_POSES = 256
"""Greatest number of poses of a motion."""
LONGEST_STEP = 1.0 / 30.0
"""Longest time between two poses [s]; it is longer for a motion of more than ``MOST_POSES``."""
ROUNDING = 1e-6
"""Approach that is none [m]."""


class Outline(NamedTuple):
    """A convex footprint, by its edges."""

    corners: FloatArray
    """(k, 2) counter-clockwise in base_link [m]; edge i begins at corner i."""
    normals: FloatArray
    """(k, 2) unit vectors outwards."""
    offsets: FloatArray
    """(k,) distance of each edge from base_link's origin [m]."""
    radius: float
    """Radius of the circumscribed circle about base_link [m]."""


class Course(NamedTuple):
    """Commands that the body obeys one after the other before it brakes."""

    start: FloatArray
    """(6,) x, y, yaw, v_x, v_y, w_z at the beginning."""
    times: FloatArray
    """(n,) how long each command is obeyed [s]."""
    commands: FloatArray
    """(n, 3) the commands; the last is the one that is judged."""
    accelerations: FloatArray
    """(3,) greatest accelerations [m/s^2, m/s^2, rad/s^2]."""
    decelerations: FloatArray
    """(3,) decelerations that braking is counted on to have."""


class Beams(NamedTuple):
    """A scan by its beams."""

    ranges: FloatArray
    """(num_beams,) [m]"""
    origin: FloatArray
    """(2,) position of the lidar in base_link [m]."""
    directions: FloatArray
    """(num_beams, 2) in base_link."""


class Poses(NamedTuple):
    """Scratch for the poses of a motion."""

    poses: FloatArray
    """(MOST_POSES, 4) x, y, cosine and sine of the heading."""
    travel: FloatArray
    """(MOST_POSES,) way that no point of the footprint can have exceeded [m]."""


class Keep(NamedTuple):
    """Distance that is kept from returns."""

    margin: float
    """Clearance within which nothing is approached any further [m]."""
    turn: float
    """Approach that is none while turning on the spot within the margin [m]."""
    floor: float
    """Clearance that is kept wherever the body stands within the margin already [m]."""


def outline_of(footprint: FloatArray) -> Outline:
    """The edges of a convex footprint (k, 2), counter-clockwise [m]."""
    corners = np.ascontiguousarray(footprint, np.float64)
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    radius = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    return Outline(corners, normals, (normals * corners).sum(axis=1), radius)


def empty_poses() -> Poses:
    """Scratch for one motion."""
    return Poses(np.zeros((MOST_POSES, 4)), np.zeros(MOST_POSES))


@njit(cache=True)
def farthest(course, radius):
    """Way that no point of the footprint exceeds on a course, nor on a course whose last command is smaller [m]."""
    top_x, top_y, top_w = abs(course.start[3]), abs(course.start[4]), abs(course.start[5])
    total = 0.0
    for n in range(len(course.times)):
        top_x = max(top_x, abs(course.commands[n, 0]))
        top_y = max(top_y, abs(course.commands[n, 1]))
        top_w = max(top_w, abs(course.commands[n, 2]))
        total += course.times[n]
    a = course.decelerations
    way = (math.hypot(top_x, top_y) + radius * top_w) * total
    way += 0.5 * top_x * top_x / a[0] + 0.5 * radius * top_w * top_w / a[2]
    return way + (0.5 * top_y * top_y / a[1] if top_y > 0.0 else 0.0)


@njit(cache=True)
def roll_out(course, command, radius, out):
    """Write the poses of the body on a course, its last command replaced, until it stands.

    Args:
        course: A ``Course``.
        command: (3,) the command that is judged.
        radius: Radius of the footprint [m].
        out: ``Poses``, written to.

    Returns:
        The number of poses; the last is where the body stands.
    """
    start, last = course.start, len(course.times) - 1
    x, y, yaw = start[0], start[1], start[2]
    v_x, v_y, w_z = start[3], start[4], start[5]
    total = 0.0
    for n in range(len(course.times)):
        total += course.times[n]
    b = course.decelerations
    braking = max(max(abs(v_x), abs(command[0])) / b[0], max(abs(w_z), abs(command[2])) / b[2])
    if v_y != 0.0 or command[1] != 0.0:
        braking = max(braking, max(abs(v_y), abs(command[1])) / b[1])
    dt = max(LONGEST_STEP, (total + braking) / (MOST_POSES - 2 * len(course.times) - 4))
    out.poses[0] = x, y, math.cos(yaw), math.sin(yaw)
    out.travel[0] = 0.0
    count, way = 1, 0.0
    for n in range(len(course.times) + 1):
        brakes = n > last
        if brakes:
            u_x, u_y, u_w, steps, step = 0.0, 0.0, 0.0, MOST_POSES, dt
            a_x, a_y, a_w = b[0] * step, b[1] * step, b[2] * step
        else:
            if n == last:
                u_x, u_y, u_w = command[0], command[1], command[2]
            else:
                u_x, u_y, u_w = course.commands[n, 0], course.commands[n, 1], course.commands[n, 2]
            steps = int(math.ceil(course.times[n] / dt - 1e-9))
            step = course.times[n] / max(steps, 1)
            a = course.accelerations
            a_x, a_y, a_w = a[0] * step, a[1] * step, a[2] * step
        for _ in range(steps):
            if count == MOST_POSES or (brakes and v_x == 0.0 and v_y == 0.0 and w_z == 0.0):
                break
            n_x = v_x + min(max(u_x - v_x, -a_x), a_x)
            n_y = v_y + min(max(u_y - v_y, -a_y), a_y)
            n_w = w_z + min(max(u_w - w_z, -a_w), a_w)
            m_x, m_y, m_w = 0.5 * (v_x + n_x), 0.5 * (v_y + n_y), 0.5 * (w_z + n_w)
            middle = yaw + 0.5 * m_w * step
            c, s = math.cos(middle), math.sin(middle)
            x += (m_x * c - m_y * s) * step
            y += (m_x * s + m_y * c) * step
            yaw += m_w * step
            way += (math.hypot(m_x, m_y) + abs(m_w) * radius) * step
            v_x, v_y, w_z = n_x, n_y, n_w
            out.poses[count] = x, y, math.cos(yaw), math.sin(yaw)
            out.travel[count] = way
            count += 1
    return count


@njit(cache=True)
def distance_to(outline, x, y):
    """Distance of a point in base_link to the outline, negative inside [m]."""
    corners, normals, offsets = outline.corners, outline.normals, outline.offsets
    count, inside, squared = len(offsets), -np.inf, np.inf
    for e in range(count):
        ahead = normals[e, 0] * x + normals[e, 1] * y - offsets[e]
        inside = max(inside, ahead)
        if ahead > 0.0:
            f = e + 1 if e + 1 < count else 0
            edge_x, edge_y = corners[f, 0] - corners[e, 0], corners[f, 1] - corners[e, 1]
            away_x, away_y = x - corners[e, 0], y - corners[e, 1]
            along = (away_x * edge_x + away_y * edge_y) / (edge_x * edge_x + edge_y * edge_y)
            along = min(max(along, 0.0), 1.0)
            away_x -= along * edge_x
            away_y -= along * edge_y
            squared = min(squared, away_x * away_x + away_y * away_y)
    return math.sqrt(squared) if inside > 0.0 else inside


@njit(cache=True)
def _bounded_distance(outline, pose_x, pose_y, c, s, x, y, enough):
    """Distance of a point to the outline at a pose [m]; from ``enough`` on only some number of that, and no more."""
    away_x, away_y = x - pose_x, y - pose_y
    least = math.sqrt(away_x * away_x + away_y * away_y) - outline.radius
    return least if least >= enough else distance_to(outline, c * away_x + s * away_y, c * away_y - s * away_x)


@njit(cache=True)
def gather(scan, start, reach, exact, outline, out):
    """Collect the points of a scan that a motion can come near.

    Args:
        scan: A ``Beams``; a range that is not finite is no point.
        start: Pose at which the motion begins, in base_link of the scan.
        reach: Distance from the footprint up to which a point counts [m].
        exact: Distance up to which distances are exact; above, only no greater than they are, and above it too [m].
        outline: An ``Outline``.
        out: (n, 3) written to: x, y in base_link of the scan and the distance to the outline at the start [m].

    Returns:
        How many points there are.
    """
    count, c, s = 0, math.cos(start[2]), math.sin(start[2])
    for b in range(len(scan.ranges)):
        r = scan.ranges[b]
        if not r < np.inf:
            continue
        x, y = scan.origin[0] + r * scan.directions[b, 0], scan.origin[1] + r * scan.directions[b, 1]
        distance = _bounded_distance(outline, start[0], start[1], c, s, x, y, exact)
        if distance < reach:
            out[count] = x, y, distance
            count += 1
    return count


@njit(cache=True)
def smooth(ranges, reach, surface, out):
    """Write ranges averaged over neighbouring beams that end on the same surface; others stay as they are.

    Args:
        ranges: (num_beams,) [m]; what is not finite stays.
        reach: Number of neighbours on each side.
        surface: Difference of ranges up to which two returns are of the same surface [m].
        out: (num_beams,) written to [m].
    """
    count = len(ranges)
    for b in range(count):
        r = ranges[b]
        out[b] = r
        if not r < np.inf:
            continue
        total, n = r, 1
        for k in range(1, reach + 1):  # in pairs: on a slanting wall one side alone would pull the point nearer
            left, right = ranges[(b - k) % count], ranges[(b + k) % count]
            if not (abs(left - r) <= surface and abs(right - r) <= surface):
                break
            total += left + right
            n += 2
        out[b] = total / n


@njit(cache=True)
def intrusion(points, poses, travel, outline, margin, enough):
    """How much a motion comes too near: the most by which a point gets nearer than the margin, or than it was [m].

    A point that is within the margin at the start may stay as near or get farther. Points are passed over by as
    many poses as the body needs to get to them.

    Args:
        points: (n, 3) x, y and distance at the start, as ``gather`` gives them.
        poses: (m, 4) x, y, cosine and sine of the heading, the start first.
        travel: (m,) as ``Poses.travel``.
        outline: An ``Outline``.
        margin: Distance to keep [m].
        enough: The search ends with the first intrusion above this [m].

    Returns:
        The intrusion, ``ROUNDING`` or less for none; and the index of the point, -1 without one.
    """
    most, which, count = ROUNDING, -1, len(poses)
    for k in range(len(points)):
        keep = min(margin, points[k, 2])
        i, distance = 0, points[k, 2]
        while True:
            if keep - distance > most:
                most, which = keep - distance, k
                if most > enough:
                    return most, which
            goal = travel[i] + distance - (keep - most)
            if goal > travel[count - 1]:
                break
            i += 1
            while travel[i] < goal:
                i += 1
            x, y, c, s = poses[i]
            distance = _bounded_distance(outline, x, y, c, s, points[k, 0], points[k, 1], keep)
            if i == count - 1:
                if keep - distance > most:
                    most, which = keep - distance, k
                break
    return most, which


@njit(cache=True)
def intrudes(points, course, command, outline, margin, enough, out):
    """How much nearer than a margin the body comes under a command, as ``intrusion`` has it, and to which point.

    Args:
        points: (n, 3) x, y and distance at the start, as ``gather`` gives them.
        course: A ``Course``.
        command: (3,) the command that is judged.
        outline: An ``Outline``.
        margin: Distance to keep [m].
        enough: The search ends with the first intrusion above this [m].
        out: ``Poses``, written to.
    """
    count = roll_out(course, command, outline.radius, out)
    return intrusion(points, out.poses[:count], out.travel[:count], outline, margin, enough)


@njit(cache=True)
def approaches(points, course, command, outline, keep, enough, out):
    """How much nearer than the margin, or than it is already, the body comes under a command; to which point.

    Args:
        points: (n, 3) x, y and distance at the start, as ``gather`` gives them.
        course: A ``Course``.
        command: (3,) the command that is judged.
        outline: An ``Outline``.
        keep: A ``Keep``.
        enough: The search ends with the first approach above this [m].
        out: ``Poses``, written to.
    """
    margin, clearance = keep.margin, np.inf
    for k in range(len(points)):
        clearance = min(clearance, points[k, 2])
    if clearance < margin:
        turns = command[0] == 0.0 and command[1] == 0.0
        margin = min(margin, max(clearance - keep.turn if turns else clearance, keep.floor))
    return intrudes(points, course, command, outline, margin, enough, out)


@njit(cache=True)
def greatest_share(points, course, wanted, outline, keep, safe, halvings, out):
    """The greatest share of a command, or of its turn beside a safe share of its speed, that approaches nothing.

    Args:
        points: (n, 3) as ``gather`` gives them, the nearest first: they end a search.
        course: A ``Course``.
        wanted: (3,) the command, which is not safe as a whole.
        outline: An ``Outline``.
        keep: A ``Keep``.
        safe: Share of the speed that is safe, for that of the turn; below 0 for that of the whole command.
        halvings: Bisections.
        out: ``Poses``, written to.
    """
    least, most = max(safe, 0.0), 1.0
    tried = np.empty(3)
    for _ in range(halvings):
        share = 0.5 * (least + most)
        linear = share if safe < 0.0 else safe
        tried[0], tried[1], tried[2] = linear * wanted[0], linear * wanted[1], share * wanted[2]
        if approaches(points, course, tried, outline, keep, ROUNDING, out)[0] > ROUNDING:
            most = share
        else:
            least = share
    return least
