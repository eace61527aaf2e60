"""The percept of one scan and the odometry, made once a tick: the same value for every stage and every method."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.perception.distance_field import DistanceField
from vuca_nav.perception.scan_memory import ScanField, ScanHistory
from vuca_nav.types import FloatArray, Pose2, Scan, Twist2

MOVERS_NEAR = 3.0
"""Distance of what moves within which it matters to the robot's next moves [m]: it is left to a policy that knows
tracks, however narrow the way is, and is waited for where there is no progress."""
_AT_BASE: FloatArray = np.zeros(2)


class LevelScan(NamedTuple):
    """A scan as seen from above, for mapping: a leaning body's beams projected onto the floor."""

    ranges: FloatArray
    """(num_beams,) over ground [m]; ``inf`` where nothing came back, NaN where a beam must not be mapped."""
    beams: FloatArray
    """(num_beams, 2) directions over ground, ahead and left of the base."""
    is_mover: NDArray[np.bool_]
    """(num_beams,) mask of the returns of moving tracks."""
    origin: FloatArray = _AT_BASE
    """(2,) place of the lidar over ground, ahead and left of the base [m]."""


@dataclass(frozen=True, slots=True)
class Percept:
    """One tick's perception. Its arrays, ``history`` and ``field`` are lent: the next tick writes over them."""

    scan: Scan
    """The lidar's latest scan, checked: what is no return is ``inf``, or NaN where nothing is known."""
    is_new: bool
    """Whether this tick is the first with this scan. Where it is not, ``ring`` is the scan moved on by odometry."""
    ring: FloatArray
    """(ring beams,) distance from base_link to the nearest obstacle in every direction, the beams of ``ring_of`` the
    lidar [m]; ``inf`` where nothing came back, NaN where single beams are missing. Where the lidar does not look, it is
    the distance up to which that direction was seen free lately."""
    ring_level: LevelScan
    """The ring as seen from above."""
    odom_from_base: Pose2
    """Pose by odometry, without jumps: while ``odometry_is_known`` is false it stays, and goes on from there."""
    odometry_is_known: bool
    motion: Pose2
    """Displacement of the base since the last tick by odometry, in its frame of then; none while it is not known."""
    twist: Twist2
    """Measured velocity."""
    is_valid: bool
    """False while there is a ``fault``: the body has to stand."""
    fault: str | None
    """What is wrong: more than half of the scan is NaN, no new scan comes, a number is not finite, or the odometry
    jumps farther than the body can. None if nothing is."""
    is_blind: bool
    """Whether no beam came back at all: an open field, or a dead lidar."""
    level: LevelScan
    """The scan as seen from above; of use while it is new."""
    tracks: FloatArray
    """(k, TRACK_SIZE) as ``vuca_nav.perception.tracks`` names the columns, in base_link over ground."""
    moving: FloatArray
    """(m, 3) x, y [m] in base_link over ground and radius [m] of the tracks that surely move. They have no place in a
    map, and bar no path: when the robot gets there they are elsewhere."""
    unexplained: FloatArray
    """Those of them, (n, 3), that are not explained by what has been in the map for a while: most posts and corners
    that seem to move are not among them, but neither is a mover that has parked."""
    history: ScanHistory
    """Rings of the last ticks."""
    field: ScanField
    """Source of ``distance_field``."""
    odometry_has_jumped: bool = False
    """Whether the odometry has jumped at this tick: how far the body has moved meanwhile, nobody knows."""

    @property
    def stamp(self) -> float:
        """Time of the scan [s]."""
        return self.scan.stamp

    def moves_within(self, away: float) -> bool:
        """Whether something moves within a distance that the map does not explain [m]."""
        return bool((np.hypot(self.unexplained[:, 0], self.unexplained[:, 1]) < away).any())

    @property
    def distance_field(self) -> DistanceField:
        """Distance to the nearest return around the robot; computed on demand, once a tick."""
        return self.field.get()
