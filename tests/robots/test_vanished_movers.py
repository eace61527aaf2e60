"""A mover that is not there is nowhere: not in the lidar, in contacts, clearance, the oracle's future, a recording."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eval.baselines.oracle.truth import foreseen
from robots.noise import NoiseConfig
from robots.simulation import Simulation
from tests.robots.halls import hall
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, Pose2
from worlds.world import Box, Cylinder, Keyframes, Mover, MoverPart

APPEARS, GOES = 1.0, 2.0
PLACE = (32.0, 30.0)
"""Where it is while it is there, 2 m ahead of the robot [m]."""


class Places(Telemetry):
    """Keeps what the simulation reports of the movers."""

    def __init__(self):
        self.shapes, self.poses = [], []

    def mover_model(self, parts):
        self.shapes = list(parts)

    def movers(self, poses):
        self.poses.append(poses.copy())


def visitor(place=PLACE):
    parts = (MoverPart(Cylinder(0.0, 0.0, 0.3, 1.5)), MoverPart(Box(0.0, 0.0, 0.2, 0.2, 0.0, 1.7)))
    motion = Keyframes((APPEARS, GOES), (place, place), vanishes=True)
    return Mover("person", parts, 0.3, Pose2(place[0], place[1], 0.0), motion)


def visited(tiago, place=PLACE, telemetry=None):
    world = replace(hall(), movers=(visitor(place),))
    return Simulation(world, tiago, 0, noise=NoiseConfig.none(), telemetry=telemetry)


def test_lidar_and_clearance_meet_it_while_it_is_there_alone(tiago):
    simulation = visited(tiago)
    scan, _ = simulation.reset()
    empty = hall_alone(tiago)
    for _ in range(90):
        there = APPEARS - 1e-6 <= simulation.time <= GOES + 1e-6
        ahead = scan.ranges[len(scan.ranges) // 2]
        if there:
            assert ahead == pytest.approx(1.7, abs=0.01)
            assert simulation.clearance < 1.5
        else:
            assert ahead == math.inf  # the hall's walls are out of range
            assert simulation.clearance == pytest.approx(empty, abs=0.01)
        scan, _ = simulation.step(STOP)


def hall_alone(tiago):
    simulation = Simulation(hall(), tiago, 0, noise=NoiseConfig.none())
    simulation.reset()
    return simulation.clearance


def test_it_touches_the_robot_only_while_it_is_there(tiago):
    simulation = visited(tiago, (30.0, 30.0))  # on the robot
    simulation.reset()
    while simulation.time < APPEARS - 0.05:
        simulation.step(STOP)
        assert simulation.contact is None
    for _ in range(5):
        simulation.step(STOP)
    assert simulation.contact == "person"
    assert simulation.contact_name is not None
    assert simulation.contact_facts is not None
    assert simulation.contact_facts.name == "person_0"


def test_the_oracle_foresees_when_it_comes_and_goes(tiago):
    simulation = visited(tiago)
    simulation.reset()
    future = foreseen(simulation.movers, 3.0, None)
    there = np.isfinite(future.movers[:, 0, 0])
    times = np.arange(len(there)) / 30.0
    np.testing.assert_array_equal(there, (times >= APPEARS - 1e-6) & (times <= GOES + 1e-6))
    assert np.isfinite(future.parts[:, :, 0]).all(axis=1).tolist() == there.tolist()
    np.testing.assert_allclose(future.movers[there, 0], [PLACE] * there.sum())


def test_telemetry_is_told_that_it_is_not_there(tiago):
    places = Places()
    simulation = visited(tiago, telemetry=places)
    simulation.reset()
    for _ in range(75):
        simulation.step(STOP)
    assert all(shape.vanishes for shape in places.shapes)
    there = np.isfinite(np.array(places.poses)[:, :, 0])
    assert not there[0].any()
    assert there[45].all()
    assert not there[-1].any()
