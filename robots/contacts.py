"""Contacts of the robot with the scene: they are detected here, and judged by the episode."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

from collections.abc import Mapping
from typing import NamedTuple

import mujoco
import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray

_LEAST_NORMAL = 0.2
"""Horizontal part of a unit normal below which it says nothing of the direction: a shape is touched from above."""


class Touch(NamedTuple):
    """A contact of the robot with one geom of the scene, in the step that found it."""

    name: str
    """Name of the geom, e.g. "wall_12"."""
    kind: str
    """Kind of the obstacle or mover, e.g. "wall"."""
    point: FloatArray
    """Middle of the places where they touch, in the world (2,) [m]."""
    normal: FloatArray | None
    """Horizontal unit vector from the robot to the other, in the world (2,); None if they touch from above."""
    base_pose: FloatArray
    """base_link's position and quaternion w, x, y, z before the impact (7,)."""
    base_velocity: FloatArray
    """Its velocity before the impact: linear in the world, angular in base_link (6,)."""


class SceneContacts:
    """Finds the robot's contacts with anything but the floor.

    Args:
        model: The compiled scene with the robot.
        kind_of_geom: Kind of each geom of the scene ("wall", "cart", ...) by the geom's name. The robot's geoms and
            the floor are not in it.
    """

    def __init__(self, model: mujoco.MjModel, kind_of_geom: Mapping[str, str]):
        self._named = {model.geom(name).id: (name, kind) for name, kind in kind_of_geom.items()}
        self._is_scene = np.zeros(model.ngeom, np.bool_)
        self._is_scene[list(self._named)] = True

    def first(self, data: mujoco.MjData, base_pose: FloatArray, base_velocity: FloatArray) -> Touch | None:
        """The robot's contact with a geom of the scene in the last physics step.

        Args:
            data: State after that step.
            base_pose: base_link's position and quaternion before it, when MuJoCo looked for contacts (7,).
            base_velocity: Its velocity then (6,), which MuJoCo has changed by the impact since.
        """
        pairs = data.contact.geom
        geom = _first_scene_geom(pairs, self._is_scene)
        if geom < 0:
            return None
        of_geom = (pairs == geom).any(axis=1)
        points = data.contact.pos[of_geom]
        # A contact's normal points from its first geom to its second.
        signs = np.where(pairs[of_geom, 1] == geom, 1.0, -1.0)
        normal = (signs[:, None] * data.contact.frame[of_geom, :3]).mean(axis=0)[:2]
        length = float(np.hypot(*normal))
        return Touch(
            *self._named[geom],
            point=points[:, :2].mean(axis=0),
            normal=normal / length if length > _LEAST_NORMAL else None,
            base_pose=base_pose.copy(),
            base_velocity=base_velocity.copy(),
        )


@njit(cache=True)
def _first_scene_geom(pairs, is_scene):
    for i in range(len(pairs)):
        for side in range(2):
            if is_scene[pairs[i, side]]:
                return pairs[i, side]
    return -1
