"""The map of a log: its keyframes drawn where they are by now."""

import numpy as np

from vuca_nav.geometry import compose, distance, transform_points, wrap_angle
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.submaps import Keyframe, SubmapStore
from vuca_nav.types import FloatArray, Pose2

DRAWN = GridConfig(hit=9, miss=2)
"""A map drawn from keyframes, 0.2 m apart: fewer beams cross a cell than where every scan is drawn."""
_LEVER = 3.0
"""Distance from a submap's first keyframe at which a turn of it counts as a shift [m]."""


class KeyframeMap:
    """``update(store)`` as often as the map is wanted.

    Attributes:
        grid: The map.
        left_out: Number of keyframes that do not fit into the greatest size of a map.
    """

    def __init__(self):
        self._begin(Pose2(0.0, 0.0, 0.0))

    def _begin(self, first: Pose2) -> None:
        self.grid = OccupancyGrid(DRAWN, (first.x, first.y))
        self.left_out = 0
        self._num_drawn = 0
        self._drawn_at: list[Pose2] = []

    def update(self, store: SubmapStore) -> bool:
        """Draw what is new; all anew if a submap has moved by more than half a cell since it was drawn.

        Returns:
            Whether all was drawn anew.
        """
        places = [compose(submap.map_from_local, submap.node) for submap in store.submaps]
        moved = any(map(self._has_moved, self._drawn_at, places))
        if store.keyframes and (moved or not self._num_drawn):
            self._begin(store.map_from_base(store.keyframes[0]))
        for keyframe in store.keyframes[self._num_drawn :]:
            self.left_out += not self._draw(keyframe, store.map_from_base(keyframe))
        self._num_drawn = len(store.keyframes)
        self._drawn_at += places[len(self._drawn_at) :]
        return moved

    def way(self, store: SubmapStore) -> FloatArray:
        """Places of the keyframes by now, (n, 2) [m]."""
        return np.array([store.map_from_base(keyframe)[:2] for keyframe in store.keyframes]).reshape(-1, 2)

    def _has_moved(self, before: Pose2, now: Pose2) -> bool:
        return distance(before, now) + _LEVER * abs(wrap_angle(now.yaw - before.yaw)) > 0.5 * self.grid.resolution

    def _draw(self, keyframe: Keyframe, pose: Pose2) -> bool:
        ends = transform_points(pose, keyframe.ends.astype(np.float64))
        origin = transform_points(pose, np.array([keyframe.origin]))[0]
        both = np.vstack([ends, origin[None]])
        box = np.concatenate([both.min(axis=0), both.max(axis=0)])
        lidar = Pose2(float(origin[0]), float(origin[1]), pose.yaw)
        return self.grid.insert(lidar, ends, keyframe.num_hits, keyframe.grazed.astype(np.float64), box)
