"""PAL Robotics' TIAGo: a PMB2 differential base with a lifting torso, an arm without a hand, and a head.

Numbers come from example-robot-data's ``tiago_no_hand.urdf`` ("the URDF") unless a line says otherwise, or from
PAL's own configuration (github.com/pal-robotics/pmb2_robot and tiago_robot, Apache-2.0).
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math
from functools import cache

import mujoco
import numpy as np

from robots.bodies.assets import asset
from robots.bodies.body import Body, BoundBody, VisualPart
from robots.bodies.meshes import merged_parts
from robots.bodies.urdf import Inertia, Urdf, read_urdf
from robots.noise import NoiseConfig
from robots.sensors import WheelOdometer
from vuca_nav.types import BodySpec, LidarSpec, Odometry, Pose2, VelocityCommand
from worlds.mjcf import TOUCHES_FLOOR, TOUCHES_SCENE, RootElement

URDF_FILE = "tiago_description/robots/tiago_no_hand.urdf"
"""Description without the Hey5 hand: tucked, the hand reaches 0.10 m beyond the base, the bare wrist does not."""

TUCK = {
    "torso_lift_joint": 0.15,
    "arm_1_joint": 0.20,
    "arm_2_joint": -1.34,
    "arm_3_joint": -0.20,
    "arm_4_joint": 1.94,
    "arm_5_joint": -1.57,
    "arm_6_joint": 1.37,
    "arm_7_joint": 0.0,
}
"""Joint positions of the tucked arm: PAL's "home" motion, last point
(tiago_bringup/config/motions/pmb2/tiago_motions_pal-hey5.yaml) [m, rad]."""

WHEEL_RADIUS = 0.0985
"""Radius of the drive wheels, from the collision cylinder of wheel_*_link [m]."""
WHEEL_SEPARATION = 0.4044
"""Distance of the drive wheels, twice the y of wheel_*_joint [m]."""
WHEEL_MAX_TORQUE = 6.0
"""Effort limit of wheel_*_joint [N m]."""
WHEEL_MAX_SPEED = 10.152284264
"""Velocity limit of wheel_*_joint: 1.0 m/s [rad/s]."""
WHEEL_GAIN = 4.0
"""Gain of the velocity servo [N m s/rad]. A wheel spinning free of the floor has 0.0084 kg m^2: at 300 Hz the servo is
stable below 5.0. It only corrects; the torque for a wanted acceleration is fed forward."""
WHEEL_FRICTION = 1.0
"""Friction coefficient of rubber on concrete."""
CASTERS = ((0.1535, 0.102), (0.1535, -0.102), (-0.1895, 0.102), (-0.1895, -0.102))
"""Contact points of the caster wheels, x and y in base_link [m]: caster_*_1_joint plus caster_*_2_joint."""
CASTER_RADIUS = 0.025
"""Radius of the casters, from the collision sphere of caster_*_2_link [m]."""
CASTER_LIFT = 0.00015
"""Height of the casters above the URDF's [m], so that, as with the real base's sprung wheels, the drive wheels carry
about half of the weight (a sixth each otherwise) and never slip."""

MAX_V_X = 1.0
"""Greatest forward velocity: linear.x.max_velocity of PAL's controller (pmb2_controller_configuration,
mobile_base_controller.yaml) [m/s]."""
MIN_V_X = -0.2
"""Greatest backward velocity: linear.x.min_velocity, same file [m/s]."""
REAR_MIN_V_X = -0.6
"""Greatest backward velocity of ``tiago-rear``, chosen [m/s]. PAL's limit is that of a base that sees nothing behind;
this one has a merged scan all round. The drive's own limit is 1.0 m/s either way."""
MAX_A_X = 1.0
"""Greatest acceleration: linear.x.max_acceleration, same file [m/s^2]."""
MAX_W_Z = 1.0
"""Greatest turn rate, chosen [rad/s]. PAL allows 120 deg/s; at half of that the laser sweeps 2 degrees between scans,
not 4."""
MAX_A_W = math.radians(120.0)
"""Greatest angular acceleration: angular.z.max_acceleration, same file [rad/s^2]."""

