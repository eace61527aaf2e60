"""The factory's promises, verified on its geometry."""

import math
from itertools import pairwise

import numpy as np
import pytest

from worlds import make_world
from worlds.arrays import pack_shapes
from worlds.clearance import clearance_at, clearance_field
from worlds.scenes.factory import QUARTER_BOUNDS, factory_lattice
from worlds.scenes.parts.generation import reachable_cells, rectangle
from worlds.shortest_path import shortest_path

CASES = [(region, seed) for region in (1, 2, 3, 4) for seed in range(4)]


def section_line(lattice, a, b):
    """Centre line of a section between two junctions of one quarter: two ends and the lane's direction."""
    (i, j), (k, _) = min(a, b), max(a, b)
    if i != k:
        (x0, x1), y = lattice.x.gap(i), lattice.y.centre(j)
        return (x0, y), (x1, y), True
    x, (y0, y1) = lattice.x.centre(i), lattice.y.gap(j)
    return (x, y0), (x, y1), False


def free_width(shapes, x, y, along_x):
    """Length of the free stretch across a lane that holds a point, to a centimetre."""
    sides = []
    for sign in (-1.0, 1.0):
        k = 0
        while k < 600:
            step = sign * 0.01 * k
            if clearance_at(shapes, x + (0 if along_x else step), y + (step if along_x else 0))[0] <= 1e-9:
                break
            k += 1
        sides.append(0.01 * k)
    return sum(sides)


@pytest.mark.parametrize(("region", "seed"), CASES)
def test_ten_movers_start_in_each_quarter(region, seed):
    world = make_world("factory", seed, region=region)
    assert len(world.movers) == 10 * region
    for quarter in range(1, region + 1):
        x0, y0, x1, y1 = QUARTER_BOUNDS[quarter]
        there = [m for m in world.movers if x0 < m.start.x < x1 and y0 < m.start.y < y1]
        assert len(there) == 10
        assert {m.kind for m in there} == {"cylinder", "cart", "legs"}
        assert max(m.radius for m in there) <= 0.36


def test_start_and_goal_are_in_the_corners():
    ends = {1: (20, 20), 2: (40, 20), 3: (40, 40), 4: (0, 40)}
    for region, corner in ends.items():
        world = make_world("factory", 0, region=region)
        assert math.dist(world.start[:2], (0, 0)) < 2.5
        assert math.dist(world.goal, corner) < 2.5


def test_quarters_are_passed_in_turn():
    """The first and the last quarter touch, but no door joins them: region 4 is the longest."""
    for seed in range(4):
        world = make_world("factory", seed)
        path = shortest_path(world, 0.3)
        dense = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(path)])
        quarters = [
            q for x, y in dense for q, (x0, y0, x1, y1) in QUARTER_BOUNDS.items() if x0 < x < x1 and y0 < y < y1
        ]
        assert sorted(set(quarters)) == [1, 2, 3, 4]
        assert quarters[0] == 1
        assert quarters[-1] == 4
        turns = [b for a, b in pairwise(quarters) if a != b]
        assert turns[:1] == [2]
        assert np.hypot(*np.diff(path, axis=0).T).sum() > 70.0


@pytest.mark.parametrize(("region", "seed"), CASES)
def test_corridors_are_between_1_8_and_3_metres_wide(region, seed):
    world, lattice = make_world("factory", seed, region=region), factory_lattice(seed, region)
    shapes = pack_shapes([o.shape for o in world.obstacles])
    widths = []
    for section in sorted(tuple(sorted(s)) for s in lattice.open_sections):
        a, b = section
        if lattice.quarter(a) != lattice.quarter(b):
            continue
        (x0, y0), (x1, y1), along_x = section_line(lattice, a, b)
        for share in (0.15, 0.5, 0.85):
            widths.append(free_width(shapes, x0 + share * (x1 - x0), y0 + share * (y1 - y0), along_x))
    assert min(widths) >= 1.78
    assert max(widths) <= 3.02
    assert region < 3 or min(widths) < 2.2  # refuges
    assert np.mean(np.array(widths) >= 2.3) > 0.4  # room for the movers


@pytest.mark.parametrize(("region", "seed"), CASES)
def test_nothing_narrows_a_corridor_below_1_8_metres(region, seed):
    """A disc of 1.75 m (1.8 m less the grid's error) gets from the start to every open junction."""
    world, lattice = make_world("factory", seed, region=region), factory_lattice(seed, region)
    reached = reachable_cells(field := clearance_field(world.obstacles, world.bounds, 0.05), world.start[:2], 0.875)
    for section in lattice.open_sections:
        for junction in section:
            assert reached[field.cell(*lattice.point(junction))]


@pytest.mark.parametrize(("region", "seed"), CASES)
def test_blind_alleys(region, seed):
    """Two a quarter: 5 m deep, a dead end, the mouth on the straight way to the goal, and on the shortest way."""
    world, lattice = make_world("factory", seed, region=region), factory_lattice(seed, region)
    shapes = pack_shapes([o.shape for o in world.obstacles])
    path = shortest_path(world, 0.3)
    dense = np.concatenate([np.linspace(a, b, 400) for a, b in pairwise(path)])
    on_the_way = np.zeros(5, int)
    for alley in lattice.alleys:
        (i, j), (k, m), end = alley.junctions[0], alley.junctions[1], alley.junctions[-1]
        step = np.array([k - i, m - j])
        x, y = lattice.point((i, j))
        reach = lattice.x.width(i) / 2 if step[0] else lattice.y.width(j) / 2
        half_mouth = lattice.y.width(j) / 2 if step[0] else lattice.x.width(i) / 2
        mouth = np.array([x, y]) + reach * step

        # Straight on from the mouth there are at least 5 m of free way.
        depth = 0.0
        while clearance_at(shapes, *(mouth + (depth + 0.02) * step))[0] > 0.0:
            depth += 0.02
        assert depth >= 5.0
        assert depth >= alley.depth - 0.05

        # With the mouth walled up nothing leads out; with it open, something does.
        across = np.array([step[1], step[0]]) * (half_mouth + 0.3)
        a, b = mouth + 0.35 * step - np.abs(across) - 0.01, mouth + 0.35 * step + np.abs(across) + 0.01
        plug = rectangle("wall", *(a - 0.1 * np.abs(step)), *(b + 0.1 * np.abs(step)))
        plugged = clearance_field((*world.obstacles, plug), world.bounds)
        inside = reachable_cells(plugged, lattice.point(end), 0.2)
        assert inside.any()
        assert not inside[plugged.cell(*world.start[:2])]
        assert not inside[plugged.cell(*world.goal)]
        assert inside.sum() * 0.01 < 90.0  # m^2: the alley, and the niches at its sides
        opened = clearance_field(world.obstacles, world.bounds)
        assert reachable_cells(opened, world.start[:2], 0.3)[opened.cell(*lattice.point(end))]

        # The straight line from the junction to the goal leaves through the mouth.
        to_goal = np.array(world.goal) - (x, y)
        share = reach / float(to_goal @ step)
        assert 0.0 < share < 1.0
        crossing = np.array([x, y]) + share * to_goal
        assert np.abs((crossing - mouth) @ np.array([step[1], step[0]])) < half_mouth

        corner = math.hypot(lattice.x.width(i), lattice.y.width(j)) / 2
        on_the_way[alley.quarter] += np.hypot(*(dense - (x, y)).T).min() <= corner
    assert (on_the_way[1 : region + 1] >= 2).all()
