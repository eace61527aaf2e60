import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from robots.bodies.assets import asset
from robots.bodies.go2 import GO2, Go2
from robots.bodies.urdf import BadUrdf, read_urdf
from robots.locomotion.gait import Gait, Mode
from robots.locomotion.model import QuadrupedModel
from robots.locomotion.network import BadObservation
from robots.noise import NoiseConfig
from robots.registry import find_quadruped, make_body
from robots.simulation import Simulation
from tests.robots.halls import hall
from vuca_nav.errors import UnknownName
from vuca_nav.geometry import between
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, Pose2, VelocityCommand


@pytest.fixture(scope="module")
def go2() -> Go2:
    return Go2()


@pytest.fixture
def walker(go2) -> Simulation:
    simulation = Simulation(hall(), go2, 0, noise=NoiseConfig())
    simulation.reset()
    return simulation


def walk(simulation, command, seconds):
    odometry = None
    for _ in range(round(30 * seconds)):
        _, odometry = simulation.step(command)
    return odometry


def test_registry():
    assert make_body("go2").spec.name == "go2"
    assert find_quadruped("go2") is GO2
    with pytest.raises(UnknownName, match="available: a1, go2"):
        find_quadruped("tiago")


def test_the_mission_begins_at_its_start_though_rising_shifts_the_base(go2):
    start = Pose2(10.0, 20.0, 0.8)
    simulation = Simulation(hall(start=start), go2, 3, noise=NoiseConfig())
    _, odometry = simulation.reset()
    np.testing.assert_allclose(simulation.true_pose, start, atol=1e-9)
    assert odometry.odom_from_base == (0.0, 0.0, 0.0)
    walk(simulation, STOP, 1.0)
    np.testing.assert_allclose(simulation.true_pose, start, atol=0.03)


def test_mass_limits_and_joints_are_the_urdfs(walker):
    urdf = read_urdf(asset(GO2.urdf))
    base = walker.model.body("go2/").id
    assert walker.model.body_subtreemass[base] == pytest.approx(sum(link.inertia.mass for link in urdf.links.values()))
    for leg in GO2.leg_names:
        for piece in ("hip", "thigh", "calf"):
            joint, own = walker.model.joint(f"go2/{leg}_{piece}"), urdf.joints[f"{leg}_{piece}_joint"]
            assert joint.range == pytest.approx([own.lower, own.upper])
            assert walker.model.actuator(f"go2/{leg}_{piece}").forcerange[1] == own.effort


def test_it_stands_after_the_start_up_and_stays_where_it_is(walker):
    assert not walker.fallen
    assert walker.data.qpos[2] == pytest.approx(GO2.trot.hip_height, abs=0.03)
    before = walker.true_pose
    walk(walker, STOP, 1.0)
    speeds = []
    for _ in range(60):
        walker.step(STOP)
        speeds.append(np.abs(walker.data.qvel[6:]).max())
    moved = between(before, walker.true_pose)
    assert math.hypot(moved.x, moved.y) < 0.03
    assert np.mean(speeds) < 0.3  # rad/s: no trembling


@pytest.mark.parametrize(
    "command", [(0.8, 0.0, 0.0), (-0.4, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 1.0), (0.5, 0.0, -0.6)]
)
def test_it_goes_where_it_is_told(walker, command):
    command = VelocityCommand(*command)
    walk(walker, command, 2.0)
    v_x, v_y, w_z = [], [], []
    for _ in range(120):
        before = walker.true_pose
        walker.step(command)
        step = between(before, walker.true_pose)
        v_x.append(30.0 * step.x)
        v_y.append(30.0 * step.y)
        w_z.append(30.0 * step.yaw)
    assert not walker.fallen
    assert np.mean(v_x) == pytest.approx(command.v_x, abs=0.1)
    assert np.mean(v_y) == pytest.approx(command.v_y, abs=0.1)
    assert np.mean(w_z) == pytest.approx(command.w_z, abs=0.15)


def test_feet_clear_the_floor(walker):
    """Each foot rises by at least 3 cm in a stride."""
    command = VelocityCommand(0.6, 0.0, 0.0)
    walk(walker, command, 1.0)
    feet = [walker.model.geom(f"go2/{leg}_foot").id for leg in ("FL", "FR", "RL", "RR")]
    heights = []
    for _ in range(45):
        walker.step(command)
        heights.append(walker.data.geom_xpos[feet, 2] - GO2.foot_radius)
    assert (np.max(heights, axis=0) > 0.03).all()


