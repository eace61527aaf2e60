"""Worlds by name: same seed, same world; options and difficulties."""

import math
from dataclasses import replace

import pytest

from tests.vuca_nav.rooms import disc_body
from vuca_nav.errors import BadArgument, BadWorld, UnknownName
from vuca_nav.types import Pose2
from worlds import WORLDS, load_scene, make_world, save_scene
from worlds.arrays import pack_shapes
from worlds.checks import check_task
from worlds.clearance import clearance_at
from worlds.registry import CORRIDOR_KINDS, ordered_difficulties
from worlds.scenes.parts.population import LARGEST_FOOTPRINT
from worlds.shortest_path import shortest_path_length
from worlds.world import Box, Cylinder, Obstacle, RandomWalk, SocialForce

NAMES = sorted(WORLDS)
MOVERS = {"factory": 40, "square": 24, "double_branch": 8, "building": 20, "static": 0, "dynamic": 20, "crossing": 20}
SPEEDS = {
    "factory": (0.2, 0.8),
    "square": (0.2, 2.0),
    "double_branch": (0.2, 0.8),
    "building": (0.5, 1.2),
    "dynamic": (0.2, 1.0),
}


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_same_world_other_seed_other_layout(name):
    worlds = [make_world(name, seed) for seed in range(4)]
    assert make_world(name, 2) == worlds[2]
    layouts = {(w.obstacles, w.start, w.goal) for w in worlds}
    assert len(layouts) == 4


@pytest.mark.parametrize("name", NAMES)
def test_without_v_only_the_movers_go(name):
    full, still = make_world(name, 5), make_world(name, 5, without="VA")
    assert len(full.movers) == MOVERS[name]
    assert still.movers == ()
    assert (still.obstacles, still.start, still.goal) == (full.obstacles, full.start, full.goal)


@pytest.mark.parametrize("name", NAMES)
def test_without_c_the_floor_is_open_and_walled_in(name):
    full, opened = make_world(name, 1), make_world(name, 1, without="C")
    assert (opened.movers, opened.start, opened.goal) == (full.movers, full.start, full.goal)
    inner = [o for o in opened.obstacles if o.kind in CORRIDOR_KINDS]
    assert len(inner) == 4  # the outer walls
    assert all(o.kind == "wall" for o in inner)
    straight = math.dist(opened.start[:2], opened.goal)
    assert shortest_path_length(opened, 0.3) < 1.1 * straight


def test_without_c_region_3_stays_closed_off_from_the_quarter_that_is_not_built():
    opened = make_world("factory", 1, region=3, without="C")
    assert sum(o.kind == "wall" for o in opened.obstacles) == 6
    assert 38.0 < shortest_path_length(opened, 0.3) < 60.0


@pytest.mark.parametrize("name", NAMES)
def test_every_seed_is_solvable_and_start_and_goal_have_room(name):
    for seed in range(20):
        world = make_world(name, seed)
        shapes = pack_shapes([o.shape for o in world.obstacles])
        for x, y in (world.start[:2], world.goal):
            assert clearance_at(shapes, x, y)[0] >= 0.6
        straight = math.dist(world.start[:2], world.goal)
        assert straight * 0.999 <= shortest_path_length(world, 0.45) < math.inf


@pytest.mark.parametrize("name", sorted(SPEEDS))
def test_movers_are_within_their_speeds_and_start_away_from_the_robot(name):
    speeds = []
    for seed in range(5):
        world = make_world(name, seed, footprint_radius=0.27)
        for mover in world.movers:
            assert math.dist(mover.start[:2], world.start[:2]) >= 2.0 + mover.radius + LARGEST_FOOTPRINT
            speeds.append(mover.motion.speed)
            assert isinstance(mover.motion, SocialForce if name == "building" else RandomWalk)
    low, high = SPEEDS[name]
    assert low <= min(speeds) < low + 0.2 * (high - low)
    assert high - 0.2 * (high - low) < max(speeds) <= high


