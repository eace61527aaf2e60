"""Contacts of the robot with the scene: which they are, and when it is worth looking for them."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

from collections.abc import Mapping

import mujoco
import numpy as np
from numba import njit


class SceneContacts:
    """Finds contacts with anything but the floor, and switches the search for them off and on.

    In a factory of 200 shapes the search is half the cost of a physics step, and most of the time nothing is
    near. While it is off, bodies of the scene take no part in collision detection; the physics is the same as
    long as nothing of the scene would have been touched, which the caller has to know.

    Args:
        model: The compiled scene with the robot.
        kind_of_geom: What each geom of the scene is, by name; all others, the robot's and the floor, are not named.
    """

    def __init__(self, model: mujoco.MjModel, kind_of_geom: Mapping[str, str]):
        self._model, self._watching = model, True
        self._named = {model.geom(name).id: (name, kind) for name, kind in kind_of_geom.items()}
        self._is_scene = np.zeros(model.ngeom, np.bool_)
        self._is_scene[list(self._named)] = True
        self._bodies = np.unique(model.geom_bodyid[self._is_scene])
        self._masks = model.body_conaffinity[self._bodies].copy()

    def watch(self, watching: bool) -> None:
        """Switch the search on or off."""
        if watching != self._watching:
            self._model.body_conaffinity[self._bodies] = self._masks if watching else 0
            self._watching = watching

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
