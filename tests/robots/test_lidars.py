"""Bodies with other lidars than a full circle about base_link at the loop's rate."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eval.methods import build, resolve
from robots.bodies.tiago import FRONT_LIDAR, Tiago
from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.simulation import Simulation
from vuca_nav.geometry import compose
from vuca_nav.task import GOAL_TOLERANCE
from vuca_nav.types import STOP, LidarSpec, Pose2, VelocityCommand
from worlds.registry import make_world
from worlds.world import Box, Cylinder, Obstacle, World

SHAPES = (Box(6.0, 2.0, 2.0, 0.4, 0.6, 2.0), Box(2.0, 6.0, 0.5, 3.0, 0.0, 2.0), Cylinder(5.5, 6.0, 0.4, 2.0))
WORLD = World(
    "shapes", 0, (0.0, 0.0, 8.0, 8.0), tuple(Obstacle("block", shape) for shape in SHAPES), (), Pose2(4.0, 4.0, 0.7),
    (1.0, 1.0),
)  # fmt: skip
HALF = LidarSpec(
    num_beams=241, rate=10.0, angle_min=1.5, angle_increment=-0.0125, mount=Pose2(0.2, -0.1, 0.3), min_range=0.3
)


def with_lidar(robot: str, lidar: LidarSpec):
    body = make_body(robot)
    body.lidar = replace(lidar, height=body.lidar.height)
    return body


def first_scan(lidar: LidarSpec):
    simulation = Simulation(WORLD, with_lidar("tiago", lidar), 0, noise=NoiseConfig.none())
    return simulation.reset()[0].ranges, simulation.true_pose


@pytest.mark.parametrize("lidar", [FRONT_LIDAR, HALF, LidarSpec(num_beams=720), LidarSpec(num_beams=361)])
def test_a_beam_reads_what_a_full_circle_from_its_place_reads_in_its_direction(lidar):
    ranges, pose = first_scan(lidar)
    place = compose(pose, lidar.mount)
    directions = pose.yaw + lidar.angles_in_base()
    fine = replace(WORLD, start=Pose2(place.x, place.y, 0.0))
    body = with_lidar("tiago", LidarSpec(num_beams=36_000, max_range=lidar.max_range))
    simulation = Simulation(fine, body, 0, noise=NoiseConfig.none())
    reference = simulation.reset()[0].ranges
    nearest = np.rint((directions + math.pi) / (2.0 * math.pi) * 36_000).astype(int) % 36_000
    either = np.stack([reference[(nearest + d) % 36_000] for d in (-3, 0, 3)])  # at an edge one of them may miss it
    inside = np.isfinite(ranges)
    assert inside.sum() > 20
    assert (abs(either[:, inside] - ranges[inside]).min(axis=0) < 0.03).all()
    assert np.isinf(either[:, ~inside]).any(axis=0).all()


@pytest.mark.parametrize("rate", [5.0, 10.0, 12.0, 15.0, 30.0, 40.0])
def test_a_lidar_gives_as_many_scans_as_its_rate_says(rate):
    simulation = Simulation(WORLD, with_lidar("tiago", replace(HALF, rate=rate)), 0, noise=NoiseConfig())
    scans = [simulation.reset()[0]]
    stamps = [scans[0].stamp]
    for tick in range(1, 61):
        scan, odometry = simulation.step(STOP)
        assert odometry.stamp == pytest.approx(tick / 30)
        assert scan.stamp <= odometry.stamp < scan.stamp + 1.0 / min(rate, 30.0) + 1.0 / 30.0
        assert (scan.stamp == scans[-1].stamp) == (scan is scans[-1])
        scans.append(scan)
        stamps.append(scan.stamp)
    assert len(set(stamps)) == 1 + min(round(2.0 * rate), 60)


def test_another_lidar_leaves_the_robots_motion_alone():
    usual = Simulation(WORLD, Tiago(), 0, noise=NoiseConfig())
    other = Simulation(WORLD, with_lidar("tiago", FRONT_LIDAR), 0, noise=NoiseConfig())
    for simulation in (usual, other):
        simulation.reset()
        for _ in range(20):
            simulation.step(VelocityCommand(0.3, 0.0, 0.5))
    assert usual.true_pose == other.true_pose


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ours-dh", "dwa-dh", "fusion"])
@pytest.mark.parametrize(
    ("robot", "lidar"),
    [("tiago", FRONT_LIDAR), ("tiago", LidarSpec(num_beams=720, rate=10.0)), ("tiago", HALF), ("go2", FRONT_LIDAR)],
)
def test_a_robot_arrives_by_the_lidar_it_has(robot, lidar, method):
    body = with_lidar(robot, lidar)
    world = make_world("static", 1, footprint_radius=body.spec.radius)
    simulation = Simulation(world, body, 1, noise=NoiseConfig())
    navigator = build(resolve(method), body.spec, body.lidar)
    scan, odometry = simulation.reset()
    navigator.reset(world.start, world.goal)
    while simulation.time < 60.0 and math.dist(simulation.true_pose[:2], world.goal) > GOAL_TOLERANCE:
        scan, odometry = simulation.step(navigator.step(scan, odometry))
        assert simulation.contact is None
        assert not simulation.fallen
    assert math.dist(simulation.true_pose[:2], world.goal) <= GOAL_TOLERANCE
    assert math.dist(navigator.map_from_base[:2], simulation.true_pose[:2]) < 0.15