def test_obstacles_are_seen_by_a_planar_lidar():
    for name in NAMES:
        for obstacle in make_world(name, 3).obstacles:
            assert obstacle.shape.base == 0.0
            assert obstacle.shape.height >= 0.35
            if obstacle.kind == "low":
                assert 0.4 <= obstacle.shape.height <= 0.7


def test_square_has_ten_roadblocks_and_one_on_the_straight_way():
    for seed in range(10):
        world = make_world("square", seed, movers=40)
        assert world.bounds == (0.0, 0.0, 24.0, 24.0)
        assert len(world.movers) == 40
        assert len({m.kind for m in world.movers}) == 4
        roadblocks = [o for o in world.obstacles if o.kind != "wall"]
        assert len(roadblocks) == 10
        shapes = pack_shapes([o.shape for o in roadblocks])
        (x0, y0), (x1, y1) = world.start[:2], world.goal
        on_line = [clearance_at(shapes, x0 + k / 500 * (x1 - x0), y0 + k / 500 * (y1 - y0))[0] for k in range(501)]
        assert min(on_line) == 0.0


def test_double_branch_short_way_is_the_crowded_one():
    for seed in range(6):
        world = make_world("double_branch", seed, movers=12)
        x_min, _, x_max, y_max = world.bounds
        crowded_left = world.goal[0] < (x_min + x_max) / 2
        assert len(world.movers) == 12
        assert all((m.start.x < x_max / 2) == crowded_left for m in world.movers)

        def barred(left, world=world, x_max=x_max, y_max=y_max):
            x = x_max / 4 if left else 3 * x_max / 4
            bar = Obstacle("wall", Box(x, y_max / 2, x_max / 2, 0.2, 0.0, 2.0))
            return replace(world, obstacles=(*world.obstacles, bar))

        short = shortest_path_length(barred(not crowded_left), 0.3)
        long = shortest_path_length(barred(crowded_left), 0.3)
        assert shortest_path_length(world, 0.3) == pytest.approx(short, abs=0.1)
        assert 1.2 * short < long < 2.5 * short


def test_building_is_wide_enough_for_people_at_its_doors():
    for seed in range(5):
        world = make_world("building", seed, movers=30)
        assert len(world.movers) == 30
        shapes = pack_shapes([o.shape for o in world.obstacles])
        for mover in world.movers:
            assert isinstance(mover.motion, SocialForce)
            for x, y in mover.motion.waypoints:
                assert clearance_at(shapes, x, y)[0] >= 0.4


@pytest.mark.parametrize(
    ("arguments", "options", "error", "text"),
    [
        (("factori", 0), {}, UnknownName, "did you mean 'factory'"),
        (("factory", -1), {}, BadArgument, "seed is 0 or more"),
        (("factory", 0), {"region": 5}, BadArgument, "--region 5: factory takes 1 to 4"),
        (("static", 0), {"movers": 5}, BadArgument, "--movers: static has nothing that moves"),
        (("static", 0), {"speed": 2.0}, BadArgument, "--speed: static has nothing that moves .only factory, square"),
        (("static", 0), {"sighted": 0.0}, BadArgument, "--sighted: static has nothing that moves"),
        (("factory", 0), {"movers": 81}, BadArgument, "--movers 81: factory takes 0 to 80"),
        (
            ("factory", 0),
            {"movers": 21, "region": 1},
            BadArgument,
            "--movers 21: factory takes 0 to 20 with --region 1",
        ),
        (("square", 0), {"speed": 3.0}, BadArgument, "--speed 3: a factor of 0 to 2.5"),
        (("square", 0), {"speed": -1.0}, BadArgument, "--speed -1: a factor of 0 to 2.5"),
        (("square", 0), {"speed": math.nan}, BadArgument, "--speed nan: a factor of 0 to 2.5"),
        (("square", 0), {"sighted": 1.5}, BadArgument, "--sighted 1.5: a share of 0 to 1"),
        (("square", 0), {"sighted": 0.5, "without": "V"}, BadArgument, "--sighted 0.5 does not go with --without V"),
        (("square", 0), {"movers": 41}, BadArgument, "--movers 41: square takes 0 to 40"),
        (("static", 0), {"region": 1}, BadArgument, "--region: static does not take it"),
        (("static", 0), {"without": "X"}, BadArgument, "unknown difficulty 'X'"),
        (("square", 0), {"movers": 3, "without": "UV"}, BadArgument, "--movers 3 does not go with --without V"),
        (("static", 0), {"footprint_radius": 0.0}, BadArgument, "footprint radius"),
        (("nowhere.yaml", 0), {}, BadWorld, "nowhere.yaml cannot be read: No such file"),
        (("factory", 0), {"footprint_radius": 1.5}, BadWorld, "a smaller body"),
    ],
)
def test_bad_arguments(arguments, options, error, text):
    with pytest.raises(error, match=text):
        make_world(*arguments, **options)


