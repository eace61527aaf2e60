import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from vuca_nav.footprint import cover_by_discs
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.planning.cells import ALL_HEADINGS, HEADINGS, chamfer, coarsen
from vuca_nav.planning.costmap import Costmap, CostmapConfig
from vuca_nav.planning.paths import _ALONG, _DI, _DJ, _LENGTH, UNREACHED, PathField, _dijkstra
from vuca_nav.planning.waypoints import NEAREST, farthest_free_waypoint
from vuca_nav.types import Pose2

DISC = np.array([[0.0, 0.0, 0.3]])
"""Body of a radius of 0.3 m."""
TIAGO = np.array([[0.0, 0.0, 0.284]])
GO2 = cover_by_discs(np.array([(0.34, -0.19), (0.34, 0.19), (-0.36, 0.19), (-0.36, -0.19)]))
"""A body as long and as wide as the Go2, about."""


def grid_of(rows: list[str]) -> OccupancyGrid:
    """A picture, top row first, one character a 0.1 m cell: '#' occupied, '.' free, ' ' unknown."""
    value = {"#": 1, ".": -1, " ": 0}
    level = np.array([[value[c] for c in row] for row in reversed(rows)], np.int8)
    grid = OccupancyGrid(GridConfig())
    grid.fill(np.kron(level, np.ones((2, 2), np.int8)), (0.0, 0.0))
    return grid


def hall(width: int, height: int) -> np.ndarray:
    picture = np.full((height, width), ".")
    picture[[0, -1]] = "#"
    picture[:, [0, -1]] = "#"
    return picture


def as_grid(picture: np.ndarray) -> OccupancyGrid:
    return grid_of(["".join(row) for row in picture])


def test_a_coarse_cell_is_what_its_cells_are():
    level = np.array([[-1, -1, 0, 0, 1, -1], [0, 0, 0, -1, -1, -1]], np.int8)
    assert list(coarsen(level, 2)[0]) == [1, 0, 2]


def test_chamfer_is_close_to_the_euclidean_distance():
    rng = np.random.default_rng(0)
    state = np.where(rng.random((80, 90)) < 0.01, 2, 1).astype(np.int8)
    exact = np.asarray(distance_transform_edt(state != 2))
    approximate = chamfer(state, 1000) / 5.0
    assert np.abs(approximate - exact).max() <= 0.08 * exact.max()
    np.testing.assert_array_equal(approximate == 0, state == 2)
    assert chamfer(state, 12).max() == 12


def test_dial_agrees_with_a_library_dijkstra():
    rng = np.random.default_rng(1)
    weight = rng.integers(4, 17, (25, 31)).astype(np.int16)
    weight[rng.random(weight.shape) < 0.25] = 0
    weight[3, 4] = 4
    grids = weight, np.full(weight.shape, ALL_HEADINGS, np.uint16), np.zeros(weight.shape, np.int16)
    cost, came_by = _dijkstra(grids, (3, 4), (_DI, _DJ, _LENGTH, _ALONG), 0)
    rows, columns = weight.shape
    edges = []
    for i in range(rows):
        for j in range(columns):
            for di, dj, length in zip(_DI, _DJ, _LENGTH):
                a, b = i + di, j + dj
                if not (0 <= a < rows and 0 <= b < columns) or weight[a, b] == 0 or weight[i, j] == 0:
                    continue
                if di and dj and (weight[i, b] == 0 or weight[a, j] == 0):
                    continue
                edges.append((i * columns + j, a * columns + b, length * weight[a, b]))
    start, end, value = np.array(edges).T
    graph = coo_array((value.astype(float), (start, end)), shape=(weight.size, weight.size)).tocsr()
    expected = dijkstra(graph, indices=3 * columns + 4).reshape(rows, columns)
    np.testing.assert_array_equal(np.where(cost == UNREACHED, np.inf, cost), expected)
    assert came_by[3, 4] == -1


