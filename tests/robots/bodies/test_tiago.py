# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math

import mujoco
import numpy as np
import pytest

from robots.bodies.assets import asset
from robots.bodies.tiago import (
    FOOTPRINT,
    HEIGHT,
    MAX_A_X,
    TUCK,
    URDF_FILE,
    WHEEL_MAX_SPEED,
    WHEEL_MAX_TORQUE,
    WHEEL_RADIUS,
    WHEEL_SEPARATION,
)  # fmt: skip
from robots.bodies.urdf import read_urdf
from robots.noise import NoiseConfig
from robots.registry import ROBOTS, make_body
from robots.simulation import Simulation
from tests.robots.halls import hall
from vuca_nav.errors import UnknownName
from vuca_nav.geometry import between
from vuca_nav.types import STOP, VelocityCommand

FORWARD, TURN = VelocityCommand(1.0, 0.0, 0.0), VelocityCommand(0.0, 0.0, 1.0)
SECOND = 30
"""Ticks."""


def drive(simulation, command, seconds):
    for _ in range(round(seconds * SECOND)):
        simulation.step(command)


def encoders(simulation):
    return np.array([simulation.data.sensor(f"tiago/wheel_{side}_encoder").data[0] for side in ("left", "right")])


def test_registry():
    assert make_body("tiago").spec.name == "tiago"
    with pytest.raises(UnknownName, match="tiago"):
        make_body("tigao")
    assert "tiago" in ROBOTS


def test_mass_and_centre_of_mass_are_the_urdfs(simulation):
    urdf = read_urdf(asset(URDF_FILE))
    whole = urdf.fuse("base_link", urdf.links, TUCK)
    assert whole.mass == pytest.approx(sum(link.inertia.mass for link in urdf.links.values()), abs=1e-9)
    model, data = simulation.model, mujoco.MjData(simulation.model)
    data.qpos[:3] = 0.0
    mujoco.mj_forward(model, data)
    base = model.body("tiago/").id
    assert model.body_subtreemass[base] == pytest.approx(whole.mass, abs=1e-6)
    np.testing.assert_allclose(data.subtree_com[base], whole.centre, atol=1e-6)
    # The inertia that MuJoCo sees about the base, wheels included, is the URDF's (its own sum over six axes).
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    d = whole.centre
    about_base = whole.tensor + whole.mass * (d @ d * np.eye(3) - np.outer(d, d))
    np.testing.assert_allclose(matrix[3:6, 3:6], about_base, rtol=1e-3, atol=1e-3)


def test_wheels_are_the_urdfs():
    joint = read_urdf(asset(URDF_FILE)).joints["wheel_left_joint"]
    assert (joint.effort, joint.velocity) == (WHEEL_MAX_TORQUE, WHEEL_MAX_SPEED)
    assert joint.parent_from_joint[1, 3] == WHEEL_SEPARATION / 2.0


def test_footprint_holds_every_visual_and_every_collision_geom(tiago, simulation):
    edges = np.roll(FOOTPRINT, -1, axis=0) - FOOTPRINT
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None]
    turns = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1] - edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
    assert (turns > 0).all()  # convex, counter-clockwise

    def outside(points):
        return ((points[:, None, :2] - FOOTPRINT) * normals).sum(axis=2).max()

    mujoco.mj_forward(simulation.model, simulation.data)
    model, data = simulation.model, simulation.data
    origin, turn = data.body("tiago/base_link").xpos, data.body("tiago/base_link").xmat.reshape(3, 3)
    reach = -math.inf
    for part in tiago.visuals():
        body = data.body(f"tiago/{part.body}")
        points = part.mesh.vertices @ body.xmat.reshape(3, 3).T + body.xpos
        reach = max(reach, outside((points - origin) @ turn))
        assert points[:, 2].max() < HEIGHT + 0.01
    assert -0.008 < reach < 0.005  # it also touches: thinning moves vertices by millimetres
    for name in ("base", "column", "torso", "arm", "head"):
        geom = model.geom(f"tiago/{name}")
        x, y = geom.size[:2] if geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX else (geom.size[0], geom.size[0])
        angles = np.linspace(0.0, 2.0 * math.pi, 72, endpoint=False)
        if geom.type[0] == mujoco.mjtGeom.mjGEOM_BOX:
            rim = np.array([(x, y), (-x, y), (-x, -y), (x, -y)])
        else:
            rim = x * np.column_stack([np.cos(angles), np.sin(angles)])
        assert outside(rim + geom.pos[:2]) < 0.005


