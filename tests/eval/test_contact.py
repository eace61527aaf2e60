"""Classes of contacts: two bodies in an empty hall, with known speeds and bearings."""

import math
from dataclasses import replace

import pytest

from eval.contact import CONTACT_CLASSES, classify_contact
from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.simulation import Simulation
from robots.witness import LOST_SIGHT, ContactFacts
from tests.robots.halls import hall
from vuca_nav.types import Pose2, VelocityCommand
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol

TIAGO = make_body("tiago")
REACH = 0.265
"""Radius of TIAGo's base [m]."""


def person(*waypoints, speed=0.8, sighted=None):
    """A person of 0.2 m radius; the robot starts at (30, 30), ahead is +x."""
    start = Pose2(waypoints[0][0], waypoints[0][1], 0.0)
    part = MoverPart(Cylinder(0.0, 0.0, 0.2, 1.7))
    return Mover("person", (part,), 0.2, start, Patrol(speed, waypoints), sighted)


def first_contact(command, *movers, obstacles=(), body=TIAGO):
    world = hall()
    world = replace(world, movers=movers, obstacles=(*world.obstacles, *obstacles))
    simulation = Simulation(world, body, 0, noise=NoiseConfig.none())
    simulation.reset()
    while simulation.contact is None and simulation.time < 20.0:
        simulation.step(VelocityCommand(*command))
    assert simulation.contact_facts is not None
    return classify_contact(simulation.contact_facts)


AHEAD, BEHIND, LEFT = ((34.0, 30.0), (20.0, 30.0)), ((26.0, 30.0), (45.0, 30.0)), ((30.0, 34.0), (30.0, 20.0))
ASIDE = (32.0, 34.0), (32.0, 20.0)


@pytest.mark.parametrize(
    ("command", "route", "speed", "expected", "own", "bearing"),
    [
        ((0.0, 0.0, 0.0), AHEAD, 0.8, "stopped", False, 0.0),
        ((0.0, 0.0, 1.0), LEFT, 0.8, "stopped", None, None),  # it turns on the spot
        ((0.5, 0.0, 0.0), AHEAD, 0.8, "front", True, 0.0),
        ((0.5, 0.0, 0.0), AHEAD, 0.0, "static", True, 0.0),
        ((0.5, 0.0, 0.0), AHEAD, 0.04, "static", True, 0.0),
        ((0.5, 0.0, 0.0), BEHIND, 1.2, "yielding", False, 180.0),
        ((-0.2, 0.0, 0.0), AHEAD, 0.8, "yielding", False, 0.0),
        ((-0.2, 0.0, 0.0), BEHIND, 0.3, "rear", True, 180.0),
        ((0.4, 0.0, 0.0), ASIDE, 0.72, "side", True, None),
    ],
)
def test_classes(command, route, speed, expected, own, bearing):
    contact = first_contact(command, person(*route, speed=speed))
    assert contact.contact_class == expected
    assert contact.other == "person_0"
    if own is not None:
        assert contact.own == own
    if bearing is not None:
        assert abs(math.degrees(contact.bearing)) == pytest.approx(bearing, abs=5.0)
    assert contact.other_speed == pytest.approx(speed, abs=1e-6)


def test_speeds_are_those_before_the_impact_and_times_count_from_the_start():
    contact = first_contact((0.5, 0.0, 0.0), person(*AHEAD))
    assert contact.robot_speed == pytest.approx(0.5, abs=0.01)
    assert contact.closing == pytest.approx(1.3, abs=0.02)
    # 4 m less both radii at 1.3 m/s, and half of 0.5 s to get up to speed.
    met = (4.0 - 0.2 - REACH + 0.5 * 0.5 * 0.5) / 1.3
    assert contact.straight_for == pytest.approx(met, abs=0.05)
    assert contact.in_sight_for == pytest.approx(met, abs=0.05)
    yielding = first_contact((0.5, 0.0, 0.0), person(*BEHIND, speed=1.2))
    assert yielding.closing == pytest.approx(0.7, abs=0.02)