FOOTPRINT = np.array(
    [
        (0.265, 0.051), (0.251, 0.104), (0.215, 0.165), (0.165, 0.215), (0.104, 0.251), (0.035, 0.269),
        (-0.035, 0.269), (-0.104, 0.251), (-0.165, 0.215), (-0.221, 0.160), (-0.249, 0.111), (-0.269, 0.035),
        (-0.269, -0.035), (-0.249, -0.111), (-0.221, -0.160), (-0.165, -0.215), (-0.104, -0.251), (-0.035, -0.269),
        (0.035, -0.269), (0.131, -0.243), (0.196, -0.206), (0.199, -0.203), (0.246, -0.122), (0.265, -0.051),
    ]
)  # fmt: skip
"""Footprint, a 24-gon around the convex hull of all visual meshes, tucked, at any height [m]: the base's disc of 0.269
m, but for the upper arm on the right (0.284 m) and the shoulders (0.272 m)."""
HEIGHT = 1.262
"""Height of the top of the head, tucked [m]."""

LIDAR = LidarSpec(height=0.0945)
"""Lidar: PMB2's laser stands at z = -0.004 m in base_link (pmb2_description/urdf/base/base_sensors.urdf.xacro). It sees
220 degrees; the model is the merged scan of a front and a rear one, given from the base's axis, in which the base
itself is not seen."""

FRONT_LIDAR = LidarSpec(
    num_beams=811,
    min_range=0.05,
    max_range=25.0,
    rate=15.0,
    height=0.0945,
    angle_min=math.radians(-135.0),
    angle_increment=math.radians(270.0) / 810,
    mount=Pose2(0.202, 0.0, 0.0),
)
"""The front laser alone, a SICK TiM571 (data sheet: 270 degrees in steps of 1/3, 15 Hz, 0.05 to 25 m) where PMB2 has it
(base_sensors.urdf.xacro); to drive with it, give it to a body: ``body.lidar = FRONT_LIDAR``."""

SETTLE_TIME = 0.5
"""Time to sink into the contacts, by micrometres, and to come to rest [s]."""

_HULL = {
    "base": ("cylinder", (0.0, 0.0, 0.1595), (0.269, 0.1365)),
    "column": ("box", (0.022, 0.0, 0.4335), (0.198, 0.125, 0.1375)),
    "torso": ("box", (-0.0235, 0.0, 0.806), (0.1985, 0.155, 0.235)),
    "arm": ("box", (0.1435, -0.0125, 0.639), (0.0565, 0.1905, 0.151)),
    "head": ("box", (0.1395, 0.0, 1.1525), (0.0935, 0.130, 0.1095)),
}
"""Collision shapes: type, centre in base_footprint (on the floor) and MuJoCo size [m]. Boxes and a cylinder around the
links' visual meshes, kept within the footprint; the last 2 cm of the wrist, above the base, stick out of the arm's."""
_FALLEN = math.cos(math.radians(30.0))
"""Vertical part of the upward axis below which the robot cannot recover: with its mass centre 0.39 m high, it tips over
forwards from 20 degrees, backwards from 28."""


@cache
def _urdf() -> Urdf:
    return read_urdf(asset(URDF_FILE))


@cache
def _visuals() -> tuple[VisualPart, ...]:
    urdf = _urdf()
    wheels = {f"{wheel}_link" for wheel in _wheels()}
    body_of_link = {link: link if link in wheels else "base_link" for link in urdf.links}
    return tuple(VisualPart(body, mesh) for body, mesh in merged_parts(urdf, body_of_link, TUCK))


def _wheels() -> tuple[str, str]:
    return "wheel_left", "wheel_right"


def fused_base() -> Inertia:
    """Inertia of everything but the drive wheels as one rigid body in base_link, tucked."""
    urdf = _urdf()
    wheels = {f"{wheel}_link" for wheel in _wheels()}
    return urdf.fuse("base_link", [link for link in urdf.links if link not in wheels], TUCK)


