import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vuca_nav.rooms import (
    LIDAR,
    NOTHING,
    PERCEPTION,
    REST,
    Sensors,
    moved,
    percept_of,
    ranges_to_boxes,
    room,
    scan_of,
)
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import between, compose, distance, inverse, wrap_angle
from vuca_nav.mapping.alignment import Aligner, Alignment, AlignmentConfig, Spread
from vuca_nav.mapping.front_end import FrontEndConfig
from vuca_nav.mapping.grid import FREE_BELOW, OCCUPIED_ABOVE, GridConfig, OccupancyGrid
from vuca_nav.mapping.slam import Slam, SlamConfig
from vuca_nav.mapping.surfaces import SurfaceGrid
from vuca_nav.perception.perception import Perception, PerceptionConfig
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan


def insert_beam(grid: OccupancyGrid, end: tuple[float, float], is_hit: bool = True) -> None:
    points = np.array([end])
    box = np.array([min(0.0, end[0]), min(0.0, end[1]), max(0.0, end[0]), max(0.0, end[1])])
    grid.insert(Pose2(0.025, 0.025, 0.0), points, int(is_hit), np.zeros(1), box)


def test_one_beam_frees_its_cells_and_occupies_its_end():
    grid = OccupancyGrid(GridConfig())
    insert_beam(grid, (1.025, 0.025))
    i, j = grid.cell(0.025, 0.025)
    row = grid.level[i]
    assert list(row[j : j + 20]) == [-4] * 20
    assert row[j + 20] == 9
    assert np.count_nonzero(grid.level) == 21
    assert grid.state(1.025, 0.025) == 1
    assert grid.state(0.5, 0.025) == -1
    assert grid.state(0.5, 0.5) == 0


def test_levels_leave_the_unknown_band_at_once():
    grid = OccupancyGrid(GridConfig())
    p = grid.probability_of_level
    assert p[128] == 0.5
    assert p[129] > OCCUPIED_ABOVE
    assert p[127] < FREE_BELOW
    with pytest.raises(BadArgument, match="must leave"):
        GridConfig(unit=0.05)


def test_what_moved_away_is_erased_by_six_beams():
    grid = OccupancyGrid(GridConfig())
    for _ in range(30):
        insert_beam(grid, (1.025, 0.025))
    assert grid.level.max() == grid.config.limit
    for k in range(6):
        assert grid.state(1.025, 0.025) == (1 if k < 5 else 0)
        insert_beam(grid, (2.025, 0.025))
    assert grid.state(1.025, 0.025) == -1


def test_a_hit_is_not_undone_by_another_beam_of_the_same_scan():
    grid = OccupancyGrid(GridConfig())
    points = np.array([[1.025, 0.025], [2.025, 0.025]])
    grid.insert(Pose2(0.025, 0.025, 0.0), points, 2, np.zeros(2), np.array([0.0, 0.0, 2.1, 0.1]))
    assert grid.level[grid.cell(1.025, 0.025)] == grid.config.hit


def beam_cells(start: tuple[float, float], end: tuple[float, float]) -> list[tuple[int, int]]:
    """The cells of a beam but for its last, from those of many points on it; start and end in rows and columns."""
    points = np.linspace(start, end, 200_001)
    cells = np.floor(points).astype(int)
    keep = np.r_[True, (np.diff(cells, axis=0) != 0).any(axis=1)]
    return [tuple(cell) for cell in cells[keep] if (cell != cells[-1]).any()]


