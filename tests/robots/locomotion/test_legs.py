import math

import numpy as np
import pytest

from robots.bodies.go2 import GO2
from robots.locomotion.kernels import foot_motion, leg_velocity
from robots.locomotion.legs import foot_jacobian, foot_position, leg_angles
from robots.locomotion.model import QuadrupedModel

CONTROL_DT = 1.0 / 60.0
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def model() -> QuadrupedModel:
    return QuadrupedModel(GO2)


def poses(count):
    rng = np.random.default_rng(0)
    return [(leg, rng.uniform((-0.6, -0.2, -2.3), (0.6, 1.4, -0.9))) for leg in range(4) for _ in range(count)]


def place(model, leg, q):
    out = np.empty(3)
    foot_position(model.legs, leg, q, out)
    return out


def test_foot_position_is_the_urdfs(model):
    for leg, q in poses(5):
        name = GO2.leg_names[leg]
        positions = {f"{name}_{joint}": float(angle) for joint, angle in zip(GO2.joint_names, q)}
        expected = model.urdf.transform("base", f"{name}_foot", positions)[:3, 3]
        assert place(model, leg, q) == pytest.approx(expected, abs=1e-12)


def test_inverse_kinematics_returns_the_angles(model):
    for leg, q in poses(20):
        back = np.empty(3)
        x, y, z = place(model, leg, q)
        leg_angles(model.legs, leg, x, y, z, back)
        assert back == pytest.approx(q, abs=1e-9)


def test_jacobian_is_the_finite_difference(model):
    for leg, q in poses(5):
        jacobian = np.empty((3, 3))
        foot_jacobian(model.legs, leg, q, jacobian)
        for k in range(3):
            step = np.zeros(3)
            step[k] = 1e-6
            difference = (place(model, leg, q + step) - place(model, leg, q - step)) / 2e-6
            assert jacobian[:, k] == pytest.approx(difference, abs=1e-8)


def test_a_standing_point_foot_tells_the_bodys_velocity(model):
    point = model.legs._replace(foot_radius=0.0)
    velocity, gyro = np.array([0.6, -0.2, 0.1]), np.array([0.1, -0.3, 0.7])
    for leg, q in poses(10):
        jacobian, told = np.empty((3, 3)), np.empty(3)
        foot_jacobian(point, leg, q, jacobian)
        # The foot stands in the world: v + w x p + J dq = 0.
        dq = np.linalg.solve(jacobian, -(velocity + np.cross(gyro, place(model, leg, q))))
        foot_motion(point, leg, q, dq, gyro, UP, np.zeros(3), told)
        assert told == pytest.approx(velocity, abs=1e-9)


def test_a_rolling_foot_carries_the_body_along(model):
    """A rigid leg swinging about a round foot: the hip moves by the angle times its height over the floor."""
    q, rate = np.array([0.0, 0.8, -1.6]), 0.5
    told = np.empty(3)
    foot_motion(model.legs, 0, q, np.zeros(3), np.array([0.0, rate, 0.0]), UP, np.zeros(3), told)
    height = -place(model, 0, q)[2] + model.legs.foot_radius
    assert told[0] == pytest.approx(rate * height)


def test_force_on_a_foot_from_its_torques(model):
    for leg, q in poses(10):
        jacobian = np.empty((3, 3))
        foot_jacobian(model.legs, leg, q, jacobian)
        force = np.array([5.0, -8.0, 70.0])
        told = foot_motion(model.legs, leg, q, np.zeros(3), np.zeros(3), UP, -jacobian.T @ force, np.empty(3))
        assert told == pytest.approx(70.0)


def test_feet_in_the_air_tell_nothing(model):
    tuning = model.tuning(CONTROL_DT)
    q = tuning.nominal
    worth = leg_velocity(model.legs, tuning, np.zeros(3), UP, q, np.ones(12), q, q, np.empty(2))
    assert worth < 0.1


def test_a_foot_counts_only_if_present_and_last_targets_say_that_it_carries(model):
    """Three legs stand still, the fourth swings: whichever targets its servos follow yet, it has no say."""
    tuning = model.tuning(CONTROL_DT)
    q, limp, dq = np.empty(12), tuning.nominal.copy(), np.zeros(12)
    for leg in range(4):
        hip = model.legs.hips[leg]
        y = hip[1] + model.legs.offsets[leg]
        y += math.copysign(tuning.stance_width, y)
        leg_angles(model.legs, leg, hip[0], y, model.legs.foot_radius - tuning.hip_height, q[3 * leg : 3 * leg + 3])
    limp[:3], dq[:3] = q[:3], (0.5, 0.5, 0.0)
    told = {}
    for name, now, last in (("both", tuning.nominal, tuning.nominal), ("now", limp, tuning.nominal),
                            ("last", tuning.nominal, limp)):  # fmt: skip
        told[name] = np.empty(2)
        assert leg_velocity(model.legs, tuning, np.zeros(3), UP, q, dq, now, last, told[name]) > 0.4
    assert abs(told["both"]).min() > 0.01
    assert told["now"] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert told["last"] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_standing_feet_carry_the_weight(model):
    """At the nominal targets' own stance the servos hold the robot: each foot a quarter."""
    tuning = model.tuning(CONTROL_DT)
    q = np.empty(12)
    for leg in range(4):
        hip = model.legs.hips[leg]
        y = hip[1] + model.legs.offsets[leg]
        y += math.copysign(tuning.stance_width, y)
        leg_angles(model.legs, leg, hip[0], y, model.legs.foot_radius - tuning.hip_height, q[3 * leg : 3 * leg + 3])
        torque = tuning.kp * (tuning.nominal - q)[3 * leg : 3 * leg + 3]
        told = foot_motion(model.legs, leg, q[3 * leg : 3 * leg + 3], np.zeros(3), np.zeros(3), UP, torque, np.empty(3))
        assert told == pytest.approx(tuning.weight / 4.0)
    assert math.isclose(tuning.weight, 16.085 * 9.81)  # the URDF's masses