class Tiago(Body):
    """TIAGo with its upper body tucked and fused into the base.

    The drive wheels roll on the floor by friction and carry velocity servos with the URDF's torque limit. The four
    casters are fixed in the URDF; here they are frictionless spheres, which is what a swivelling caster is to the
    base but for the small push it gives when it swings round. Wheels touch the floor as spheres of the wheel's
    radius: a tyre's one contact point, at the wheel's centre plane.

    Args:
        name: Name of the body.
        min_v_x: Greatest backward velocity, negative [m/s].
    """

    def __init__(self, name: str = "tiago", min_v_x: float = MIN_V_X):
        self.spec = BodySpec(
            name=name,
            footprint=FOOTPRINT,
            max_v_x=MAX_V_X,
            min_v_x=min_v_x,
            max_v_y=0.0,
            max_w_z=MAX_W_Z,
            max_a_x=MAX_A_X,
            max_a_y=0.0,
            max_a_w=MAX_A_W,
        )
        self.lidar = LIDAR
        self.height = HEIGHT
        self.base_height = WHEEL_RADIUS
        self.settle_time = SETTLE_TIME

    def mjcf(self) -> RootElement:
        """Implements :class:`~robots.bodies.body.Body`."""
        root = RootElement(model=self.spec.name)
        root.compiler.angle = "radian"
        # Explicit on purpose: implicit integrators damp the servos after the contact forces have been solved for,
        # which here makes the base roll 5% farther than its wheels while it speeds up.
        root.option.integrator = "Euler"
        base = root.worldbody.add("body", name="base_link")
        base.add("inertial", **fused_base().mjcf())
        for name, (kind, (x, y, z), size) in _HULL.items():
            base.add(
                "geom", name=name, type=kind, pos=(x, y, z - WHEEL_RADIUS), size=size,
                contype=TOUCHES_SCENE | TOUCHES_FLOOR, conaffinity=0, group=3,
            )  # fmt: skip
        for i, (x, y) in enumerate(CASTERS):
            base.add(
                "geom", name=f"caster_{i}", type="sphere", pos=(x, y, CASTER_RADIUS + CASTER_LIFT - WHEEL_RADIUS),
                size=(CASTER_RADIUS,), contype=TOUCHES_FLOOR, conaffinity=0, condim=1, priority=1, group=3,
            )  # fmt: skip
        base.add("site", name="imu")
        root.sensor.add("gyro", name="gyro", site="imu")
        for wheel, y in zip(_wheels(), (WHEEL_SEPARATION / 2.0, -WHEEL_SEPARATION / 2.0)):
            body = base.add("body", name=f"{wheel}_link", pos=(0.0, y, 0.0), euler=(-math.pi / 2.0, 0.0, 0.0))
            body.add("inertial", **_urdf().links[f"{wheel}_link"].inertia.mjcf())
            joint = body.add("joint", name=f"{wheel}_joint", type="hinge", axis=(0.0, 0.0, 1.0))
            body.add(
                "geom", name=wheel, type="sphere", size=(WHEEL_RADIUS,), contype=TOUCHES_FLOOR, conaffinity=0,
                condim=3, friction=(WHEEL_FRICTION, 0.005, 0.0001), priority=1, group=3,
            )  # fmt: skip
            root.actuator.add(
                "velocity", name=wheel, joint=joint, kv=WHEEL_GAIN, forcelimited="true",
                forcerange=(-WHEEL_MAX_TORQUE, WHEEL_MAX_TORQUE),
            )  # fmt: skip
            root.sensor.add("jointpos", name=f"{wheel}_encoder", joint=joint)
        return root

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig) -> "BoundTiago":
        """Implements :class:`~robots.bodies.body.Body`."""
        return BoundTiago(self.spec, model, data, control_dt, noise)

    def visuals(self) -> tuple[VisualPart, ...]:
        """Implements :class:`~robots.bodies.body.Body`."""
        return _visuals()


class TiagoRear(Tiago):
    """PAL Robotics' TIAGo that backs out faster, at 0.6 m/s: it sees all round."""

    def __init__(self):
        super().__init__("tiago-rear", REAR_MIN_V_X)