def test_path_goes_round_the_wall_and_keeps_its_distance():
    picture = hall(60, 40)
    picture[10:39, 30] = "#"  # a wall from below, open at the top
    grid = as_grid(picture)
    costmap = Costmap(grid, DISC, (1.5, 1.0), CostmapConfig())
    path = PathField(costmap, (1.5, 1.0)).path_to(4.5, 1.0)
    assert tuple(path[0]) == (1.5, 1.0)
    assert tuple(path[-1]) == (4.5, 1.0)
    at_wall = path[np.abs(path[:, 0] - 3.05) < 0.3]
    assert at_wall[:, 1].min() > 3.0 + 0.3
    wall = np.array([3.05, 2.95])
    assert np.hypot(*(path - wall).T).min() > 0.37
    lengths = np.hypot(*np.diff(path, axis=0).T)
    assert lengths.max() < 0.25


def test_a_path_within_a_cell_leads_to_the_point_all_the_same():
    costmap = Costmap(as_grid(hall(30, 30)), DISC, (1.51, 1.51), CostmapConfig())
    assert costmap.cell(1.51, 1.51) == costmap.cell(1.59, 1.59)
    path = PathField(costmap, (1.51, 1.51)).path_to(1.59, 1.59)
    assert path.tolist() == [[1.51, 1.51], [1.59, 1.59]]


def test_a_door_narrower_than_the_body_is_closed():
    # The rule: the body and 0.10 m. Before, a door of 0.7 m was closed: the margin was hard.
    for door, passes in ((6, False), (7, True)):
        picture = hall(60, 40)
        picture[1:39, 30] = "#"
        picture[20 : 20 + door, 30] = "."
        costmap = Costmap(as_grid(picture), DISC, (1.5, 1.0), CostmapConfig())
        assert PathField(costmap, (1.5, 1.0)).reaches(4.5, 1.0) is passes


def test_unknown_cells_are_not_crossed():
    picture = hall(60, 40)
    picture[1:39, 25:35] = " "
    costmap = Costmap(as_grid(picture), DISC, (1.5, 1.0), CostmapConfig())
    assert not PathField(costmap, (1.5, 1.0)).reaches(4.5, 1.0)


def test_from_too_near_a_wall_a_path_leads_away_and_none_along():
    costmap = Costmap(as_grid(hall(60, 40)), DISC, (0.3, 2.0), CostmapConfig())
    path = PathField(costmap, (0.3, 2.0)).path_to(0.7, 3.5)
    assert len(path)
    inside = path[path[:, 0] < 0.4]
    assert inside[:, 1].max() < 2.8
    waypoint = farthest_free_waypoint(costmap, path, (0.3, 2.0))
    assert waypoint[0] > 0.4


def test_a_gap_too_narrow_is_none_beside_the_robot_either():
    """The cells about the robot by which it may leave a tight spot lead through no gap that it does not fit into."""
    picture = hall(60, 40)
    picture[1:39, 30] = "#"
    picture[20:25, 30] = "."  # 0.5 m: the body is 0.6 m wide
    for x in (2.4, 2.6, 2.7):
        paths = PathField(Costmap(as_grid(picture), DISC, (x, 2.25), CostmapConfig()), (x, 2.25))
        assert not paths.reaches(4.5, 1.0)
        assert paths.reaches(1.5, 1.0)  # it gets out of there all the same


def test_the_waypoint_is_the_farthest_in_sight():
    picture = hall(60, 40)
    picture[10:39, 30] = "#"
    costmap = Costmap(as_grid(picture), DISC, (1.5, 1.0), CostmapConfig())
    path = PathField(costmap, (1.5, 1.0)).path_to(4.5, 1.0)
    waypoint = farthest_free_waypoint(costmap, path, (1.5, 1.0))
    k = int(np.flatnonzero((path == waypoint).all(axis=1))[0])
    assert 5 < k < len(path) - 5
    # Straight to it is free; the wall's end hides what comes after.
    assert waypoint[1] > 2.0
    open_floor = Costmap(as_grid(hall(60, 40)), DISC, (1.5, 1.0), CostmapConfig())
    direct = PathField(open_floor, (1.5, 1.0)).path_to(4.5, 3.0)
    assert farthest_free_waypoint(open_floor, direct, (1.5, 1.0)) == pytest.approx((4.5, 3.0))


