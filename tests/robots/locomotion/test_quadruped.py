"""A quadruped's physics, whatever its gait has learned."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from robots.bodies.go2 import GO2
from robots.bodies.urdf import BadUrdf
from robots.locomotion.config import LEGS
from robots.locomotion.kernels import servo_torque
from robots.locomotion.model import QuadrupedModel
from robots.locomotion.network import BadWeights, gait_contract, load_policy
from robots.noise import NoiseConfig
from robots.simulation import Rates, Simulation
from tests.robots.gaits import untaught
from tests.robots.halls import MIDDLE, hall
from vuca_nav.errors import BadArgument
from vuca_nav.types import STOP
from worlds.world import Box, Obstacle, World


@pytest.fixture(scope="module")
def walker(tmp_path_factory) -> Simulation:
    simulation = Simulation(hall(), untaught(tmp_path_factory.mktemp("gait")), 0, noise=NoiseConfig.none())
    simulation.reset()
    return simulation


@pytest.fixture(scope="module")
def bare() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot alone in the air, its servos without delay."""
    robot = QuadrupedModel(GO2).mjcf(delayed=False)
    robot.worldbody.body["base_link"].add("freejoint")
    model = mujoco.MjModel.from_xml_string(robot.to_xml_string())
    return model, mujoco.MjData(model)


def touching(model, data) -> set[frozenset[str]]:
    """Pairs of the robot's geoms in contact."""
    return {frozenset(model.geom(int(geom)).name for geom in pair) for pair in data.contact.geom}


def test_the_servos_give_what_the_gait_thinks_they_give(bare):
    model, data = bare
    quadruped = QuadrupedModel(GO2)
    tuning = quadruped.tuning(1.0 / 60.0)
    rng = np.random.default_rng(0)
    for _ in range(50):
        data.qpos[7:] = rng.uniform(quadruped.lower, quadruped.upper)
        data.qvel[6:] = rng.uniform(-35.0, 35.0, 12)
        data.ctrl[:] = rng.uniform(-3.0, 3.0, 12)
        mujoco.mj_forward(model, data)
        own = [servo_torque(tuning, j, data.ctrl[j], data.qpos[7 + j], data.qvel[6 + j]) for j in range(12)]
        assert data.actuator_force == pytest.approx(own, abs=1e-9)


@pytest.mark.parametrize(("joint", "limit", "speed"), [(0, 23.7, 30.1), (1, 23.7, 30.1), (2, 45.43, 15.7)])
def test_a_motors_torque_falls_with_its_speed(joint, limit, speed):
    """Full up to 45% of the speed limit, then in a straight line to nothing; full against the motion."""
    tuning = QuadrupedModel(GO2).tuning(1.0 / 60.0)
    for share, torque in ((0.0, 1.0), (0.45, 1.0), (0.725, 0.5), (1.0, 0.0), (-0.9, 1.0)):
        assert servo_torque(tuning, joint, 9.0, 0.0, share * speed) == pytest.approx(torque * limit)
        assert servo_torque(tuning, joint, -9.0, 0.0, -share * speed) == pytest.approx(-torque * limit)


def test_motors_of_another_speed_are_refused():
    with pytest.raises(BadUrdf, match=r"allows 15\.7 rad/s"):
        QuadrupedModel(dataclasses.replace(GO2, speed_limits=(30.1, 30.1, 20.0)))


def test_targets_reach_the_servos_late(walker):
    """10 ms at 300 Hz: the third step after a change is the last one that does not feel it."""
    model, data = walker.model, mujoco.MjData(walker.model)
    data.qpos[:] = walker.data.qpos
    data.qpos[2] += 1.0
    held = data.qpos[7:].copy()
    for actuator in range(12):
        samples = np.full((model.actuator_history[actuator, 0], 1), held[actuator])
        mujoco.mj_initCtrlHistory(model, data, actuator, None, samples)
    data.ctrl[:] = held
    mujoco.mj_step(model, data)
    data.ctrl[2] += 0.5
    asked = []
    for _ in range(5):
        before, speed = data.qpos[9], data.qvel[8]
        mujoco.mj_step(model, data)
        asked.append((data.actuator_force[2] + GO2.kd * speed) / GO2.kp + before - held[2])
    assert asked == pytest.approx([0.0, 0.0, 0.0, 0.5, 0.5], abs=1e-6)