def test_straight_on_covers_what_the_acceleration_limit_allows(simulation):
    drive(simulation, FORWARD, 5.0)
    moved = between(simulation.world.start, simulation.true_pose)
    ideal = 5.0 - 0.5 * 1.0 / MAX_A_X  # 1 s of speeding up covers half as much
    assert math.hypot(moved.x, moved.y) == pytest.approx(ideal, rel=0.005)
    assert abs(moved.yaw) < 0.03  # the arm makes it heavier on the right


def test_wheels_roll_and_do_not_slip(simulation):
    before = encoders(simulation)
    drive(simulation, FORWARD, 4.0)
    drive(simulation, STOP, 2.0)
    rolled = (encoders(simulation) - before).mean() * WHEEL_RADIUS
    moved = between(simulation.world.start, simulation.true_pose)
    assert math.hypot(moved.x, moved.y) == pytest.approx(rolled, rel=0.005)
    drive(simulation, FORWARD, 0.5)  # while it speeds up
    surface = simulation.data.qvel[6:8].mean() * WHEEL_RADIUS
    assert simulation.data.qvel[0] == pytest.approx(surface, abs=0.01)


def test_turns_on_the_spot(simulation):
    drive(simulation, TURN, 5.0)
    moved = between(simulation.world.start, simulation.true_pose)
    assert math.hypot(moved.x, moved.y) < 0.01
    ideal = 5.0 - 0.5 / math.radians(120.0)
    assert moved.yaw % (2 * math.pi) == pytest.approx(ideal, rel=0.01)


def test_an_arc_beyond_the_wheels_speed_keeps_its_radius(simulation):
    drive(simulation, VelocityCommand(1.0, 0.0, 1.0), 2.0)
    _, odometry = simulation.step(VelocityCommand(1.0, 0.0, 1.0))
    fastest = 1.0 / (1.0 + WHEEL_SEPARATION / 2.0)
    assert odometry.twist.v_x == pytest.approx(fastest, rel=0.01)
    # The centre of mass, 16 mm ahead of the wheels, pulls outwards; the servos give way a little.
    assert odometry.twist.w_z == pytest.approx(fastest, rel=0.04)


def test_limits_hold_whatever_is_asked(simulation):
    drive(simulation, VelocityCommand(-9.0, 5.0, 0.0), 2.0)
    _, odometry = simulation.step(VelocityCommand(-9.0, 5.0, 0.0))
    assert odometry.twist.v_x == pytest.approx(-0.2, abs=0.005)
    drive(simulation, VelocityCommand(0.0, 0.0, -9.0), 2.0)
    _, odometry = simulation.step(VelocityCommand(0.0, 0.0, -9.0))
    assert odometry.twist.w_z == pytest.approx(-1.0, rel=0.01)


def test_torque_suffices_for_the_accelerations(simulation):
    strongest = 0.0
    for command in (FORWARD, STOP, TURN, VelocityCommand(1.0, 0.0, -1.0), VelocityCommand(-0.2, 0.0, 1.0)):
        for _ in range(SECOND):
            simulation.step(command)
            strongest = max(strongest, np.abs(simulation.data.actuator_force).max())
    assert 2.0 < strongest < WHEEL_MAX_TORQUE


def test_standing_still_is_still(simulation):
    start = simulation.true_pose
    for _ in range(10 * SECOND):
        simulation.step(STOP)
        assert np.abs(simulation.data.qvel).max() < 1e-4
    assert np.abs(simulation.data.qvel).max() < 1e-8
    assert math.hypot(simulation.true_pose.x - start.x, simulation.true_pose.y - start.y) < 1e-6
    lean = 2.0 * math.hypot(*simulation.data.qpos[4:6])
    assert lean < math.radians(0.02)


def test_hard_braking_does_not_lift_or_topple_it(simulation):
    leans = []
    for command in (FORWARD, STOP, TURN, STOP):
        for _ in range(2 * SECOND):
            simulation.step(command)
            leans.append(2.0 * math.hypot(*simulation.data.qpos[4:6]))
    assert max(leans) < math.radians(0.5)
    assert not simulation.fallen


def test_has_fallen_when_it_lies(tiago):
    simulation = Simulation(hall(), tiago, 0, noise=NoiseConfig.none())
    simulation.reset()
    angle = math.radians(60.0)
    simulation.data.qpos[2:7] = (0.6, math.cos(angle / 2), math.sin(angle / 2), 0.0, 0.0)
    drive(simulation, STOP, 2.0)
    assert simulation.fallen
    assert simulation.contact is None  # it lies on the floor, and the floor does not count
