"""Shortest ways and space-time reachability against answers known beforehand."""

import math
from dataclasses import replace

import numpy as np
import pytest

import worlds.fairness
from tests.vuca_nav.rooms import disc_body
from vuca_nav.errors import BadWorld, VucaError
from vuca_nav.types import Pose2
from worlds import make_world
from worlds.checks import check_task
from worlds.fairness import fairness
from worlds.reachability import reachable
from worlds.shortest_path import occupancy, shortest_path, shortest_path_length
from worlds.widest_way import widest_way
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol, World

TIAGO = 0.285
"""Radius that holds TIAGo's footprint [m]."""
ROUND = disc_body(TIAGO).footprint
"""An outline of that radius: by the rule it needs ways of 0.67 m."""
LONG = np.array([(0.34, -0.19), (0.34, 0.19), (-0.36, 0.19), (-0.36, -0.19)])
"""An outline about as long and as wide as the Go2's: by the rule it needs ways of 0.48 m."""


def hall(*obstacles, movers=(), start=(2.1, 5.1), goal=(18.1, 5.1)):
    """20 x 10 m, walled in by its bounds."""
    return World("hall", 0, (0.0, 0.0, 20.0, 10.0), obstacles, movers, Pose2(start[0], start[1], 0.0), goal)


def wall_with_gap(x, gap_from, gap_to):
    low = Obstacle("wall", Box(x, gap_from / 2, 0.2, gap_from, 0.0, 2.0))
    high = Obstacle("wall", Box(x, (gap_to + 10.0) / 2, 0.2, 10.0 - gap_to, 0.0, 2.0))
    return low, high


def plug(*waypoints, speed=1.0, radius=0.6):
    part = MoverPart(Cylinder(0.0, 0.0, radius, 1.0))
    return Mover("cylinder", (part,), radius, Pose2(waypoints[0][0], waypoints[0][1], 0.0), Patrol(speed, waypoints))


def test_occupancy_of_a_box():
    world = hall(Obstacle("block", Box(10.0, 5.0, 2.0, 1.0, 0.0, 1.0)))
    for inflation, area in ((0.0, 2.0), (0.5, 2.0 + 3.0 + math.pi / 4)):
        grid = occupancy(world, 0.05, inflation)
        inner = grid.blocked[40:160, 40:360]  # without the inflated bounds
        assert inner.sum() * 0.05**2 == pytest.approx(area, rel=0.03)
        assert grid.blocked[grid.cell(10.9, 5.4)]
    assert not grid.blocked[grid.cell(10.0, 6.1)]


def test_shortest_path_in_an_empty_hall_is_the_straight_line_at_any_angle():
    for goal in ((18.1, 5.1), (17.3, 9.1), (9.4, 9.3), (4.4, 9.3)):
        world = hall(goal=goal)
        assert shortest_path_length(world, 0.3) == pytest.approx(math.dist((2.1, 5.1), goal), rel=1e-3)
        assert len(shortest_path(world, 0.3)) == 2


def test_shortest_path_round_a_thin_wall():
    """A disc of radius r goes round the wall's end on an arc of radius r: two tangents and the arc."""
    r = 0.5
    world = hall(Obstacle("wall", Box(10.1, 3.0, 0.001, 6.0, 0.0, 2.0)), start=(6.1, 3.1), goal=(14.1, 3.1))
    # In the triangle of start, wall end and disc centre: the tangent's length, and what the arc leaves of the turn.
    away, half_turn = math.hypot(4.0, 2.9), math.atan2(4.0, 2.9)
    expected = 2 * math.sqrt(away**2 - r**2) + r * (2 * math.pi - 2 * half_turn - 2 * math.acos(r / away))
    assert shortest_path_length(world, r) == pytest.approx(expected, rel=0.01)


def test_no_shortest_path_through_a_gap_that_is_too_narrow():
    world = hall(*wall_with_gap(10.0, 4.6, 5.4))
    assert shortest_path_length(world, 0.3) < 17.0
    assert shortest_path_length(world, 0.5) == math.inf


