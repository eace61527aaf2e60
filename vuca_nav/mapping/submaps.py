"""Submaps: overlapping pieces of the map, each rigid in itself, and the keyframes that they are drawn from.

All poses are given in the *local* frame, in which the robot's way goes on without jumps. A submap has a transform of
its own from there into the map, which loop closures correct (Hess et al. 2016, Section V).
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.geometry import compose, transform_points
from vuca_nav.mapping.returns import Returns
from vuca_nav.mapping.surfaces import PackedSurfaces, SurfaceGrid
from vuca_nav.types import STANDING, FloatArray, Pose2


class Keyframe(NamedTuple):
    """A scan that is kept."""

    local_from_base: Pose2
    submap: int
    """Number of the submap that it was matched to."""
    ends: NDArray[np.float32]
    """(m, 2) what is drawn in base_link, the returns first; see ``Returns`` [m]."""
    num_hits: int
    """Number of surface points among them."""
    normals: NDArray[np.float32]
    """(n, 2) normals of the returns; zeros where there is none."""
    grazed: NDArray[np.float32]
    """(m,) see ``Returns`` [m]."""
    origin: tuple[float, float]
    """Place of the lidar in base_link [m]."""

    @property
    def points(self) -> NDArray[np.float32]:
        """(n, 2) returns in base_link [m]."""
        return self.ends[: len(self.normals)]


def keyframe_of(returns: Returns, local_from_base: Pose2, submap: int) -> Keyframe:
    """Copy a scan."""
    return Keyframe(
        local_from_base,
        submap,
        returns.ends.astype(np.float32),
        returns.num_hits,
        returns.normals.astype(np.float32),
        returns.grazed.astype(np.float32),
        returns.origin,
    )


@dataclass(slots=True)
class Submap:
    """A piece of the map."""

    grid: SurfaceGrid | None
    """What is drawn of it so far; None once it is finished."""
    node: Pose2
    """Pose of its first keyframe in the local frame: where the pose graph holds it."""
    drift: FloatArray
    """(3, 3) covariance of ``node`` as ``previous`` sees it, in the local frame's axes [m, rad]."""
    first_keyframe: int
    previous: int = -1
    """Number of the submap from which the robot came here, -1 for none: the last one, unless it had been lost."""
    num_keyframes: int = 0
    packed: PackedSurfaces | None = None
    """What was drawn, once it is finished."""
    map_from_local: Pose2 = STANDING
    """Where it is in the map; loop closures correct it."""


@dataclass(slots=True)
class SubmapStore:
    """All submaps and keyframes of a mission."""

    submaps: list[Submap] = field(default_factory=list)
    keyframes: list[Keyframe] = field(default_factory=list)
    map_from_local: Pose2 = STANDING
    """Where the first submap is in the map."""
    continuous_from: int = 0
    """Number of the first keyframe since the robot was last found again: poses of earlier ones do not go on into it."""

    def map_from_base(self, keyframe: Keyframe) -> Pose2:
        """Where a keyframe is in the map by now."""
        return compose(self.submaps[keyframe.submap].map_from_local, keyframe.local_from_base)

    def surfaces_of(self, number: int) -> PackedSurfaces:
        """What is drawn of a submap, finished or not."""
        submap = self.submaps[number]
        if submap.packed is not None:
            return submap.packed
        assert submap.grid is not None  # a submap has one or the other
        return submap.grid.pack()

    def places_of(self, number: int) -> FloatArray:
        """Where the keyframes of a submap were taken, in the local frame (n, 2) [m]; its node if it has none."""
        submap = self.submaps[number]
        keyframes = self.keyframes[submap.first_keyframe : submap.first_keyframe + submap.num_keyframes]
        return np.array([keyframe.local_from_base[:2] for keyframe in keyframes] or [submap.node[:2]])


def insert_scan(grid: SurfaceGrid, local_from_base: Pose2, returns: Returns | Keyframe) -> bool:
    """Draw a scan into a submap; returns whether it had room."""
    ends = transform_points(local_from_base, np.asarray(returns.ends, np.float64))
    origin = transform_points(local_from_base, np.array([returns.origin]))[0]
    both = np.vstack([ends, origin[None]])
    low, high = both.min(axis=0), both.max(axis=0)
    lidar = Pose2(float(origin[0]), float(origin[1]), local_from_base.yaw)
    grazed = np.asarray(returns.grazed, np.float64)
    return grid.insert(lidar, ends, returns.num_hits, grazed, np.concatenate([low, high]))