def test_scene_file_by_path(tmp_path):
    world = make_world("building", 2)
    path = str(tmp_path / "scene.yaml")
    save_scene(world, path)
    assert make_world(path, 7) == load_scene(path) == world
    assert make_world(path, 0, without="VC") == make_world("building", 2, without="VC")
    with pytest.raises(BadArgument, match="--region"):
        make_world(path, 0, region=1)
    with pytest.raises(BadWorld, match=r"goal: no way leads from the start .* 1.90 m wide"):  # making it asks no body
        check_task(make_world(path, 0), disc_body(0.9).footprint)


def test_pillars_survive_an_open_floor():
    world = make_world("factory", 3, without="C")
    assert any(isinstance(o.shape, Cylinder) and o.kind == "pillar" for o in world.obstacles)


@pytest.mark.parametrize("name", ["factory", "square", "double_branch", "building"])
def test_movers_are_the_same_for_every_body_that_gets_the_same_layout(name):
    small, large = (make_world(name, 3, footprint_radius=radius) for radius in (0.2, 0.35))
    assert small.obstacles == large.obstacles
    assert small.movers == large.movers


@pytest.mark.parametrize("region", [1, 2, 3, 4])
def test_a_saved_factory_keeps_its_enclosure_without_corridors(region, tmp_path):
    """Region 3 has two walls that stand far from its bounds."""
    save_scene(make_world("factory", 2, region=region), tmp_path / "scene.yaml")
    opened = make_world(str(tmp_path / "scene.yaml"), 0, without="C")
    assert opened == make_world("factory", 2, region=region, without="C")
    walls = [o for o in opened.obstacles if o.kind == "wall"]
    assert len(walls) == (6 if region == 3 else 4)
    assert all(wall.outer for wall in walls)


def test_a_wall_at_the_bounds_is_an_inner_one_unless_it_is_said_to_be_outer(tmp_path):
    world = make_world("static", 0)
    beside = Obstacle("wall", Box(0.25, 8.0, 0.1, 3.0, 0.0, 2.0))
    save_scene(replace(world, obstacles=(*world.obstacles, beside)), tmp_path / "scene.yaml")
    assert beside not in make_world(str(tmp_path / "scene.yaml"), 0, without="C").obstacles


def test_a_building_without_room_for_its_people_says_so(monkeypatch):
    monkeypatch.setattr("worlds.scenes.building.START_DISTANCE", 100.0)
    with pytest.raises(BadWorld, match=r"no free place for person 1 of 20 in 4000 tries"):
        make_world("building", 0)


def test_difficulties_in_their_order_each_once():
    assert ordered_difficulties("") == ""
    assert ordered_difficulties("AAVU") == "VUA"


def test_the_ways_of_the_double_branch_are_beside_its_block_and_only_the_short_one_is_crowded():
    for seed in range(6):
        world = make_world("double_branch", seed, movers=8)
        assert [way.name for way in world.ways] == ["short", "quiet"]
        assert {world.way_of(mover.start) for mover in world.movers} <= {"short", None}
        assert world.way_of(world.start) is None
        assert world.way_of(Pose2(*world.goal, 0.0)) is None
        for way in world.ways:
            x = 0.5 * (way.box[0] + way.box[2])
            assert world.way_of(Pose2(x, 0.5 * (way.box[1] + way.box[3]), 0.0)) == way.name