def test_scans_of_beams_change_the_cells_that_points_on_the_beams_lie_in():
    rng = np.random.default_rng(7)
    grid = OccupancyGrid(GridConfig())
    expected = np.zeros_like(grid.level)
    for _ in range(12):
        sensor = rng.uniform(-0.3, 0.3, 2)
        angles = rng.uniform(-math.pi, math.pi, 60)
        ends = sensor + rng.uniform(0.02, 4.0, (60, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
        box = np.r_[ends.min(axis=0), ends.max(axis=0)]
        num_hits = 20
        grid.insert(Pose2(sensor[0], sensor[1], 0.0), ends, num_hits, np.zeros(60), box)
        hits = {grid.cell(x, y) for x, y in ends[:num_hits]}
        in_cells = [(np.array(p)[::-1] - grid.origin[::-1]) / grid.resolution for p in (sensor, *ends)]
        passed = {cell for end in in_cells[1:] for cell in beam_cells(tuple(in_cells[0]), tuple(end))} - hits
        for cells, change in ((hits, grid.config.hit), (passed, -grid.config.miss)):
            rows, columns = np.array(list(cells)).T
            changed = expected[rows, columns] + change
            expected[rows, columns] = np.clip(changed, -grid.config.limit, grid.config.limit)
    assert grid.level.shape == expected.shape
    # A beam may clip less of a cell than lies between two of the points: a few cells in tens of thousands.
    assert np.count_nonzero(grid.level != expected) <= 3


def test_beams_along_edges_and_diagonals_stay_beside_them():
    for direction in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)]:
        grid = OccupancyGrid(GridConfig())
        corner = np.array(grid.origin) + 0.05 * 300
        end = corner + 1.0 * np.array(direction)
        box = np.r_[np.minimum(corner, end), np.maximum(corner, end)]
        grid.insert(Pose2(corner[0], corner[1], 0.0), end[None], 1, np.zeros(1), box)
        assert grid.state(*end) == 1
        for i, j in np.argwhere(grid.level < 0):
            centre = np.array(grid.origin) + 0.05 * (np.array([j, i]) + 0.5) - corner
            along = centre @ np.array(direction) / np.linalg.norm(direction)
            assert np.linalg.norm(centre - along * np.array(direction) / np.linalg.norm(direction)) <= 0.0501
            assert -0.06 < along < np.linalg.norm(end - corner) + 0.06
        assert 17 <= np.count_nonzero(grid.level < 0) <= 42


def test_entropy_is_kept_up_to_date():
    rng = np.random.default_rng(3)
    grid = OccupancyGrid(GridConfig())
    for _ in range(50):
        insert_beam(grid, tuple(rng.uniform(0.2, 6.0, 2)), bool(rng.random() < 0.8))
    p = grid.probability_of_level[grid.level.astype(int) + 128]
    expected = -(p * np.log(p) + (1 - p) * np.log(1 - p)).sum() - grid.level.size * np.log(2.0)
    assert grid.entropy == pytest.approx(float(expected), rel=1e-9)
    assert grid.entropy < 0.0


def test_growing_keeps_every_cell_where_it_is():
    grid = OccupancyGrid(GridConfig())
    insert_beam(grid, (1.025, 0.025))
    entropy = grid.entropy
    insert_beam(grid, (-30.0, 25.0))
    assert grid.state(1.025, 0.025) == 1
    assert grid.state(-30.0, 25.0) == 1
    assert grid.cell(0.025, 0.025) == (round(-grid.origin[1] / 0.05), round(-grid.origin[0] / 0.05))
    assert grid.entropy < entropy


def test_a_cell_remembers_the_mean_of_its_returns():
    grid = SurfaceGrid(FrontEndConfig().grid)
    for x in (1.01, 1.02, 1.045):
        insert_beam(grid, (x, 0.03))
    i, j = grid.cell(1.02, 0.03)
    assert grid.count[i, j] == 3
    np.testing.assert_allclose(grid.mean[i, j] * grid.resolution, (0.025, 0.03), atol=1e-6)
    insert_beam(grid, (-30.0, 0.03))  # makes it grow
    i, j = grid.cell(1.02, 0.03)
    assert grid.count[i, j] == 3


