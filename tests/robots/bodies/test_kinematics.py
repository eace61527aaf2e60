import math

import numpy as np
import pytest

from robots.bodies.kinematics import place_planar, planar_pose, rotation_of


def test_a_body_is_carried_with_its_lean_and_its_speed_over_ground():
    lean, yaw = 0.2, 0.7
    # Yaw after pitch, as a quaternion.
    qpos = np.array(
        [
            1.0,
            2.0,
            0.3,
            math.cos(yaw / 2) * math.cos(lean / 2),
            -math.sin(yaw / 2) * math.sin(lean / 2),
            math.cos(yaw / 2) * math.sin(lean / 2),
            math.sin(yaw / 2) * math.cos(lean / 2),
        ]
    )
    qvel = np.array([math.cos(yaw), math.sin(yaw), 0.1, 0.4, 0.5, 0.6])
    rotation, origin = np.empty((3, 3)), np.empty(3)
    place_planar(qpos, qvel, -3.0, 4.0, -1.1)
    assert planar_pose(qpos) == pytest.approx((-3.0, 4.0, -1.1))
    rotation_of(qpos, 0.0, rotation, origin)
    assert rotation[2] == pytest.approx((-math.sin(lean), 0.0, math.cos(lean)))
    assert qpos[2] == 0.3
    np.testing.assert_allclose(qvel, [math.cos(-1.1), math.sin(-1.1), 0.1, 0.4, 0.5, 0.6])
