"""Worlds that several robots share: each robot is a moving obstacle to the others, with its own footprint.

The robots of a world are consecutive rows. They keep the world's layout, start apart from each other, see each other in
their scans, and collide with each other. A robot whose episode ends starts anew elsewhere while the others go on.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from robots.clearance import Outlines
from train.arena.bodies import HIGHEST, RADIUS
from train.arena.kernels import EpisodeSettings, EpisodeSource
from train.arena.rows import GOAL_X, GOAL_Y, SHORTEST, START_X, START_Y, Episodes, Robots, Streams
from vuca_nav.kernel_cache import njit
from worlds.splitmix import next_uniform

START_GAP = 1.0
"""Least gap between the circles of two robots when one of them starts [m]."""
_MOST_DRAWS = 64
"""Number of draws of a start; after the last the one with the widest gap is taken."""


class Encounters(Protocol):
    """Part that the robots of a world have in each other's episodes; rows are indices (k,)."""

    def settle(self, rows: np.ndarray, *, new_worlds: bool) -> None:
        """Let rows whose episodes were drawn share their world and start apart.

        Args:
            rows: The rows.
            new_worlds: Whether the worlds' layouts are the ones drawn for their first rows, else they stay.
        """
        ...

    def meet(self, rows: np.ndarray) -> None:
        """Note the first tick of the decision at which rows overlap others of their world."""
        ...

    def see(self, rows: np.ndarray) -> None:
        """Shorten the beams of these rows that meet others of their world."""
        ...

    def park(self, rows: np.ndarray) -> None:
        """Leave these rows where they are, for decisions that they take no part in."""
        ...


class NoEncounters:
    """Worlds of a single robot."""

    def settle(self, rows: np.ndarray, *, new_worlds: bool) -> None:
        """Leave the episodes as they were drawn."""

    def meet(self, rows: np.ndarray) -> None:
        """Meet nobody."""

    def see(self, rows: np.ndarray) -> None:
        """See nobody."""

    def park(self, rows: np.ndarray) -> None:
        """Leave them."""


class Sight(NamedTuple):
    """Scans of n lidars."""

    heights: np.ndarray
    """Heights of their planes above the floor, (n,) [m]."""
    max_range: float
    """[m]"""
    ranges: np.ndarray
    """Ranges, shortened, (n, num_beams) [m]."""


class RobotTrajectories(NamedTuple):
    """Poses of n robots."""

    now: np.ndarray
    """x, y, yaw at present, (n, 3) [m, rad]."""
    ticks: np.ndarray
    """The same after each tick of the decision, (n, ticks, 3)."""


class Draw(NamedTuple):
    """Everything that an episode is drawn from and written to."""

    settings: EpisodeSettings
    source: EpisodeSource
    streams: Streams
    episodes: Episodes
    robots: Robots
    tick: float
    """[s]"""