def test_a_surface_that_left_and_came_back_starts_anew():
    grid = SurfaceGrid(FrontEndConfig().grid)
    for _ in range(10):
        insert_beam(grid, (1.01, 0.03))
    for _ in range(60):
        insert_beam(grid, (2.0, 0.03))
    assert grid.state(1.01, 0.03) == -1
    for _ in range(12):
        insert_beam(grid, (1.04, 0.03))
    i, j = grid.cell(1.02, 0.03)
    assert grid.mean[i, j, 0] * grid.resolution == pytest.approx(0.04, abs=0.004)


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.01, 0.01))
@settings(max_examples=20, deadline=None)
def test_a_clean_corner_is_matched_exactly(dx, dy, dyaw):
    """Two walls whose cells' means are exact: the lines are exact, so the pose is, but for the pull."""
    grid = SurfaceGrid(FrontEndConfig().grid)
    along = np.arange(-1.0, 2.0, 0.01)
    walls = np.vstack([np.column_stack([along, np.full(300, 2.013)]), np.column_stack([np.full(300, 2.013), along])])
    grid.insert(Pose2(0.0, 0.0, 0.0), walls, len(walls), np.zeros(len(walls)), np.array([-1.1, -1.1, 2.1, 2.1]))
    match = aligned(grid, Pose2(dx, dy, dyaw), walls, Spread(10.0, 10.0))
    np.testing.assert_allclose(match.pose, (0.0, 0.0, 0.0), atol=1e-3)
    assert match.quality > 0.9


def aligned(grid: SurfaceGrid, predicted: Pose2, points: np.ndarray, spread: Spread) -> Alignment:
    """A match of returns without normals of their own."""
    return Aligner(AlignmentConfig(), len(points)).align(grid.surface, predicted, spread, points, np.zeros_like(points))


def mapped_room(width: float = 7.0, height: float = 5.0) -> tuple[SurfaceGrid, np.ndarray]:
    """A room with a block, in a grid that saw it from many places with range noise."""
    boxes = np.vstack([room(width, height), [[4.5, 2.5, 5.5, 3.6]]])
    slam = Slam(LIDAR, SlamConfig(localisation="odometry"))
    grid = SurfaceGrid(FrontEndConfig().grid)
    rng = np.random.default_rng(0)
    cos, sin = np.cos(slam.lidar.angles_in_base()), np.sin(slam.lidar.angles_in_base())
    for k in range(20):
        pose = Pose2(2.0 + 0.1 * k, 2.0, 0.2 * k)
        ranges = ranges_to_boxes(boxes, pose) + rng.normal(0.0, 0.02, LIDAR.num_beams)
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        points = np.column_stack([pose.x + ranges * (c * cos - s * sin), pose.y + ranges * (s * cos + c * sin)])
        grid.insert(pose, points, len(points), np.zeros(len(points)), np.array([-1.0, -1.0, width + 1.0, height + 1.0]))
    return grid, boxes


def returns_at(boxes: np.ndarray, pose: Pose2, rng: np.random.Generator | None = None) -> np.ndarray:
    """(n, 2) in base_link, with range noise."""
    ranges = scan_of(boxes, pose, rng=rng or np.random.default_rng(1)).ranges
    hits = np.isfinite(ranges)
    angles = LIDAR.angles_in_base()[hits]
    return ranges[hits, None] * np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize(
    "offset", [(0.0, 0.0, 0.0), (0.04, -0.03, 0.012), (-0.05, 0.05, -0.017), (0.12, 0.1, 0.05), (-0.17, 0.0, -0.09)]
)
def test_matching_finds_the_pose_from_a_wrong_prediction(offset):
    grid, boxes = mapped_room()
    truth = Pose2(3.0, 1.7, 0.4)
    points = returns_at(boxes, truth)
    predicted = Pose2(truth.x + offset[0], truth.y + offset[1], truth.yaw + offset[2])
    match = aligned(grid, predicted, points, Spread(0.06, 0.03))
    assert distance(match.pose, truth) < 0.01
    assert abs(wrap_angle(match.pose.yaw - truth.yaw)) < 0.003
    assert match.quality > 0.95
    assert not match.is_degenerate


