"""What the shapes of a compiled robot make: its outline on the floor, its height, the radius of its wheels."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import math
from collections.abc import Iterable

import mujoco
import numpy as np

from vuca_nav.types import FloatArray

_ROUND = 64
"""Number of points on a circle."""
_SIDES = 24
"""Number of directions in which an outline is taken: every 15 degrees, as of TIAGo's."""
_NEAR = 1e-4
"""Distance below which two corners are one [m]."""

_CIRCLE = np.array([(math.cos(a), math.sin(a)) for a in 2.0 * math.pi * np.arange(_ROUND) / _ROUND])
_GROW = 1.0 / math.cos(math.pi / _ROUND)
"""Factor on the radius of a circle that makes its points a polygon about it."""


def surface_points(model: mujoco.MjModel, data: mujoco.MjData, geom: int, grow: float = _GROW) -> FloatArray:
    """Points in the world whose convex hull holds a geom (n, 3) [m].

    Args:
        model: A compiled model.
        data: Its state, after ``mj_kinematics``.
        geom: Index of the geom; no plane.
        grow: Factor on the radii of round shapes; 1 gives points that lie on them.
    """
    size, kind = model.geom_size[geom], model.geom_type[geom]
    ring = np.column_stack([grow * _CIRCLE, np.zeros(_ROUND)])
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        points = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float)
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        points = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        points = np.concatenate([ring * size[0] + (0.0, 0.0, z) for z in (-size[1], size[1])])
    else:  # a sphere, which a capsule has two of, or an ellipsoid
        radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
        tilts = math.pi * (np.arange(_ROUND // 2 + 1) / (_ROUND // 2) - 0.5)
        ball = np.concatenate(
            [np.column_stack([math.cos(t) * _CIRCLE, np.full(_ROUND, math.sin(t))]) for t in tilts.tolist()]
        )
        points = grow * ball * radii
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            up = np.array([0.0, 0.0, size[1]])
            points = np.concatenate([points - up, points + up])
    rotation = data.geom_xmat[geom].reshape(3, 3)
    return (points[:, None, :] * rotation[None]).sum(axis=2) + data.geom_xpos[geom]


def outline_of(points: FloatArray) -> FloatArray:
    """The convex outline about points of a plane (n, 2), counter-clockwise, with corners at most every 15 degrees.

    It holds all points; of a rectangle along the axes it is the rectangle.
    """
    angles = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    reach = (points[:, None, :] * normals[None]).sum(axis=2).max(axis=0)
    corners: list[FloatArray] = []
    for k in range(_SIDES):
        (a, b), (c, d) = normals[k], normals[(k + 1) % _SIDES]
        p, q = reach[k], reach[(k + 1) % _SIDES]
        determinant = a * d - b * c
        corner = np.array([(p * d - q * b) / determinant, (a * q - c * p) / determinant])
        if not corners or np.abs(corner - corners[-1]).max() > _NEAR:
            corners.append(corner)
    if len(corners) > 1 and np.abs(corners[0] - corners[-1]).max() <= _NEAR:
        corners.pop()
    return np.array(corners)


def overhang(outline: FloatArray, points: FloatArray) -> float:
    """Greatest distance by which points of a plane (n, 2) lie outside a convex outline, at most 0 if none does [m]."""
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    beyond = ((points[:, None, :] - outline[None]) * normals[None]).sum(axis=2)
    return float(beyond.max())


def collision_geoms(model: mujoco.MjModel, bodies: Iterable[int] | None = None) -> list[int]:
    """Indices of the geoms that can touch something, of some bodies or of all but the world."""
    chosen = range(1, model.nbody) if bodies is None else bodies
    return [
        geom
        for body in chosen
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
        if model.geom_contype[geom] or model.geom_conaffinity[geom]
    ]