class SharedWorlds:
    """The robots of a shard, ``size`` consecutive rows a world.

    Args:
        size: Number of robots in each world.
        draw: The episodes and what they are drawn from.
        outlines: Footprints of the rows.
        trajectories: Poses of the rows.
        sight: Scans of the rows.
        hit: First tick at which each row overlapped something, -1 if there is none, (n,).
    """

    def __init__(
        self, size: int, draw: Draw, outlines: Outlines, trajectories: RobotTrajectories, sight: Sight, hit: np.ndarray
    ):
        self._size, self._draw, self._hit = size, draw, hit
        self._outlines, self._trajectories, self._sight = outlines, trajectories, sight
        self._worlds = np.zeros((len(hit) // size, 2), np.int64)
        corners = outlines.footprints.shape[1]
        self._scratch = np.empty((corners, 2)), np.empty((corners, 2))

    def settle(self, rows: np.ndarray, *, new_worlds: bool) -> None:
        """Let rows share their world and start apart."""
        if new_worlds:
            episodes = self._draw.episodes
            self._worlds[:, 0] = episodes.kind[:: self._size]
            self._worlds[:, 1] = episodes.layout[:: self._size]
        _settle(rows, self._size, self._worlds, self._draw)

    def meet(self, rows: np.ndarray) -> None:
        """Note the first tick at which rows overlap others."""
        _meet(rows, self._size, self._trajectories.ticks, self._outlines, self._hit, self._scratch)

    def see(self, rows: np.ndarray) -> None:
        """Shorten the beams of these rows that meet others."""
        _see(rows, self._size, self._trajectories.now, self._outlines, self._sight, self._scratch[0])

    def park(self, rows: np.ndarray) -> None:
        """Leave these rows where they are."""
        self._trajectories.ticks[rows] = self._trajectories.now[rows, None]


@njit(cache=True, nogil=True)
def _settle(rows, size, worlds, draw):
    """Let rows share their world's layout, and draw their starts until they are apart from the other robots."""
    source, streams, episodes, robots = draw.source, draw.streams, draw.episodes, draw.robots
    pairs, pose, shape = source.pairs, robots.pose, source.body_shape
    for r in range(len(rows)):
        i = rows[r]
        world = i // size
        kind, layout = worlds[world]
        episodes.kind[i], episodes.layout[i] = kind, layout
        widest, best = -math.inf, 0
        for _ in range(_MOST_DRAWS):
            which = int(next_uniform(streams.seeds, streams.drawn, i) * pairs.shape[1])
            x, y = pairs[layout, which, START_X], pairs[layout, which, START_Y]
            gap = math.inf
            for j in range(world * size, (world + 1) * size):
                if j != i:
                    away = math.hypot(pose[j, 0] - x, pose[j, 1] - y)
                    gap = min(gap, away - shape[robots.body[i], RADIUS] - shape[robots.body[j], RADIUS])
            if gap > widest:
                widest, best = gap, which
            if gap >= START_GAP:
                break
        task = pairs[layout, best]
        episodes.task[i] = task
        pose[i, 0], pose[i, 1] = task[START_X], task[START_Y]
        episodes.distance[i] = math.hypot(task[GOAL_X] - pose[i, 0], task[GOAL_Y] - pose[i, 1])
        fastest = source.body_limits[robots.body[i], 0, HIGHEST]
        limit = draw.settings.time_factor * task[SHORTEST] / fastest + draw.settings.time_slack
        episodes.time_limit[i] = int(math.ceil(limit / draw.tick))


@njit(cache=True, nogil=True)
def _meet(rows, size, poses, outlines, hit, scratch):
    for r in range(len(rows)):
        i = rows[r]
        first = i // size * size
        for j in range(first, first + size):
            if j == i:
                continue
            reach = outlines.radii[i] + outlines.radii[j]
            ticks = poses.shape[1] if hit[i] < 0 else hit[i]
            for t in range(ticks):
                dx, dy = poses[i, t, 0] - poses[j, t, 0], poses[i, t, 1] - poses[j, t, 1]
                if dx * dx + dy * dy >= reach * reach:
                    continue
                _place(outlines.footprints[i], outlines.corners[i], poses[i, t], scratch[0])
                _place(outlines.footprints[j], outlines.corners[j], poses[j, t], scratch[1])
                a, b = scratch[0][: outlines.corners[i]], scratch[1][: outlines.corners[j]]
                if not (_is_apart(a, b) or _is_apart(b, a)):
                    hit[i] = t
                    break


@njit(cache=True, nogil=True)
def _place(footprint, corners, pose, out):
    """Corners of a footprint in the world."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for k in range(corners):
        x, y = footprint[k, 0], footprint[k, 1]
        out[k, 0], out[k, 1] = pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y


@njit(cache=True, nogil=True)
def _is_apart(polygon, other):
    """Whether an edge of a convex counter-clockwise polygon has all of another one on its outer side."""
    ax, ay = polygon[-1, 0], polygon[-1, 1]
    for k in range(len(polygon)):
        bx, by = polygon[k, 0], polygon[k, 1]
        outside = True
        for m in range(len(other)):
            if (bx - ax) * (other[m, 1] - ay) - (by - ay) * (other[m, 0] - ax) >= 0.0:
                outside = False
                break
        if outside:
            return True
        ax, ay = bx, by
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def _see(rows, size, poses, outlines, sight, corners):
    num_beams = sight.ranges.shape[1]
    pitch = 2.0 * math.pi / num_beams
    for r in range(len(rows)):
        i = rows[r]
        out = sight.ranges[i]
        x, y = poses[i, 0], poses[i, 1]
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        first = i // size * size
        for j in range(first, first + size):
            dx, dy, reach = poses[j, 0] - x, poses[j, 1] - y, sight.max_range + outlines.radii[j]
            if j == i or sight.heights[i] > outlines.heights[j] or dx * dx + dy * dy >= reach * reach:
                continue
            in_lidar = (cos * dx + sin * dy, cos * dy - sin * dx, poses[j, 2] - poses[i, 2])
            count = outlines.corners[j]
            _place(outlines.footprints[j], count, in_lidar, corners)
            ax, ay = corners[count - 1]
            angle_a = math.atan2(ay, ax)
            for k in range(count):
                bx, by = corners[k]
                angle_b = math.atan2(by, bx)
                ex, ey = bx - ax, by - ay
                across = ax * ey - ay * ex
                if across < 0.0:  # the lidar is on the outer side: from b to a the bearing grows
                    begin = math.ceil((angle_b + math.pi) / pitch - 1e-9)
                    end = math.floor((angle_a + math.pi) / pitch + 1e-9)
                    if angle_a < angle_b:  # across the seam at +-pi
                        end += num_beams
                    for beam in range(begin, end + 1):
                        bearing = beam * pitch - math.pi
                        turn = math.cos(bearing) * ey - math.sin(bearing) * ex
                        if turn < 0.0:
                            length = across / turn
                            if length < sight.max_range:
                                out[beam % num_beams] = min(out[beam % num_beams], length)
                ax, ay, angle_a = bx, by, angle_b
