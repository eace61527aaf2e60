"""A second quadruped: its constants alone make it a body, which the same gait code walks."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from robots.bodies.a1 import A1, UnitreeA1
from robots.bodies.assets import asset
from robots.bodies.urdf import read_urdf
from robots.noise import NoiseConfig
from robots.own.geometry import overhang
from robots.simulation import Simulation
from tests.robots.halls import hall
from vuca_nav.geometry import between
from vuca_nav.types import STOP, VelocityCommand

RESPONSE = Path(__file__).parents[3] / "robots" / "bodies" / "responses" / "a1.json"


@pytest.fixture(scope="module")
def a1() -> UnitreeA1:
    return UnitreeA1()


@pytest.fixture
def walker(a1) -> Simulation:
    simulation = Simulation(hall(), a1, 0, noise=NoiseConfig())
    simulation.reset()
    return simulation


def test_masses_and_joints_are_the_urdfs(walker):
    urdf = read_urdf(asset(A1.urdf))
    base = walker.model.body("a1/").id
    assert walker.model.body_subtreemass[base] == pytest.approx(sum(link.inertia.mass for link in urdf.links.values()))
    for leg in A1.leg_names:
        for piece in ("hip", "thigh", "calf"):
            joint, own = walker.model.joint(f"a1/{leg}_{piece}"), urdf.joints[f"{leg}_{piece}_joint"]
            assert joint.range == pytest.approx([own.lower, own.upper])
            assert walker.model.actuator(f"a1/{leg}_{piece}").forcerange[1] == own.effort


def test_it_stands_within_its_footprint(a1, walker):
    for _ in range(30):
        walker.step(STOP)
    assert not walker.fallen
    assert walker.data.qpos[2] == pytest.approx(A1.trot.hip_height, abs=0.03)
    pose = walker.true_pose
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    for visual in a1.visuals():
        body = walker.model.body(f"a1/{visual.body}").id
        points = visual.mesh.vertices @ walker.data.xmat[body].reshape(3, 3).T + walker.data.xpos[body]
        dx, dy = points[:, 0] - pose.x, points[:, 1] - pose.y
        assert overhang(A1.spec.footprint, np.column_stack([c * dx + s * dy, c * dy - s * dx])) < 0.02


@pytest.mark.parametrize("command", [(0.8, 0.0, 0.0), (-0.4, 0.0, 0.0), (0.0, 0.3, 0.0), (0.5, 0.0, -0.8)])
def test_it_goes_where_it_is_told(walker, command):
    command = VelocityCommand(*command)
    for _ in range(60):
        walker.step(command)
    steps = []
    for _ in range(120):
        before = walker.true_pose
        walker.step(command)
        steps.append(between(before, walker.true_pose))
    assert not walker.fallen
    assert 30.0 * np.mean(steps, axis=0) == pytest.approx(np.array(command), abs=0.12)


def test_the_stack_is_told_the_delay_that_was_measured(a1):
    """Of forward and sideways motion; within a tick of the loop."""
    measured = json.loads(RESPONSE.read_text())
    for axis in ("v_x", "v_y"):
        assert a1.spec.delay == pytest.approx(measured[axis]["delay"], abs=1.0 / 30.0)
