import math

import numpy as np
import pytest

from vuca_nav.geometry import transform_points
from vuca_nav.mapping.graph.branch_and_bound import Window, build_pyramid, search
from vuca_nav.types import Pose2

ORIGIN, STEP = (-2.0, -2.2), 0.05


def best_by_trying_all(occupied: np.ndarray, points: np.ndarray, window: Window) -> float:
    """Greatest mean value over all poses of the window: 1 on an occupied cell, a half beside one."""
    pad = 200
    value = np.zeros((occupied.shape[0] + 2 * pad, occupied.shape[1] + 2 * pad))
    for i, j in np.argwhere(occupied) + pad:
        value[i - 1 : i + 2, j - 1 : j + 2] = np.maximum(value[i - 1 : i + 2, j - 1 : j + 2], 0.5)
    for i, j in np.argwhere(occupied) + pad:
        value[i, j] = 1.0
    n, m = round(window.position / STEP), round(window.yaw / window.angular_step)
    best = 0.0
    for a in range(-m, m + 1):
        centre = window.centre
        turned = transform_points(Pose2(centre.x, centre.y, centre.yaw + a * window.angular_step), points)
        j, i = (np.floor((turned - ORIGIN) / STEP).astype(int) + pad).T
        best = max(best, *(value[i + u, j + v].mean() for u in range(-n, n + 1) for v in range(-n, n + 1)))
    return best


@pytest.mark.parametrize("seed", range(8))
def test_it_finds_what_trying_all_finds(seed):
    rng = np.random.default_rng(seed)
    occupied = rng.random((80, 90)) < 0.03
    points = rng.uniform(-1.5, 1.5, (30, 2))
    window = Window(Pose2(0.1, 0.2, 0.3), 0.6, 0.2, 0.05)
    found = search(build_pyramid(occupied, ORIGIN, STEP), points, window, 0.0)
    assert found is not None
    assert found.score == pytest.approx(best_by_trying_all(occupied, points, window))


def test_it_finds_a_corner_metres_away_and_turned():
    corner = np.zeros((200, 200), np.bool_)
    corner[40, 40:160] = corner[40:120, 40] = True
    cells = np.argwhere(corner)[::3]
    in_map = (cells[:, ::-1] + 0.5) * STEP
    truth = Pose2(4.3, 5.1, 0.25)
    back = Pose2(0.0, 0.0, -truth.yaw)
    points = transform_points(back, np.subtract(in_map, truth[:2], dtype=np.float64))
    window = Window(Pose2(truth.x - 3.0, truth.y + 2.5, 0.0), 4.0, math.radians(20.0), 0.0125)
    found = search(build_pyramid(corner, (0.0, 0.0), STEP), points, window, 0.5)
    assert found is not None
    assert math.dist(found.pose[:2], truth[:2]) < 0.08
    assert found.pose.yaw == pytest.approx(truth.yaw, abs=0.013)


def test_nothing_good_enough_is_nothing():
    window = Window(Pose2(0.0, 0.0, 0.0), 0.5, 0.1, 0.05)
    assert search(build_pyramid(np.zeros((50, 50), np.bool_), ORIGIN, STEP), np.ones((5, 2)), window, 0.1) is None