def test_a_match_that_slipped_by_four_degrees_finds_back():
    grid, boxes = mapped_room(10.0, 8.0)
    truth, slip = Pose2(5.0, 6.0, 0.4), math.radians(4.5)
    points = returns_at(boxes, truth)
    # Odometry is thought to be far better than it is; but it has turned by a tenth of a radian.
    pose = aligned(grid, Pose2(truth.x, truth.y, truth.yaw + slip), points, Spread(0.002, 0.002, 0.0, 0.1)).pose
    assert abs(wrap_angle(pose.yaw - truth.yaw)) < math.radians(0.3)
    assert distance(pose, truth) < 0.01


def test_along_a_bare_corridor_odometry_decides():
    """No end in sight: the returns say nothing of x, whatever their noise feigns, and say so."""
    corridor = np.array([[-50.0, -1.2, 50.0, -1.0], [-50.0, 1.0, 50.0, 1.2]])
    grid, rng = SurfaceGrid(FrontEndConfig().grid), np.random.default_rng(3)
    for x in np.arange(-2.0, 2.0, 0.2):
        pose = Pose2(float(x), 0.0, 0.0)
        points = returns_at(corridor, pose, rng) + pose[:2]
        grid.insert(pose, points, len(points), np.zeros(len(points)), np.array([-20.0, -2.0, 20.0, 2.0]))
    predicted = Pose2(0.3, 0.06, 0.02)
    match = aligned(grid, predicted, returns_at(corridor, Pose2(0.4, 0.0, 0.0), rng), Spread(0.05, 0.02))
    assert match.is_degenerate
    assert match.pose.x == pytest.approx(predicted.x, abs=0.003)
    assert match.pose.y == pytest.approx(0.0, abs=0.01)
    assert match.pose.yaw == pytest.approx(0.0, abs=0.004)


def drive_round(localisation: str) -> tuple[float, float, Slam]:
    """A loop in a 12 x 9 m hall with odometry that turns 4% too much and goes 3% too far; SLAM's and its error."""
    boxes = np.vstack([room(12.0, 9.0), [[3.0, 3.0, 5.0, 6.0], [7.5, 2.5, 9.5, 4.0], [7.0, 6.5, 8.0, 7.0]]])
    rng = np.random.default_rng(7)
    slam = Slam(LIDAR, SlamConfig(localisation=localisation))  # type: ignore[arg-type]
    start = Pose2(1.5, 1.5, 0.0)
    slam.reset(start)
    sensors, step = Sensors(), STANDING
    truth, odom = start, STANDING
    worst = worst_odometry = 0.0
    legs = [(300, 0.03, 0.0), (60, 0.0, math.pi / 120), (180, 0.03, 0.0), (60, 0.0, math.pi / 120)] * 2
    for ticks, forward, turn in legs:
        for _ in range(ticks):
            estimate = slam.update(sensors.see(scan_of(boxes, truth, rng=rng).ranges, step))
            worst = max(worst, distance(estimate.map_from_base, truth))
            worst_odometry = max(worst_odometry, distance(compose(start, odom), truth))
            truth, step = moved(truth, forward, turn), Pose2(1.03 * forward, 0.0, 1.04 * turn)
            odom = compose(odom, step)
    return worst, worst_odometry, slam


def test_slam_holds_the_pose_where_odometry_drifts():
    worst, worst_odometry, slam = drive_round("slam")
    assert worst_odometry > 1.0
    assert worst < 0.04
    # The map shows the room: inside free, walls occupied, behind them nothing.
    grid = slam.navigation_grid
    assert grid.state(6.0, 1.5) == -1
    assert grid.state(6.0, -1.0) == 0
    wall = [grid.level[grid.cell(x, 0.0)] > 0 or grid.level[grid.cell(x, -0.04)] > 0 for x in np.arange(1, 11, 0.1)]
    assert np.mean(wall) > 0.9