@pytest.mark.parametrize(("footprint", "rule"), [(ROUND, 0.67), (LONG, 0.48)])
def test_a_way_is_one_if_the_footprint_and_ten_centimetres_fit_through(footprint, rule):
    """Wherever the gap lies between the cells of a grid: a task is refused or has a length."""
    for width in np.arange(rule - 0.09, rule + 0.1, 0.02):
        for shift in (0.0, 0.013, 0.025, 0.05):
            world = hall(*wall_with_gap(10.0, 5.0 + shift - width / 2, 5.0 + shift + width / 2))
            if width > rule:
                assert 16.0 <= check_task(world, footprint) < 17.0
            else:
                with pytest.raises(BadWorld, match=f"goal: no way leads .* that is {rule:.2f} m wide"):
                    check_task(world, footprint)


@pytest.mark.parametrize("width", [0.2, 0.37, 0.612, 0.66])
@pytest.mark.parametrize("middle", [5.0, 5.03, 4.982])
def test_a_narrow_way_is_refused_with_its_place_and_width(width, middle):
    world = hall(*wall_with_gap(10.0, middle - width / 2, middle + width / 2))
    neck = widest_way(world, 0.335)
    assert neck is not None
    assert neck.width == pytest.approx(width, abs=0.01)
    assert neck.place == pytest.approx((10.0, middle), abs=0.12)
    if width < 0.65:
        said = rf"the widest is {neck.width:.2f} m wide at \({neck.place[0]:.2f}, {neck.place[1]:.2f}\)"
        with pytest.raises(BadWorld, match=said):
            check_task(world, ROUND)


def test_the_widest_way_is_that_of_the_wider_gap_at_any_angle():
    """Two gaps between cylinders in a slanted row: 0.50 m and 0.60 m."""
    c, s = math.cos(0.4), math.sin(0.4)
    row, along = [], -6.0
    for gap in (0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0):
        along += gap + 1.0
        row.append(Obstacle("pillar", Cylinder(10.0 - s * along, 5.0 + c * along, 0.5, 2.0)))
    neck = widest_way(hall(*(o for o in row if -0.4 < o.shape.y < 10.4)), 0.3)
    assert neck is not None
    assert neck.width == pytest.approx(0.6, abs=0.01)


def test_where_all_is_walled_up_no_width_is_told():
    world = hall(Obstacle("wall", Box(10.0, 5.0, 0.02, 10.0, 0.0, 2.0)))  # thinner than a cell
    assert widest_way(world, 0.3) is None
    with pytest.raises(BadWorld, match="all ways are walled up"):
        check_task(world, ROUND)


def test_a_place_within_the_tolerance_stands_for_a_goal_beside_a_wall():
    """Its cell's centre is too near to the wall, and so is the goal itself; a place within 0.3 m is not."""
    wall = Obstacle("wall", Box(0.1, 5.0, 0.2, 10.0, 0.0, 2.0))
    for x in (0.3, 0.4, 0.487, 0.55):
        length = check_task(hall(wall, goal=(x, 4.0)), ROUND)
        assert math.hypot(2.1 - x, 1.1) - 0.3 <= length <= math.hypot(2.1 - x, 1.1) + 0.05
    assert check_task(hall(wall, start=(0.49, 4.0), goal=(2.1, 5.1)), ROUND) < 2.1
    assert check_task(hall(goal=(10.0, 0.35)), ROUND) < 10.0
    with pytest.raises(BadWorld, match=r"goal: no way leads .* the widest is (0.40|0.39) m wide"):
        check_task(hall(wall, goal=(0.25, 4.0)), ROUND, tolerance=0.15)
    with pytest.raises(BadWorld, match=r"start: \(0.4, 4\) is 0.20 m from obstacles\[0\]"):
        check_task(hall(wall, start=(0.4, 4.0)), ROUND)


def test_a_long_body_may_stand_along_a_wall_where_it_could_not_stand_across():
    low = Obstacle("wall", Box(10.0, 4.75, 20.0, 0.1, 0.0, 2.0))  # its face is 0.3 m from the start
    assert check_task(hall(low), LONG) == pytest.approx(16.0, abs=0.2)
    assert check_task(hall(low, goal=(18.1, 8.1)), LONG) > 16.0
    turned = replace(hall(low), start=Pose2(2.1, 5.1, math.pi / 2))
    with pytest.raises(BadWorld, match=r"start: .* from obstacles\[0\]"):
        check_task(turned, LONG)


def test_start_and_goal_in_one_cell():
    world = hall(start=(2.11, 5.11), goal=(2.14, 5.15))
    assert shortest_path_length(world, 0.3) == pytest.approx(0.05)
    assert shortest_path(world, 0.3).shape == (2, 2)


