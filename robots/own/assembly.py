"""A description made into a body: contact masks, wheels, servos and sensors."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

from collections.abc import Sequence
from difflib import get_close_matches
from typing import NamedTuple

import mujoco
import numpy as np
import trimesh

from robots.bodies.body import VisualPart
from robots.own.compiling import as_bad_robot
from robots.own.description import Description
from robots.own.folder import RobotFolder
from robots.own.geometry import collision_geoms, surface_points
from robots.own.robot_file import DriveFile
from vuca_nav.data_files import shown
from vuca_nav.telemetry.interface import MeshPart
from worlds.mjcf import TOUCHES_FLOOR, TOUCHES_SCENE

GYRO, SITE = "vuca-gyro", "vuca-imu"
"""Names of the sensor of the turn rate, and of its place in base_link."""
PLANAR = ("vuca-forward", "vuca-left", "vuca-turn")
"""Names of an omnidirectional base's servos."""
PHYSICS = 300
"""Rate of the physics that the servos' gains are made for, as in robots.simulation [Hz]."""
_GAIN_SHARE = 0.75
"""Share of the gain from which on an explicit servo of a wheel in the air is unstable: that is twice its inertia a
step."""
_PLANAR_TIME = 0.05
"""Time constant with which an omnidirectional base's servos follow [s]. Assumed."""
_LIGHTEST, _HEAVIEST = 0.5, 2000.0
"""Masses between which a robot that drives indoors lies [kg]."""
_WIDEST_GYRATION = 3.0
"""Greatest radius of gyration of a part [m]."""
_DEFAULT_FLOOR = 1
"""``contype`` and ``conaffinity`` of a geom that states none, as of the floor of most scenes."""


class Wheel(NamedTuple):
    """A wheel of the assembled robot."""

    joint: str
    servo: str
    """Name of its actuator; empty for a wheel that only rolls."""
    sign: float
    """Sign that makes its angle grow as the robot goes forward."""
    gain: float
    """Gain of its servo [N m s/rad]."""


class Assembly(NamedTuple):
    """A robot's MJCF, and what in it is what."""

    xml: str
    assets: dict[str, bytes]
    base: str
    """Name of base_link."""
    left: tuple[Wheel, ...]
    right: tuple[Wheel, ...]
    rolling: tuple[Wheel, ...]
    """Wheels of an omnidirectional base."""
    radius: float
    """Radius of the wheels, 0 if there are none [m]."""
    track: float
    """Distance of left and right wheels, 0 if there are none [m]."""
    mass: float
    """[kg]"""
    yaw_inertia: float
    """Inertia of the whole robot about base_link's z axis [kg m^2]."""
    visuals: tuple[VisualPart, ...]