def test_a_given_map_is_as_good_as_an_own_one():
    """Solid blocks in a map of cells: what is inside them is no surface to match."""
    boxes = np.vstack([room(12.0, 9.0), [[3.0, 3.0, 5.0, 6.0], [7.5, 2.5, 9.5, 4.0]]])
    prior = OccupancyGrid(SlamConfig().navigation_grid)
    level = np.full((200, 260), -1, np.int8)
    for x0, y0, x1, y1 in boxes:
        rows, columns = (
            slice(max(round((v + 0.5) / 0.05), 0), round((w + 0.5) / 0.05)) for v, w in ((y0, y1), (x0, x1))
        )
        level[rows, columns] = 1
    prior.fill(level, (-0.5, -0.5))
    slam = Slam(LIDAR)
    truth, sensors = Pose2(1.5, 1.5, 0.0), Sensors()
    slam.reset(truth, prior)
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(420):
        estimate = slam.update(sensors.see(scan_of(boxes, truth, rng=rng).ranges, Pose2(0.0206, 0.0, 0.0022)))
        worst = max(worst, distance(estimate.map_from_base, truth))
        truth = moved(truth, 0.02, 0.002)
    assert worst < 0.03


def test_trusting_odometry_means_dead_reckoning():
    worst, worst_odometry, _ = drive_round("odometry")
    assert worst == pytest.approx(worst_odometry)


def test_skimming_beams_do_not_wash_a_wall_away():
    """Driving off along a wall whose surface lies inside a row of cells, looking back at it."""
    boxes = np.vstack([room(30.0, 2.0), [[-1.0, 1.97, 31.0, 2.3]]])
    slam = Slam(LIDAR, SlamConfig(localisation="odometry"))
    slam.reset(Pose2(2.0, 1.0, 0.0))
    rng, sensors = np.random.default_rng(0), Sensors()
    for k in range(450):
        pose = Pose2(2.0 + 0.03 * k, 1.0, 0.0)
        slam.update(sensors.see(scan_of(boxes, pose, rng=rng).ranges, Pose2(0.03 if k else 0.0, 0.0, 0.0)))
    grid = slam.navigation_grid
    columns = [grid.cell(x, 1.97)[1] for x in np.arange(1.0, 15.0, 0.05)]
    row = grid.cell(0.0, 1.97)[0]
    assert np.mean([(grid.level[row - 1 : row + 2, j] > 0).any() for j in columns]) > 0.99


def test_a_leaning_body_maps_neither_the_floor_nor_what_it_looks_over():
    """A lidar at 0.37 m in an empty hall, 5 degrees nose down: ahead it meets the floor at 4.2 m."""
    lidar, lean = LidarSpec(height=0.37), math.radians(5.0)
    up = (-math.sin(lean), 0.0, math.cos(lean))
    angles = lidar.angles_in_base()
    rise = -np.sin(lean) * np.cos(angles)
    ranges = np.full(360, 5.0)
    floor = rise < -0.37 / 5.0
    ranges[floor] = -0.37 / rise[floor]
    slam = Slam(lidar)
    slam.reset(Pose2(0.0, 0.0, 0.0))
    estimate = slam.update(percept_of(ranges, lidar, up))
    away = np.hypot(*estimate.points_in_map.T)
    # What is left are the beams to the sides, at 5 m over ground.
    np.testing.assert_allclose(away, 5.0, atol=0.01)
    bearing = np.abs(np.arctan2(*estimate.points_in_map.T[::-1]))
    assert bearing.min() > math.radians(50.0)
    assert bearing.max() < math.radians(126.0)
    assert slam.navigation_grid.state(1.0, 0.02) == 0  # ahead nothing is known, neither free nor occupied
    assert slam.navigation_grid.state(0.02, 1.0) == -1


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
@settings(max_examples=25, deadline=None)
def test_a_leaning_body_sees_walls_where_they_are(roll, pitch):
    # Walls of any height 1 m ahead and behind, 0.8 m left and right; what is above or below the band is left out.
    angles = LIDAR.angles_in_base()
    up = (-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch))
    x = np.cos(angles) * math.cos(pitch) + np.sin(angles) * math.sin(roll) * math.sin(pitch)
    y = np.sin(angles) * math.cos(roll)
    ranges = np.minimum(1.0 / np.maximum(abs(x), 1e-9), 0.8 / np.maximum(abs(y), 1e-9))
    estimate = Slam(LIDAR).update(percept_of(ranges, up=up))
    ends = estimate.points_in_map
    assert len(ends) > 50
    assert np.maximum(abs(ends[:, 0]), abs(ends[:, 1]) / 0.8) == pytest.approx(1.0)


