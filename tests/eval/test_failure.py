"""Classes of missions that neither arrived nor ended in a contact."""

from dataclasses import replace

import pytest

from eval.failure import Trail, classify_failure, is_out_of_reach
from robots.registry import make_body
from tests.robots.halls import hall
from vuca_nav.types import Pose2
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol, World


def trail_of(places, period=1.0 / 30.0):
    trail = Trail()
    for k, (x, y) in enumerate(places):
        trail.add(k * period, Pose2(x, y, 0.0))
    return trail


def failure(places, period=1.0 / 30.0, **changes):
    (x, y), time = places[-1], len(places) * period
    given = {
        "fallen": False, "out_of_reach": False, "slam_error": 0.1, "time": time, "end": Pose2(x, y, 0.0),
        "trail": trail_of(places, period), "way": 24.0, "shortest": 8.0,
    }  # fmt: skip
    return classify_failure(**(given | changes)).row()


def test_stuck_says_where_and_since_when():
    there = [(0.1 * k / 3.0, 2.0) for k in range(600)]  # 20 s at 1 m/s, to x = 20 m
    row = failure([*there, *[(20.0, 2.0)] * 1200])
    assert row["class"] == "stuck"
    assert row["where"] == [20.0, 2.0]
    assert row["since"] == pytest.approx(19.0, abs=0.6)  # when it came within a metre
    assert (row["detour"], row["mean_speed"]) == (3.0, pytest.approx(24.0 / 60.0))


def test_one_that_stays_for_less_than_half_a_minute_is_out_of_time():
    there = [(0.1 * k / 3.0, 2.0) for k in range(600)]
    assert failure([*there, *[(20.0, 2.0)] * 800])["class"] == "out_of_time"
    assert failure(there)["class"] == "out_of_time"


def test_one_that_never_left_is_stuck_from_the_start():
    row = failure([(3.0, 3.0)] * 3000)
    assert (row["class"], row["since"]) == ("stuck", 0.0)


def test_the_first_class_that_fits():
    places = [(3.0, 3.0)] * 3000
    assert failure(places, slam_error=0.6)["class"] == "lost"
    assert failure(places, slam_error=0.6, out_of_reach=True)["class"] == "unreachable"
    assert failure(places, slam_error=0.6, out_of_reach=True, fallen=True)["class"] == "fall"


def corridor(*movers):
    walls = tuple(Obstacle("wall", Box(10.0, y, 20.0, 0.2, 0.0, 2.0), outer=True) for y in (0.1, 1.9))
    return World("corridor", 0, (0.0, 0.0, 20.0, 2.0), walls, movers, Pose2(2.0, 1.0, 0.0), (18.0, 1.0))


def plug(speed, sighted=None):
    part = MoverPart(Cylinder(0.0, 0.0, 0.6, 1.0))
    return Mover("cylinder", (part,), 0.6, Pose2(10.0, 1.0, 0.0), Patrol(speed, ((10.0, 1.0), (17.0, 1.0))), sighted)


def test_a_goal_behind_what_never_leaves_the_corridor_is_out_of_reach():
    tiago = make_body("tiago")
    assert not is_out_of_reach(corridor(), tiago, 60.0)
    assert is_out_of_reach(corridor(plug(0.0)), tiago, 60.0)
    assert not is_out_of_reach(corridor(plug(0.0, sighted=True)), tiago, 60.0)  # it might make way
    assert is_out_of_reach(corridor(), tiago, 10.0)  # 16 m at 1 m/s
    assert not is_out_of_reach(hall(), tiago, 100.0)


def test_a_start_as_tight_as_the_body_counts_as_within_reach():
    """The cells of the grid about it are barred, which says nothing about the goal."""
    tiago = make_body("tiago")
    assert not is_out_of_reach(replace(hall(), start=Pose2(30.0, 0.16, 0.0)), tiago, 100.0)
