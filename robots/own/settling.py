"""What a robot of one's own does on a floor: it must stand on its wheels, still, and not fall through."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import math
from typing import NamedTuple

import mujoco
import numpy as np

from robots.bodies.body import Body, BoundBody
from robots.bodies.kinematics import planar_pose
from robots.noise import NoiseConfig
from robots.own.assembly import PHYSICS, Assembly
from robots.own.compiling import as_bad_robot
from robots.own.folder import RobotFolder
from robots.own.geometry import collision_geoms, outline_of, overhang, surface_points
from robots.physics import build_model
from vuca_nav.geometry import wrap_angle
from vuca_nav.types import STOP, FloatArray, Pose2, VelocityCommand
from worlds.mjcf import FLOOR
from worlds.world import World

CONTROL = 60
"""Rate of the control while the robot settles [Hz]."""
_TIME = 1.5
"""Time that the robot is given to come to rest [s]."""
_SUNK = 0.02
"""Depth in the floor from which on the robot falls through it [m]."""
_LEAN = math.radians(8.0)
"""Greatest lean of a robot that stands [rad]."""
_STILL = 0.05
"""Greatest speed of a robot at rest [m/s, rad/s]."""
_DRIVE_TIME = 2.0
"""Time for which each of two commands, forwards and turning, is tried [s]."""
_LEAST_DRIVEN, _LEAST_TURNED = 0.6, 0.35
"""Least shares of the commanded way and angle; a base that skids turns by less than its wheels make of it."""
_LEFT_OUT = 0.02
"""Distance by which shapes may stick out of a footprint that is given [m]: within the margin that every clearance has,
so that no contact goes unnoticed."""
_WIDEST = 2.0
"""Greatest radius of a footprint [m]."""


class Stance(NamedTuple):
    """How a robot stands on a floor, by its shapes."""

    footprint: FloatArray
    """Convex outline in base_link, (n, 2) [m]."""
    height: float
    """Height over all [m]."""
    base_height: float
    """Height of base_link above the floor [m]."""


def stance_of(
    folder: RobotFolder, assembly: Assembly, given_outline: FloatArray | None, given_height: float | None
) -> Stance:
    """Find how a robot stands by its collision shapes.

    Args:
        folder: The robot's folder, for messages.
        assembly: The robot.
        given_outline: Footprint of the robot's file, instead of that of the shapes.
        given_height: Height of the robot's file; shapes that begin above it do not count.

    Raises:
        BadRobot: If the footprint is empty or too large, base_link is not in it, or it leaves shapes out.
    """
    with as_bad_robot(folder.file):
        model = mujoco.MjModel.from_xml_string(assembly.xml, assembly.assets)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    shapes = {geom: surface_points(model, data, geom) for geom in collision_geoms(model)}
    bottom = min(float(points[:, 2].min()) for points in shapes.values())
    top = max(float(points[:, 2].max()) for points in shapes.values()) - bottom
    height = top if given_height is None else given_height
    within = {geom: points[:, :2] for geom, points in shapes.items() if points[:, 2].min() - bottom < height}
    outline = outline_of(np.concatenate(list(within.values()))) if given_outline is None else given_outline
    area = 0.5 * float((outline[:, 0] * np.roll(outline[:, 1], -1) - outline[:, 1] * np.roll(outline[:, 0], -1)).sum())
    if len(outline) < 3 or area < 1e-3:
        raise folder.wrong(
            "footprint",
            f"its area is {max(area, 0.0):.2g} m^2; collision shapes, or an outline, that cover more would be right",
        )
    radius = float(np.hypot(outline[:, 0], outline[:, 1]).max())
    if radius > _WIDEST:
        raise folder.wrong(
            "footprint", f"it reaches {radius:.3g} m from base_link; at most {_WIDEST:g} m would be right"
        )
    if overhang(outline, np.zeros((1, 2))) >= 0.0:
        raise folder.wrong(
            "footprint", "base_link is not inside of it; a base_link between the robot's shapes would be right"
        )
    for geom, points in within.items():
        out = overhang(outline, points)
        if out > _LEFT_OUT:
            name = model.geom(geom).name or model.body(model.geom_bodyid[geom]).name
            raise folder.wrong(
                "footprint",
                f"{name!r} sticks out of it by {out:.3g} m; an outline that holds all shapes would be right",
            )
    return Stance(outline, height, -bottom)


def settle(folder: RobotFolder, body: Body) -> float:
    """Let a robot down on a floor; returns the height of base_link above it at rest [m].

    Raises:
        BadRobot: If it falls through the floor, tips over, does not come to rest, or a wheel does not touch the floor.
    """
    model, data, bound = _on_floor(body)
    base = model.body(f"{body.spec.name}/").id
    joint = model.body_jntadr[base]
    start, first = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    touched: set[int] = set()
    for tick in range(round(_TIME * CONTROL)):
        bound.apply(STOP)
        mujoco.mj_step(model, data, nstep=PHYSICS // CONTROL)
        if not math.isfinite(float(data.qpos.sum() + data.qvel.sum())):
            raise folder.wrong(
                "model", "the physics diverges as it is put on a floor; masses and servos that fit would be right"
            )
        if tick >= (_TIME - 0.5) * CONTROL:
            touched |= _bodies_on_floor(model, data)
    geoms = collision_geoms(model, range(base, model.nbody))
    lowest = {geom: float(surface_points(model, data, geom, 1.0)[:, 2].min()) for geom in geoms}
    depth = -min(lowest.values())
    if depth > _SUNK:
        raise folder.wrong(
            "model",
            f"it falls through the floor: {depth:.3g} m deep after {_TIME:g} s; shapes that carry it would be right",
        )
    x, y = data.qpos[start + 4 : start + 6]
    lean = math.acos(min(max(1.0 - 2.0 * float(x * x + y * y), -1.0), 1.0))
    if lean > _LEAN:
        raise folder.wrong(
            "model",
            f"it leans by {math.degrees(lean):.0f} degrees on a level floor",
            "a mass between its wheels and casters",
        )
    speed = float(np.abs(data.qvel[first : first + 6]).max())
    if speed > _STILL:
        raise folder.wrong(
            "model",
            f"it does not come to rest on a level floor: it moves at {speed:.2g} m/s or rad/s after {_TIME:g} s",
        )
    assembly: Assembly = body.assembly  # type: ignore[attr-defined]
    for wheel in (*assembly.left, *assembly.right, *assembly.rolling):
        own = int(model.joint(f"{body.spec.name}/{wheel.joint}").bodyid[0])
        if own not in touched:
            gap = min(lowest[geom] for geom in collision_geoms(model, [own]))
            raise folder.wrong(
                "drive",
                f"the wheel of {wheel.joint!r} does not touch the floor as the robot stands: it is {gap:.3g} m above",
                "a wheel as low as the others",
            )
    return float(data.qpos[start + 2])


def try_out(folder: RobotFolder, body: Body) -> None:
    """Drive a robot over a floor for a moment, forwards, then turning.

    Raises:
        BadRobot: If it moves by much less than it is told to, or the other way.
    """
    spec = body.spec
    for axis, most, acceleration in ((0, spec.max_v_x, spec.max_a_x), (2, spec.max_w_z, spec.max_a_w)):
        speed = 0.5 * most
        model, data, bound = _on_floor(body)
        start = int(model.jnt_qposadr[model.body_jntadr[model.body(f"{spec.name}/").id]])
        command = VelocityCommand(*(speed if k == axis else 0.0 for k in range(3)))
        _, _, yaw = planar_pose(data.qpos[start : start + 7])
        turned = 0.0
        for _ in range(round(_DRIVE_TIME * CONTROL)):
            bound.apply(command)
            mujoco.mj_step(model, data, nstep=PHYSICS // CONTROL)
            before, yaw = yaw, planar_pose(data.qpos[start : start + 7])[2]
            turned += wrap_angle(yaw - before)
        moved = float(data.qpos[start]) if axis == 0 else turned
        expected = speed * (_DRIVE_TIME - 0.5 * speed / acceleration) if speed < acceleration * _DRIVE_TIME else 0.0
        if not moved >= (_LEAST_DRIVEN if axis == 0 else _LEAST_TURNED) * expected:
            what, unit = ("forwards", "m") if axis == 0 else ("to the left", "rad")
            raise folder.wrong(
                "drive",
                f"it does not move as it is told to: {expected:.2g} {unit} {what} became {moved:.2g} {unit}",
                "wheels that turn that way, casters that slide (drive.casters), and effort enough",
            )


def _on_floor(body: Body) -> tuple[mujoco.MjModel, mujoco.MjData, BoundBody]:
    """A robot put down on an endless floor."""
    world = World("floor", 0, (-10.0, -10.0, 10.0, 10.0), (), (), Pose2(0.0, 0.0, 0.0), (1.0, 0.0))
    model = build_model(world, body, PHYSICS)
    data = mujoco.MjData(model)
    bound = body.bind(model, data, 1.0 / CONTROL, NoiseConfig.none())
    bound.reset(Pose2(0.0, 0.0, 0.0), np.random.default_rng(0))
    return model, data, bound


def _bodies_on_floor(model: mujoco.MjModel, data: mujoco.MjData) -> set[int]:
    """Bodies that touch the floor."""
    floor = model.geom(FLOOR).id
    pairs = data.contact.geom
    others = [int(b if a == floor else a) for a, b in pairs.tolist() if floor in (a, b)]
    return {int(model.geom_bodyid[geom]) for geom in others}