def test_dropped_beams_do_not_open_walls():
    boxes = room(6.0, 6.0)
    slam = Slam(LIDAR)
    pose = Pose2(3.0, 3.0, 0.1)
    slam.reset(pose)
    ranges = ranges_to_boxes(boxes, pose)
    ranges[::5] = np.inf
    slam.update(percept_of(ranges))
    grid = slam.navigation_grid
    rows, columns = np.nonzero(grid.level < 0)
    x = grid.origin[0] + (columns + 0.5) * grid.resolution
    y = grid.origin[1] + (rows + 0.5) * grid.resolution
    assert x.min() > -0.1
    assert x.max() < 6.1
    assert y.min() > -0.1
    assert y.max() < 6.1


def test_an_empty_scan_leaves_the_pose_to_odometry_and_frees_the_surroundings():
    slam, sensors = Slam(LIDAR), Sensors()
    slam.reset(STANDING)
    slam.update(sensors.see(NOTHING))
    estimate = slam.update(sensors.see(NOTHING, Pose2(0.1, 0.0, 0.0)))
    assert estimate.map_from_base == pytest.approx((0.1, 0.0, 0.0))
    assert slam.navigation_grid.state(8.01, 0.01) == -1 or slam.navigation_grid.state(8.01, -0.01) == -1


def test_where_odometry_begins_does_not_matter():
    start, step = Pose2(1.0, 2.0, 0.3), Pose2(0.1, 0.05, 0.02)
    for begin in (STANDING, Pose2(-7.0, 4.0, 2.0)):
        slam, sensors = Slam(LIDAR, SlamConfig(localisation="odometry")), Sensors()
        slam.reset(start)
        first = slam.update(sensors.see(NOTHING, begin))
        assert first.map_from_base == start
        assert first.map_from_odom == pytest.approx(compose(start, inverse(begin)), abs=1e-12)
        second = slam.update(sensors.see(NOTHING, step))
        assert second.map_from_base == pytest.approx(compose(start, step), abs=1e-12)
        assert second.map_from_odom == first.map_from_odom  # there was nothing to correct it by


def test_the_estimate_is_the_correction_after_odometry():
    slam, sensors, rng = Slam(LIDAR), Sensors(), np.random.default_rng(0)
    start = truth = Pose2(2.0, 2.0, 0.1)
    slam.reset(start)
    odom_from_base, last = STANDING, start
    for k in range(60):
        step = Pose2(0.022, 0.0, 0.011) if k else STANDING
        odom_from_base = compose(odom_from_base, step)
        estimate = slam.update(sensors.see(scan_of(room(7.0, 5.0), truth, rng=rng).ranges, step))
        assert estimate.map_from_base == pytest.approx(compose(estimate.map_from_odom, odom_from_base), abs=1e-9)
        assert estimate.map_correction == STANDING
        assert 0.0 < estimate.score <= 1.0
        truth, last = moved(truth, 0.02, 0.01), estimate.map_from_odom
    assert distance(last, start) > 0.03  # what odometry overstates


