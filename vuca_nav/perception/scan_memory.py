"""Scans of the last ticks, and the present one's distance field."""

import numpy as np

from vuca_nav.perception.distance_field import DistanceField, fill_field
from vuca_nav.types import FloatArray


class ScanHistory:
    """A ring of scans, one a tick.

    Args:
        depth: Number of scans that are kept, the present one included.
        num_beams: Number of a scan's beams.
    """

    def __init__(self, depth: int, num_beams: int):
        self._ranges = np.full((depth, num_beams), np.inf)
        self._newest = 0

    @property
    def depth(self) -> int:
        """Number of scans that are kept, the present one included."""
        return len(self._ranges)

    def begin(self, ranges: FloatArray) -> None:
        """Let a scan (num_beams,) also stand for all of the past."""
        self._ranges[:] = ranges

    def add(self, ranges: FloatArray) -> None:
        """Take in the next scan (num_beams,)."""
        self._newest = (self._newest + 1) % len(self._ranges)
        self._ranges[self._newest] = ranges

    def past(self, ages: np.ndarray) -> FloatArray:
        """Scans of the given ages in ticks, (len(ages), num_beams) [m]; ages must be less than ``depth``."""
        return self._ranges[(self._newest - ages) % len(self._ranges)]


class ScanField:
    """The distance field of the present scan, computed on demand.

    Args:
        beams: (num_beams, 2) directions in base_link.
        reach: Half side of the field [m].
        resolution: Side of its cells [m].
    """

    def __init__(self, beams: FloatArray, reach: float, resolution: float):
        self._beams = beams
        self._field = DistanceField.empty(reach, resolution)
        self._ranges: FloatArray | None = None

    @property
    def uncertainty(self) -> float:
        """Greatest error of the field; see ``DistanceField.uncertainty`` [m]."""
        return self._field.uncertainty

    def set_scan(self, ranges: FloatArray) -> None:
        """Make the field that of these ranges (num_beams,) from now on."""
        self._ranges = ranges

    def get(self) -> DistanceField:
        """The field; valid until the next scan."""
        if self._ranges is not None:
            fill_field(self._ranges, self._beams, self._field)
            self._ranges = None
        return self._field
