"""The percept of one scan and the odometry, made once a tick: the same value for every stage and every method."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.perception.distance_field import DistanceField
from vuca_nav.perception.scan_memory import ScanField, ScanHistory
from vuca_nav.types import FloatArray, Pose2, Scan, Twist2


class LevelScan(NamedTuple):
    """A scan as seen from above, for mapping: a leaning body's beams projected onto the floor."""

    ranges: FloatArray
    """(num_beams,) over ground [m]; ``inf`` where nothing came back, NaN where a beam must not be mapped."""
    beams: FloatArray
    """(num_beams, 2) directions over ground, ahead and left of the base."""
    is_mover: NDArray[np.bool_]
    """(num_beams,) mask of the returns of moving tracks."""


@dataclass(frozen=True, slots=True)
class Percept:
    """One tick's perception. Its arrays, ``history`` and ``field`` are lent: the next tick writes over them."""

    scan: Scan
    """The scan as the lidar gave it."""
    odom_from_base: Pose2
    motion: Pose2
    """Displacement of the base since the last tick by odometry, in its frame of then."""
    twist: Twist2
    """Measured velocity."""
    is_valid: bool
    """False if more than half of the scan is NaN, or velocity or motion is not finite: the body has to stand."""
    is_blind: bool
    """Whether no beam came back at all: an open field, or a dead lidar."""
    level: LevelScan
    tracks: FloatArray
    """(k, TRACK_SIZE) as ``vuca_nav.perception.tracks`` names the columns, in base_link over ground."""
    moving: FloatArray
    """(m, 3) x, y [m] in base_link over ground and radius [m] of the tracks that surely move. They have no place in a
    map, and bar no path: when the robot gets there they are elsewhere."""
    history: ScanHistory
    """Scans of the last ticks."""
    field: ScanField
    """Source of ``distance_field``."""

    @property
    def stamp(self) -> float:
        """Time of the scan [s]."""
        return self.scan.stamp

    @property
    def distance_field(self) -> DistanceField:
        """Distance to the nearest return around the robot; computed on demand, once a tick."""
        return self.field.get()