def test_a_mover_on_the_start_is_refused():
    def with_mover(gap):
        return hall(movers=(plug((2.1 + 0.6 + TIAGO + gap, 5.1)),))

    assert check_task(with_mover(0.11), ROUND) == pytest.approx(16.0)
    for gap, said in ((0.09, "0.09 m from the body"), (-0.5, "-0.50 m from the body")):
        with pytest.raises(BadWorld, match=rf"start: movers\[0\] \(a cylinder\) begins at .* {said}"):
            check_task(with_mover(gap), ROUND)


def overhead(base, x=10.0, length=0.2, width=10.0):
    """Something that spans the hall, its lower face at ``base``."""
    return Obstacle("wall", Box(x, 5.0, length, width, 0.0, 0.3, base=base))


@pytest.mark.parametrize(
    ("base", "height", "passes"),
    [(2.1, 1.262, True), (2.5, 1.262, True), (1.262, 1.262, True), (1.26, 1.262, False), (0.6, 0.42, True),
     (0.4, 0.42, False), (0.0, 0.42, False)],
)  # fmt: skip
def test_a_beam_bars_the_bodies_that_are_taller_than_its_lower_face(base, height, passes):
    world = hall(overhead(base), start=(2.1, 5.1), goal=(18.1, 5.1))
    assert math.isfinite(shortest_path_length(world, TIAGO, height)) == passes
    assert reachable(world, TIAGO, 1.0, 30.0, height=height).reached == passes
    if passes:
        assert check_task(world, ROUND, height=height) == pytest.approx(16.0, rel=1e-3)
    else:
        with pytest.raises(BadWorld, match="goal: no way leads"):
            check_task(world, ROUND, height=height)


def test_a_lintel_leaves_the_door_below_it_as_wide_as_it_is():
    posts = wall_with_gap(10.0, 4.5, 5.5)
    lintel = Obstacle("wall", Box(10.0, 5.0, 0.2, 1.0, 0.0, 0.5, base=2.1))
    assert shortest_path_length(hall(*posts, lintel), TIAGO) == shortest_path_length(hall(*posts), TIAGO)
    assert shortest_path_length(hall(*posts, lintel), 0.55) == math.inf


def test_start_and_goal_may_lie_under_a_ceiling():
    ceiling = overhead(3.0, length=20.0)
    assert check_task(hall(ceiling), ROUND, height=1.262) == pytest.approx(16.0, rel=1e-3)
    pillar = Obstacle("pillar", Cylinder(18.1, 5.1, 0.3, 2.0))
    with pytest.raises(BadWorld, match=r"goal: \(18.1, 5.1\) is inside obstacles\[1\] \(a pillar\)"):
        check_task(hall(ceiling, pillar), ROUND, height=1.262)
    with pytest.raises(BadWorld, match=r"start: \(2.1, 5.1\) is inside obstacles\[0\] \(a wall\)"):
        check_task(hall(overhead(1.0, length=20.0), pillar), ROUND, height=1.262)


def test_a_mover_overhead_is_not_in_the_way():
    crane = replace(plug((2.1, 5.1)), parts=(MoverPart(Cylinder(0.0, 0.0, 0.6, 1.0, base=2.5)),))
    assert check_task(hall(movers=(crane,)), ROUND, height=1.262) == pytest.approx(16.0, rel=1e-3)
    assert reachable(hall(movers=(crane,)), TIAGO, 1.0, 30.0, height=1.262).reached
    with pytest.raises(BadWorld, match=r"start: movers\[0\]"):
        check_task(hall(movers=(crane,)), ROUND, height=2.6)


def test_fairness_is_of_the_worlds_that_the_body_gets(monkeypatch):
    asked = []

    def recorded(name, seed, **options):
        asked.append(options["footprint_radius"])
        return make_world(name, seed, **options)

    monkeypatch.setattr(worlds.fairness, "make_world", recorded)
    result = fairness("square", range(1), radius=0.31)
    assert asked == [0.31]
    assert result.lengths == (shortest_path_length(make_world("square", 0, footprint_radius=0.31), 0.31),)