def drift(go2, noise, seed, seconds):
    simulation = Simulation(hall(300.0, Pose2(150.0, 150.0, 0.0)), go2, seed, noise=noise)
    simulation.reset()
    rng = np.random.default_rng(seed)
    start, distance, odometry = simulation.true_pose, 0.0, None
    for _ in range(round(seconds / 2.0)):
        turn = rng.uniform(-0.8, 0.8) if rng.random() < 0.5 else 0.0
        before = simulation.true_pose
        odometry = walk(simulation, VelocityCommand(rng.uniform(0.3, 1.0), 0.0, turn), 2.0)
        distance += math.hypot(simulation.true_pose.x - before.x, simulation.true_pose.y - before.y)
    assert odometry is not None
    truth, believed = between(start, simulation.true_pose), odometry.odom_from_base
    return math.hypot(truth.x - believed.x, truth.y - believed.y) / distance


def test_leg_odometry_drifts_but_not_far(go2):
    drifts = [drift(go2, NoiseConfig(), seed, 20.0) for seed in range(4)]
    assert 0.002 < np.mean(drifts) < 0.08


def test_a_fallen_robot_gives_way_and_stays_down(walker):
    bound = walker._bound
    walker.data.qpos[3:7] = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # on its side
    walk(walker, VelocityCommand(1.0, 0.0, 0.0), 1.0)
    assert walker.fallen
    assert bound.gait.mode is Mode.FALLEN
    speeds = np.abs(walker.data.qvel[6:])
    assert speeds.max() < 1.0  # damped, not thrashing
    walker.reset()
    assert bound.gait.mode is Mode.WALKING
    assert not walker.fallen


def test_a_measurement_that_is_not_finite_stops_everything(walker):
    gait = walker._bound.gait
    zeros = np.zeros(12)
    with pytest.raises(BadObservation, match="not finite"):
        gait.measure(np.array([0.0, np.nan, 0.0]), np.array([0.0, 0.0, 1.0]), zeros, zeros)


@pytest.mark.parametrize("mode", list(Mode))
def test_a_command_that_is_not_finite_is_refused_in_every_mode(go2, mode):
    gait = Gait(go2.model, go2.policy, 1.0 / 60.0)
    q, zeros, up = go2.model.tuning(1.0 / 60.0).nominal, np.zeros(12), np.array([0.0, 0.0, 1.0])
    gait.reset(q)
    gait.mode = Mode.WALKING
    gait.step(VelocityCommand(0.3, 0.0, 0.0), np.zeros(3), up, q, zeros)
    gait.mode = mode
    with pytest.raises(BadObservation, match=r"command is not finite: .*nan"):
        gait.step(VelocityCommand(0.1, math.nan, 0.0), np.zeros(3), up, q, zeros)
    assert gait.state.wanted.tolist() == [0.3, 0.0, 0.0]


def test_same_seed_same_bits(go2):
    ends = []
    for _ in range(2):
        simulation = Simulation(hall(), go2, 3, noise=NoiseConfig())
        simulation.reset()
        odometry = walk(simulation, VelocityCommand(0.7, 0.1, 0.3), 1.0)
        ends.append((simulation.true_pose, odometry))
    assert ends[0] == ends[1]


def test_a_reset_forgets(walker):
    first = [walker.reset(), walk(walker, VelocityCommand(0.5, 0.0, 0.0), 0.5), walker.true_pose]
    second = [walker.reset(), walk(walker, VelocityCommand(0.5, 0.0, 0.0), 0.5), walker.true_pose]
    assert first[1:] == second[1:]


def test_the_command_is_kept_within_the_limits(go2):
    simulation = Simulation(hall(), go2, 0, noise=NoiseConfig.none())
    simulation.reset()
    walk(simulation, VelocityCommand(9.0, 0.0, 0.0), 3.0)
    before = simulation.true_pose
    walk(simulation, VelocityCommand(9.0, 0.0, 0.0), 1.0)
    assert 0.8 < between(before, simulation.true_pose).x < GO2.spec.max_v_x + 0.15
    assert not simulation.fallen


def test_every_visual_hangs_on_a_body_and_legs_have_theirs(go2, walker):
    bodies = {visual.body for visual in go2.visuals()}
    assert {"base_link", "FL_hip", "FL_thigh", "FL_calf", "RR_calf"} <= bodies
    for body in bodies:
        assert walker.model.body(f"go2/{body}").id > 0