@pytest.mark.parametrize("localisation", ["slam", "odometry"])
def test_a_correction_moves_the_robot_with_the_map_and_is_told_once(localisation):
    slam, sensors, step = Slam(LIDAR, SlamConfig(localisation=localisation)), Sensors(), Pose2(0.02, 0.0, 0.01)
    slam.reset(Pose2(3.0, 1.0, 0.5))
    before = [slam.update(sensors.see(NOTHING, step)) for _ in range(5)][-1]
    first, second = Pose2(0.3, -0.2, 0.1), Pose2(-0.1, 0.4, -0.3)
    slam.correct(first)
    slam.correct(second)  # before anybody was told of the first
    both = compose(second, first)
    after = slam.update(sensors.see(NOTHING, step))
    assert after.map_correction == pytest.approx(both)
    assert after.map_from_odom == pytest.approx(compose(both, before.map_from_odom))
    assert after.map_from_base == pytest.approx(compose(both, compose(before.map_from_base, step)))
    again = slam.update(sensors.see(NOTHING, step))
    assert again.map_correction == STANDING
    assert again.map_from_odom == pytest.approx(after.map_from_odom)
    assert between(after.map_from_base, again.map_from_base) == pytest.approx(step, abs=1e-9)


def test_a_new_mission_knows_of_no_correction():
    slam = Slam(LIDAR)
    slam.update(percept_of(NOTHING))
    slam.correct(Pose2(1.0, 0.0, 0.0))
    slam.reset(STANDING)
    estimate = slam.update(percept_of(NOTHING))
    assert estimate.map_correction == STANDING
    assert estimate.map_from_base == STANDING


@pytest.mark.parametrize("broken", [Pose2(math.nan, 0.0, 0.0), Pose2(0.0, math.inf, 0.0), Pose2(0.0, 0.0, math.nan)])
def test_while_odometry_is_not_finite_the_estimate_stays_and_nothing_is_mapped(broken):
    slam, perception, start = Slam(LIDAR), Perception(LIDAR), Pose2(3.0, 3.0, 0.2)
    slam.reset(start)
    ranges = ranges_to_boxes(room(6.0, 6.0), start)

    def tick(k: int, odom_from_base: Pose2, seen: np.ndarray = ranges):
        return slam.update(perception.update(Scan(k / 30, seen), Odometry(k / 30, odom_from_base, REST)))

    assert tick(0, broken).map_from_base == start
    assert not slam.navigation_grid.level.any()
    before = [tick(k, Pose2(5.0, 1.0, 0.5)) for k in range(1, 5)][-1]
    level = slam.navigation_grid.level.copy()
    during = tick(5, broken, np.full(360, 1.0))
    assert during.map_from_base == before.map_from_base
    assert during.map_from_odom == before.map_from_odom
    assert during.map_correction == STANDING
    assert len(during.points_in_map) == 0
    np.testing.assert_array_equal(slam.navigation_grid.level, level)
    after = tick(6, Pose2(5.0, 1.0, 0.5))
    assert after.map_from_base == pytest.approx(before.map_from_base, abs=1e-3)
    slam.correct(Pose2(1.0, 0.0, 0.0))
    corrected = tick(7, broken)
    assert corrected.map_correction == (1.0, 0.0, 0.0)
    assert corrected.map_from_base == pytest.approx((after.map_from_base.x + 1.0, *after.map_from_base[1:]))


HALL, HERE = room(6.0, 6.0), Pose2(2.0, 3.0, 0.0)


def pass_by(config: PerceptionConfig = PERCEPTION):
    """A pillar of 0.4 m comes from the right and stops before the robot: SLAM, the last percept and estimate."""
    slam, sensors = Slam(LIDAR), Sensors(config=config)
    slam.reset(HERE)

    def tick(k: int):
        y = 1.4 + 0.8 * k / 30.0
        percept = sensors.see(ranges_to_boxes(np.vstack([HALL, [[3.8, y - 0.2, 4.2, y + 0.2]]]), HERE))
        return slam, percept, slam.update(percept)

    return [tick(k) for k in range(61)][-1]