def test_it_lies_and_stands_without_touching_itself(walker):
    model = walker.model
    robot = {f"go2/{name}" for leg in LEGS for name in (f"{leg}_foot", f"{leg}_thigh_limb", f"{leg}_calf_limb")}
    assert not any(pair <= robot for pair in touching(model, walker.data))
    assert {frozenset(("floor", f"go2/{leg}_foot")) for leg in LEGS} == touching(model, walker.data)


def test_it_is_put_down_on_the_floor_not_into_it(walker):
    walker._bound.reset(MIDDLE, np.random.default_rng(0))
    assert all(contact.dist > -0.002 for contact in walker.data.contact)
    walker.reset()


def test_legs_collide_with_each_other(bare):
    """Swung inwards, left and right ones meet."""
    model, data = bare
    nominal = QuadrupedModel(GO2).tuning(1.0 / 60.0).nominal
    mujoco.mj_resetData(model, data)
    data.qpos[7:] = nominal
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    sides = np.array([-1.0, 1.0, -1.0, 1.0])
    for angle in np.linspace(0.2, 0.8, 40):
        data.qpos[7::3] = sides * angle
        mujoco.mj_forward(model, data)
        if data.ncon:
            break
    names = [set(pair) for pair in touching(model, data)]
    assert names
    assert all(len({name[:2] for name in pair}) == 2 for pair in names)  # of two legs


def test_head_and_hips_touch_the_scene():
    model = mujoco.MjModel.from_xml_string(QuadrupedModel(GO2).mjcf().to_xml_string())
    for name in ("head_0", "head_1", *(f"{leg}_hip_drum" for leg in LEGS)):
        assert model.geom(name).contype[0] & 3 == 3
    assert model.geom("head_0").pos[0] + model.geom("head_0").size[0] == pytest.approx(0.335)
    assert model.geom("FR_hip_drum").pos[1] == pytest.approx(-0.08)


def test_it_does_not_rise_through_a_beam(tmp_path):
    beam = Obstacle("block", Box(MIDDLE.x, MIDDLE.y, 1.0, 1.0, 0.0, 0.5, 0.26))
    world = World("low", 0, (0.0, 0.0, 60.0, 60.0), (beam,), (), MIDDLE, (1.0, 1.0))
    simulation = Simulation(world, untaught(tmp_path), 0, noise=NoiseConfig.none())
    simulation.reset()
    assert simulation.data.qpos[2] + 0.057 < 0.28  # the top of the trunk's box


def test_a_gait_runs_at_its_own_rate(tmp_path):
    with pytest.raises(BadArgument, match="60 Hz, not at 30 Hz"):
        Simulation(hall(), untaught(tmp_path), 0, noise=NoiseConfig.none(), rates=Rates(control=30))


@pytest.mark.parametrize("change", [
    {"kp": 41.0}, {"side_slip": 0.06}, {"yaw_lever": 0.4}, {"control_rate": 50},
    {"spec": dataclasses.replace(GO2.spec, max_a_x=3.0)}, {"trot": dataclasses.replace(GO2.trot, deadband=0.03)},
])  # fmt: skip
def test_a_policy_of_another_gait_is_refused(tmp_path, change):
    other = untaught(tmp_path, **change).config
    assert gait_contract(other) != gait_contract(GO2)
    with pytest.raises(BadWeights, match="gait is"):
        load_policy(GO2, tmp_path / "untaught.safetensors")


def test_a_fallen_robot_that_rolled_back_has_still_fallen(walker):
    walker.data.qpos[3:7] = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    for _ in range(3):
        walker.step(STOP)
    walker.data.qpos[2:7] = (0.3, 1.0, 0.0, 0.0, 0.0)
    walker.step(STOP)
    assert walker.fallen
    walker.reset()
    assert not walker.fallen
