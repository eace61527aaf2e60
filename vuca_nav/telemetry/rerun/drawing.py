"""Rerun archetypes of a recording's entities: solids, meshes, the map, trails, frontiers, arcs."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from vuca_nav.exploration.heatmap import SafetyMap
from vuca_nav.geometry import compose, distance
from vuca_nav.telemetry.interface import FrontierView, SceneShape
from vuca_nav.telemetry.rerun.blueprint import (
    BEST_FRONTIER,
    CATEGORY_COLOURS,
    LABEL,
    OTHER_CATEGORY,
    UNSEEN,
    WORST_FRONTIER,
    Colour,
)
from vuca_nav.types import FloatArray, Pose2, VelocityCommand

_CLASS_BOUNDS = (0.48, 0.52)
"""Occupancy probability between which a cell counts as unknown (Zhang et al., Section III-C)."""
_LEVELS = 8
"""Number of greys, free and occupied alike, in a recorded map: fewer distinct bytes compress several times better."""


def _greys() -> NDArray[np.uint8]:
    """Grey of each occupancy probability times 255: white is free, UNSEEN is unknown, black is occupied."""
    probability = np.arange(256) / 255.0
    lower, upper = _CLASS_BOUNDS
    free = np.round((lower - probability) / lower * _LEVELS) / _LEVELS  # 1 is certainly free
    occupied = np.round((probability - upper) / (1.0 - upper) * _LEVELS) / _LEVELS
    greys = np.full(256, UNSEEN, dtype=np.float64)
    greys = np.where(probability < lower, 170.0 + 85.0 * free, greys)
    greys = np.where(probability > upper, 60.0 * (1.0 - occupied), greys)
    return np.round(greys).astype(np.uint8)


_GREYS = _greys()


def greys_of(probability: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Occupancy probability times 255 as greys of few levels; same shape."""
    return _GREYS[probability]


def grid_map(greys: NDArray[np.uint8], resolution: float, origin: tuple[float, float]) -> rr.GridMap | None:
    """The seen part of a map as an archetype; None if nothing was seen.

    Args:
        greys: (rows y, columns x) result of ``greys_of``.
        resolution: Side of a cell [m].
        origin: Lower-left corner [m].
    """
    seen = greys != UNSEEN
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if len(rows) == 0:
        return None
    bottom, left = int(rows[0]), int(columns[0])
    crop = greys[bottom : rows[-1] + 1, left : columns[-1] + 1]
    return rr.GridMap(
        data=np.ascontiguousarray(crop[::-1]).tobytes(),  # an image's first row is its upper one
        format=rr.components.ImageFormat(
            width=crop.shape[1], height=crop.shape[0], color_model="L", channel_datatype="U8"
        ),
        cell_size=resolution,
        translation=(origin[0] + left * resolution, origin[1] + bottom * resolution, 0.0),
        colormap=rr.components.Colormap.Grayscale,
    )


def safety_grid(safety: SafetyMap) -> rr.GridMap | None:
    """V^h as colours, dark to bright over the map's scale; None if all are alike."""
    values = safety.values
    if values.min() == values.max():
        return None
    low, high = safety.scale
    levels = np.round(255.0 * np.clip((values - low) / (high - low), 0.0, 1.0)).astype(np.uint8)
    rows, columns = values.shape
    return rr.GridMap(
        data=np.ascontiguousarray(levels[::-1]).tobytes(),  # an image's first row is its upper one
        format=rr.components.ImageFormat(width=columns, height=rows, color_model="L", channel_datatype="U8"),
        cell_size=safety.resolution,
        translation=(*safety.lower_left, 0.0),
        colormap=rr.components.Colormap.Viridis,
    )


