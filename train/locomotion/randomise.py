"""Variation of the training's robots and floors, so that the gait works on others than it has seen."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from robots.locomotion.model import GRAVITY, SERVO_KD, SERVO_KP, SERVO_SUPPLY
from train.locomotion.floors import SILL_DEPTH, SILL_HALF_HEIGHT, SILL_TOP


@dataclass(frozen=True, slots=True)
class Randomisation:
    """Ranges of uniform draws, relative unless a unit is given."""

    friction: tuple[float, float] = (0.4, 1.25)
    """Sliding friction of feet on floor."""
    spin_friction: tuple[float, float] = (0.3, 1.5)
    """Torsional and rolling friction."""
    payload: tuple[float, float] = (-1.0, 2.0)
    """Payload on the trunk [kg]."""
    centre_of_mass: float = 0.03
    """Greatest shift of the trunk's centre of mass, either way, along each axis [m]."""
    gains: tuple[float, float] = (0.9, 1.1)
    """Gains of the servos."""
    strength: tuple[float, float] = (0.85, 1.05)
    """Torque limits and supply of the motors."""
    damping: tuple[float, float] = (0.5, 2.0)
    armature: tuple[float, float] = (0.8, 1.2)
    joint_friction: tuple[float, float] = (0.3, 1.6)
    sill_height: tuple[float, float] = (0.0, SILL_TOP)
    """Height of the sills at full roughness [m]."""
    sills: float = 0.7
    """Share of the floors that have sills."""
    slope: float = 0.12
    """Greatest slope at full roughness."""
    slopes: float = 0.6
    """Share of the floors that are not level."""


def randomise(
    model: mujoco.MjModel,
    base: mujoco.MjModel,
    data: mujoco.MjData,
    ranges: Randomisation,
    rng: np.random.Generator,
    roughness: float,
) -> None:
    """Make a model a random variant of ``base``: of its robot and, within the compiled sizes, of its floor.

    A ramp is a level floor under a tilted gravity. The robot cannot tell the difference as long as its attitude is
    given against gravity, not against the floor.

    Args:
        model: A copy of ``base`` or an earlier variant; changed.
        base: Robot and floor as they were compiled.
        data: Data of either model; overwritten.
        ranges: Ranges of the draws.
        rng: Source of randomness.
        roughness: 0 flat, 1 as rough as the ranges allow.
    """
    _draw_robot(model, base, ranges, rng)
    sills = base.geom_bodyid == model.body("sills").id
    angle = rng.uniform(-math.pi, math.pi)
    slope = roughness * rng.uniform(0.0, ranges.slope) * (rng.random() < ranges.slopes)
    down = np.array([slope * math.cos(angle), slope * math.sin(angle), -1.0])
    model.opt.gravity[:] = GRAVITY * down / np.linalg.norm(down)
    if sills.any():
        rough = roughness > 0.0 and rng.random() < ranges.sills
        height = rng.uniform(*ranges.sill_height, sills.sum()) * roughness
        model.geom_size[sills, 0] = 0.5 * rng.uniform(0.1 * SILL_DEPTH, SILL_DEPTH, sills.sum())
        model.geom_pos[sills, 2] = (height if rough else -0.1) - SILL_HALF_HEIGHT
    # Last: it also fits the collision tree to the shapes as they are then.
    mujoco.mj_setConst(model, data)


def randomise_robot(
    model: mujoco.MjModel,
    base: mujoco.MjModel,
    data: mujoco.MjData,
    ranges: Randomisation,
    rng: np.random.Generator,
) -> None:
    """Make a model's robot a random variant of ``base``'s; see ``randomise``."""
    _draw_robot(model, base, ranges, rng)
    mujoco.mj_setConst(model, data)  # quantities that follow from masses and inertias, like how far a contact gives


def _draw_robot(model: mujoco.MjModel, base: mujoco.MjModel, ranges: Randomisation, rng: np.random.Generator) -> None:
    def draw(low_high: tuple[float, float]) -> float:
        return float(rng.uniform(*low_high))

    feet = base.geom_priority > 0
    model.geom_friction[feet, 0] = draw(ranges.friction)
    model.geom_friction[feet, 1:] = base.geom_friction[feet, 1:] * draw(ranges.spin_friction)
    trunk = int(base.jnt_bodyid[0]) + 1  # attaching puts a massless body with the free joint around it
    payload = draw(ranges.payload)
    scale = (base.body_mass[trunk] + payload) / base.body_mass[trunk]
    model.body_mass[trunk] = base.body_mass[trunk] * scale
    model.body_inertia[trunk] = base.body_inertia[trunk] * scale
    shift = ranges.centre_of_mass
    model.body_ipos[trunk] = base.body_ipos[trunk] + rng.uniform(-shift, shift, 3)
    kp, kd = draw(ranges.gains), draw(ranges.gains)
    model.actuator_gainprm[:, SERVO_KP] = base.actuator_gainprm[:, SERVO_KP] * kp
    model.actuator_gainprm[:, SERVO_KD] = base.actuator_gainprm[:, SERVO_KD] * kd
    strength = draw(ranges.strength)
    model.actuator_forcerange[:] = base.actuator_forcerange * strength
    model.actuator_gainprm[:, SERVO_SUPPLY] = base.actuator_gainprm[:, SERVO_SUPPLY] * strength
    model.dof_damping[6:] = base.dof_damping[6:] * draw(ranges.damping)
    model.dof_armature[6:] = base.dof_armature[6:] * draw(ranges.armature)
    model.dof_frictionloss[6:] = base.dof_frictionloss[6:] * draw(ranges.joint_friction)
