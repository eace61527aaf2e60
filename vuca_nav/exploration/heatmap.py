"""V^h of every place around the robot as a goal, as drawn in Zhang et al."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vuca_nav.types import FloatArray

DARK = 0.5
"""Chance at and below which a place is drawn darkest."""


class SafetyMap(NamedTuple):
    """V^h at the middles of square cells."""

    values: FloatArray
    """(rows y, columns x); higher is safer."""
    lower_left: tuple[float, float]
    """Corner of the first cell, in the map [m]."""
    resolution: float
    """Side of a cell [m]."""

    @property
    def scale(self) -> tuple[float, float]:
        """Values that are drawn darkest and brightest.

        Chances are drawn from an even one to certainty, alike in all maps. A policy's values, which are rewards and no
        chances, are drawn over their own range.
        """
        least, greatest = float(self.values.min()), float(self.values.max())
        return (DARK, 1.0) if least >= 0.0 and greatest <= 1.0 else (least, greatest)


def safety_around(
    rate: Callable[[FloatArray], FloatArray], centre: tuple[float, float], half_side: float, resolution: float
) -> SafetyMap:
    """Ask a critic about a square.

    Args:
        rate: Gives V^h (n,) of points (n, 2) in the map [m].
        centre: Centre of the square [m].
        half_side: Half the side of the square [m].
        resolution: Side of a cell [m].
    """
    cells = max(1, round(2.0 * half_side / resolution))
    offsets = np.asarray((np.arange(cells) + 0.5 - 0.5 * cells) * resolution, np.float64)
    x, y = np.meshgrid(centre[0] + offsets, centre[1] + offsets)
    values = rate(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    corner = centre[0] - 0.5 * cells * resolution, centre[1] - 0.5 * cells * resolution
    return SafetyMap(values, corner, resolution)