class Solids:
    """Upright boxes and cylinders under one entity path: sizes logged once, poses as often as needed.

    Two entities, ``path/boxes`` and ``path/cylinders``, whatever the number of shapes. Where a shape may vanish, sizes
    come with the poses: one that is not there has none.

    Args:
        path: Entity path.
        shapes: The shapes; a pose's height above the floor is the shape's own.
    """

    def __init__(self, path: str, shapes: Sequence[SceneShape]):
        self._path = path
        self._shapes = list(shapes)
        self._boxes = np.array([i for i, s in enumerate(shapes) if s.kind == "box"], dtype=np.intp)
        self._cylinders = np.array([i for i, s in enumerate(shapes) if s.kind == "cylinder"], dtype=np.intp)
        self._heights = np.array([s.centre[2] for s in shapes])
        self._half = np.array([s.half_size for s in shapes]).reshape(-1, 3)
        self._vanish = any(shape.vanishes for shape in shapes)

    def log_model(self, stream: rr.RecordingStream, fill_mode: rr.components.FillMode) -> None:
        """Log colours, and the sizes of shapes that stay, static."""
        colours = np.array([CATEGORY_COLOURS.get(s.category, OTHER_CATEGORY) for s in self._shapes], dtype=np.uint8)
        for name, kind, chosen in self._entities():
            sizes = {} if self._vanish else _sizes(name, self._half[chosen])
            shapes = kind.from_fields(**sizes, colors=colours[chosen], fill_mode=fill_mode)
            stream.log(f"{self._path}/{name}", shapes, static=True)

    def log_poses(self, stream: rr.RecordingStream, poses: FloatArray, *, static: bool = False) -> None:
        """Log their poses, (n, 3) as x, y, yaw [m, rad]; one that is not there has an infinite place."""
        there = np.isfinite(poses[:, :1])
        centres = np.column_stack([np.where(there, poses[:, :2], 0.0), self._heights])
        half = np.where(there, self._half, 0.0)
        for name, kind, chosen in self._entities():
            fields = _sizes(name, half[chosen]) if self._vanish else {}
            if name == "boxes":
                half_yaw = poses[chosen, 2] / 2.0
                zero = np.zeros_like(half_yaw)
                fields["quaternions"] = np.column_stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)])
            stream.log(f"{self._path}/{name}", kind.from_fields(**fields, centers=centres[chosen]), static=static)

    def _entities(self) -> list[tuple[str, Any, NDArray[np.intp]]]:
        """Name, archetype and shapes of each entity that there is."""
        both = ("boxes", rr.Boxes3D, self._boxes), ("cylinders", rr.Cylinders3D, self._cylinders)
        return [entity for entity in both if len(entity[2])]


def _sizes(name: str, half: FloatArray) -> dict[str, Any]:
    """Fields of the sizes of boxes or cylinders, from their half sizes (n, 3) [m]."""
    return {"half_sizes": half} if name == "boxes" else {"lengths": 2.0 * half[:, 2], "radii": half[:, 0]}


class Trail:
    """Trail of a pose, thinned out.

    Args:
        colour: Colour of the line.
        z: Height above the floor [m].
    """

    _SPACING = 0.2
    """Distance between vertices [m]."""

    def __init__(self, colour: Colour, z: float):
        self._colour, self._z = colour, z
        self._kept: list[Pose2] = []
        self._last: Pose2 | None = None

    def extend(self, pose: Pose2) -> None:
        """Add the present pose."""
        self._last = pose
        if not self._kept or distance(self._kept[-1], pose) >= self._SPACING:
            self._kept.append(pose)

    def move(self, map_correction: Pose2) -> None:
        """Move the trail along with the map."""
        self._kept = [compose(map_correction, pose) for pose in self._kept]
        if self._last is not None:
            self._last = compose(map_correction, self._last)

    def become(self, points: FloatArray) -> None:
        """Take over another way, (n, 2) [m]."""
        self._kept = [Pose2(x, y, 0.0) for x, y in points.tolist()]
        self._last = None

    def strip(self) -> rr.LineStrips3D:
        """The line from the start to the present pose."""
        poses = self._kept if self._last is None else [*self._kept, self._last]
        points = at_height(np.array(poses, dtype=np.float64).reshape(-1, 3)[:, :2], self._z)
        return rr.LineStrips3D([points], colors=self._colour, radii=rr.Radius.ui_points(1.2))


