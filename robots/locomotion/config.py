"""What distinguishes one quadruped from another: a constants file is one of these."""

from dataclasses import dataclass

from vuca_nav.types import BodySpec, LidarSpec

LEGS = ("FL", "FR", "RL", "RR")
"""Front left, front right, rear left, rear right: the order of everything that comes four at a time."""
JOINTS_PER_LEG = ("hip", "thigh", "calf")
"""Abduction, hip flexion and knee: the order of everything that comes three to a leg."""
NUM_JOINTS = 12


@dataclass(frozen=True, slots=True)
class Trot:
    """The nominal gait, which the learned policy corrects."""

    frequency: float = 2.0
    """Strides a second [Hz]."""
    duty: float = 0.55
    """Share of a stride that a foot is on the ground."""
    swing_height: float = 0.09
    """Of the foot over the ground in mid-swing [m]."""
    hip_height: float = 0.30
    """Of the hips over the ground [m]."""
    stance_width: float = 0.0
    """How much farther out than under their hips the feet stand [m]."""
    ramp_time: float = 0.2
    """In which stepping fades in or out when the command leaves or reaches zero [s]."""
    deadband: float = 0.02
    """Commands slower than this mean standing still [m/s]."""


@dataclass(frozen=True, slots=True)
class Ball:
    """A sphere of a collision model."""

    centre: tuple[float, float, float]
    """In the frame of the body it belongs to [m]."""
    radius: float
    """[m]"""


@dataclass(frozen=True, slots=True)
class Drum:
    """A cylinder of a collision model."""

    centre: tuple[float, float, float]
    """In the frame of the body it belongs to [m]."""
    radius: float
    """[m]"""
    half_length: float
    """[m]"""
    axis: tuple[float, float, float]
    """Along it, a unit vector."""


@dataclass(frozen=True, slots=True)
class QuadrupedConfig:
    """A quadruped of three-joint legs, its knees bending backwards.

    Link and joint names of the URDF are made of a leg's name and a piece: ``FL_thigh``, ``FL_thigh_joint``.
    """

    spec: BodySpec
    lidar: LidarSpec
    urdf: str
    """In example-robot-data."""
    base: str
    """The trunk's link: base_link."""
    leg_names: tuple[str, str, str, str]
    """The legs' names in the URDF, in the order of LEGS."""
    joint_names: tuple[str, str, str]
    """The joints' names in the URDF after the leg's name."""
    link_names: tuple[str, str, str, str]
    """Hip, thigh, shank and foot after the leg's name."""
    foot_radius: float
    """[m]"""
    foot_friction: tuple[float, float, float]
    """Sliding, torsional [m] and rolling [m]."""
    trunk_box: tuple[float, float, float]
    """Half sizes of the trunk's collision box [m]."""
    trunk_centre: tuple[float, float, float]
    """Of that box in base_link [m]."""
    head: tuple[Ball | Drum, ...]
    """More shapes of the trunk's collision model."""
    hip: Drum
    """The collision shape of a left leg's hip link; those of the right legs are its mirror image."""
    limb_radii: tuple[float, float]
    """Of the capsules around thigh and shank [m]."""
    height: float
    """Of the highest point above the floor when it stands [m]."""
    armature: tuple[float, float, float]
    """Inertia of a motor's rotor as felt at the joint [kg m^2], hip, thigh, calf."""
    joint_damping: float
    """[N m s/rad]"""
    joint_friction: float
    """Dry friction [N m]."""
    torque_limits: tuple[float, float, float]
    """[N m]; checked against the URDF's."""
    speed_limits: tuple[float, float, float]
    """Without load [rad/s]; checked against the URDF's."""
    full_torque_speed: float
    """Share of that speed up to which a motor gives its full torque; from there it falls to none in a straight line."""
    latency: float
    """From a measurement until its targets reach the servos, in the simulation [s]."""
    kp: float
    """Of the joints' position servos [N m/rad]."""
    kd: float
    """[N m s/rad]"""
    action_scale: tuple[float, float, float]
    """What an action of one adds to a joint's target [rad]."""
    lying: tuple[float, float, float]
    """Joint angles of a leg folded under the lying trunk [rad]."""
    lying_height: float
    """Of base_link over the floor then [m]."""
    fall_height: float
    """Of base_link over the floor: below it, it lies [m]."""
    side_slip: float
    """Feet under load creep: the body drifts by so much times its centripetal acceleration, outwards [s]."""
    yaw_lever: float
    """Turns rad/s into m/s when it is asked whether a command is slow [m]."""
    control_rate: int
    """Of the gait [Hz]."""
    trot: Trot
    weights: str
    """File in robots/locomotion/weights."""
