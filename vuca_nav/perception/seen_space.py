"""Seen space: the ground around the robot that its lidar has seen free a moment ago, in the frame of odometry.

What is outside of the lidar's field of view is unknown, and the body must not be driven there. But what it has passed
it knows for a while: without that memory a robot that sees ahead only could not back out of a dead end.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from vuca_nav.perception.ring import BeamGeometry
from vuca_nav.types import FloatArray, Pose2

CELL = 0.1
"""Side of a cell [m]: beams 1 degree apart leave none out up to 5.7 m."""
CELLS = 128
"""Number of cells each way: 6.4 m to each side, a policy's greatest range."""
MEMORY = 10.0
"""Time for which a place is known after it was seen [s]: long enough to back out, and in it odometry errs by less than
a cell. What moves may have come there since."""
ROOM = 0.3
"""Distance from the body within which nothing is forgotten [m]: to get there unseen, something must pass the body."""
START_ROOM = 0.2
"""Free space around the body when it is put down [m]."""
_TOUCH = CELL * math.sqrt(0.5)
"""Distance of a cell's middle from a disc up to which the disc may touch it [m]."""
_THROUGH = 0.04
"""Distance of a remembered return from a beam or into a disc at which it cannot be there any more [m]: the range noise
and odometry's error. A beam that only grazes its cell says nothing about it."""


class _Space(NamedTuple):
    """Cells about the robot, addressed by their place modulo ``CELLS``."""

    seen: NDArray[np.int64]
    """(CELLS, CELLS) tick at which a cell was last seen, counted from 1: free, or negative with an obstacle in it; 0 if
    it is not known."""
    point: FloatArray
    """(CELLS, CELLS, 2) the last return from a cell with an obstacle in it [m]."""
    corner: NDArray[np.int64]
    """(2,) x and y of the lower left cell."""


class SeenSpace:
    """Remembers which places were seen free.

    Args:
        discs: (k, 3) discs that cover the body: where it stands is free [m].
        rate: Rate of the ticks [Hz].
    """

    def __init__(self, discs: FloatArray, rate: float):
        self._discs = discs
        self._size = float((np.hypot(discs[:, 0], discs[:, 1]) + discs[:, 2]).max())
        self._space = _Space(np.zeros((CELLS, CELLS), np.int64), np.zeros((CELLS, CELLS, 2)), np.zeros(2, np.int64))
        self._memory = round(MEMORY * rate)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._space.seen[:] = 0
        self._tick = 0

    def stand(self, odom_from_base: Pose2) -> None:
        """Begin a tick with the body at this pose: where it stands is free, and what is old is forgotten."""
        self._tick += 1
        _centre(self._space, odom_from_base)
        if self._tick == 1:
            start = np.array([[0.0, 0.0, self._size + START_ROOM]])
            _cover(self._space, self._tick, odom_from_base, start)
        _cover(self._space, self._tick, odom_from_base, self._discs)
        _forget(self._space, self._tick - self._memory, odom_from_base, self._size + ROOM)

    def see(self, odom_from_base: Pose2, ranges: FloatArray, beams: BeamGeometry) -> None:
        """Take in a scan at this pose: what its beams pass is free, and what they end on is not."""
        _see(self._space, self._tick, odom_from_base, ranges, beams)

    def fill(self, odom_from_base: Pose2, ring: FloatArray, gaps: NDArray[np.bool_]) -> None:
        """Write into a ring how far its unknown directions are known to be free.

        Args:
            odom_from_base: Pose of the body.
            ring: (n,) [m]; written to where there are gaps, ``inf`` beyond the cells.
            gaps: (n,) the unknown directions.
        """
        _fill(self._space, odom_from_base, ring, gaps)


@njit(cache=True, inline="always")
def _contains(space, i, j):
    return space.corner[1] <= i < space.corner[1] + CELLS and space.corner[0] <= j < space.corner[0] + CELLS


@njit(cache=True)
def _centre(space, pose):
    """Move the cells along with the robot; those that come in anew are not known."""
    j0 = int(math.floor(pose[0] / CELL)) - CELLS // 2
    i0 = int(math.floor(pose[1] / CELL)) - CELLS // 2
    old_j, old_i = space.corner[0], space.corner[1]
    for j in range(j0, j0 + CELLS):
        if not old_j <= j < old_j + CELLS:
            space.seen[:, j % CELLS] = 0
    for i in range(i0, i0 + CELLS):
        if not old_i <= i < old_i + CELLS:
            space.seen[i % CELLS] = 0
    space.corner[0], space.corner[1] = j0, i0


