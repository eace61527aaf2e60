"""Exact clearance of a robot's footprint to upright shapes, for metrics and for the simulation's own use."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.arrays import ShapeArrays
from worlds.level_raycast import level_columns


class FootprintClearance:
    """Clearance of a convex footprint to the nearest obstacle or mover.

    Args:
        static: Shapes of the static obstacles, in the world.
        part_shapes: Shapes of the moving obstacles' parts; their poses come with each call.
        footprint: Convex outline in base_link, counter-clockwise, (n, 2) [m].
        height: Height of the robot [m]; shapes that begin above it, or end at the floor, do not count.
    """

    def __init__(self, static: ShapeArrays, part_shapes: ShapeArrays, footprint: FloatArray, height: float):
        self._shapes = np.concatenate([_packed(shapes, height) for shapes in (static, part_shapes)])
        self._num_static = len(static)
        self._footprint = np.ascontiguousarray(footprint, float)
        self._radius = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
        self._moved = np.empty_like(self._footprint)

    def distance(self, x: float, y: float, yaw: float, part_poses: FloatArray) -> float:
        """Distance from the footprint to the nearest surface; 0 inside a shape, ``inf`` if there is none [m].

        Args:
            x: Position of base_link in the world [m].
            y: Position of base_link in the world [m].
            yaw: Heading of base_link in the world [rad].
            part_poses: x, y, yaw of each part's centre in the world, (num_parts, 3).
        """
        return self._distance_up_to(math.inf, x, y, yaw, part_poses)

    def is_beyond(self, limit: float, x: float, y: float, yaw: float, part_poses: FloatArray) -> bool:
        """Whether every surface is at least ``limit`` [m] from the footprint; cheaper than the distance.

        Args:
            limit: Distance to compare with [m].
            x: Position of base_link in the world [m].
            y: Position of base_link in the world [m].
            yaw: Heading of base_link in the world [rad].
            part_poses: x, y, yaw of each part's centre in the world, (num_parts, 3).
        """
        return self._distance_up_to(limit, x, y, yaw, part_poses) >= limit

    def _distance_up_to(self, limit: float, x: float, y: float, yaw: float, part_poses: FloatArray) -> float:
        return _clearance(
            self._shapes, self._num_static, part_poses, self._footprint, self._radius, (x, y, yaw), limit, self._moved
        )


_BOUND = 7
"""Column of ``level_columns`` with the radius of the circle that holds the shape."""


def _packed(shapes: ShapeArrays, height: float) -> FloatArray:
    """Copy the first eight of ``level_columns``; the bounding radius of shapes out of reach in height becomes -1."""
    columns = level_columns(shapes)[:, : _BOUND + 1]
    within_reach = (shapes.z[:, 0] < height) & (shapes.z[:, 1] > 0.0)
    columns[:, _BOUND] = np.where(within_reach, columns[:, _BOUND], -1.0)
    return columns


@njit(cache=True)
def _clearance(shapes, num_static, part_poses, footprint, radius, pose, limit, moved):
    """Distance to the nearest shape, or ``limit`` if that is less."""
    x, y, yaw = pose
    for i in range(len(part_poses)):
        row = shapes[num_static + i]
        row[0], row[1] = part_poses[i, 0], part_poses[i, 1]
        row[2], row[3] = math.cos(part_poses[i, 2]), math.sin(part_poses[i, 2])
    base_cos, base_sin = math.cos(yaw), math.sin(yaw)
    nearest = limit
    for i in range(len(shapes)):
        cx, cy, cos, sin, half_x, half_y, is_cylinder, bound = shapes[i]
        if bound < 0.0:
            continue
        dx, dy = x - cx, y - cy
        reach = nearest + radius + bound
        if dx * dx + dy * dy >= reach * reach:
            continue
        # base_link's origin in the shape's frame, which is the cheapest lower bound for long walls
        px, py = cos * dx + sin * dy, cos * dy - sin * dx
        if is_cylinder != 0.0:
            # the other way round: the cylinder's centre in base_link
            qx, qy = -(base_cos * dx + base_sin * dy), -(base_cos * dy - base_sin * dx)
            gap = _point_to_polygon(qx, qy, footprint) - half_x
        else:
            out_x, out_y = max(abs(px) - half_x, 0.0), max(abs(py) - half_y, 0.0)
            if math.sqrt(out_x * out_x + out_y * out_y) - radius >= nearest:
                continue
            turn_cos, turn_sin = cos * base_cos + sin * base_sin, cos * base_sin - sin * base_cos
            for k in range(len(footprint)):
                fx, fy = footprint[k, 0], footprint[k, 1]
                moved[k, 0] = px + turn_cos * fx - turn_sin * fy
                moved[k, 1] = py + turn_sin * fx + turn_cos * fy
            gap = _polygon_to_box(moved, half_x, half_y)
        nearest = min(nearest, max(gap, 0.0))
    return nearest


_SLACK = 1.0 + 1e-9
"""Factor on squared distances that only decide whether to compute an exact distance: far above rounding."""


@njit(cache=True)
def _point_to_polygon(x, y, polygon):
    """Distance of a point to a convex counter-clockwise polygon, 0 inside."""
    inside, nearest, worth = True, math.inf, math.inf
    ax, ay = polygon[-1, 0], polygon[-1, 1]
    for k in range(len(polygon)):
        bx, by = polygon[k, 0], polygon[k, 1]
        ex, ey, rx, ry = bx - ax, by - ay, x - ax, y - ay
        if ex * ry - ey * rx < 0.0:
            inside = False
        t = min(max((ex * rx + ey * ry) / (ex * ex + ey * ey), 0.0), 1.0)
        px, py = rx - t * ex, ry - t * ey
        if px * px + py * py <= worth:
            nearest = min(nearest, math.hypot(px, py))
            worth = nearest * nearest * _SLACK
        ax, ay = bx, by
    return 0.0 if inside else nearest


@njit(cache=True)
def _polygon_to_box(polygon, half_x, half_y):
    """Distance of a convex polygon to the box |x| <= half_x, |y| <= half_y; 0 if they overlap.

    Between disjoint convex shapes the shortest way starts at a corner of one of them; those that overlap have
    no corner inside only if an edge of the polygon crosses the box.
    """
    nearest, worth = math.inf, math.inf
    low_x = low_y = math.inf
    high_x = high_y = -math.inf
    ax, ay = polygon[-1, 0], polygon[-1, 1]
    for k in range(len(polygon)):
        bx, by = polygon[k, 0], polygon[k, 1]
        low_x, high_x, low_y, high_y = min(low_x, bx), max(high_x, bx), min(low_y, by), max(high_y, by)
        out_x, out_y = max(abs(bx) - half_x, 0.0), max(abs(by) - half_y, 0.0)
        if out_x * out_x + out_y * out_y <= worth:
            nearest = min(nearest, math.hypot(out_x, out_y))
            worth = nearest * nearest * _SLACK
        if nearest == 0.0 or _segment_meets_box(ax, ay, bx, by, half_x, half_y):
            return 0.0
        ax, ay = bx, by
    for sign_x in (-1.0, 1.0):
        for sign_y in (-1.0, 1.0):
            x, y = sign_x * half_x, sign_y * half_y
            # A corner as far as that from the polygon's own bounding box is at least as far from the polygon.
            out_x, out_y = max(low_x - x, x - high_x, 0.0), max(low_y - y, y - high_y, 0.0)
            if out_x * out_x + out_y * out_y <= worth:
                nearest = min(nearest, _point_to_polygon(x, y, polygon))
                worth = nearest * nearest * _SLACK
    return nearest


@njit(cache=True)
def _segment_meets_box(ax, ay, bx, by, half_x, half_y):
    """Whether a segment meets the box, by separating axes: x, y and the segment's normal."""
    if min(ax, bx) > half_x or max(ax, bx) < -half_x or min(ay, by) > half_y or max(ay, by) < -half_y:
        return False
    nx, ny = ay - by, bx - ax
    return abs(nx * ax + ny * ay) <= abs(nx) * half_x + abs(ny) * half_y