def test_outside_the_map_there_is_no_path():
    costmap = Costmap(as_grid(hall(20, 20)), DISC, (1.0, 1.0), CostmapConfig())
    field = PathField(costmap, (1.0, 1.0))
    assert not field.reaches(50.0, 50.0)
    assert field.path_to(50.0, 50.0).shape == (0, 2)
    assert not PathField(costmap, (-50.0, 1.0)).reaches(1.0, 1.0)


def test_a_mover_does_not_bar_a_way():
    picture = hall(60, 40)
    picture[:, 30] = "#"
    picture[14:26, 30] = "."  # a passage 1.2 m wide ...
    picture[19:21, 30] = "#"  # ... with a mover in it
    grid, robot = as_grid(picture), (1.5, 2.0)
    barred = Costmap(grid, DISC, robot, CostmapConfig())
    assert not PathField(barred, robot).reaches(4.5, 2.0)
    mover = np.array([[3.05, 2.0, 0.1]])
    free = Costmap(grid, DISC, robot, CostmapConfig(), mover)
    assert PathField(free, robot).reaches(4.5, 2.0)
    changed = np.argwhere(free.state != barred.state)  # nothing else: the passage's walls are 0.6 m from it
    assert sorted(free.point(i, j)[1] for i, j in changed) == pytest.approx([1.95, 2.05])
    assert len(changed) == 2


def test_small_obstacles_that_have_not_been_seen_lately_may_have_moved_away():
    picture = hall(60, 40)
    grid, robot, box = as_grid(picture), (1.5, 1.0), np.array([1.0, 1.0, 5.0, 5.0])
    spot, bar = np.arange(1.025, 3.95, 0.05), np.arange(1.025, 3.95, 0.05)
    spot, bar = spot[:30], bar[:32]  # 1.5 m and 1.6 m

    def scan(*ends: tuple[float, float]) -> None:
        points = np.array(ends)
        grid.insert(Pose2(2.5, 2.5, 0.0), points, len(points), np.full(len(points), 9.0), box)

    def occupied(y: float, *, doubting: bool) -> list[bool]:
        """In the state that frontiers are looked for in, and in the weights that paths are led by."""
        costmap = Costmap(grid, DISC, robot, CostmapConfig(), doubting=doubting)
        i, j = costmap.cell(1.85, y)
        return [costmap.state[i, j] == 2, costmap.weight[i, j] == 0]

    for _ in range(4):
        scan(*((x, 1.975) for x in spot), *((x, 2.975) for x in bar))
    for scans, gone in ((59, False), (2, True)):  # the memory is 60 scans
        for _ in range(scans):
            scan((5.0, 3.0))
        assert occupied(1.975, doubting=True) == [True, not gone]
        assert occupied(2.975, doubting=True) == [True, True]
        assert occupied(1.975, doubting=False) == [True, True]  # as a rule nothing is doubted
    scan((1.825, 1.975))
    assert occupied(1.975, doubting=True) == [True, True]  # seen again, a part of it


def test_where_ways_lead_first():
    picture = hall(60, 40)
    picture[1:30, 30] = "#"
    costmap = Costmap(as_grid(picture), DISC, (1.0, 2.0), CostmapConfig())
    field = PathField(costmap, (1.0, 2.0))
    points = np.array([[5.0, 3.5], [5.0, 0.6], [1.3, 2.0]])
    assert all(field.reaches(x, y) for x, y in points)
    for ahead in (0.5, 1.7, 4.0):
        found = field.on_the_way(points, ahead)
        for (x, y), point in zip(found, points):
            path = field.path_to(*point)
            assert np.hypot(*(path - (x, y)).T).min() < 1e-9 or (x, y) == pytest.approx(point)
            length = field.length_to_cell(*costmap.cell(x, y))
            whole = field.length_to_cell(*costmap.cell(*point))
            assert length <= ahead
            assert length > min(ahead, whole) - 0.15  # a diagonal step of a cell of 0.1 m
    np.testing.assert_array_equal(field.on_the_way(points, 100.0), points)
    assert field.on_the_way(np.empty((0, 2)), 1.0).shape == (0, 2)


