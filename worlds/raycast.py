"""The lidar's geometry: an exact analytic caster over upright boxes, upright cylinders and the floor.

A planar lidar on a tilted body casts its beams in a tilted plane. For each shape the kernel finds the beams
that can meet it at all: the two silhouette directions of the shape as seen from the origin, taken back through
the plane's projection onto the floor, are exactly the first and the last beam. Shapes are visited roughly
nearest first, so that most beams behind a near shape are dismissed by one comparison.

A beam that starts inside a shape returns the way out, as MuJoCo's ray casting does. The floor is seen from above.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, LidarSpec
from worlds.arrays import ShapeArrays

# Columns of a packed shape.
_CX, _CY, _HX, _HY, _COS, _SIN, _Z0, _Z1, _CYLINDER, _RADIUS = range(10)
_COLUMNS = 10
_BINS = 48
"""Number of distance bins, for the order of visits: 0.25 m each at 12 m."""
_MIN_PROJECTION = 0.1
"""Determinant of the projection below which the scan plane is nearly upright (tilt above 84 degrees) and every beam
tries all shapes."""


class _Caster(NamedTuple):
    """State that a caster keeps from scan to scan."""

    shapes: np.ndarray
    """The static shapes, then the movers' parts, (s, _COLUMNS)."""
    num_static: int
    beams: np.ndarray
    """cos, sin of the beams in the lidar's frame, (num_beams, 2)."""
    max_range: float
    """Maximum range [m]."""
    is_ring: bool
    """Whether the beams go once round evenly from -pi on; otherwise every beam tries all shapes that are near."""
    directions: np.ndarray
    """Scratch: directions of the beams in the world, (num_beams, 3)."""
    near: np.ndarray
    """Scratch: see ``_sort_by_distance``, (s, 3)."""
    order: np.ndarray
    """Scratch: see ``_sort_by_distance``, (2, s + _BINS + 1)."""


class RayCaster:
    """Casts all beams of a lidar into a world.

    Attributes:
        directions: Directions of the beams in the world at the last cast, (num_beams, 3).

    Args:
        static: The static shapes, in the world.
        part_shapes: The movers' parts: sizes and heights; their poses come with each cast.
        lidar: Beam directions in base_link and maximum range.
    """

    def __init__(self, static: ShapeArrays, part_shapes: ShapeArrays, lidar: LidarSpec):
        shapes = np.concatenate([_packed(static), _packed(part_shapes)])
        angles = lidar.angles_in_base()
        self._caster = _Caster(
            shapes, len(static), np.column_stack([np.cos(angles), np.sin(angles)]), lidar.max_range,
            lidar.is_centred_ring, np.empty((lidar.num_beams, 3)), np.empty((len(shapes), 3)),
            np.empty((2, len(shapes) + _BINS + 1), np.int64),
        )  # fmt: skip
        self.directions = self._caster.directions

    def cast(
        self, origin: FloatArray, world_from_lidar: FloatArray, part_poses: FloatArray, ranges: FloatArray
    ) -> None:
        """Fill ``ranges`` with the distance to the first surface, ``inf`` beyond the maximum range.

        Args:
            origin: Origin of the lidar in the world, (3,) [m].
            world_from_lidar: Rotation of base_link, in whose axes the beams are given, (3, 3).
            part_poses: x, y, yaw of each part's centre in the world, (num_parts, 3).
            ranges: Output, (num_beams,) [m].
        """
        _cast(self._caster, part_poses, origin, world_from_lidar, ranges)


def _packed(shapes: ShapeArrays) -> FloatArray:
    packed = np.empty((len(shapes), _COLUMNS))
    packed[:, _CX : _CY + 1] = shapes.centre
    packed[:, _HX : _HY + 1] = shapes.half
    packed[:, _COS], packed[:, _SIN] = np.cos(shapes.yaw), np.sin(shapes.yaw)
    packed[:, _Z0 : _Z1 + 1] = shapes.z
    packed[:, _CYLINDER] = shapes.is_cylinder
    packed[:, _RADIUS] = np.where(shapes.is_cylinder, shapes.half[:, 0], np.hypot(shapes.half[:, 0], shapes.half[:, 1]))
    return packed


