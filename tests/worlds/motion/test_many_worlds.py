"""The kernels that step many worlds at once do what the single world's do."""

import math

import numpy as np
import pytest

from robots.bodies.tiago import FOOTPRINT
from robots.clearance import FootprintClearance, Outlines, PartTrajectories, StaticScenes, overlaps_batch
from vuca_nav.types import LidarSpec, Pose2
from worlds.arrays import pack_shapes
from worlds.clearance import clearance_field, distance_to_wide_ways
from worlds.level_raycast import CurrentParts, Standing, cast_level, level_columns
from worlds.motion.mover_columns import (
    DIRECTION,
    FIRST_WAYPOINT,
    MOTION,
    PATROL,
    RADIUS,
    RANDOM_WALK,
    SINCE_TURN,
    SPEED,
    STATE_SIZE,
    TARGET,
    WAYPOINTS,
)
from worlds.motion.movers import TICK, TURN_RATE, MoverField
from worlds.motion.walk import PATIENCE, MoverRows, PartRows, WideWays, walk_batch
from worlds.raycast import RayCaster
from worlds.registry import make_world
from worlds.scenes.parts.population import MOVER_WAY
from worlds.world import Box, Cylinder, Mover, MoverPart, Patrol, RandomWalk, World

NUM_BEAMS = 180
LIDAR = LidarSpec(num_beams=NUM_BEAMS)
ANGLES = LIDAR.angles_in_base()
BEAMS = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
ONE = np.zeros(1, np.int64)


def level_scan(shapes, pose, height=0.1, parts=(), part_poses=(), max_range=12.0):
    """One row of the batch caster."""
    static = level_columns(pack_shapes(shapes))
    moving = level_columns(pack_shapes(parts))[None]
    places = np.array([(x, y, math.cos(yaw), math.sin(yaw)) for x, y, yaw in part_poses]).reshape(1, -1, 4)
    ranges = np.empty((1, NUM_BEAMS))
    cast_level(
        ONE, np.array([pose], float), np.array([height]), ONE, Standing(static, np.array([0, len(shapes)])),
        CurrentParts(moving, places, np.array([len(parts)])), BEAMS, max_range, ranges,
    )  # fmt: skip
    return ranges[0]


def test_ranges_in_a_square_room_are_analytic():
    t = 0.2
    walls = [Box(5, -t / 2, 12, t, 0, 2), Box(5, 10 + t / 2, 12, t, 0, 2), Box(-t / 2, 5, t, 12, 0, 2)]
    walls.append(Box(10 + t / 2, 5, t, 12, 0, 2))
    x, y, yaw = 3.0, 6.0, 0.4
    directions = ANGLES + yaw
    with np.errstate(divide="ignore"):
        along_x = np.where(np.cos(directions) > 0, (10 - x), -x) / np.cos(directions)
        along_y = np.where(np.sin(directions) > 0, (10 - y), -y) / np.sin(directions)
    np.testing.assert_allclose(level_scan(walls, (x, y, yaw)), np.minimum(along_x, along_y), atol=1e-9)


def test_nothing_in_range_reads_inf():
    assert np.isinf(level_scan([Box(50, 0, 1, 1, 0, 1)], (0, 0, 0))).all()
    assert np.isinf(level_scan([], (0, 0, 0))).all()


