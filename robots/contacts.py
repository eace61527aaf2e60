"""Contacts of the robot with the scene: they are detected here, and judged by the episode."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

from collections.abc import Mapping

import mujoco
import numpy as np
from numba import njit


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

    def first(self, data: mujoco.MjData) -> tuple[str, str] | None:
        """Name and kind of a geom of the scene that the robot touched in the last physics step."""
        geom = _first_scene_geom(data.contact.geom, self._is_scene)
        return self._named[geom] if geom >= 0 else None


@njit(cache=True)
def _first_scene_geom(pairs, is_scene):
    for i in range(len(pairs)):
        for side in range(2):
            if is_scene[pairs[i, side]]:
                return pairs[i, side]
    return -1