@njit(cache=True, error_model="numpy")
def _cast(caster, part_poses, origin, rotation, ranges):
    shapes, num_static, beams, max_range, is_ring, directions, near, order = caster
    ox, oy, oz = origin[0], origin[1], origin[2]
    num_beams = len(beams)
    for i in range(len(part_poses)):
        row = shapes[num_static + i]
        row[_CX], row[_CY] = part_poses[i, 0], part_poses[i, 1]
        row[_COS], row[_SIN] = math.cos(part_poses[i, 2]), math.sin(part_poses[i, 2])

    # Beams in the world; the floor first.
    for k in range(num_beams):
        bx, by = beams[k, 0], beams[k, 1]
        directions[k, 0] = rotation[0, 0] * bx + rotation[0, 1] * by
        directions[k, 1] = rotation[1, 0] * bx + rotation[1, 1] * by
        directions[k, 2] = dz = rotation[2, 0] * bx + rotation[2, 1] * by
        ranges[k] = min(max_range, -oz / dz) if dz < -1e-12 and oz >= 0.0 else max_range
    steepest = math.hypot(rotation[2, 0], rotation[2, 1])
    lowest, highest = oz - steepest * max_range, oz + steepest * max_range

    # The inverse of the projection (lidar plane -> floor), to find the beams at a shape's silhouette.
    a, b, c, d = rotation[0, 0], rotation[0, 1], rotation[1, 0], rotation[1, 1]
    determinant = a * d - b * c
    steep = determinant < _MIN_PROJECTION

    num_near = _sort_by_distance(shapes, ox, oy, lowest, highest, max_range, near, order)
    for n in range(num_near):
        index = order[1, n]
        row = shapes[index]
        qx, qy, distance = near[index, 0], near[index, 1], near[index, 2]
        hx, hy, cos, sin = row[_HX], row[_HY], row[_COS], row[_SIN]
        z0, z1, is_cylinder = row[_Z0], row[_Z1], row[_CYLINDER] != 0.0
        if steep or distance <= 0.0 or not is_ring:
            first, last = 0, num_beams - 1
        else:
            if is_cylinder:
                # Tangents: the direction to the centre (-q), turned by +-asin(r / distance to the centre).
                sine = hx / (distance + hx)
                cosine = math.sqrt(1.0 - sine * sine)
                rx, ry = -qx * cosine - qy * sine, -qy * cosine + qx * sine
                lx, ly = -qx * cosine + qy * sine, -qy * cosine - qx * sine
            else:
                sx = 1.0 if qx > hx else (-1.0 if qx < -hx else 0.0)
                sy = 1.0 if qy > hy else (-1.0 if qy < -hy else 0.0)
                # Right and left silhouette corner for each of the eight regions around the box.
                ux = (-sy if sy != 0.0 else sx) * hx - qx
                uy = (sx if sx != 0.0 else sy) * hy - qy
                vx = (sy if sy != 0.0 else sx) * hx - qx
                vy = (-sx if sx != 0.0 else sy) * hy - qy
                rx, ry = cos * ux - sin * uy, sin * ux + cos * uy
                lx, ly = cos * vx - sin * vy, sin * vx + cos * vy
            pitch = 2.0 * math.pi / num_beams
            first = math.ceil((math.atan2(a * ry - c * rx, d * rx - b * ry) + math.pi) / pitch - 1e-9)
            last = math.floor((math.atan2(a * ly - c * lx, d * lx - b * ly) + math.pi) / pitch + 1e-9)
            if last < first:
                last += num_beams
            if last - first >= num_beams // 2 + 1:  # an empty interval, unrolled: narrower than one beam
                continue
        for m in range(first, last + 1):
            k = m if m < num_beams else m - num_beams
            best = ranges[k]
            if best <= distance:
                continue
            dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
            if is_cylinder:
                square = dx * dx + dy * dy
                half_b = qx * dx + qy * dy
                inside = qx * qx + qy * qy - hx * hx
                if square > 1e-12:
                    discriminant = half_b * half_b - square * inside
                    if discriminant < 0.0:
                        continue
                    root = math.sqrt(discriminant)
                    t_in, t_out = (-half_b - root) / square, (-half_b + root) / square
                else:
                    if inside > 0.0:
                        continue
                    t_in, t_out = -math.inf, math.inf
            else:
                t_in, t_out = _slab(qx, cos * dx + sin * dy, -hx, hx)
                t_in_y, t_out_y = _slab(qy, cos * dy - sin * dx, -hy, hy)
                t_in, t_out = max(t_in, t_in_y), min(t_out, t_out_y)
            if t_in > t_out or t_out < 0.0 or t_in >= best:
                continue
            z = oz + t_in * dz
            if t_in < 0.0 or z < z0 or z > z1:  # not through the side: a cap, from inside, or past it
                t_in_z, t_out_z = _slab(oz, dz, z0, z1)
                t_in, t_out = max(t_in, t_in_z), min(t_out, t_out_z)
                if t_in > t_out or t_out < 0.0:
                    continue
                if t_in < 0.0:
                    t_in = t_out
            if t_in < best:
                ranges[k] = t_in
    for k in range(num_beams):
        if ranges[k] >= max_range:
            ranges[k] = math.inf