def test_a_mover_has_no_place_in_the_map():
    """It is at (4, 3) now; if nothing is tracked it is in the map as everything else."""
    for tracks, state in ((False, 1), (True, -1)):
        slam, percept, estimate = pass_by(PerceptionConfig(tracks=tracks))
        assert len(percept.moving) == tracks
        grid = slam.navigation_grid
        near_side = [grid.state(3.825, y) for y in np.arange(2.875, 3.15, 0.05)]
        assert max(near_side) == state
        assert grid.state(3.6, 3.0) == -1  # on the way to it it is free all the same
        assert grid.state(6.01, 5.0) == 1  # the wall is where it was
        assert (np.abs(estimate.points_in_map - (3.8, 3.0)) < 0.1).all(1).any()  # to be seen in a recording


def percept_with_movers(ranges: np.ndarray, movers: np.ndarray, sensors: Sensors):
    """A percept in which returns within 0.2 m of circles (x, y, radius) in base_link are a mover's."""
    percept = sensors.see(ranges)
    ends = np.where(ranges < np.inf, ranges, 99.0)[:, None] * percept.level.beams
    for x, y, radius in movers:
        percept.level.is_mover[:] |= np.hypot(*(ends - (x, y)).T) < radius + 0.2
    return percept


def test_a_movers_returns_do_not_occupy_and_their_beams_free():
    slam = Slam(LIDAR)
    for movers, state in ((np.empty((0, 3)), 1), (np.array([[2.0, 0.0, 0.2]]), 0)):
        slam.reset(HERE)
        ranges = ranges_to_boxes(np.vstack([HALL, [[3.8, 2.8, 4.2, 3.2]]]), HERE)
        slam.update(percept_with_movers(ranges, movers, Sensors()))
        grid = slam.navigation_grid
        assert grid.state(3.81, 3.0) == state  # its near side is what is seen
        assert grid.state(3.7, 3.0) == -1
        assert grid.state(6.01, 5.0) == 1


def test_a_phantom_before_a_wall_does_not_wash_it_away():
    slam, pose, rng, sensors = Slam(LIDAR), Pose2(3.0, 3.0, 0.0), np.random.default_rng(2), Sensors()
    slam.reset(pose)
    before = None
    for k in range(300):
        movers = np.array([[3.0, 0.0, 0.2]]) if k >= 30 else np.empty((0, 3))
        slam.update(percept_with_movers(scan_of(HALL, pose, rng=rng).ranges, movers, sensors))
        if k == 29:
            before = sum(slam.navigation_grid.state(6.025, y) > 0 for y in np.arange(2.625, 3.4, 0.05))
    assert before is not None
    assert before > 10
    assert sum(slam.navigation_grid.state(6.025, y) > 0 for y in np.arange(2.625, 3.4, 0.05)) >= before - 1


def test_what_no_scan_has_changed_lately_is_told():
    grid = OccupancyGrid(GridConfig())
    insert_beam(grid, (1.0, 0.025))
    for _ in range(5):
        insert_beam(grid, (-1.0, 0.025))
    there, elsewhere = grid.cell(1.0, 0.025), grid.cell(-1.0, 0.025)
    assert grid.not_updated_for(4)[there]
    assert not grid.not_updated_for(5)[there]
    assert not grid.not_updated_for(0)[elsewhere]
    assert not grid.not_updated_for(0)[0, 0]  # never seen at all: a map given beforehand may know it


def test_a_correction_before_the_first_scan_moves_where_it_starts():
    slam, sensors = Slam(LIDAR), Sensors()
    slam.reset(Pose2(1.0, 2.0, 0.0))
    slam.correct(Pose2(0.5, 0.0, 0.0))
    estimate = slam.update(sensors.see(NOTHING))
    assert estimate.map_from_base == pytest.approx(Pose2(1.5, 2.0, 0.0))
    assert estimate.map_correction == Pose2(0.5, 0.0, 0.0)