def frontier_points(view: FrontierView, z: float) -> rr.Points3D:
    """All candidates, coloured by score."""
    return rr.Points3D(
        at_height(view.points_in_map, z), colors=_score_colours(view.score), radii=rr.Radius.ui_points(5.0)
    )


def labelled_frontiers(view: FrontierView, which: Sequence[int], z: float) -> rr.Points3D:
    """Some candidates with their score and its parts in writing."""
    labels = [
        f"#{rank} {view.score[i]:.1f} (D {view.goal_term[i]:.1f}, V {view.safety_term[i]:.1f})"
        for rank, i in enumerate(which, start=1)
    ]
    return floating_labels(at_height(view.points_in_map[list(which)], z), labels)


def floating_labels(points: FloatArray, labels: Sequence[str]) -> rr.Points3D:
    """Labels at points whose marks are not drawn."""
    return rr.Points3D(points, colors=LABEL, radii=0.0, labels=labels, show_labels=True)


def _score_colours(score: FloatArray) -> NDArray[np.uint8]:
    """Colours between those of the best and the worst score, (n, 3)."""
    if len(score) == 0:
        return np.empty((0, 3), dtype=np.uint8)
    spread = float(np.ptp(score))
    badness = (score - score.min()) / (spread if spread > 0.0 else 1.0)
    mixed = (1.0 - badness[:, None]) * BEST_FRONTIER + badness[:, None] * np.array(WORST_FRONTIER)
    return np.round(mixed).astype(np.uint8)


def copy_of(view: FrontierView) -> FrontierView:
    """Copy a decision into arrays of its own."""
    return FrontierView(
        view.points_in_map.copy(),
        view.goal_term.copy(),
        view.safety_term.copy(),
        view.score.copy(),
        view.chosen,
    )


def transform(parent_from_child: Pose2) -> rr.Transform3D:
    """A planar pose as the transform of an entity."""
    half = parent_from_child.yaw / 2.0
    return rr.Transform3D(
        translation=(parent_from_child.x, parent_from_child.y, 0.0),
        quaternion=rr.Quaternion(xyzw=(0.0, 0.0, math.sin(half), math.cos(half))),
    )


def heading_arrow(colour: Colour, z: float) -> rr.Arrows3D:
    """An arrow of one metre along x."""
    return rr.Arrows3D(
        origins=[[0.0, 0.0, z]], vectors=[[1.0, 0.0, 0.0]], radii=rr.Radius.ui_points(4.0), colors=colour
    )


def vertex_normals(vertices: NDArray[np.float32], faces: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Unit normals (n, 3) for shading: the mean of the faces about each vertex, weighted by area."""
    corners = vertices[faces]  # (m, 3 corners, 3)
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], face_normals)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.maximum(lengths, 1e-12)).astype(np.float32)


def at_height(points: FloatArray, z: float) -> FloatArray:
    """Planar points (n, 2) in space, (n, 3) [m]."""
    return np.column_stack([points, np.full(len(points), z)])


def ring(centre: tuple[float, float], radius: float, z: float) -> FloatArray:
    """A closed circle as a line strip, (n, 3) [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, 33)
    return at_height(np.asarray(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)]), z)


def command_arc(command: VelocityCommand, duration: float, z: float) -> FloatArray:
    """Path of base_link's origin if the command is obeyed at once and held, in base_link, (n, 3) [m].

    The integral of the turning velocity: from ``v_x`` it is ``v_x sin(wt)/w, v_x (1 - cos(wt))/w``.
    """
    t = np.linspace(0.0, duration, 13)
    w = command.w_z if abs(command.w_z) > 1e-6 else math.copysign(1e-6, command.w_z)
    along, across = np.sin(w * t) / w, (1.0 - np.cos(w * t)) / w
    x, y = command.v_x * along - command.v_y * across, command.v_x * across + command.v_y * along
    return at_height(np.column_stack([x, y]), z)
