"""A quadruped's MJCF from its URDF and its constants."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

from dataclasses import replace
from typing import Any

import numpy as np

from robots.bodies.assets import asset
from robots.bodies.urdf import BadUrdf, Inertia, Urdf, read_urdf
from robots.locomotion.config import JOINTS_PER_LEG, LEGS, Ball, Drum, QuadrupedConfig
from robots.locomotion.kernels import Tuning, trot_angles
from robots.locomotion.legs import Legs, joint_of, legs_of
from vuca_nav.errors import BadArgument
from worlds.mjcf import TOUCHES_FLOOR, TOUCHES_SCENE, Element, RootElement

GRAVITY = 9.81
SERVO_KP, SERVO_KD, SERVO_SUPPLY = 4, 6, 7
"""Indices into ``actuator_gainprm``, as MuJoCo's DC motor has them."""
_SUPPLY = 1.0
"""Supply of the motors: any will do, as only torques and speeds matter [V]."""
_MAX_LATENCY_STEPS = 32
"""Greatest latency that the model can remember, in steps of the physics."""
_TRUNK_BIT, _LEG_BITS = 4, (8, 16, 32, 64)
"""``contype`` bits after those of worlds.mjcf. A leg collides with the trunk and with the other legs, not with itself:
neighbours overlap."""


def joint_names() -> list[str]:
    """Names of the model's joints, actuators and encoders, in the order of an action."""
    return [f"{leg}_{joint}" for leg in LEGS for joint in JOINTS_PER_LEG]