@njit(cache=True)
def _cover(space, tick, pose, discs):
    """Mark the cells that discs of the body touch as free, but for remembered returns outside of the discs."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for d in range(len(discs)):
        x = pose[0] + c * discs[d, 0] - s * discs[d, 1]
        y = pose[1] + s * discs[d, 0] + c * discs[d, 1]
        reach = discs[d, 2] + _TOUCH
        for i in range(int(math.floor((y - reach) / CELL)), int(math.floor((y + reach) / CELL)) + 1):
            for j in range(int(math.floor((x - reach) / CELL)), int(math.floor((x + reach) / CELL)) + 1):
                away_x, away_y = (j + 0.5) * CELL - x, (i + 0.5) * CELL - y
                if away_x * away_x + away_y * away_y >= reach * reach or not _contains(space, i, j):
                    continue
                row, column = i % CELLS, j % CELLS
                if space.seen[row, column] < 0:
                    away_x, away_y = space.point[row, column, 0] - x, space.point[row, column, 1] - y
                    if math.hypot(away_x, away_y) > discs[d, 2] - _THROUGH:
                        continue
                space.seen[row, column] = tick


@njit(cache=True)
def _forget(space, oldest, pose, reach):
    """Forget the cells that were last seen before a tick, but for those about the body."""
    for i in range(space.corner[1], space.corner[1] + CELLS):
        for j in range(space.corner[0], space.corner[0] + CELLS):
            seen = space.seen[i % CELLS, j % CELLS]
            if seen != 0 and abs(seen) < oldest:
                away_x, away_y = (j + 0.5) * CELL - pose[0], (i + 0.5) * CELL - pose[1]
                if away_x * away_x + away_y * away_y > reach * reach:
                    space.seen[i % CELLS, j % CELLS] = 0


@njit(cache=True)
def _see(space, tick, pose, ranges, beams):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x0 = pose[0] + c * beams.origin[0] - s * beams.origin[1]
    y0 = pose[1] + s * beams.origin[0] + c * beams.origin[1]
    step = 0.5 * CELL
    for k in range(len(ranges)):
        r = ranges[k]
        if r != r:
            continue
        dx = c * beams.directions[k, 0] - s * beams.directions[k, 1]
        dy = s * beams.directions[k, 0] + c * beams.directions[k, 1]
        for m in range(int(min(r, beams.max_range) / step)):
            i, j = int(math.floor((y0 + m * step * dy) / CELL)), int(math.floor((x0 + m * step * dx) / CELL))
            if not _contains(space, i, j):
                break
            row, column = i % CELLS, j % CELLS
            if space.seen[row, column] < 0:
                px, py = space.point[row, column, 0] - x0, space.point[row, column, 1] - y0
                if abs(px * dy - py * dx) > _THROUGH or px * dx + py * dy > r - _THROUGH:
                    continue
            space.seen[row, column] = tick
    for k in range(len(ranges)):
        r = ranges[k]
        if r < np.inf:
            dx = c * beams.directions[k, 0] - s * beams.directions[k, 1]
            dy = s * beams.directions[k, 0] + c * beams.directions[k, 1]
            x, y = x0 + r * dx, y0 + r * dy
            i, j = int(math.floor(y / CELL)), int(math.floor(x / CELL))
            if _contains(space, i, j):
                space.seen[i % CELLS, j % CELLS] = -tick
                space.point[i % CELLS, j % CELLS, 0], space.point[i % CELLS, j % CELLS, 1] = x, y


@njit(cache=True)
def _fill(space, pose, ring, gaps):
    n = len(ring)
    step = 0.25 * CELL
    for b in range(n):
        if not gaps[b]:
            continue
        angle = pose[2] - math.pi + b * (2.0 * math.pi / n)
        dx, dy = math.cos(angle), math.sin(angle)
        ring[b] = np.inf
        for m in range(int(0.5 * CELLS * CELL / step)):
            i = int(math.floor((pose[1] + m * step * dy) / CELL))
            j = int(math.floor((pose[0] + m * step * dx) / CELL))
            if not _contains(space, i, j):
                continue
            row, column = i % CELLS, j % CELLS
            if space.seen[row, column] < 0:
                ring[b] = math.hypot(space.point[row, column, 0] - pose[0], space.point[row, column, 1] - pose[1])
                break
            if space.seen[row, column] == 0:
                ring[b] = m * step
                break
