"""The distance field against brute force, and what is read from it."""

import math

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from tests.vuca_nav.rooms import LIDAR, Sensors, percept_of, ranges_to_boxes, room
from vuca_nav.perception.distance_field import DistanceField, clearance_at, fill_field, smooth_clearance_at
from vuca_nav.perception.perception import PerceptionConfig
from vuca_nav.types import Pose2

ANGLES = LIDAR.angles_in_base()
BEAMS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
DISC = np.array([[0.0, 0.0, 0.3]])
FAR = 32000


def filled(ranges: np.ndarray, reach: float, resolution: float = 0.05) -> DistanceField:
    field = DistanceField.empty(reach, resolution)
    fill_field(ranges, BEAMS, field)
    return field


def random_ranges(seed: int) -> np.ndarray:
    """A room, or single returns here and there; some beams met nothing, some are broken, some end at the body."""
    rng = np.random.default_rng(seed)
    if seed % 2:
        ranges = ranges_to_boxes(room(4.0, 3.0), Pose2(*rng.uniform((0.5, 0.5, -3.0), (3.5, 2.5, 3.0))))
    else:
        ranges = np.where(rng.random(360) < 0.02, rng.uniform(0.0, 5.0, 360), np.inf)
    ranges[rng.random(360) < 0.05] = rng.choice([np.inf, np.nan, 0.05])
    return ranges


def two_passes(ranges: np.ndarray, reach: float, resolution: float) -> np.ndarray:
    """The 5-7 chamfer as it is in the book: from above and from below, each cell from the neighbours before it."""
    n = 2 * round(reach / resolution)
    reach = 0.5 * n * resolution
    field = np.full((n, n), FAR, np.int64)
    for r, (x, y) in zip(ranges, BEAMS):
        if r < 1.5 * reach:
            i, j = int((r * y + reach) / resolution), int((r * x + reach) / resolution)
            if 0 <= i < n and 0 <= j < n:
                field[i, j] = 0
    for order in (1, -1):
        for i in range(1, n)[::order] if order > 0 else range(n - 1)[::-1]:
            for j in range(1, n - 1)[::order]:
                before = [(i - order, j - 1, 7), (i - order, j, 5), (i - order, j + 1, 7), (i, j - order, 5)]
                field[i, j] = min(field[i, j], *(field[a, b] + step for a, b, step in before))
    return field


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(("reach", "resolution"), [(2.6, 0.05), (1.5, 0.1)])
def test_it_is_the_two_pass_chamfer(seed, reach, resolution):
    ranges = random_ranges(seed)
    np.testing.assert_array_equal(filled(ranges, reach, resolution).fifths, two_passes(ranges, reach, resolution))


@pytest.mark.parametrize("seed", range(12))
def test_it_is_close_to_the_euclidean_distance(seed):
    field = filled(random_ranges(seed), 2.6)
    exact = np.asarray(distance_transform_edt(field.fifths != 0))
    inner = (slice(1, -1),) * 2  # the outermost cells are not worked out
    chamfer, exact = field.fifths[inner] / 5.0, exact[inner]
    assert (chamfer <= 1.08 * exact + 1e-9).all()
    assert (chamfer >= 0.98 * exact - 1e-9).all()  # 7/5 for a diagonal


def test_without_returns_everything_is_far():
    for nothing in (math.inf, math.nan):
        assert (filled(np.full(360, nothing), 2.6).fifths == FAR).all()
        assert clearance_at(filled(np.full(360, nothing), 2.6), DISC, 0.0, 0.0, 1.0, 0.0) > 100.0


def test_an_old_scan_leaves_no_trace():
    field = filled(random_ranges(1), 2.6)
    fill_field(random_ranges(2), BEAMS, field)
    np.testing.assert_array_equal(field.fifths, filled(random_ranges(2), 2.6).fifths)


def one_return(x: float, y: float) -> DistanceField:
    """Of 2 m, with a single return."""
    field = DistanceField.empty(2.0, 0.05)
    away = math.hypot(x, y)
    fill_field(np.array([away]), np.array([[x / away, y / away]]), field)
    return field


def test_the_clearance_of_discs_is_known():
    field = one_return(1.025, 0.025)
    assert clearance_at(field, DISC, 0.0, 0.0, 1.0, 0.0) == pytest.approx(1.0 - 0.3)
    ahead = np.array([[0.2, 0.0, 0.3]])
    assert clearance_at(field, ahead, 0.025, 0.0, 1.0, 0.0) == pytest.approx(0.8 - 0.3)
    # Turned to the left, the disc is beside; to the right about, behind.
    assert clearance_at(field, ahead, 0.025, 0.025, -1.0, 0.0) == pytest.approx(1.2 - 0.3)
    assert clearance_at(field, np.vstack([DISC, ahead]), 0.025, 0.0, 1.0, 0.0) == pytest.approx(0.8 - 0.3)
    assert clearance_at(field, DISC, 5.0, 0.0, 1.0, 0.0) == 1e9


def test_the_smooth_clearance_goes_evenly_from_cell_to_cell():
    field = one_return(1.025, 0.025)
    xs = np.arange(-1.0, 0.9, 0.003)
    smooth = np.array([smooth_clearance_at(field, DISC, x, 0.025, 1.0, 0.0) for x in xs])
    assert smooth == pytest.approx(1.025 - xs - 0.3)
    coarse = np.array([clearance_at(field, DISC, x, 0.025, 1.0, 0.0) for x in xs])
    assert np.abs(smooth - coarse).max() <= 0.0251  # half a cell
    assert smooth_clearance_at(field, DISC, 5.0, 0.0, 1.0, 0.0) == 1e9


@pytest.mark.parametrize("seed", range(20))
def test_no_return_is_nearer_than_the_uncertainty_allows(seed):
    """Of the clearance that is read to the true one, the chamfer's least share taken into account."""
    rng, ranges = np.random.default_rng(seed), random_ranges(seed)
    field = filled(ranges, 2.6)
    points = ranges[ranges < 12.0, None] * BEAMS[ranges < 12.0]
    for x, y in rng.uniform(-2.0, 2.0, (200, 2)):
        true = np.hypot(*(points - (x, y)).T).min(initial=np.inf)
        read = smooth_clearance_at(field, np.zeros((1, 3)), x, y, 1.0, 0.0)
        if true < 0.5:  # farther off it may lie outside of the field
            assert read >= 0.98 * true - field.uncertainty


def test_a_percepts_field_is_that_of_its_scan():
    sensors = Sensors(config=PerceptionConfig(field_reach=1.6, field_resolution=0.1))
    for seed in range(5):
        ranges = random_ranges(seed)
        percept = sensors.see(ranges)
        if seed != 3:  # nobody asks at this tick
            field = percept.distance_field
            np.testing.assert_array_equal(field.fifths, filled(ranges, 1.6, 0.1).fifths)
            assert (field.reach, field.resolution) == (1.6, 0.1)
            assert percept.distance_field is field
    assert percept_of(random_ranges(1)).field.uncertainty == pytest.approx(1.5 * math.sqrt(2.0) * 0.05)
