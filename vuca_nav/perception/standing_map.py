"""What was mapped as standing a while ago: a track whose returns it explains most likely does not move.

Posts that are seen two by two in changing pairs seem to jump, and the visible part of a wall behind a corner seems to
go along with the robot. But they return from where something stood before they were tracked.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vuca_nav.geometry import compose, inverse
from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import LevelScan
from vuca_nav.perception.tracks import RADIUS, X, Y
from vuca_nav.types import STANDING, FloatArray, Pose2

AGE = 0.5
"""Least age of what was mapped [s]: a mover that was mapped before it was known to move has left its cells by then. It
may be twice as old."""
EXPLAINED = 0.8
"""Share of a track's returns that come from mapped cells or their neighbours, from which on the track stands."""
BEYOND = 0.1
"""Distance beyond a track's radius at which returns are its own here [m]."""


class StandingMap:
    """Keeps the cells that were occupied a while ago.

    Args:
        rate: Rate of the ticks [Hz].
    """

    def __init__(self, rate: float):
        self._ticks = max(round(AGE * rate), 1)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        nothing = np.zeros((0, 0), np.bool_), (0.0, 0.0)
        self._older, self._newer = nothing, nothing
        self._resolution = 1.0
        self._map_from_odom = STANDING
        self._tick = 0

    def take(
        self,
        level: NDArray[np.int8],
        origin: tuple[float, float],
        resolution: float,
        poses: tuple[Pose2, Pose2],
    ) -> None:
        """Take in the map at the end of a tick.

        Args:
            level: (rows, columns) above 0 where it is occupied, row i holds y.
            origin: Lower-left corner of the first cell in the map [m].
            resolution: Side of a cell [m].
            poses: ``map_from_base`` and ``odom_from_base``.
        """
        map_from_base, odom_from_base = poses
        self._map_from_odom = compose(map_from_base, inverse(odom_from_base))
        self._resolution = resolution
        if self._tick % self._ticks == 0:
            self._older = self._newer
            self._newer = level > 0, origin
        self._tick += 1

    def unexplained(self, moving: FloatArray, level: LevelScan, odom_from_base: Pose2) -> FloatArray:
        """The tracks whose returns do not come from what was mapped, (n, TRACK_SIZE).

        Args:
            moving: (m, TRACK_SIZE) tracks that seem to move.
            level: The scan as seen from above.
            odom_from_base: Pose of the base.
        """
        occupied, origin = self._older
        if not occupied.size:
            return moving
        pose = compose(self._map_from_odom, odom_from_base)
        return moving[~_explained(moving, level, occupied, (*origin, self._resolution), tuple(pose))]


@njit(cache=True)
def _explained(moving, level, occupied, place, pose):
    x0, y0, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    rows, columns = occupied.shape
    result = np.zeros(len(moving), np.bool_)
    for m in range(len(moving)):
        near = (moving[m, RADIUS] + BEYOND) ** 2
        returns = explained = 0
        for k in range(len(level.ranges)):
            r = level.ranges[k]
            if not r < np.inf:
                continue
            x, y = level.origin[0] + r * level.beams[k, 0], level.origin[1] + r * level.beams[k, 1]
            if (x - moving[m, X]) ** 2 + (y - moving[m, Y]) ** 2 > near:
                continue
            returns += 1
            j = int(math.floor((x0 + c * x - s * y - place[0]) / place[2]))
            i = int(math.floor((y0 + s * x + c * y - place[1]) / place[2]))
            if 0 < i < rows - 1 and 0 < j < columns - 1 and occupied[i - 1 : i + 2, j - 1 : j + 2].any():
                explained += 1
        result[m] = returns > 0 and explained >= EXPLAINED * returns
    return result
