"""Shapes as arrays, for the ray caster, the movers and the training arena."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vuca_nav.types import FloatArray
from worlds.world import Cylinder, Shape


@dataclass(frozen=True, slots=True)
class ShapeArrays:
    """n upright shapes, column by column."""

    is_cylinder: NDArray[np.bool_]
    """(n,) mask of the cylinders."""
    centre: FloatArray
    """(n, 2) centres [m]."""
    half: FloatArray
    """(n, 2) half length and half width of a box; (radius, radius) of a cylinder [m]."""
    yaw: FloatArray
    """(n,) yaw [rad]."""
    z: FloatArray
    """(n, 2) lower and upper face [m]."""

    def __len__(self) -> int:
        """Number of shapes."""
        return len(self.yaw)


def pack_shapes(shapes: Sequence[Shape]) -> ShapeArrays:
    """Pack shapes into arrays, in the same order."""
    n = len(shapes)
    packed = ShapeArrays(np.zeros(n, np.bool_), np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n), np.zeros((n, 2)))
    for i, shape in enumerate(shapes):
        packed.centre[i] = shape.x, shape.y
        packed.z[i] = shape.base, shape.base + shape.height
        if isinstance(shape, Cylinder):
            packed.is_cylinder[i] = True
            packed.half[i] = shape.radius
        else:
            packed.half[i] = shape.length / 2.0, shape.width / 2.0
            packed.yaw[i] = shape.yaw
    return packed
