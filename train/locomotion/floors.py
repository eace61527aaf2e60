"""Floors to walk on: a plane, level or tilted, with bars sunk into it."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from robots.locomotion.model import QuadrupedModel
from vuca_nav.types import FloatArray
from worlds.mjcf import TOUCHES_FLOOR, RootElement

SILL_SPACING = 0.9
"""Distance between the middles of two bars [m]."""
SILL_DEPTH = 0.5
"""Greatest depth of a bar along x [m]."""
SILL_TOP = 0.05
"""Greatest height of a bar over the floor [m]."""
SILL_HALF_HEIGHT = 0.5
"""Half height of a bar, which is sunk into the floor [m]."""
SILL_HALF_WIDTH = 4.0
"""Half width of a bar along y, in which it is alike everywhere: a robot may be put back by any distance [m]."""


@dataclass(frozen=True, slots=True)
class Floor:
    """A plane through the origin and the bars on it, which cross its x axis."""

    slope: float = 0.0
    """Slope, rise over run."""
    uphill: float = 0.0
    """Direction of the steepest ascent from the x axis [rad]."""
    tops: tuple[float, ...] = ()
    """Heights of the bars over the plane [m]."""
    depths: tuple[float, ...] = ()
    """Depths of the bars along x [m]."""

    @classmethod
    def for_training(cls, num_sills: int) -> "Floor":
        """Make a level floor with each bar as large as can be: within that, ``randomise`` changes them."""
        return cls(tops=(SILL_TOP,) * num_sills, depths=(SILL_DEPTH,) * num_sills)

    @property
    def length(self) -> float:
        """Length after which the floor may be taken to repeat along x [m]."""
        return len(self.tops) * SILL_SPACING + 1.0

    def quaternion(self) -> FloatArray:
        """Attitude of the plane in the world, w, x, y, z (4,)."""
        half = 0.5 * math.atan(self.slope)  # about the horizontal axis to the right of uphill
        sine = math.sin(half)
        return np.array([math.cos(half), sine * math.sin(self.uphill), -sine * math.cos(self.uphill), 0.0])


def compile_model(
    model: QuadrupedModel, physics: int, floor: Floor, *, touch: bool = False, delayed: bool = True
) -> mujoco.MjModel:
    """Compile the robot, free to move, on a floor.

    Args:
        model: The robot.
        physics: Rate of the physics [Hz].
        floor: The floor in the world's frame; gravity points down.
        touch: Add the sensors of contact force; see QuadrupedModel.mjcf.
        delayed: Delay the targets; see QuadrupedModel.mjcf.
    """
    arena = RootElement(model="floor")
    quaternion = floor.quaternion()
    floor_touches = {"contype": 0, "conaffinity": TOUCHES_FLOOR}
    arena.worldbody.add("geom", name="floor", type="plane", size=(0, 0, 1), quat=quaternion, **floor_touches)
    # A body of their own: the world body holds the endless floor, next to which nothing can be culled.
    sills = arena.worldbody.add("body", name="sills", quat=quaternion)
    for k, (top, depth) in enumerate(zip(floor.tops, floor.depths, strict=True)):
        sills.add(
            "geom", name=f"sill_{k}", type="box", size=(depth / 2.0, SILL_HALF_WIDTH, SILL_HALF_HEIGHT),
            pos=((k - 0.5 * (len(floor.tops) - 1)) * SILL_SPACING, 0, top - SILL_HALF_HEIGHT), **floor_touches,
        )  # fmt: skip
    arena.attach(model.mjcf(touch=touch, delayed=delayed)).add("freejoint")
    option = arena.option
    option.flag.autoreset = "disable"  # a lost state must be noticed, not start anew unseen
    option.timestep = 1.0 / physics
    return mujoco.MjModel.from_xml_string(arena.to_xml_string())