def door(width: float, thickness: float = 0.15) -> OccupancyGrid:
    """A hall of 6 x 4 m with a door near y = 2 in a wall across it, in the cells of 0.05 m of a map."""
    level = np.full((80, 120), -1, np.int8)
    level[[0, -1]] = level[:, [0, -1]] = 1
    cells = round(width / 0.05)
    low = 40 - cells // 2
    level[:, 60 : 60 + round(thickness / 0.05)] = 1
    level[low : low + cells, 60 : 60 + round(thickness / 0.05)] = -1
    grid = OccupancyGrid(GridConfig())
    grid.fill(level, (0.0, 0.0))
    return grid


@pytest.mark.parametrize(
    ("discs", "width", "passes"),
    [(TIAGO, 0.75, True), (TIAGO, 0.55, False), (GO2, 0.60, True), (GO2, 0.50, True), (GO2, 0.35, False)],
)
def test_a_body_passes_a_door_that_its_footprint_and_a_little_room_fit_through(discs, width, passes):
    costmap = Costmap(door(width), discs, (1.5, 1.0), CostmapConfig())
    field = PathField(costmap, (1.5, 1.0))
    assert field.reaches(4.5, 1.0) is passes
    if passes:
        path = field.path_to(4.5, 1.0)
        inside = path[(path[:, 0] > 3.0) & (path[:, 0] < 3.15)]
        assert len(inside)
        middle = 0.05 * (40 - round(width / 0.05) // 2) + 0.5 * width
        assert np.abs(inside[:, 1] - middle).max() <= 0.05  # through the middle, within a cell of the map


def test_a_long_body_fits_into_a_door_along_it_and_not_across_it():
    costmap = Costmap(door(0.6), GO2, (1.5, 1.0), CostmapConfig())
    i, j = costmap.cell(3.08, 2.0)
    assert costmap.headings[i, j] & 1  # along x
    assert not costmap.headings[i, j] & 1 << HEADINGS // 4  # along y
    assert costmap.headings[costmap.cell(4.5, 2.0)] == ALL_HEADINGS
    # Two corridors of 0.6 m that meet at a right angle: round the corner goes what is at most 1.7 m less twice its
    # width long.
    longer = cover_by_discs(np.array([(0.55, -0.19), (0.55, 0.19), (-0.55, 0.19), (-0.55, -0.19)]))
    level = np.full((80, 120), 1, np.int8)
    level[34:46, 5:60] = -1
    level[34:75, 48:60] = -1
    grid = OccupancyGrid(GridConfig())
    grid.fill(level, (0.0, 0.0))
    for discs, passes in ((np.array([[0.0, 0.0, 0.2]]), True), (GO2, True), (longer, False)):
        assert PathField(Costmap(grid, discs, (0.7, 2.0), CostmapConfig()), (0.7, 2.0)).reaches(2.7, 3.0) is passes


def test_a_place_within_reach_stands_for_a_point_beside_a_wall():
    grid = as_grid(hall(60, 40))  # its wall's surface is at x = 0.1
    costmap = Costmap(grid, np.array([[0.0, 0.0, 0.4]]), (3.0, 2.0), CostmapConfig())
    field = PathField(costmap, (3.0, 2.0))
    goal = (0.45, 2.03)
    assert not field.reaches(*goal)
    place = field.standing_place(*goal, 0.2)
    assert place is not None
    assert field.reaches(*place)
    assert np.hypot(place[0] - goal[0], place[1] - goal[1]) <= 0.2
    # Of 0.22 m that it lacks for an easy turn, the place takes four fifths: 1 / (1 + 1 / ROOM_WEIGHT).
    assert place[0] == pytest.approx(0.45 + 0.8 * 0.22, abs=0.05)
    assert field.standing_place(*goal, 0.02) is None
    assert field.standing_place(3.3, 2.2, 0.2) == (3.3, 2.2)


def test_a_place_with_more_room_stands_for_a_point_that_leaves_a_little():
    grid = as_grid(hall(60, 40))
    field = PathField(Costmap(grid, TIAGO, (3.0, 2.0), CostmapConfig()), (3.0, 2.0))
    goal = (0.45, 2.03)
    assert field.reaches(*goal)
    assert field.standing_place(*goal, 0.0) == goal
    place = field.standing_place(*goal, 0.25)
    assert place is not None
    assert 0.5 < place[0] < 0.7
    corner = field.standing_place(0.45, 0.45, 0.25)
    assert corner is not None
    assert corner[0] == pytest.approx(corner[1], abs=0.06)
    assert 0.25 >= np.hypot(corner[0] - 0.45, corner[1] - 0.45) > 0.15


def clutter(seed: int) -> OccupancyGrid:
    """A hall of 8 x 6 m with a wall's dot here and there."""
    rng = np.random.default_rng(seed)
    level = np.full((120, 160), -1, np.int8)
    level[[0, -1]] = level[:, [0, -1]] = 1
    for i, j in rng.integers((8, 30), (112, 152), (40, 2)):
        level[i : i + 3, j : j + 3] = 1
    grid = OccupancyGrid(GridConfig())
    grid.fill(level, (0.0, 0.0))
    return grid


@pytest.mark.parametrize("discs", [TIAGO, GO2], ids=["round", "long"])
def test_paths_keep_clear_and_waypoints_lie_ahead(discs):
    start, num_paths = (0.8, 3.0), 0
    for seed in range(8):
        grid = clutter(seed)
        config = CostmapConfig()
        costmap = Costmap(grid, discs, start, config)
        field = PathField(costmap, start)
        away = np.asarray(distance_transform_edt(grid.level <= 0)) * grid.resolution
        origin = np.array(grid.origin)
        for x, y in np.random.default_rng(seed + 100).uniform((0.5, 0.5), (7.5, 5.5), (20, 2)):
            path = field.path_to(x, y)
            if not len(path):
                continue
            num_paths += 1
            for point in path[1:-1]:
                cell = costmap.cell(*point)
                assert costmap.weight[cell] == costmap.escape_weight or costmap.headings[cell]
                j, i = ((point - origin) / grid.resolution).astype(int)
                # The chamfer distance is at most 8% too far.
                assert away[i, j] >= (costmap.radius + config.margin) / 1.08
            waypoint = farthest_free_waypoint(costmap, path, start)
            k = int(np.flatnonzero((path == waypoint).all(axis=1))[0])
            assert k == len(path) - 1 or np.hypot(*np.diff(path[: k + 1], axis=0).T).sum() >= NEAREST - 1e-9
    assert num_paths > 50


def test_a_body_that_reaches_far_ahead_is_not_taken_for_its_mirror_image():
    """Its middle stands 0.3 m from the end of a blind alley where it has come in backwards, and not forwards."""
    outline = np.array([(0.7, -0.2), (0.7, 0.2), (-0.2, 0.2), (-0.2, -0.2)])
    level = np.full((40, 120), 1, np.int8)
    level[14:26, 5:114] = -1
    grid = OccupancyGrid(GridConfig())
    grid.fill(level, (0.0, 0.0))
    costmap = Costmap(grid, cover_by_discs(outline), (3.0, 1.0), CostmapConfig())
    assert costmap.headings[costmap.cell(0.55, 1.0)] & 1  # faces out of the alley's left end
    assert not costmap.headings[costmap.cell(0.55, 1.0)] & 1 << HEADINGS // 2
    assert not costmap.headings[costmap.cell(5.35, 1.0)] & 1
    assert costmap.headings[costmap.cell(5.35, 1.0)] & 1 << HEADINGS // 2
