import numpy as np
import pytest
import yaml
from PIL import Image

from eval.prior_map import rasterise, read_prior_map
from vuca_nav.errors import VucaError
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.map_file import write_map
from vuca_nav.types import Pose2
from worlds.world import Box, Cylinder, Obstacle, World


def test_obstacles_are_occupied_free_floor_is_free_and_beyond_is_unknown():
    obstacles = (
        Obstacle("wall", Box(5.0, 2.0, 2.0, 0.2, 0.0, 2.0)),
        Obstacle("pillar", Cylinder(2.0, 4.0, 0.3, 2.0)),
        Obstacle("low", Box(8.0, 4.0, 0.4, 0.4, 0.785398, 0.05)),
    )
    grid = rasterise(World("w", 0, (0.0, 0.0, 10.0, 6.0), obstacles, (), Pose2(1.0, 1.0, 0.0), (9.0, 1.0)))
    for x, y in ((4.02, 2.0), (5.98, 2.0), (5.0, 2.08), (2.28, 4.0), (2.0, 3.72), (8.0, 4.26), (8.0, 4.0)):
        assert grid.state(x, y) == 1, (x, y)
    for x, y in ((3.9, 2.0), (6.1, 2.0), (5.0, 2.2), (2.4, 4.0), (8.2, 4.2), (1.0, 1.0), (9.0, 1.0)):
        assert grid.state(x, y) == -1, (x, y)
    for x, y in ((-0.5, 3.0), (10.5, 3.0), (5.0, 6.5)):
        assert grid.state(x, y) == 0, (x, y)


def test_what_hangs_above_the_robot_is_left_out():
    beams = tuple(Obstacle("wall", Box(x, 3.0, 0.2, 6.0, 0.0, 0.3, base=base)) for x, base in ((3.0, 1.0), (6.0, 2.1)))
    grid = rasterise(World("w", 0, (0.0, 0.0, 10.0, 6.0), beams, (), Pose2(1.0, 1.0, 0.0), (9.0, 1.0)), 1.262)
    assert grid.state(3.0, 3.0) == 1
    assert grid.state(6.0, 3.0) == -1


def world_map(folder, image: np.ndarray, resolution: float = 0.05, origin=(0.0, 0.0, 0.0)):
    """A map of map_server; the image's first row is its upper one."""
    Image.fromarray(image).save(folder / "map.pgm")
    facts = {"image": "map.pgm", "resolution": resolution, "origin": list(origin), "negate": 0}
    facts |= {"occupied_thresh": 0.65, "free_thresh": 0.196}
    (folder / "map.yaml").write_text(yaml.safe_dump(facts))
    return folder / "map.yaml"


def states(grid: OccupancyGrid, corner: tuple[float, float], rows: int, columns: int) -> list[list[int]]:
    """States of cells, the lowest row first."""
    x, y = corner
    return [[grid.state(x + 0.05 * (j + 0.5), y + 0.05 * (i + 0.5)) for j in range(columns)] for i in range(rows)]


def test_a_map_that_was_written_is_read_cell_by_cell(tmp_path):
    rng = np.random.default_rng(0)
    level = rng.integers(-1, 2, (90, 70)).astype(np.int8)
    level[0, 0] = level[-1, -1] = 1
    written = OccupancyGrid(GridConfig(), (3.0, -8.0))
    written.fill(level, (2.35, -9.6))
    write_map(written, tmp_path / "map.yaml")
    read = read_prior_map(tmp_path / "map.yaml")
    np.testing.assert_array_equal(states(read, (2.35, -9.6), 90, 70), level)
    assert np.count_nonzero(read.level) == np.count_nonzero(level)


def test_larger_cells_are_split_and_of_smaller_ones_the_occupied_count(tmp_path):
    image = np.array([[0, 254], [205, 254]], np.uint8)
    coarse = read_prior_map(world_map(tmp_path, image, 0.1, (1.0, 2.0, 0.0)))
    assert states(coarse, (1.0, 2.0), 4, 4) == [[0, 0, -1, -1], [0, 0, -1, -1], [1, 1, -1, -1], [1, 1, -1, -1]]
    image = np.full((4, 6), 254, np.uint8)
    image[0, 1], image[3, 2] = 0, 205
    fine = read_prior_map(world_map(tmp_path, image, 0.025, (1.0, 2.0, 0.0)))
    assert states(fine, (1.0, 2.0), 2, 3) == [[-1, 0, -1], [1, -1, -1]]
    # From the middle of a cell on: its other half is unknown.
    fine = read_prior_map(world_map(tmp_path, np.full((2, 4), 254, np.uint8), 0.025, (1.025, 2.0, 0.0)))
    assert states(fine, (1.0, 2.0), 1, 3) == [[0, -1, 0]]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"resolution": 0.07}, r"a side of 0\.07 m; 0\.05 m, or a whole multiple or part"),
        ({"origin": (0.0, 0.0, 0.3)}, r"turned by 0\.3 rad; 0 would be right"),
        ({"resolution": 60.0 / 9.0}, "200 m each way would be right"),
        ({"resolution": 4.0}, r"a side of 4 m; 0\.05 m"),
    ],
)
def test_a_map_that_does_not_fit_the_grid_is_refused(tmp_path, changes, says):
    path = world_map(tmp_path, np.full((40, 4), 254, np.uint8), **changes)
    with pytest.raises(VucaError, match=says) as error:
        read_prior_map(path)
    assert "map" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_map_without_its_image_is_refused(tmp_path):
    path = world_map(tmp_path, np.full((4, 4), 254, np.uint8))
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(VucaError, match=r"there is no map\.pgm"):
        read_prior_map(path)
