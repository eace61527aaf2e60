"""Unitree Go2: the constants of a quadruped; ``robots.locomotion`` does the rest.

Numbers come from example-robot-data's ``go2.urdf`` ("the URDF") or from MuJoCo Menagerie's ``unitree_go2``
(github.com/google-deepmind/mujoco_menagerie, BSD-3-Clause; "Menagerie") unless a line says otherwise.
"""

import numpy as np

from robots.locomotion.config import Ball, Drum, QuadrupedConfig, Trot
from robots.locomotion.quadruped import Quadruped
from vuca_nav.types import BodySpec, LidarSpec

FOOTPRINT = np.array(
    [
        (0.37, 0.10), (0.33, 0.185), (-0.33, 0.19), (-0.38, 0.16),
        (-0.38, -0.16), (-0.33, -0.19), (0.33, -0.185), (0.37, -0.10),
    ]
)  # fmt: skip
"""Outline of head, thighs and feet [m]: it holds all visual meshes in 99% of a random walk over the whole range of
commands; a foot caught by a push or in a sharp turn at full speed comes out by up to 0.06 m."""

ROTOR_INERTIA = 0.000111842
"""Inertia of a rotor about its axis: ``*_rotor`` of the URDF [kg m^2]."""
GEAR = 6.33
"""Gear ratio of hip and thigh: Unitree's GO-M8010-6 motor, data sheet."""
KNEE_GEAR = GEAR * 45.43 / 23.7
"""Gear ratio of the knee: its linkage turns as much slower as it is stronger, as the URDF's effort and velocity limits
have it."""

GO2 = QuadrupedConfig(
    spec=BodySpec(
        name="go2",
        footprint=FOOTPRINT,
        max_v_x=1.2,
        min_v_x=-0.6,
        max_v_y=0.4,
        max_w_z=1.2,
        max_a_x=2.0,
        max_a_y=2.0,
        max_a_w=5.0,
        delay=0.11,  # between v_x's and v_y's of responses/go2.json
    ),
    lidar=LidarSpec(height=0.37),
    urdf="go2_description/urdf/go2.urdf",
    base="base",
    leg_names=("FL", "FR", "RL", "RR"),
    joint_names=("hip_joint", "thigh_joint", "calf_joint"),
    link_names=("hip", "thigh", "calf", "foot"),
    foot_radius=0.022,  # Menagerie
    foot_friction=(0.8, 0.02, 0.01),  # Menagerie
    trunk_box=(0.1881, 0.04675, 0.057),  # Unitree's own URDF (unitree_ros): 0.3762 x 0.0935 x 0.114
    trunk_centre=(0.0, 0.0, 0.0),
    head=(  # Unitree's own URDF, its Head_upper and Head_lower
        Drum((0.285, 0.0, 0.01), 0.05, 0.045, (0.0, 0.0, 1.0)),
        Ball((0.293, 0.0, -0.06), 0.047),
    ),
    hip=Drum((0.0, 0.08, 0.0), 0.046, 0.02, (0.0, 1.0, 0.0)),  # Unitree's own URDF
    limb_radii=(0.022, 0.013),  # thigh 0.0245 x 0.034 m across, shank 0.013 (unitree_ros)
    height=0.42,
    armature=(ROTOR_INERTIA * GEAR**2, ROTOR_INERTIA * GEAR**2, ROTOR_INERTIA * KNEE_GEAR**2),
    joint_damping=0.1,  # Menagerie
    joint_friction=0.2,  # Menagerie
    torque_limits=(23.7, 23.7, 45.43),
    speed_limits=(30.1, 30.1, 15.7),
    full_torque_speed=0.45,  # Go2HV of Unitree's unitree_rl_lab: full torque to 13.5 rad/s, none at 30
    latency=0.01,  # assumed: sensors and policy, Unitree's bus (500 Hz) both ways and the motors' own loop
    kp=40.0,
    kd=1.0,
    action_scale=(0.2, 0.25, 0.25),
    lying=(0.0, 1.30, -2.70),
    lying_height=0.12,  # on its feet
    fall_height=0.13,
    side_slip=0.05,  # fitted to 70 random walks of varied robots
    yaw_lever=0.5,
    control_rate=60,
    # At 2 Hz yaw ripples twice as much in the corners of the command range; at 3 Hz, or with feet that stand less wide
    # or are lifted less, it falls much more often on sills and slopes and after pushes: docs/findings.md.
    trot=Trot(frequency=2.5, swing_height=0.11, stance_width=0.025),
    weights="go2.safetensors",
)


class Go2(Quadruped):
    """Unitree Go2, walking by a learned gait."""

    def __init__(self):
        super().__init__(GO2)
