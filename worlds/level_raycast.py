"""A level lidar in many worlds at once, for training; equal to ``worlds.raycast`` in each, to rounding.

With beams in a plane, a beam can hit the one or two faces of a box that look at the lidar, and each face fills one run
of beams. Within a run the range is a division, or for a cylinder a square root: no beam is
tried on a shape that it cannot hit, and the loops over beams are straight ones that the compiler turns into vectors.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.arrays import ShapeArrays

LEVEL_COLUMNS = 10
"""Columns of a shape for ``cast_level``, in the order of the names below."""
SHAPE_X, SHAPE_Y, SHAPE_COS, SHAPE_SIN, HALF_LENGTH, HALF_WIDTH, IS_CYLINDER, BOUND, LOWER, UPPER = range(LEVEL_COLUMNS)
"""Columns of a shape: centre, direction, half sizes, kind, bounding radius, and the heights it reaches from and to."""


class Standing(NamedTuple):
    """The static shapes of all layouts, one layout after the other."""

    shapes: np.ndarray
    """The shapes, (s, LEVEL_COLUMNS)."""
    first: np.ndarray
    """Index at which each layout's shapes begin, and the end of the last one's, (layouts + 1,)."""


class CurrentParts(NamedTuple):
    """The movers' parts in n worlds, at one moment."""

    shapes: np.ndarray
    """The parts, (n, p, LEVEL_COLUMNS); their poses are taken from ``poses``."""
    poses: np.ndarray
    """x, y, cos, sin in the world, (n, p, 4) [m]."""
    counts: np.ndarray
    """Number of parts in each world, (n,)."""


def level_columns(shapes: ShapeArrays) -> FloatArray:
    """Convert shapes to the columns of ``cast_level``, (n, LEVEL_COLUMNS)."""
    radius = np.where(shapes.is_cylinder, shapes.half[:, 0], np.hypot(shapes.half[:, 0], shapes.half[:, 1]))
    cos, sin = np.cos(shapes.yaw), np.sin(shapes.yaw)
    return np.column_stack([shapes.centre, cos, sin, shapes.half, shapes.is_cylinder.astype(float), radius, shapes.z])


@njit(cache=True, error_model="numpy", nogil=True)
def cast_level(rows, poses, heights, layout, standing, parts, beams, max_range, ranges):
    """Cast scans of level lidars, each in a world of its own.

    A beam that starts inside a shape returns the way out.

    Args:
        rows: Indices of the rows to cast, (k,).
        poses: x, y, yaw of the lidars, (n, 3) [m, rad].
        heights: Heights of their planes above the floor, (n,) [m].
        layout: Layout of each row, (n,).
        standing: A ``Standing``.
        parts: A ``CurrentParts``.
        beams: cos, sin of the beams in the lidar's frame, (2, num_beams); the first at -pi, evenly spaced.
        max_range: Maximum range [m].
        ranges: Output (n, num_beams), ``inf`` beyond the maximum range [m].
    """
    num_beams = beams.shape[1]
    direction = np.empty((2, num_beams))
    for r in range(len(rows)):
        i = rows[r]
        ox, oy, height = poses[i, 0], poses[i, 1], heights[i]
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        out = ranges[i]
        for k in range(num_beams):
            direction[0, k] = cos * beams[0, k] - sin * beams[1, k]
            direction[1, k] = sin * beams[0, k] + cos * beams[1, k]
            out[k] = max_range
        base = (cos, sin)
        for s in range(standing.first[layout[i]], standing.first[layout[i] + 1]):
            row = standing.shapes[s]
            if row[LOWER] <= height <= row[UPPER]:
                place = (ox - row[SHAPE_X], oy - row[SHAPE_Y], row[SHAPE_COS], row[SHAPE_SIN])
                _see(place, row, base, direction, max_range, out)
        for p in range(parts.counts[i]):
            row = parts.shapes[i, p]
            if row[LOWER] <= height <= row[UPPER]:
                pose = parts.poses[i, p]
                px, py, reach = ox - pose[0], oy - pose[1], max_range + row[BOUND]
                if px * px + py * py >= reach * reach:
                    continue
                _see((px, py, pose[2], pose[3]), row, base, direction, max_range, out)
        for k in range(num_beams):
            if out[k] >= max_range:
                out[k] = math.inf