class Outlines(NamedTuple):
    """Footprints and heights of n robots."""

    footprints: np.ndarray
    """Convex outlines in base_link, counter-clockwise (n, c, 2) [m]."""
    corners: np.ndarray
    """Number of corners of each outline (n,)."""
    radii: np.ndarray
    """Radii of the circles about base_link that hold the outlines (n,) [m]."""
    heights: np.ndarray
    """Heights of the robots (n,) [m]."""


class StaticScenes(NamedTuple):
    """Static obstacles of several layouts, one layout after the other."""

    shapes: np.ndarray
    """Columns as ``worlds.level_raycast.level_columns`` gives them (s, 10)."""
    first: np.ndarray
    """Index of each layout's first shape, and the number of all shapes (layouts + 1,)."""
    distance: np.ndarray
    """Clearance on all layouts' grids (cells,) [m]."""
    grid_shape: np.ndarray
    """Index of the first cell of each layout's grid, its rows and its columns (layouts, 3)."""
    grids: np.ndarray
    """Origin and resolution of each layout's grid (layouts, 3) [m]."""


class PartTrajectories(NamedTuple):
    """Parts of the moving obstacles around each of n robots, over some ticks."""

    shapes: np.ndarray
    """Columns as ``worlds.level_raycast.level_columns`` gives them; the first four are not read (n, p, 10)."""
    poses: np.ndarray
    """x, y, cos, sin in the world at each tick (n, ticks, p, 4) [m]."""
    counts: np.ndarray
    """Number of parts in use, of the p there is space for (n,)."""