def assemble(folder: RobotFolder, description: Description, drive: DriveFile) -> Assembly:
    """Give a description the contact masks of this project's scenes, the servos of its drive, and its sensors.

    Args:
        folder: The robot's folder, for messages.
        description: The robot's canonical MJCF.
        drive: What moves it.

    Raises:
        BadRobot: If a geom misses the floor by its masks, a mass is absurd, or a wheel is not there or not a wheel.
    """
    with as_bad_robot(folder.file):
        spec = mujoco.MjSpec.from_string(description.xml, assets=description.assets)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
    _check_masses(folder, model)
    _check_masks(folder, model)
    wheels = {name: _wheel_of(folder, model, data, drive, name) for name in drive.joints}
    casters = _casters(folder, model, drive)
    visuals = _visuals(model)
    base = model.body(description.base)

    names = [model.body(k).name for k in range(1, model.nbody)]
    for name in names:  # what stays is seen no more: its mass does not depend on it
        own, compiled = spec.body(name), model.body(name)
        own.mass, own.ipos, own.iquat = float(compiled.mass[0]), compiled.ipos, compiled.iquat
        own.inertia, own.explicitinertial = compiled.inertia, True
    rolling_bodies = {spec.joint(name).parent.name for name in drive.wheels}
    driven_bodies = {spec.joint(name).parent.name for name in (*drive.left, *drive.right)}
    for geom, index in [(geom, geom.id) for geom in spec.geoms]:  # deletions change the indices
        if not (geom.contype or geom.conaffinity):
            spec.delete(geom)
            continue
        geom.contype, geom.conaffinity = TOUCHES_FLOOR | TOUCHES_SCENE, 0
        if index in casters or geom.parent.name in rolling_bodies:
            geom.condim, geom.priority = 1, 1  # casters and rollers give way in every direction
        elif geom.parent.name in driven_bodies:
            geom.priority = max(int(geom.priority), 1)  # its tyre's friction counts, not the floor's
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
    if drive.kind != "own":
        for actuator in [each for each in spec.actuators if each.target in wheels]:
            spec.delete(actuator)
    _add_sensors_and_servos(spec, model, description.base, drive, wheels)
    with as_bad_robot(folder.file):
        spec.compile()
        xml = spec.to_xml()
    kept = {mesh.file for mesh in spec.meshes}
    sides = tuple(tuple(wheels[name] for name in names) for names in (drive.left, drive.right, drive.wheels))
    return Assembly(
        xml=xml,
        assets={name: content for name, content in description.assets.items() if name in kept},
        base=description.base,
        left=sides[0], right=sides[1], rolling=sides[2],
        radius=_radius(folder, model, data, drive),
        track=_track(folder, model, data, drive),
        mass=float(base.subtreemass[0]),
        yaw_inertia=_yaw_inertia(model, data, base.id),
        visuals=visuals,
    )  # fmt: skip


def _check_masses(folder: RobotFolder, model: mujoco.MjModel) -> None:
    total = float(model.body_mass[1:].sum())
    if not _LIGHTEST <= total <= _HEAVIEST:
        raise folder.wrong("model", f"the robot's mass is {total:g} kg", f"one from {_LIGHTEST:g} to {_HEAVIEST:g} kg")
    for body in range(1, model.nbody):
        mass, inertia = float(model.body_mass[body]), float(model.body_inertia[body].max())
        if mass > 0.0 and inertia > mass * _WIDEST_GYRATION**2:
            raise folder.wrong(
                "model",
                f"the body {model.body(body).name!r} of {mass:g} kg has an inertia of {inertia:g} kg m^2, as if it "
                f"reached more than {_WIDEST_GYRATION:g} m far",
                "one that fits its size",
            )


def _check_masks(folder: RobotFolder, model: mujoco.MjModel) -> None:
    """Refuse geoms that would fall through an ordinary floor, and pass through its walls, by their contact masks."""
    touching = collision_geoms(model)
    if not touching:
        raise folder.wrong("model", "no geom of it can touch anything", "geoms of contype 1")
    for geom in touching:
        contype, conaffinity = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
        if not (contype | conaffinity) & _DEFAULT_FLOOR:
            raise folder.wrong(
                "model",
                f"{_told(model, geom)} has the contact masks {contype} and {conaffinity}, which miss a floor's (1 and "
                "1): it would fall through",
                "contype 1, or 0 and 0 for a geom that is only seen,",
            )


def _told(model: mujoco.MjModel, geom: int) -> str:
    name = model.geom(geom).name
    return f"the geom {shown(name)!r}" if name else f"a geom of the body {model.body(model.geom_bodyid[geom]).name!r}"