class QuadrupedModel:
    """Everything that is derived from the constants and the URDF, once.

    Raises:
        BadUrdf: If the URDF lacks a link or a joint, or contradicts the constants.
    """

    def __init__(self, config: QuadrupedConfig, urdf: Urdf | None = None):
        self.config = config
        self.urdf = urdf or read_urdf(asset(config.urdf))
        self.legs: Legs = legs_of(config, self.urdf)
        self.pieces = self._pieces()
        limits = [
            (joint_of(self.urdf, leg, name), torque, speed)
            for leg in config.leg_names
            for name, torque, speed in zip(config.joint_names, config.torque_limits, config.speed_limits)
        ]
        for joint, torque, speed in limits:
            for allowed, own, unit in ((joint.effort, torque, "N m"), (joint.velocity, speed, "rad/s")):
                if abs(allowed - own) > 1e-6:
                    raise BadUrdf(
                        f"robot {self.urdf.name!r}: joint {joint.name!r} allows {allowed} {unit}, "
                        f"but {config.spec.name}'s constants say {own}"
                    )
        self.lower = np.array([joint.lower for joint, _, _ in limits])
        self.upper = np.array([joint.upper for joint, _, _ in limits])
        # Torque falls with speed on a straight line that is cut off at the torque limit.
        self.stall_torque = np.array(config.torque_limits) / (1.0 - config.full_torque_speed)
        self.mass = sum(link.inertia.mass for link in self.urdf.links.values())

    def tuning(self, control_dt: float) -> Tuning:
        """The constants as the kernels take them.

        Raises:
            BadArgument: If the gait runs at another rate.
        """
        config, trot = self.config, self.config.trot
        if abs(control_dt * config.control_rate - 1.0) > 1e-9:
            raise BadArgument(
                f"{config.spec.name}'s gait runs at {config.control_rate} Hz, not at {1 / control_dt:g} Hz"
            )
        tuning = Tuning(
            dt=control_dt, frequency=trot.frequency, duty=trot.duty, swing_height=trot.swing_height,
            hip_height=trot.hip_height, stance_width=trot.stance_width, ramp_time=trot.ramp_time,
            deadband=trot.deadband, kp=config.kp, kd=config.kd, weight=GRAVITY * self.mass,
            max_torque=np.array(config.torque_limits), stall_torque=self.stall_torque,
            no_load_speed=np.array(config.speed_limits),
            slew=np.array([config.spec.max_a_x, config.spec.max_a_y, config.spec.max_a_w]),
            nominal=np.zeros(12), action_scale=np.tile(config.action_scale, 4),
            lower=self.lower, upper=self.upper, fall_height=config.fall_height, side_slip=config.side_slip,
            yaw_lever=config.yaw_lever,
        )  # fmt: skip
        trot_angles(self.legs, tuning, np.zeros(3), np.zeros(2), np.zeros(4), tuning.nominal)
        return tuning

    def mjcf(self, *, touch: bool = False, delayed: bool = True) -> RootElement:
        """Make a new model of the robot alone, without its free joint.

        Args:
            touch: Add sensors of the feet's contact forces, for training; the gait does not use them.
            delayed: Let targets reach the servos late by the config's latency; else at once.
        """
        config = self.config
        root = RootElement(model=config.spec.name)
        root.compiler.angle = "radian"
        root.option.integrator = "implicitfast"  # the servos' damping is stiff for a light shank
        trunk: Any = root.worldbody.add("body", name="base_link")
        trunk.add("inertial", **self.pieces["base_link"].mjcf())
        touches = {"contype": TOUCHES_SCENE | TOUCHES_FLOOR | _TRUNK_BIT, "conaffinity": 0, "group": 3}
        trunk.add("geom", name="trunk", type="box", pos=config.trunk_centre, size=config.trunk_box, **touches)
        for k, shape in enumerate(config.head):
            trunk.add("geom", name=f"head_{k}", **_geometry(shape), **touches)
        trunk.add("site", name="imu")
        root.sensor.add("gyro", name="gyro", site="imu")
        root.sensor.add("framequat", name="attitude", objtype="site", objname="imu")
        for i, leg in enumerate(LEGS):
            self._add_leg(root, trunk, i, leg, delayed)
        if touch:
            for leg in LEGS:
                root.sensor.add("touch", name=f"{leg}_touch", site=f"{leg}_foot")
        for name in joint_names():
            root.sensor.add("jointpos", name=f"{name}_angle", joint=name)
        for name in joint_names():
            root.sensor.add("jointvel", name=f"{name}_speed", joint=name)
        return root

    def _add_leg(self, root: RootElement, trunk: Element, i: int, leg: str, delayed: bool) -> None:
        config, legs = self.config, self.legs
        touches = {"contype": TOUCHES_SCENE | TOUCHES_FLOOR, "conaffinity": 0, "group": 3}
        touches_legs = touches | {
            "contype": TOUCHES_SCENE | TOUCHES_FLOOR | _LEG_BITS[i],
            "conaffinity": sum(_LEG_BITS[:i], _TRUNK_BIT),  # one of two geoms has to name the other
        }
        delay = {"delay": config.latency, "nsample": _MAX_LATENCY_STEPS} if delayed else {}
        side = (0.0, float(legs.offsets[i]), 0.0)
        places = (tuple(legs.hips[i]), side, (0.0, 0.0, -legs.thigh))
        axes = ((1, 0, 0), (0, 1, 0), (0, 1, 0))
        parent = trunk
        for k, joint in enumerate(JOINTS_PER_LEG):
            name = f"{leg}_{joint}"
            body: Any = parent.add("body", name=name, pos=places[k])
            body.add("inertial", **self.pieces[name].mjcf())
            index = 3 * i + k
            body.add(
                "joint", name=name, type="hinge", axis=axes[k], limited="true",
                range=(self.lower[index], self.upper[index]), armature=config.armature[k],
                damping=config.joint_damping, frictionloss=config.joint_friction,
            )  # fmt: skip
            torque = config.torque_limits[k]
            # A position servo whose voltage is limited, so that its torque falls with speed.
            constant = _SUPPLY / config.speed_limits[k]
            resistance = constant * _SUPPLY / self.stall_torque[k]
            root.actuator.add(
                "general", name=name, joint=name, input="pos", dyntype="dcmotor", dynprm=(0,), actearly="true",
                gaintype="dcmotor", gainprm=(resistance, constant, 0, 0, config.kp, 0, config.kd, _SUPPLY),
                biastype="dcmotor", forcelimited="true", forcerange=(-torque, torque), **delay,
            )  # fmt: skip
            parent = body
            if k == 0:
                hip = config.hip
                centre = hip.centre if side[1] > 0.0 else (hip.centre[0], -hip.centre[1], hip.centre[2])
                body.add("geom", name=f"{name}_drum", **_geometry(replace(hip, centre=centre)), **touches)
            if k > 0:
                radius = config.limb_radii[k - 1]
                end = -(legs.thigh if k == 1 else legs.shank - config.foot_radius)
                body.add(
                    "geom", name=f"{name}_limb", type="capsule", fromto=(0, 0, 0, 0, 0, end), size=(radius,),
                    **touches_legs,
                )  # fmt: skip
        parent.add(
            "geom", name=f"{leg}_foot", type="sphere", pos=(0.0, 0.0, -legs.shank), size=(config.foot_radius,),
            condim=6, friction=config.foot_friction, priority=1, **touches_legs,
        )  # fmt: skip
        parent.add("site", name=f"{leg}_foot", pos=(0.0, 0.0, -legs.shank), size=(config.foot_radius + 0.005,))

    def _pieces(self) -> dict[str, Inertia]:
        """Inertia of each moving body, with all that is fixed to it, in its own frame."""
        return {
            name: self.urdf.fuse(link, fused, {}) for name, (link, fused) in self.bodies().items()
        }  # fmt: skip

    def bodies(self) -> dict[str, tuple[str, list[str]]]:
        """Link of the URDF that each body of the MJCF is, and the links fused into it."""
        moving = {self.config.base: "base_link"}
        for leg, own in zip(LEGS, self.config.leg_names):
            for joint, name in zip(JOINTS_PER_LEG, self.config.joint_names):
                moving[joint_of(self.urdf, own, name).child] = f"{leg}_{joint}"
        parent_of = {joint.child: joint.parent for joint in self.urdf.joints.values()}
        fused: dict[str, list[str]] = {link: [] for link in moving}
        for link in self.urdf.links:
            owner = link
            while owner not in moving:
                if owner not in parent_of:
                    break
                owner = parent_of[owner]
            if owner in moving:
                fused[owner].append(link)
        return {body: (link, fused[link]) for link, body in moving.items()}


def _geometry(shape: Ball | Drum) -> dict:
    if isinstance(shape, Ball):
        return {"type": "sphere", "pos": shape.centre, "size": (shape.radius,)}
    along = shape.half_length * np.array(shape.axis)
    ends = (*(shape.centre - along), *(shape.centre + along))
    return {"type": "cylinder", "fromto": ends, "size": (shape.radius,)}