class BoundTiago(BoundBody):
    """TIAGo in one compiled model."""

    def __init__(
        self, spec: BodySpec, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig
    ) -> None:
        self._dt, self._noise, self._min_v_x = control_dt, noise, spec.min_v_x
        name = spec.name
        base = model.body(f"{name}/").id
        start = model.jnt_qposadr[model.body_jntadr[base]]
        self._qpos = data.qpos[start : start + 7]
        self._qvel = data.qvel
        left, right = (model.actuator(f"{name}/{wheel}").id for wheel in _wheels())
        self._ctrl, self._left, self._right = data.ctrl, left, right
        self._sensors = data.sensordata
        self._gyro_z = model.sensor(f"{name}/gyro").adr[0] + 2
        self._encoders = [int(model.sensor(f"{name}/{wheel}_encoder").adr[0]) for wheel in _wheels()]
        self._all_qpos = data.qpos
        self._v_x = self._w_z = 0.0
        # Torque a wheel needs for an acceleration of the base, forwards [m/s^2] and about its axis [rad/s^2].
        mass, inertia = model.body_subtreemass[base], _yaw_inertia()
        spin = 2.0 * _urdf().links["wheel_left_link"].inertia.tensor[2, 2] / WHEEL_RADIUS**2
        self._torque_per_a = 0.5 * float(mass + spin) * WHEEL_RADIUS
        arm = WHEEL_SEPARATION / 2.0
        self._torque_per_alpha = 0.5 * (inertia + spin * arm**2) * WHEEL_RADIUS / arm
        self._odometer = WheelOdometer(noise, np.random.default_rng(0), WHEEL_RADIUS, control_dt)

    def reset(self, pose: Pose2, rng: np.random.Generator) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        self._all_qpos[:] = 0.0
        self._qvel[:] = 0.0
        self._ctrl[:] = 0.0
        self._qpos[:] = (
            pose.x, pose.y, WHEEL_RADIUS, math.cos(pose.yaw / 2.0), 0.0, 0.0, math.sin(pose.yaw / 2.0)
        )  # fmt: skip
        self._v_x = self._w_z = 0.0
        self._odometer = WheelOdometer(self._noise, rng, WHEEL_RADIUS, self._dt)

    def start_odometry(self) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        left, right = self._encoders
        self._odometer.start(float(self._sensors[left]), float(self._sensors[right]))

    def apply(self, command: VelocityCommand) -> None:
        """Limit speed, then acceleration, as ROS's diff_drive_controller does, and set the wheels' servos.

        Where a wheel would have to turn faster than it can, both speeds shrink alike: the arc stays the same
        (``preserve_turning_radius: true`` in PAL's configuration).
        """
        v_x = min(max(command.v_x, self._min_v_x), MAX_V_X)
        w_z = min(max(command.w_z, -MAX_W_Z), MAX_W_Z)
        fastest = (abs(v_x) + abs(w_z) * WHEEL_SEPARATION / 2.0) / WHEEL_RADIUS
        if fastest > WHEEL_MAX_SPEED:
            v_x *= WHEEL_MAX_SPEED / fastest
            w_z *= WHEEL_MAX_SPEED / fastest
        step_v, step_w = MAX_A_X * self._dt, MAX_A_W * self._dt
        change_v = min(max(v_x - self._v_x, -step_v), step_v)
        change_w = min(max(w_z - self._w_z, -step_w), step_w)
        # The servo holds one speed for the whole control step: aim at its middle, feed the acceleration forward.
        v_middle, w_middle = self._v_x + 0.5 * change_v, self._w_z + 0.5 * change_w
        self._v_x += change_v
        self._w_z += change_w
        straight = v_middle / WHEEL_RADIUS + self._torque_per_a * change_v / (self._dt * WHEEL_GAIN)
        turn = (
            w_middle * WHEEL_SEPARATION / (2.0 * WHEEL_RADIUS)
            + self._torque_per_alpha * change_w / (self._dt * WHEEL_GAIN)
        )  # fmt: skip
        self._ctrl[self._left] = straight - turn
        self._ctrl[self._right] = straight + turn

    def update_odometry(self) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        sensors, (left, right) = self._sensors, self._encoders
        self._odometer.update(float(sensors[left]), float(sensors[right]), float(sensors[self._gyro_z]))

    def odometry(self, stamp: float) -> Odometry:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        return self._odometer.odometry(stamp)

    def has_fallen(self) -> bool:
        """Whether the robot leans by more than 30 degrees."""
        x, y = self._qpos[4], self._qpos[5]
        return 1.0 - 2.0 * (x * x + y * y) < _FALLEN


def _yaw_inertia() -> float:
    """Inertia of the whole robot about the vertical between its wheels [kg m^2]."""
    urdf = _urdf()
    whole = urdf.fuse("base_link", urdf.links, TUCK)
    x, y, _ = whole.centre
    return float(whole.tensor[2, 2] + whole.mass * (x * x + y * y))