@njit(cache=True, nogil=True)
def overlaps_batch(rows, poses, outlines, scenes, layout, parts, hit, moved):
    """Find the first tick at which each robot's footprint overlaps anything, by the rule of ``FootprintClearance``.

    Args:
        rows: Indices of the robots to look at, (k,).
        poses: x, y, yaw of base_link at each tick, (n, ticks, 3) [m, rad].
        outlines: An :class:`Outlines` of the robots.
        scenes: A :class:`StaticScenes`.
        layout: The scene that each robot is in, (n,).
        parts: A :class:`PartTrajectories`.
        hit: Output: the tick, -1 if there is none, (n,).
        moved: Scratch, (c, 2).
    """
    for r in range(len(rows)):
        i = rows[r]
        hit[i] = -1
        place, radius, height = layout[i], outlines.radii[i], outlines.heights[i]
        footprint = outlines.footprints[i, : outlines.corners[i]]
        begin, height_cells, width = scenes.grid_shape[place]
        x0, y0, resolution = scenes.grids[place]
        for t in range(poses.shape[1]):
            x, y, yaw = poses[i, t]
            cos, sin = math.cos(yaw), math.sin(yaw)
            row = min(max(int((y - y0) / resolution), 0), height_cells - 1)
            column = min(max(int((x - x0) / resolution), 0), width - 1)
            touched = False
            # The field is exact at the cells' centres: half a diagonal away it is off by no more than that.
            if scenes.distance[begin + row * width + column] - 0.7072 * resolution < radius:
                for s in range(scenes.first[place], scenes.first[place + 1]):
                    shape = scenes.shapes[s]
                    if shape[8] >= height or shape[9] <= 0.0:
                        continue
                    offset = x - shape[0], y - shape[1], shape[2], shape[3]
                    if overlaps(shape, offset, cos, sin, footprint, radius, moved):
                        touched = True
                        break
            for p in range(0 if touched else parts.counts[i]):
                shape = parts.shapes[i, p]
                dx, dy, reach = x - parts.poses[i, t, p, 0], y - parts.poses[i, t, p, 1], radius + shape[_BOUND]
                if dx * dx + dy * dy >= reach * reach or shape[8] >= height or shape[9] <= 0.0:
                    continue
                offset = dx, dy, parts.poses[i, t, p, 2], parts.poses[i, t, p, 3]
                if overlaps(shape, offset, cos, sin, footprint, radius, moved):
                    touched = True
                    break
            if touched:
                hit[i] = t
                break


@njit(cache=True, nogil=True)
def overlaps(shape, offset, base_cos, base_sin, footprint, radius, moved):
    """Whether a footprint overlaps a shape, given the shape's yaw and the offset from its centre to base_link."""
    dx, dy, cos, sin = offset
    half_x, half_y, is_cylinder = shape[4], shape[5], shape[6] != 0.0
    reach = radius + shape[_BOUND]
    if dx * dx + dy * dy >= reach * reach:
        return False
    if is_cylinder:
        qx, qy = -(base_cos * dx + base_sin * dy), -(base_cos * dy - base_sin * dx)
        return _point_to_polygon(qx, qy, footprint) < half_x
    px, py = cos * dx + sin * dy, cos * dy - sin * dx
    if abs(px) - half_x >= radius or abs(py) - half_y >= radius:
        return False
    turn_cos, turn_sin = cos * base_cos + sin * base_sin, cos * base_sin - sin * base_cos
    for k in range(len(footprint)):
        fx, fy = footprint[k, 0], footprint[k, 1]
        moved[k, 0] = px + turn_cos * fx - turn_sin * fy
        moved[k, 1] = py + turn_sin * fx + turn_cos * fy
    return _polygon_to_box(moved[: len(footprint)], half_x, half_y) <= 0.0
