"""Unitree A1: the constants of a quadruped; ``robots.locomotion`` does the rest.

Numbers come from example-robot-data's ``a1.urdf`` ("the URDF"), from MuJoCo Menagerie's ``unitree_a1``
(github.com/google-deepmind/mujoco_menagerie, BSD-3-Clause; "Menagerie") or from Isaac Lab's ``UNITREE_A1_CFG``
(github.com/isaac-sim/IsaacLab, BSD-3-Clause; "Isaac Lab") unless a line says otherwise.
"""

import numpy as np

from robots.locomotion.config import Drum, QuadrupedConfig, Trot
from robots.locomotion.quadruped import Quadruped
from vuca_nav.types import BodySpec, LidarSpec

FOOTPRINT = np.array(
    [
        (0.34, 0.10), (0.30, 0.19), (-0.32, 0.195), (-0.375, 0.16),
        (-0.375, -0.16), (-0.32, -0.195), (0.30, -0.19), (0.34, -0.10),
    ]
)  # fmt: skip
"""Outline of head, thighs and feet [m], standing and walking straight on. Over random commands in the whole range feet
and shanks come out of it by 0.014 m in the median, and by more than 0.072 m in 1% of the steps."""

A1 = QuadrupedConfig(
    spec=BodySpec(
        name="a1",
        footprint=FOOTPRINT,
        max_v_x=1.0,
        min_v_x=-0.5,
        max_v_y=0.4,
        max_w_z=1.2,
        max_a_x=2.0,
        max_a_y=2.0,
        max_a_w=5.0,
        delay=0.105,  # between v_x's and v_y's of responses/a1.json
    ),
    lidar=LidarSpec(height=0.36),  # on its back
    urdf="a1_description/urdf/a1.urdf",
    base="base",
    leg_names=("FL", "FR", "RL", "RR"),
    joint_names=("hip_joint", "thigh_joint", "calf_joint"),
    link_names=("hip", "thigh", "calf", "foot"),
    foot_radius=0.02,
    foot_friction=(0.8, 0.02, 0.01),  # Menagerie
    trunk_box=(0.1335, 0.097, 0.057),
    trunk_centre=(0.0, 0.0, 0.0),
    head=(  # the mesh's head: x 0.24 to 0.28, y to 0.08 either way, z to 0.057
        Drum((0.26, 0.0, 0.037), 0.02, 0.08, (0.0, 1.0, 0.0)),
        Drum((0.26, 0.0, 0.0), 0.02, 0.08, (0.0, 1.0, 0.0)),
        Drum((0.26, 0.0, -0.037), 0.02, 0.08, (0.0, 1.0, 0.0)),
    ),
    hip=Drum((0.0, 0.081, 0.0), 0.041, 0.016, (0.0, 1.0, 0.0)),  # its thigh_shoulder
    limb_radii=(0.017, 0.01),  # thigh 0.0245 x 0.034 m across; shank: Menagerie
    height=0.40,  # lidar
    armature=(0.01, 0.01, 0.01),  # Menagerie
    joint_damping=0.1,  # as Go2's; Menagerie's 1 and 2 stand for the servos' damping as well
    joint_friction=0.2,  # Menagerie
    torque_limits=(33.5, 33.5, 33.5),
    speed_limits=(21.0, 21.0, 21.0),
    full_torque_speed=0.0,  # Isaac Lab: torque falls from standstill on
    latency=0.01,  # as Go2's
    kp=40.0,  # as Go2's; Isaac Lab has 25
    kd=1.0,  # as Go2's; Isaac Lab has 0.5
    action_scale=(0.2, 0.25, 0.25),
    lying=(0.0, 1.30, -2.65),
    lying_height=0.12,  # on its feet
    fall_height=0.12,
    side_slip=0.05,  # as Go2's
    yaw_lever=0.5,
    control_rate=60,
    # Go2's gait, its lengths in proportion to the legs: 0.40 m instead of 0.426 m.
    trot=Trot(frequency=2.5, swing_height=0.10, hip_height=0.28, stance_width=0.025),
    weights="a1.safetensors",
)


class UnitreeA1(Quadruped):
    """Unitree A1, walking by a learned gait."""

    def __init__(self):
        super().__init__(A1)