@pytest.mark.parametrize("v_max", [0.5, 1.0])
def test_an_empty_hall_takes_distance_over_speed(v_max):
    result = reachable(hall(), 0.27, v_max, 100.0)
    assert result.reached
    assert result.time == pytest.approx(16.0 / v_max, abs=0.3 / v_max)
    diagonal = reachable(hall(goal=(6.1, 9.1)), 0.27, v_max, 100.0)
    assert diagonal.time == pytest.approx(4.0 * math.sqrt(2.0) / v_max, abs=0.4 / v_max)


def test_never_faster_than_v_max():
    for goal in ((18.1, 5.1), (15.7, 8.3), (4.3, 8.9)):
        assert reachable(hall(goal=goal), 0.27, 1.0, 100.0).time >= math.dist((2.1, 5.1), goal) - 1e-6


def test_the_horizon_counts():
    assert reachable(hall(), 0.27, 1.0, 16.5).reached
    result = reachable(hall(), 0.27, 1.0, 15.5)
    assert not result.reached
    assert result.time == math.inf


def test_a_closed_wall():
    world = hall(Obstacle("wall", Box(10.0, 5.0, 0.2, 10.0, 0.0, 2.0)))
    assert not reachable(world, 0.27, 1.0, 60.0).reached


def test_a_mover_that_plugs_the_only_gap_for_ever():
    gap = wall_with_gap(10.0, 4.3, 5.9)
    assert reachable(hall(*gap), 0.27, 1.0, 100.0).time == pytest.approx(16.0, abs=0.4)
    stuck = hall(*gap, movers=(plug((10.0, 5.1), speed=0.0),))
    assert not reachable(stuck, 0.27, 1.0, 100.0).reached


def test_a_mover_that_leaves_the_gap():
    """It goes 4 m to the right at 0.1 m/s; the disc waits at the gap, then follows it and overtakes in the open."""
    gap = wall_with_gap(10.0, 4.3, 5.9)
    leaving = hall(*gap, movers=(plug((10.0, 5.1), (14.0, 5.1), speed=0.1),))
    result = reachable(leaving, 0.27, 1.0, 100.0)
    # Passable once the mover is a diameter and more away: reach 0.27 + 0.6 m, so after about 8 s, then 8 m to go.
    assert 17.0 < result.time < 32.0


def test_a_fast_mover_in_a_corridor_cannot_be_jumped_over():
    """A piston fills the corridor and sweeps all of it faster than the disc runs: no way past, no refuge."""
    walls = (
        Obstacle("block", Box(10.0, 2.05, 12.0, 4.1, 0.0, 2.0)),
        Obstacle("block", Box(10.0, 8.05, 12.0, 3.9, 0.0, 2.0)),
    )
    piston = plug((15.0, 5.1), (5.0, 5.1), speed=4.0, radius=0.8)
    assert reachable(hall(*walls), 0.27, 1.0, 60.0).reached
    assert not reachable(hall(*walls, movers=(piston,)), 0.27, 1.0, 60.0).reached


def test_a_start_without_room_is_an_error():
    with pytest.raises(BadWorld, match="start: no room for a disc"):
        reachable(hall(start=(0.3, 5.0)), 0.27, 1.0, 10.0)


def test_factory_and_square_are_fair():
    """A sample; all 100 seeds of every region are the slow test below."""
    assert fairness("factory", range(5), radius=TIAGO, region=4).unsolved == ()
    square = fairness("square", range(10), radius=TIAGO)
    assert square.unsolved == ()
    straight = [math.dist(w.start[:2], w.goal) for w in (make_world("square", seed) for seed in range(10))]
    assert sum(square.times) < 1.2 * sum(straight)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "region"), [("factory", 1), ("factory", 2), ("factory", 3), ("factory", 4), ("square", None)]
)
def test_at_least_99_of_100_seeds_can_be_solved(world, region):
    assert len(fairness(world, range(100), radius=TIAGO, region=region).unsolved) <= 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"world": "nope"}, "unknown world 'nope'"),
        ({"seeds": 0}, "--seeds must be 1 or more, got 0"),
        ({"radius": 0.0}, "--radius must be 0.01 to 2 m, got 0.0"),
        ({"resolution": float("nan")}, "--resolution must be 0.02 to 2 m, got nan"),
    ],
)
def test_what_fairness_is_not_asked(changes, message):
    arguments = worlds.fairness.FairnessArguments("square", 0.3)
    with pytest.raises(VucaError, match=message):
        worlds.fairness.main(replace(arguments, **changes))