def test_what_is_above_or_below_the_plane_is_not_seen():
    shelf = [Box(2, 0, 1, 1, 0, 0.3, base=0.5)]
    assert np.isinf(level_scan(shelf, (0, 0, 0), height=0.1)).all()
    assert level_scan(shelf, (0, 0, 0), height=0.6)[NUM_BEAMS // 2] == pytest.approx(1.5)


@pytest.mark.parametrize(("name", "options"), [("static", {}), ("factory", {"region": 1}), ("square", {})])
def test_scans_equal_the_ray_casters(name, options):
    world = make_world(name, 3, **options)
    movers = MoverField(world)
    movers.step(2.0)
    shapes = [o.shape for o in world.obstacles]
    parts = [part.shape for mover in world.movers for part in mover.parts]
    caster = RayCaster(pack_shapes(shapes), movers.part_shapes, LIDAR)
    rng = np.random.default_rng(0)
    x0, y0, x1, y1 = world.bounds
    differences = []
    for _ in range(150):
        pose = rng.uniform((x0, y0, -math.pi), (x1, y1, math.pi))
        expected = np.empty(NUM_BEAMS)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        caster.cast(np.array([*pose[:2], 0.1]), rotation, movers.part_poses, expected)
        got = level_scan(shapes, pose, 0.1, parts, movers.part_poses)
        differences.append(np.where(expected == got, 0.0, np.abs(np.minimum(expected, 1e3) - np.minimum(got, 1e3))))
    # A beam that grazes an edge within rounding may go either way.
    assert np.mean(np.array(differences) > 1e-9) < 1e-4


def test_a_beam_that_starts_inside_returns_the_way_out():
    inside_box = level_scan([Box(0, 0, 2, 4, 0, 1)], (0, 0, 0))
    assert inside_box[NUM_BEAMS // 2] == pytest.approx(1.0)
    assert inside_box[3 * NUM_BEAMS // 4] == pytest.approx(2.0)
    np.testing.assert_allclose(level_scan([Cylinder(0, 0, 0.7, 1)], (0, 0, 0)), 0.7)


def hall_with_movers():
    """Walkers and patrols in a hall of 12 m with a pillar."""
    rng = np.random.default_rng(4)
    obstacles = make_world("dynamic", 0, movers=0).obstacles
    movers = []
    for k in range(10):
        x, y, yaw = rng.uniform(3, 13), rng.uniform(3, 13), rng.uniform(-3, 3)
        part = MoverPart(Cylinder(0.05, 0.1, 0.2, 1.0), swing=0.15 if k % 2 else 0.0)
        motion = Patrol(0.7, ((x, y), (8.0, 8.0), (3.0, 12.0))) if k % 3 == 0 else RandomWalk(0.3 + 0.1 * k, 10 + k)
        movers.append(Mover("legs", (part, MoverPart(Box(0, 0, 0.3, 0.2, 0.3, 1.0))), 0.45, Pose2(x, y, yaw), motion))
    start = Pose2(1.0, 1.0, 0.0)
    return World("hall", 0, (0.0, 0.0, 16.0, 16.0), obstacles, tuple(movers), start, (15.0, 15.0))


def test_movers_walk_as_the_mover_field_has_it():
    world = hall_with_movers()
    single = MoverField(world)
    m, ticks = len(world.movers), 3
    constants, state, headings = np.zeros((1, m, 5)), np.zeros((1, m, STATE_SIZE)), np.zeros((1, m, 2))
    seeds, counters, waypoints = np.zeros((1, m), np.uint64), np.zeros((1, m), np.uint64), np.zeros((1, 3 * m, 2))
    parts, owners = np.zeros((1, 2 * m, 5)), np.repeat(np.arange(m), 2)[None]
    for i, mover in enumerate(world.movers):
        motion = mover.motion
        constants[0, i, SPEED], constants[0, i, RADIUS] = motion.speed, mover.radius
        state[0, i, :2], state[0, i, SINCE_TURN], state[0, i, DIRECTION] = mover.start[:2], PATIENCE, 1.0
        headings[0, i] = math.cos(mover.start.yaw), math.sin(mover.start.yaw)
        if isinstance(motion, RandomWalk):
            constants[0, i, MOTION], seeds[0, i] = RANDOM_WALK, motion.seed
        else:
            assert isinstance(motion, Patrol)
            constants[0, i, MOTION], constants[0, i, FIRST_WAYPOINT] = PATROL, 3 * i
            constants[0, i, WAYPOINTS], state[0, i, TARGET] = 3, 1.0
            waypoints[0, 3 * i : 3 * i + 3] = motion.waypoints
        for p, part in enumerate(mover.parts):
            shape = part.shape
            yaw = getattr(shape, "yaw", 0.0)
            parts[0, 2 * i + p] = shape.x, shape.y, math.cos(yaw), math.sin(yaw), part.swing
    field = clearance_field(world.obstacles, world.bounds)
    away = distance_to_wide_ways(field, MOVER_WAY).astype(np.float32)
    grid, shape = np.array([[*field.origin, field.resolution]]), np.array([[0, *away.shape]])
    turn = np.array([math.cos(TURN_RATE * TICK), math.sin(TURN_RATE * TICK)])
    poses = np.zeros((1, ticks, 2 * m, 4))

    def walk(ticks):
        walk_batch(
            ONE, TICK, ticks, turn, ONE, WideWays(away.ravel(), shape, grid),
            MoverRows(
                np.array([m]), np.zeros((1, m), np.int64), constants, state, headings, seeds, counters,
                np.zeros((1, m, 4)), waypoints,
            ),
            PartRows(np.array([2 * m]), parts, owners, poses),
        )  # fmt: skip

    walk(0)
    np.testing.assert_allclose(poses[0, -1, :, :2], single.part_poses[:, :2], atol=1e-9)
    for _ in range(100):  # 10 s
        walk(ticks)
        single.step(ticks * TICK)
    np.testing.assert_allclose(poses[0, -1, :, :2], single.part_poses[:, :2], atol=1e-6)
    np.testing.assert_allclose(poses[0, -1, :, 2], np.cos(single.part_poses[:, 2]), atol=1e-6)
    np.testing.assert_allclose(poses[0, -1, :, 3], np.sin(single.part_poses[:, 2]), atol=1e-6)


def overlap(shapes, pose, height=1.2, parts=(), part_poses=(), footprint=FOOTPRINT):
    """Whether a footprint at a pose overlaps static shapes or parts."""
    field = clearance_field([], (-20.0, -20.0, 20.0, 20.0))
    near = np.zeros(field.distance.size, np.float32)  # no short cut: every shape is looked at
    static = level_columns(pack_shapes(shapes))
    moving = level_columns(pack_shapes(parts))[None]
    places = np.array([(x, y, math.cos(yaw), math.sin(yaw)) for x, y, yaw in part_poses]).reshape(1, 1, -1, 4)
    hit = np.zeros(1, np.int64)
    radius = np.hypot(*footprint.T).max()
    outlines = Outlines(footprint[None], np.array([len(footprint)]), np.array([radius]), np.array([height]))
    scenes = StaticScenes(
        static, np.array([0, len(shapes)]), near, np.array([[0, *field.distance.shape]]),
        np.array([[-20.0, -20.0, 0.1]]),
    )  # fmt: skip
    moving = PartTrajectories(moving, places, np.array([len(parts)]))
    overlaps_batch(ONE, np.array([[pose]], float), outlines, scenes, ONE, moving, hit, np.empty_like(footprint))
    return hit[0] == 0


def test_a_rectangle_touches_a_wall_at_its_known_distance():
    rectangle = np.array([(0.4, -0.2), (0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2)])
    wall = [Box(2.0, 0.0, 1.0, 5.0, 0.0, 1.0)]  # its near face is at x = 1.5
    assert overlap(wall, (1.11, 0.0, 0.0), footprint=rectangle)
    assert not overlap(wall, (1.09, 0.0, 0.0), footprint=rectangle)
    assert overlap(wall, (1.31, 0.0, math.pi / 2), footprint=rectangle)
    assert not overlap(wall, (1.29, 0.0, math.pi / 2), footprint=rectangle)
    low_bar = [Box(2.0, 0.0, 1.0, 5.0, 0.0, 0.2, base=1.0)]
    assert overlap(low_bar, (1.2, 0.0, 0.0), height=1.2, footprint=rectangle)
    assert not overlap(low_bar, (1.2, 0.0, 0.0), height=0.9, footprint=rectangle)


def test_overlap_is_no_clearance():
    rng = np.random.default_rng(1)
    shapes = [Box(0, 0, 1.0, 0.4, 0.5, 1.0), Cylinder(1.5, 0.2, 0.3, 1.0)]
    parts = [Cylinder(0.0, 0.0, 0.2, 1.0), Box(0.0, 0.0, 0.6, 0.3, 0.0, 1.0)]
    clearance = FootprintClearance(pack_shapes(shapes), pack_shapes(parts), FOOTPRINT, 1.2)
    answers = []
    for _ in range(400):
        x, y, yaw = rng.uniform((-1, -1, -3), (3, 1, 3))
        places = rng.uniform((-1, -1, -3), (3, 1, 3), (2, 3))
        touches = clearance.distance(x, y, yaw, places) == 0.0
        assert overlap(shapes, (x, y, yaw), 1.2, parts, places) == touches
        answers.append(touches)
    assert 50 < sum(answers) < 350
