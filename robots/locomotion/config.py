"""The constants of a quadruped: each robot's file defines one :class:`QuadrupedConfig`."""

from dataclasses import dataclass

from vuca_nav.types import BodySpec, LidarSpec

LEGS = ("FL", "FR", "RL", "RR")
"""Names of the legs, front left, front right, rear left, rear right: the order of all arrays over legs."""
JOINTS_PER_LEG = ("hip", "thigh", "calf")
"""Names of a leg's joints, abduction, hip flexion and knee: the order of all arrays over a leg's joints."""
NUM_JOINTS = 12


@dataclass(frozen=True, slots=True)
class Trot:
    """The nominal gait, which the learned policy corrects."""

    frequency: float = 2.0
    """Strides a second [Hz]."""
    duty: float = 0.55
    """Share of a stride for which a foot is on the ground."""
    swing_height: float = 0.09
    """Height of the foot over the ground in mid-swing [m]."""
    hip_height: float = 0.30
    """Height of the hips over the ground [m]."""
    stance_width: float = 0.0
    """Sideways offset of the feet from below their hips, outwards [m]."""
    ramp_time: float = 0.2
    """Time in which stepping fades in or out when the command leaves or reaches zero [s]."""
    deadband: float = 0.02
    """Speed of a command below which it means standing still [m/s]."""


@dataclass(frozen=True, slots=True)
class Ball:
    """A sphere of a collision model."""

    centre: tuple[float, float, float]
    """Centre in the frame of the body it belongs to [m]."""
    radius: float
    """[m]"""


@dataclass(frozen=True, slots=True)
class Drum:
    """A cylinder of a collision model."""

    centre: tuple[float, float, float]
    """Centre in the frame of the body it belongs to [m]."""
    radius: float
    """[m]"""
    half_length: float
    """[m]"""
    axis: tuple[float, float, float]
    """Direction of the axis, a unit vector."""


@dataclass(frozen=True, slots=True)
class QuadrupedConfig:
    """A quadruped of three-joint legs, its knees bending backwards.

    Link and joint names of the URDF are made of a leg's name and a piece: ``FL_thigh``, ``FL_thigh_joint``.
    """

    spec: BodySpec
    lidar: LidarSpec
    urdf: str
    """Path in example-robot-data."""
    base: str
    """Name of the trunk's link, which is base_link."""
    leg_names: tuple[str, str, str, str]
    """The legs' names in the URDF, in the order of LEGS."""
    joint_names: tuple[str, str, str]
    """The joints' names in the URDF after the leg's name."""
    link_names: tuple[str, str, str, str]
    """Names of hip, thigh, shank and foot after the leg's name."""
    foot_radius: float
    """[m]"""
    foot_friction: tuple[float, float, float]
    """Friction coefficients of the feet: sliding, torsional [m] and rolling [m]."""
    trunk_box: tuple[float, float, float]
    """Half sizes of the trunk's collision box [m]."""
    trunk_centre: tuple[float, float, float]
    """Centre of that box in base_link [m]."""
    head: tuple[Ball | Drum, ...]
    """Further shapes of the trunk's collision model."""
    hip: Drum
    """The collision shape of a left leg's hip link; those of the right legs are its mirror image."""
    limb_radii: tuple[float, float]
    """Radii of the capsules around thigh and shank [m]."""
    height: float
    """Height of the highest point above the floor when the robot stands [m]."""
    armature: tuple[float, float, float]
    """Inertia of a motor's rotor as felt at the joint [kg m^2], hip, thigh, calf."""
    joint_damping: float
    """[N m s/rad]"""
    joint_friction: float
    """Dry friction [N m]."""
    torque_limits: tuple[float, float, float]
    """Torque limits of the joints [N m]; checked against the URDF's."""
    speed_limits: tuple[float, float, float]
    """Joint speeds without load [rad/s]; checked against the URDF's."""
    full_torque_speed: float
    """Share of the speed without load up to which a motor gives its full torque; from there it falls to none in a
    straight line."""
    latency: float
    """Delay from a measurement until its targets reach the servos, in the simulation [s]."""
    kp: float
    """Stiffness of the joints' position servos [N m/rad]."""
    kd: float
    """Damping of the joints' position servos [N m s/rad]."""
    action_scale: tuple[float, float, float]
    """Change of a joint's target by an action of one [rad]."""
    lying: tuple[float, float, float]
    """Joint angles of a leg folded under the lying trunk [rad]."""
    lying_height: float
    """Height of base_link over the floor then [m]."""
    fall_height: float
    """Height of base_link over the floor below which the robot lies [m]."""
    side_slip: float
    """Sideways drift of the body, outwards, as a multiple of its centripetal acceleration [s]: feet under load
    creep."""
    yaw_lever: float
    """Lever that turns rad/s into m/s where a command is compared with the deadband [m]."""
    control_rate: int
    """Rate of the gait [Hz]."""
    trot: Trot
    weights: str
    """Name of the file in robots/locomotion/weights."""