class PartsListener(Telemetry):
    def __init__(self):
        self.orientations = []

    def robot_parts(self, positions, quaternions):
        self.orientations.append(quaternions.copy())


def test_legs_move_in_the_recording(go2):
    listener = PartsListener()
    simulation = Simulation(hall(), go2, 0, noise=NoiseConfig(), telemetry=listener)
    simulation.reset()
    walk(simulation, VelocityCommand(0.6, 0.0, 0.0), 1.0)
    swing = np.ptp(np.array(listener.orientations), axis=0).max(axis=1)  # (parts,)
    for visual, moved in zip(go2.visuals(), swing):
        assert visual.body == "base_link" or visual.body.endswith("hip") or moved > 0.1


def test_footprint_holds_the_standing_robot(go2, walker):
    data, model = walker.data, walker.model
    outline = GO2.spec.footprint
    edges = np.roll(outline, -1, axis=0) - outline
    for visual in go2.visuals():
        body = model.body(f"go2/{visual.body}").id
        points = visual.mesh.vertices @ data.xmat[body].reshape(3, 3).T + data.xpos[body]
        c, s = math.cos(walker.true_pose.yaw), math.sin(walker.true_pose.yaw)
        dx, dy = points[:, 0] - walker.true_pose.x, points[:, 1] - walker.true_pose.y
        in_base = np.stack((c * dx + s * dy, c * dy - s * dx), axis=1)
        offsets = in_base[:, None, :] - outline[None]
        cross = edges[None, :, 0] * offsets[:, :, 1] - edges[None, :, 1] * offsets[:, :, 0]
        outside = (cross / np.linalg.norm(edges, axis=1)).min()
        assert outside > -0.02


def test_a_urdf_that_lacks_a_joint_is_refused():
    urdf = read_urdf(asset(GO2.urdf))
    joints = {name: joint for name, joint in urdf.joints.items() if name != "RL_calf_joint"}
    with pytest.raises(BadUrdf, match="no joint 'RL_calf_joint'"):
        QuadrupedModel(GO2, dataclasses.replace(urdf, joints=joints))


@pytest.mark.parametrize(
    "change", [{"kind": "fixed"}, {"lower": 0.0, "upper": 0.0}, {"lower": -math.inf}, {"kind": "continuous"}]
)
def test_a_leg_joint_that_cannot_turn_within_limits_is_refused(change):
    urdf = read_urdf(asset(GO2.urdf))
    joint = dataclasses.replace(urdf.joints["RL_thigh_joint"], **change)
    with pytest.raises(BadUrdf, match="joint 'RL_thigh_joint'"):
        QuadrupedModel(GO2, dataclasses.replace(urdf, joints={**urdf.joints, "RL_thigh_joint": joint}))


def test_a_link_that_hangs_on_nothing_is_refused():
    urdf = read_urdf(asset(GO2.urdf))
    joints = {name: joint for name, joint in urdf.joints.items() if name != "FL_foot_joint"}
    with pytest.raises(BadUrdf, match="link 'FL_foot' does not hang on 'base'"):
        QuadrupedModel(GO2, dataclasses.replace(urdf, joints=joints))


def test_a_urdf_of_other_motors_is_refused():
    with pytest.raises(BadUrdf, match=r"allows 23\.7 N m"):
        QuadrupedModel(dataclasses.replace(GO2, torque_limits=(20.0, 23.7, 45.43)))


def test_the_lidar_tilts_with_the_body(walker):
    level, _ = walker.step(STOP)
    assert np.nanmin(level.ranges) > 5.0  # 30 m to the walls; the floor shows only where it leans by a degree or two
    half = math.radians(10.0)
    walker.data.qpos[3:7] = (math.cos(half), 0.0, math.sin(half), 0.0)  # nose down by 20 degrees
    walker._ticks += 1  # the next scan is due
    scan, _ = walker._observe()
    ahead = len(scan.ranges) // 2
    seen = scan.ranges[ahead - 10 : ahead + 10]
    assert np.nanmedian(seen[np.isfinite(seen)]) == pytest.approx(0.37 / math.sin(math.radians(20.0)), abs=0.25)


def test_the_stack_is_told_the_delay_that_was_measured(go2):
    """Of forward and sideways motion; within a tick of the loop."""
    measured = json.loads((Path(__file__).parents[3] / "robots/bodies/responses/go2.json").read_text())
    for axis in ("v_x", "v_y"):
        assert go2.spec.delay == pytest.approx(measured[axis]["delay"], abs=1.0 / 30.0)