@njit(cache=True, error_model="numpy", nogil=True)
def _see(place, row, base, direction, max_range, out):
    """Shorten the beams that meet one shape.

    Args:
        place: x, y from the shape's centre to the lidar, cos, sin of the shape.
        row: Columns of the shape, (LEVEL_COLUMNS,).
        base: cos, sin of the lidar.
        direction: cos, sin of the beams in the world, (2, num_beams).
        max_range: Maximum range [m].
        out: Ranges, shortened, (num_beams,).
    """
    px, py, cos, sin = place
    base_cos, base_sin = base
    hx, hy, is_cylinder = row[HALF_LENGTH], row[HALF_WIDTH], row[IS_CYLINDER] != 0.0
    reach = max_range + row[BOUND]
    if px * px + py * py >= reach * reach:
        return
    num_beams = len(out)
    pitch = 2.0 * math.pi / num_beams
    if is_cylinder:
        square = px * px + py * py
        inside = square - hx * hx
        if inside <= 0.0:
            for k in range(num_beams):
                half_b = px * direction[0, k] + py * direction[1, k]
                out[k] = min(out[k], math.sqrt(half_b * half_b - inside) - half_b)
            return
        middle = math.atan2(base_sin * px - base_cos * py, -base_cos * px - base_sin * py)
        half = math.asin(hx / math.sqrt(square))
        begin = math.ceil((middle - half + math.pi) / pitch - 1e-9)
        end = math.floor((middle + half + math.pi) / pitch + 1e-9)
        for part in range(2):  # a run that wraps round is split in two
            low, high = _run(begin, end, num_beams, part)
            for k in range(low, high):
                half_b = px * direction[0, k] + py * direction[1, k]
                out[k] = min(out[k], -half_b - math.sqrt(max(half_b * half_b - inside, 0.0)))
        return
    qx, qy = cos * px + sin * py, cos * py - sin * px  # the lidar in the box's frame
    gap_x, gap_y = max(abs(qx) - hx, 0.0), max(abs(qy) - hy, 0.0)
    if gap_x * gap_x + gap_y * gap_y >= max_range * max_range:
        return
    if gap_x == 0.0 and gap_y == 0.0:
        for k in range(num_beams):
            way_out = _way_out(qx, cos * direction[0, k] + sin * direction[1, k], hx)
            way_out_y = _way_out(qy, cos * direction[1, k] - sin * direction[0, k], hy)
            out[k] = min(out[k], way_out, way_out_y)
        return
    # The box's axes in the lidar's frame, for the directions of its corners.
    ax, ay = cos * base_cos + sin * base_sin, sin * base_cos - cos * base_sin
    side_x = 1.0 if qx >= 0.0 else -1.0
    side_y = 1.0 if qy >= 0.0 else -1.0
    ahead = side_x * side_y
    # Angle of the near corner, then of the far end of each face that is seen.
    near = _bearing(side_x * hx - qx, side_y * hy - qy, ax, ay)
    if gap_x > 0.0:
        far = _bearing(side_x * hx - qx, -side_y * hy - qy, ax, ay)
        # With growing angle, the face x = +hx is seen from its upper end in y to its lower, that at -hx the other way.
        begin_at, end_at = (far, near) if ahead < 0.0 else (near, far)
        begin = math.ceil((begin_at + math.pi) / pitch - 1e-9)
        end = math.floor((end_at + math.pi) / pitch + 1e-9)
        nx, ny = -side_x * cos, -side_x * sin
        for part in range(2):
            low, high = _run(begin, end, num_beams, part)
            for k in range(low, high):
                approach = nx * direction[0, k] + ny * direction[1, k]
                out[k] = min(out[k], gap_x / approach if approach > 1e-9 else max_range)
    if gap_y > 0.0:
        far = _bearing(-side_x * hx - qx, side_y * hy - qy, ax, ay)
        begin_at, end_at = (near, far) if ahead < 0.0 else (far, near)
        begin = math.ceil((begin_at + math.pi) / pitch - 1e-9)
        end = math.floor((end_at + math.pi) / pitch + 1e-9)
        nx, ny = side_y * sin, -side_y * cos
        for part in range(2):
            low, high = _run(begin, end, num_beams, part)
            for k in range(low, high):
                approach = nx * direction[0, k] + ny * direction[1, k]
                out[k] = min(out[k], gap_y / approach if approach > 1e-9 else max_range)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _way_out(start, direction, half):
    """Length of a ray from within ``|x| <= half`` to its end."""
    if abs(direction) < 1e-12:
        return math.inf
    return ((half if direction > 0.0 else -half) - start) / direction


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _bearing(ux, uy, ax, ay):
    """Bearing in the lidar's frame of a vector in the box's [rad]; (ax, ay) is the box's x axis in the lidar's."""
    return math.atan2(ay * ux + ax * uy, ax * ux - ay * uy)


@njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _run(begin, end, num_beams, part):
    """The first or second half of the beams from begin to end, unrolled: [low, high) within [0, num_beams]."""
    if end < begin:
        # Either empty, or across the seam at +-pi.
        if begin - end < num_beams // 2:
            return 0, 0
        end += num_beams
    if begin < 0:
        begin, end = begin + num_beams, end + num_beams
    if part == 0:
        return begin, min(end + 1, num_beams)
    return 0, max(end + 1 - num_beams, 0)
