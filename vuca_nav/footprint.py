"""The body's outline in the plane: as discs for clearances, and as a distance along each beam."""

import math

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.types import FloatArray

EXCESS = 0.025
"""Most that the discs of a body reach beyond half its width [m]: less than the 0.05 m that a way must leave at either
side of it."""
ROOM = 0.05
"""Room that a way must leave at either side of the body [m]: a way is one if the footprint and 0.10 m fit through."""


def half_way(footprint: FloatArray) -> float:
    """Half the width of the narrowest way for a body that goes forwards; for one about round, at any heading [m].

    Args:
        footprint: Convex outline in base_link (n, 2) [m].
    """
    discs = cover_by_discs(footprint)
    return (0.5 * float(np.ptp(footprint[:, 1])) if len(discs) > 1 else float(discs[0, 2])) + ROOM


def cover_by_discs(footprint: FloatArray) -> FloatArray:
    """Equal discs along base_link's x axis that cover a convex outline.

    Args:
        footprint: (n, 2) [m].

    Returns:
        (k, 3) x, y and radius [m], the radius at most half the width and ``EXCESS``; one disc about the origin for a
        body that is about round.
    """
    x_min, y_min = footprint.min(axis=0)
    x_max, y_max = footprint.max(axis=0)
    length, width = x_max - x_min, y_max - y_min
    circumscribed = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
    widest = 0.5 * width + EXCESS
    if circumscribed <= widest:
        return np.array([[0.0, 0.0, circumscribed]])
    count = math.ceil(length / (2.0 * math.sqrt(widest**2 - (0.5 * width) ** 2)))
    piece = length / count
    radius = math.hypot(0.5 * piece, 0.5 * width)
    xs = x_min + piece * (np.arange(count) + 0.5)
    return np.column_stack([xs, np.full(count, 0.5 * (y_min + y_max)), np.full(count, radius)])


def size_of(discs: FloatArray) -> float:
    """Radius of the circle about base_link that encloses discs (k, 3) [m]."""
    return float((np.hypot(discs[:, 0], discs[:, 1]) + discs[:, 2]).max())


def outline_ranges(footprint: FloatArray, num_beams: int) -> FloatArray:
    """Distance from base_link's origin to a convex outline along each beam of a full circle, (num_beams,) [m].

    Args:
        footprint: Counter-clockwise, (k, 2) [m].
        num_beams: Number of the lidar's beams.

    Raises:
        BadArgument: If the origin is not inside.
    """
    edges = np.roll(footprint, -1, axis=0) - footprint
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])  # outwards
    offsets = (normals * footprint).sum(axis=1)
    if not (offsets > 0.0).all():
        raise BadArgument("a footprint must be convex, counter-clockwise and enclose base_link's origin")
    angles = -np.pi + np.arange(num_beams) * (2.0 * np.pi / num_beams)
    approach = np.outer(np.cos(angles), normals[:, 0]) + np.outer(np.sin(angles), normals[:, 1])  # (num_beams, k)
    with np.errstate(divide="ignore"):
        distances = np.where(approach > 1e-12, offsets / approach, np.inf)
    return distances.min(axis=1)
