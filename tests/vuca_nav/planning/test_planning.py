import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.planning.costmap import Costmap, CostmapConfig, chamfer, coarsen
from vuca_nav.planning.paths import _DI, _DJ, _LENGTH, UNREACHED, PathField, _dijkstra
from vuca_nav.planning.waypoints import farthest_free_waypoint
from vuca_nav.types import Pose2


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
    cost, came_by = _dijkstra(weight, 3, 4, _DI, _DJ, _LENGTH)
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
    costmap = Costmap(grid, 0.3, (1.5, 1.0), CostmapConfig())
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
    costmap = Costmap(as_grid(hall(30, 30)), 0.3, (1.51, 1.51), CostmapConfig())
    assert costmap.cell(1.51, 1.51) == costmap.cell(1.59, 1.59)
    path = PathField(costmap, (1.51, 1.51)).path_to(1.59, 1.59)
    assert path.tolist() == [[1.51, 1.51], [1.59, 1.59]]


def test_a_door_narrower_than_the_body_is_closed():
    for door, passes in ((7, False), (10, True)):
        picture = hall(60, 40)
        picture[1:39, 30] = "#"
        picture[20 : 20 + door, 30] = "."
        costmap = Costmap(as_grid(picture), 0.3, (1.5, 1.0), CostmapConfig())
        assert PathField(costmap, (1.5, 1.0)).reaches(4.5, 1.0) is passes


def test_unknown_cells_are_not_crossed():
    picture = hall(60, 40)
    picture[1:39, 25:35] = " "
    costmap = Costmap(as_grid(picture), 0.3, (1.5, 1.0), CostmapConfig())
    assert not PathField(costmap, (1.5, 1.0)).reaches(4.5, 1.0)


def test_from_too_near_a_wall_a_path_leads_away_and_none_along():
    costmap = Costmap(as_grid(hall(60, 40)), 0.3, (0.3, 2.0), CostmapConfig())
    path = PathField(costmap, (0.3, 2.0)).path_to(0.7, 3.5)
    assert len(path)
    inside = path[path[:, 0] < 0.4]
    assert inside[:, 1].max() < 2.8
    waypoint = farthest_free_waypoint(costmap, path, (0.3, 2.0))
    assert waypoint[0] > 0.4


def test_the_waypoint_is_the_farthest_in_sight():
    picture = hall(60, 40)
    picture[10:39, 30] = "#"
    costmap = Costmap(as_grid(picture), 0.3, (1.5, 1.0), CostmapConfig())
    path = PathField(costmap, (1.5, 1.0)).path_to(4.5, 1.0)
    waypoint = farthest_free_waypoint(costmap, path, (1.5, 1.0))
    k = int(np.flatnonzero((path == waypoint).all(axis=1))[0])
    assert 5 < k < len(path) - 5
    # Straight to it is free; the wall's end hides what comes after.
    assert waypoint[1] > 2.0
    open_floor = Costmap(as_grid(hall(60, 40)), 0.3, (1.5, 1.0), CostmapConfig())
    direct = PathField(open_floor, (1.5, 1.0)).path_to(4.5, 3.0)
    assert farthest_free_waypoint(open_floor, direct, (1.5, 1.0)) == pytest.approx((4.5, 3.0))


def test_outside_the_map_there_is_no_path():
    costmap = Costmap(as_grid(hall(20, 20)), 0.3, (1.0, 1.0), CostmapConfig())
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
    barred = Costmap(grid, 0.3, robot, CostmapConfig())
    assert not PathField(barred, robot).reaches(4.5, 2.0)
    mover = np.array([[3.05, 2.0, 0.1]])
    free = Costmap(grid, 0.3, robot, CostmapConfig(), mover)
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
        costmap = Costmap(grid, 0.3, robot, CostmapConfig(), doubting=doubting)
        i, j = costmap.cell(1.85, y)
        return [costmap.state[i, j] == 2, costmap.clearance[i, j] == 0]

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
    costmap = Costmap(as_grid(picture), 0.3, (1.0, 2.0), CostmapConfig())
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