def test_own_is_of_the_point_of_contact_and_stopped_of_the_robot():
    """A robot that turns on the spot stands, though its corner may close in."""
    pillar = Obstacle("pillar", Cylinder(32.0, 29.7, 0.2, 1.7))
    straight = first_contact((0.3, 0.0, 0.0), obstacles=(pillar,))
    assert (straight.contact_class, straight.own, straight.other) == ("static", True, "pillar_4")
    assert straight.closing == pytest.approx(0.3, abs=0.01)  # on the flat front of the base
    assert (straight.other_speed, straight.straight_for) == (0.0, None)
    turned = replace(facts(), robot_velocity=(0.0, 0.0), point_velocity=(0.3, 0.0))
    assert (classify_contact(turned).contact_class, classify_contact(turned).own) == ("stopped", True)


def test_straight_for_counts_from_the_last_turn():
    route = (33.0, 31.0), (33.0, 30.0), (20.0, 30.0)
    contact = first_contact((0.0, 0.0, 0.0), person(*route, speed=0.5))
    assert contact.straight_for == pytest.approx((3.0 - 0.2 - REACH) / 0.5, abs=0.1)
    assert contact.in_sight_for == pytest.approx(2.0 + (3.0 - 0.2 - REACH) / 0.5, abs=0.1)


def test_in_sight_for_counts_from_where_it_came_out():
    screen = Obstacle("wall", Box(31.0, 32.0, 0.1, 2.0, 0.0, 2.0))  # y from 31 to 33
    route = (32.2, 34.4), (32.2, 30.0), (20.0, 30.0)
    contact = first_contact((0.0, 0.0, 0.0), person(*route, speed=0.5), obstacles=(screen,))
    # Its edge is seen past the screen's end at y = 31 on a line from the robot; then it is at most 2.2 m off.
    appeared = (34.4 - 32.6) / 0.5
    assert appeared - 1.0 < 8.8 + (2.2 - 0.2 - REACH) / 0.5 - contact.in_sight_for < appeared + 1.0


def test_what_the_lidar_cannot_see_was_not_in_sight():
    low = Obstacle("low", Cylinder(31.0, 30.0, 0.2, 0.06))
    contact = first_contact((0.5, 0.0, 0.0), obstacles=(low,))
    assert (contact.contact_class, contact.in_sight_for) == ("static", 0.0)


def facts(**changes):
    base = ContactFacts(
        "cart_3", "cart", 9.0, (1.0, 0.0), (1.0, 0.0), 0.0, (0.5, 0.0), (0.5, 0.0), (-0.5, 0.0), 2.0, 3.0
    )
    return replace(base, **changes)


@pytest.mark.parametrize(
    ("changes", "expected", "own"),
    [
        ({"other_velocity": (0.05, 0.0)}, "static", True),
        ({"other_velocity": (0.051, 0.0)}, "front", True),
        ({"other_velocity": (0.05, 0.0), "robot_velocity": (0.0, 0.0)}, "static", True),
        ({"robot_velocity": (0.03, 0.04)}, "stopped", True),
        ({"robot_velocity": (0.03, 0.05), "point_velocity": (-0.06, 0.0)}, "yielding", False),
        ({"point_velocity": (-0.05, 0.0)}, "front", False),
        ({"point_velocity": (0.05, 3.0)}, "front", False),
        ({"bearing": math.radians(44.9)}, "front", True),
        ({"bearing": -math.radians(45.1)}, "side", True),
        ({"bearing": -math.radians(134.9)}, "side", True),
        ({"bearing": math.radians(135.1)}, "rear", True),
        ({"normal": (0.0, 1.0)}, "front", False),
    ],
)
def test_the_rules_bounds_and_their_order(changes, expected, own):
    contact = classify_contact(facts(**changes))
    assert (contact.contact_class, contact.own) == (expected, own)
    assert contact.contact_class in CONTACT_CLASSES


def test_a_row_has_the_names_that_others_rely_on():
    assert classify_contact(facts()).row() == {
        "class": "front", "own": True, "with": "cart_3", "robot_speed": 0.5, "other_speed": 0.5, "closing": 1.0,
        "bearing": 0.0, "straight_for": 2.0, "in_sight_for": 3.0,
    }  # fmt: skip


def test_a_short_gap_is_still_in_sight():
    """A thin leg between two beams now and then: what counts is the whole time."""
    leg = MoverPart(Cylinder(0.0, 0.0, 0.03, 1.0))
    walker = Mover("legs", (leg,), 0.03, Pose2(36.0, 30.0, 0.0), Patrol(1.0, ((36.0, 30.0), (20.0, 30.0))))
    contact = first_contact((0.0, 0.0, 0.0), walker)
    assert contact.in_sight_for == pytest.approx(6.0 - REACH, abs=LOST_SIGHT + 0.2)