def _wheel_of(folder: RobotFolder, model: mujoco.MjModel, data: mujoco.MjData, drive: DriveFile, name: str) -> Wheel:
    """Find a wheel by its joint."""
    where = f"drive.{'left' if name in drive.left else 'right' if name in drive.right else 'wheels'}"
    there = [model.joint(k).name for k in range(model.njnt)]
    if name not in there:
        close = get_close_matches(name, there, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        raise folder.wrong(
            where,
            f"the model has no joint {shown(name)!r}{hint} (its joints: {', '.join(filter(None, there)) or 'none'})",
        )
    joint = model.joint(name)
    if joint.type[0] != mujoco.mjtJoint.mjJNT_HINGE or joint.limited[0]:
        kind = "has a limited range" if joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE else "is no hinge"
        raise folder.wrong(where, f"the joint {name!r} {kind}", "a hinge that turns on and on")
    body = int(joint.bodyid[0])
    if not collision_geoms(model, [body]):
        raise folder.wrong(
            where, f"the wheel of {name!r}, the body {model.body(body).name!r}, has no geom that can touch the floor"
        )
    axis = data.xaxis[joint.id]
    if name in drive.wheels:
        return Wheel(name, "", 1.0, 0.0)
    if abs(axis[1]) < 0.98:
        raise folder.wrong(
            where,
            f"the joint {name!r} turns about {np.round(axis, 3).tolist()} in base_link",
            "an axis along y, across the direction of travel,",
        )
    gain = _GAIN_SHARE * 2.0 * float(model.dof_M0[joint.dofadr[0]]) * PHYSICS
    return Wheel(name, f"vuca-{name}", 1.0 if axis[1] > 0.0 else -1.0, float(f"{gain:.6g}"))


def _casters(folder: RobotFolder, model: mujoco.MjModel, drive: DriveFile) -> set[int]:
    """Indices of the geoms that slide without friction."""
    found: set[int] = set()
    for name in drive.casters:
        own = [geom for geom in range(model.ngeom) if model.geom(geom).name == name]
        bodies = [body for body in range(1, model.nbody) if model.body(body).name == name]
        geoms = own or collision_geoms(model, bodies)
        if not geoms:
            raise folder.wrong(
                "drive.casters", f"the model has no geom and no body with geoms {shown(name)!r}", "a name of one of its"
            )
        found |= set(geoms)
    return found


def _radius(folder: RobotFolder, model: mujoco.MjModel, data: mujoco.MjData, drive: DriveFile) -> float:
    """Radius of the wheels: half the height of their collision shapes."""
    if not drive.joints:
        return 0.0
    radii = {}
    for name in drive.joints:
        geoms = collision_geoms(model, [int(model.joint(name).bodyid[0])])
        heights = np.concatenate([surface_points(model, data, geom, 1.0)[:, 2] for geom in geoms])
        radii[name] = 0.5 * float(heights.max() - heights.min())
    least, greatest = min(radii, key=radii.__getitem__), max(radii, key=radii.__getitem__)
    if radii[greatest] > 1.02 * radii[least] and drive.wheel_radius is None:
        raise folder.wrong(
            "drive",
            f"its wheels differ: {least!r} has a radius of {radii[least]:.4g} m, {greatest!r} of "
            f"{radii[greatest]:.4g} m",
            "wheels of one size, or a wheel_radius,",
        )
    return drive.wheel_radius or sum(radii.values()) / len(radii)


def _track(folder: RobotFolder, model: mujoco.MjModel, data: mujoco.MjData, drive: DriveFile) -> float:
    """Distance of left and right wheels: of their joints, along y."""
    if not drive.left:
        return 0.0
    left, right = (
        float(np.mean([data.xanchor[model.joint(name).id][1] for name in names])) for names in (drive.left, drive.right)
    )
    if not left > right:
        raise folder.wrong(
            "drive",
            f"its left wheels are at y = {left:.3g} m, its right ones at {right:.3g} m",
            "left ones where y is greater",
        )
    return drive.track or left - right


def _yaw_inertia(model: mujoco.MjModel, data: mujoco.MjData, base: int) -> float:
    """Inertia of the whole robot about base_link's z axis."""
    total = 0.0
    origin = data.xpos[base]
    for body in range(1, model.nbody):
        rotation = data.ximat[body].reshape(3, 3)
        x, y, _ = data.xipos[body] - origin
        about_own = float((rotation[2] ** 2 * model.body_inertia[body]).sum())
        total += about_own + float(model.body_mass[body]) * float(x * x + y * y)
    return total


def _add_sensors_and_servos(
    spec: mujoco.MjSpec, model: mujoco.MjModel, base: str, drive: DriveFile, wheels: dict[str, Wheel]
) -> None:
    site = spec.body(base).add_site(name=SITE)
    gyro = spec.add_sensor(name=GYRO, type=mujoco.mjtSensor.mjSENS_GYRO)
    gyro.objtype, gyro.objname = mujoco.mjtObj.mjOBJ_SITE, site.name
    for wheel in wheels.values():
        if wheel.servo and drive.kind != "own":
            servo = spec.add_actuator(name=wheel.servo, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=wheel.joint)
            servo.set_to_velocity(kv=wheel.gain)
            _limit(servo, drive.max_effort)
    if drive.kind == "omnidirectional":
        mass, turning = float(model.body_mass[1:].sum()), _planar_turning(model, base)
        for name, gear, inertia in zip(PLANAR, ((1, 0), (0, 1), None), (mass, mass, turning)):
            servo = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_SITE, target=site.name)
            servo.set_to_velocity(kv=inertia / _PLANAR_TIME)
            servo.gear = (*gear, 0, 0, 0, 0) if gear else (0, 0, 0, 0, 0, 1)
            if gear:
                _limit(servo, drive.max_effort)


