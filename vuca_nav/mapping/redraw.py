"""The navigation grid drawn anew, once loop closures have moved the submaps: beside the present one, some scans a tick.

What is drawn are the keyframes. A return is drawn only if the present grid still shows something where it was: what has
moved away since the keyframe stays away.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from vuca_nav.geometry import compose, distance, inverse, transform_points, wrap_angle
from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.graph_slam import Anchored
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.submaps import SubmapStore
from vuca_nav.types import STANDING, Pose2

TURN_LEVER = 3.0
"""Distance from a submap's node at which a turn of it counts as a shift [m]."""
_ABOUT = 2
"""Cells each way of a return's former cell in which the present grid may still show its surface."""


class RedrawRule(NamedTuple):
    """When the grid is drawn anew, and how fast."""

    shift: float
    """Shift of a submap from which on [m]."""
    scans: int
    """Scans of the past that are drawn in a tick."""


class Drawing(NamedTuple):
    """A scan of the past, to be drawn anew."""

    place: Anchored
    scan_index: int
    """Number of the scan in the navigation grid."""
    ends: np.ndarray
    """(n, 2) float32 ends of its beams in base_link [m]."""
    num_hits: int
    """The first of them are returns."""
    grazed: np.ndarray
    """(n,) float32, see ``OccupancyGrid.insert`` [m]."""
    origin: tuple[float, float]
    """Place of the lidar in base_link [m]."""


class DrawnMap:
    """The navigation grid, and where it shows the submaps.

    Attributes:
        grid: The navigation grid; its owner writes the scans into it.
        drawings: Keyframes, to be drawn anew.
    """

    def __init__(self, grid: OccupancyGrid, rule: RedrawRule):
        self.grid, self.drawings = grid, list[Drawing]()
        self._rule = rule
        self._drawn: list[Pose2] = [STANDING]
        """``map_from_local`` of each submap as the grid shows it."""
        self._redrawn: list[Pose2] = []
        """The same as the grid shows it that is being drawn."""
        self._redrawing: Iterator[OccupancyGrid | None] | None = None
        self._seen = 0

    def map_from_base(self, place: Anchored) -> Pose2:
        """Where a pose is in the map as it is drawn."""
        return compose(self._drawn[place.submap], place.local_from_base)

    def take_submaps(self, store: SubmapStore) -> None:
        """Show new submaps where those are shown that the robot came from."""
        for transforms in (self._drawn, self._redrawn):
            while transforms and len(transforms) < len(store.submaps):
                previous = store.submaps[len(transforms)].previous
                transforms.append(transforms[max(previous, 0)])

    def correct(self, map_correction: Pose2) -> None:
        """Take over that the submaps have been moved by someone who has drawn the grid anew."""
        self._drawn = [compose(map_correction, one) for one in self._drawn]
        self._redrawing = None

    def step(self, store: SubmapStore, num_optimised: int, place: Anchored) -> Pose2 | None:
        """Go on drawing the map anew; begin if the submaps have moved; swap when it is done.

        Args:
            store: The submaps.
            num_optimised: Number of times that they have been moved.
            place: Where the robot is.

        Returns:
            Correction of the map about the robot if the grids have been swapped, else None.
        """
        if self._redrawing is None:
            if num_optimised == self._seen:
                return None
            self._seen = num_optimised
            if not any(self._has_moved(store, k) for k in range(len(store.submaps))):
                return None
            self._redrawn = [submap.map_from_local for submap in store.submaps]
            self._redrawing = self._draw(self.map_from_base(place))
        grid = next(self._redrawing)
        if grid is None:
            return None
        correction = compose(self._redrawn[place.submap], inverse(self._drawn[place.submap]))
        grid.scan_index = self.grid.scan_index
        self.grid, self._drawn, self._redrawn, self._redrawing = grid, self._redrawn, [], None
        return correction

    def _has_moved(self, store: SubmapStore, k: int) -> bool:
        """Whether a submap is elsewhere than the grid shows it."""
        submap, shift = store.submaps[k], self._rule.shift
        drawn, now = compose(self._drawn[k], submap.node), compose(submap.map_from_local, submap.node)
        return distance(drawn, now) > shift or abs(wrap_angle(now.yaw - drawn.yaw)) * TURN_LEVER > shift

    def _draw(self, about: Pose2) -> Iterator[OccupancyGrid | None]:
        """Draw the scans of the past, some at a time, those that come meanwhile, too; the grid at the end."""
        grid = OccupancyGrid(self.grid.config, (about.x, about.y))
        done = 0
        while done < len(self.drawings):
            for drawing in self.drawings[done : done + self._rule.scans]:
                self._draw_scan(grid, drawing)
            done += self._rule.scans
            yield None
        yield grid

    def _draw_scan(self, grid: OccupancyGrid, drawing: Drawing) -> None:
        ends_in_base, place = drawing.ends.astype(np.float64), drawing.place
        before = transform_points(self.map_from_base(place), ends_in_base[: drawing.num_hits])
        order, num_hits = _still_there(self.grid.level, self.grid.origin, self.grid.resolution, before)
        order = np.concatenate([order, np.arange(drawing.num_hits, len(ends_in_base))])
        pose = compose(self._redrawn[place.submap], place.local_from_base)
        ends = transform_points(pose, ends_in_base[order])
        x, y = transform_points(pose, np.array([drawing.origin]))[0]
        both = np.vstack([ends, [[x, y]]])
        box = np.concatenate([both.min(axis=0), both.max(axis=0)])
        grid.scan_index = drawing.scan_index - 1
        lidar = Pose2(float(x), float(y), pose.yaw)
        grid.insert(lidar, ends, num_hits, drawing.grazed[order].astype(np.float64), box)


@njit(cache=True)
def _still_there(level, origin, resolution, points):
    """Sort returns into those whose surroundings are occupied, first, and those whose are not; and count the former."""
    rows, columns = level.shape
    n = points.shape[0]
    order = np.empty(n, np.int64)
    first, last = 0, n
    for k in range(n):
        i = int((points[k, 1] - origin[1]) / resolution)
        j = int((points[k, 0] - origin[0]) / resolution)
        is_there = False
        for a in range(max(i - _ABOUT, 0), min(i + _ABOUT + 1, rows)):
            for b in range(max(j - _ABOUT, 0), min(j + _ABOUT + 1, columns)):
                is_there |= level[a, b] > 0
        if is_there:
            order[first] = k
            first += 1
        else:
            last -= 1
            order[last] = k
    return order, first