@njit(cache=True, error_model="numpy", inline="always")
def _slab(start, direction, low, high):
    """Lengths along a ray at which it enters and leaves ``low <= x <= high``."""
    if abs(direction) < 1e-12:
        if low <= start <= high:
            return -math.inf, math.inf
        return math.inf, -math.inf
    inverse = 1.0 / direction
    t_low, t_high = (low - start) * inverse, (high - start) * inverse
    return min(t_low, t_high), max(t_low, t_high)


@njit(cache=True, error_model="numpy")
def _sort_by_distance(shapes, ox, oy, lowest, highest, max_range, near, order):
    """Sort the shapes within reach, nearest first to a bin's width.

    Fills ``near[i]`` with the origin in the shape's frame (a cylinder's: not rotated) and the horizontal
    distance to its surface, 0 inside; ``order[1]`` with the shapes' indices. Returns their number.
    """
    num_shapes = len(shapes)
    scale = _BINS / max_range
    counts = order[0, num_shapes:]
    counts[:] = 0
    for i in range(num_shapes):
        row = shapes[i]
        order[0, i] = -1
        if row[_Z0] > highest or row[_Z1] < lowest:
            continue
        px, py = ox - row[_CX], oy - row[_CY]
        reach = max_range + row[_RADIUS]
        if px * px + py * py >= reach * reach:
            continue
        if row[_CYLINDER] != 0.0:
            distance = max(math.sqrt(px * px + py * py) - row[_HX], 0.0)
        else:
            px, py = row[_COS] * px + row[_SIN] * py, row[_COS] * py - row[_SIN] * px
            gap_x, gap_y = max(abs(px) - row[_HX], 0.0), max(abs(py) - row[_HY], 0.0)
            distance = math.sqrt(gap_x * gap_x + gap_y * gap_y)
        if distance >= max_range:
            continue
        near[i, 0], near[i, 1], near[i, 2] = px, py, distance
        bin_index = int(distance * scale)
        order[0, i] = bin_index
        counts[bin_index + 1] += 1
    for k in range(_BINS):
        counts[k + 1] += counts[k]
    for i in range(num_shapes):
        bin_index = order[0, i]
        if bin_index >= 0:
            order[1, counts[bin_index]] = i
            counts[bin_index] += 1
    return counts[_BINS]