def _planar_turning(model: mujoco.MjModel, base: str) -> float:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return _yaw_inertia(model, data, model.body(base).id)


def _limit(servo: mujoco.MjsActuator, most: float | None) -> None:
    if most is not None:
        servo.forcelimited, servo.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, (-most, most)


def _visuals(model: mujoco.MjModel) -> tuple[VisualPart, ...]:
    """The robot's shapes for telemetry: of each body those that are only seen, or else those that touch."""
    data = mujoco.MjData(model)
    parts = []
    for body in range(1, model.nbody):
        geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
        seen = [geom for geom in geoms if not (model.geom_contype[geom] or model.geom_conaffinity[geom])] or list(geoms)
        by_colour: dict[tuple[int, int, int], list[tuple[np.ndarray, np.ndarray]]] = {}
        for geom in seen:
            material = int(model.geom_matid[geom])
            rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
            red, green, blue = (round(255 * float(share)) for share in rgba[:3])
            by_colour.setdefault((red, green, blue), []).append(_mesh_of(model, geom))
        for colour, meshes in by_colour.items():
            offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
            vertices = np.concatenate([vertices for vertices, _ in meshes]).astype(np.float32)
            faces = np.concatenate([faces + k for (_, faces), k in zip(meshes, offsets)]).astype(np.uint32)
            name = model.body(body).name
            parts.append(VisualPart(name, MeshPart(f"{name}_{len(parts)}", vertices, faces, colour)))
    del data
    return tuple(parts)


def _mesh_of(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in the geom's body and faces (m, 3) of a geom."""
    kind, size = model.geom_type[geom], model.geom_size[geom].tolist()
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]].astype(float)
        faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
    else:
        shape = _primitive(kind, size)
        vertices, faces = np.asarray(shape.vertices, float), np.asarray(shape.faces)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    turned = (vertices[:, None, :] * rotation.reshape(1, 3, 3)).sum(axis=2)
    return turned + model.geom_pos[geom], faces


def _primitive(kind: int, size: Sequence[float]) -> trimesh.Trimesh:
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box([2.0 * half for half in size])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(size[0], 2.0 * size[1], sections=32)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        capsule = trimesh.creation.capsule(2.0 * size[1], size[0], count=[16, 16])
        return capsule.apply_translation((0.0, 0.0, -capsule.bounds.mean(axis=0)[2]))
    ball = trimesh.creation.icosphere(2)
    return ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else [size[0]] * 3)
