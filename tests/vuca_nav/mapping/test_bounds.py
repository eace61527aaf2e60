"""Maps grow with the world, but not for ever."""

import math
from typing import Any

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, REST, disc_body, percept_of, ranges_to_boxes, room
from vuca_nav.errors import BadArgument
from vuca_nav.mapping.grid import MOST_CELLS, GridConfig, OccupancyGrid
from vuca_nav.mapping.slam import Slam, SlamConfig
from vuca_nav.mapping.surfaces import SurfaceGrid
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan

SMALL = 700 * 700
"""Cells of 35 m each way, a little more than a grid begins with."""


def insert_at(grid: OccupancyGrid, x: float, y: float) -> bool:
    ends = np.array([[x + 1.0, y], [x, y + 1.0]])
    box = np.array([x, y, x + 1.0, y + 1.0])
    return grid.insert(Pose2(x, y, 0.0), ends, 2, np.zeros(2), box)


@pytest.mark.parametrize("kind", [OccupancyGrid, SurfaceGrid])
def test_a_grid_keeps_what_it_holds_as_it_grows_to_its_bound(kind):
    grid, inserted = kind(GridConfig(most_cells=3 * SMALL)), []
    places = [(4.0 * k, (-1.0) ** k * 2.0 * k + 0.02) for k in range(60)]
    for place in places:
        inserted.append(insert_at(grid, *place))
        assert grid.level.size <= 3 * SMALL
    assert inserted[0]
    assert not inserted[-1]
    for (x, y), there in zip(places, inserted, strict=True):
        assert (grid.state(x + 1.0, y) == 1) == there
        assert (grid.state(x + 0.5, y) == -1) == there
    assert insert_at(grid, 1.0, 1.0)  # inside, it still takes scans


def test_a_large_grid_grows_seldom():
    grid, shapes = OccupancyGrid(GridConfig(most_cells=1 << 24)), set()
    for k in range(200):
        insert_at(grid, 0.5 * k, 0.0)
        shapes.add(grid.level.shape)
    assert grid.level.shape[1] * 0.05 > 100.0
    assert len(shapes) <= 8


def test_a_nearly_full_grid_grows_by_what_it_takes():
    """By a block, where a quarter of its side would be more than it may have."""
    grid = OccupancyGrid(GridConfig(block=2.0))
    assert grid.cover(0.0, 0.0, 40.0, 1.0)
    (rows, columns), block = grid.level.shape, 40
    full = OccupancyGrid(GridConfig(block=2.0, most_cells=rows * (columns + block)))
    assert full.cover(0.0, 0.0, 40.0, 1.0)
    assert full.cover(0.0, 0.0, full.origin[0] + columns * full.resolution, 1.0)
    assert full.level.shape == (rows, columns + block)


def test_the_bound_is_below_a_gigabyte_for_both_grids():
    cells = OccupancyGrid(GridConfig()).level.size
    surfaces = SurfaceGrid(GridConfig())
    arrays = (surfaces.level, surfaces.mean, surfaces.count)
    a_cell = sum(array.nbytes for array in arrays) / cells + 4  # and the last update
    assert MOST_CELLS * (a_cell + 5) < 1e9


@pytest.mark.parametrize("box", [(0.0, 0.0, math.nan, 1.0), (-math.inf, 0.0, 1.0, 1.0), (0.0, 0.0, 1e9, 1.0)])
def test_a_rectangle_that_cannot_be_held_is_not_covered(box):
    grid = OccupancyGrid(GridConfig())
    shape = grid.level.shape
    assert not grid.cover(*box)
    assert grid.level.shape == shape


def test_a_map_known_beforehand_that_is_too_large_is_refused():
    grid = OccupancyGrid(GridConfig(most_cells=SMALL))
    with pytest.raises(BadArgument, match=r"900 x 900 cells .* cut it"):
        grid.fill(np.zeros((900, 900), np.int8), (0.0, 0.0))


class Events(Telemetry):
    def __init__(self):
        self.events = []

    def event(self, text, level="INFO"):
        self.events.append(text)


def test_beyond_its_map_the_robot_drives_on_and_says_so_once():
    config = NavigatorConfig(slam=SlamConfig(navigation_grid=GridConfig(most_cells=SMALL)))
    body, told = disc_body(), Events()
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR), config, told)
    start = Pose2(3.0, 3.0, 0.0)
    navigator.reset(start, (58.0, 3.0))
    pose, hall = start, room(60.0, 6.0)
    for k in range(900):
        odometry = Odometry(k / 30, Pose2(pose.x - start.x, 0.0, 0.0), REST)
        command = navigator.step(Scan(k / 30, ranges_to_boxes(hall, pose)), odometry)
        pose = Pose2(pose.x + 1.0 / 30, 3.0, 0.0)
    assert navigator.slam.navigation_grid.level.size <= SMALL
    assert sum("greatest size" in event for event in told.events) == 1
    assert math.isfinite(sum(command))
    assert math.dist(navigator.map_from_base[:2], pose[:2]) < 0.3


def test_slam_refuses_a_percept_of_another_lidar():
    slam = Slam(LIDAR)
    for beams in (180, 361, 720):
        lidar = LidarSpec(num_beams=beams)
        with pytest.raises(BadArgument, match=f"{beams} beams, SLAM's lidar has 360"):
            slam.update(percept_of(np.full(beams, 2.0), lidar))


@pytest.mark.parametrize("start", [(math.nan, 0.0, 0.0), (0.0, math.nan, 0.0), (0.0, 0.0, math.inf), (1e9, 0.0, 0.0)])
def test_a_mission_starts_and_ends_somewhere(start):
    body = disc_body()
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    with pytest.raises(BadArgument, match="start"):
        Slam(LIDAR).reset(Pose2(*start))
    with pytest.raises(BadArgument, match="start"):
        navigator.reset(Pose2(*start), (1.0, 1.0))
    with pytest.raises(BadArgument, match="goal"):
        navigator.reset(STANDING, start[:2] if math.isfinite(start[2]) else (math.nan, 0.0))
    whole: Any = Pose2(1, 2, 0)
    navigator.reset(whole, (3, 4))
    assert all(isinstance(value, float) for value in (*navigator.map_from_base, *(navigator.goal or ())))
