import math

import numpy as np
import pytest

from robots.clearance import FootprintClearance
from worlds.arrays import pack_shapes
from worlds.world import Box, Cylinder

SQUARE = np.array([(0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)])
NO_POSES = np.empty((0, 3))


def clearance(shapes, x, y, yaw, parts=(), poses=NO_POSES, height=1.0, footprint=SQUARE):
    return FootprintClearance(pack_shapes(shapes), pack_shapes(parts), footprint, height).distance(x, y, yaw, poses)


@pytest.mark.parametrize(
    ("shape", "pose", "expected"),
    [
        (Box(3.0, 0.0, 2.0, 8.0, 0.0, 1.0), (0.0, 0.0, 0.0), 1.5),  # face to face
        (Box(3.0, 0.0, 2.0, 8.0, 0.0, 1.0), (0.0, 0.0, math.pi / 4), 2.0 - math.sqrt(0.5)),  # corner to face
        (Box(3.0, 0.0, 2.0, 2.0, math.pi / 4, 1.0), (0.0, 0.0, 0.0), 2.5 - math.sqrt(2.0)),  # face to corner
        (Box(3.0, 3.0, 2.0, 2.0, 0.0, 1.0), (0.0, 0.0, 0.0), math.hypot(1.5, 1.5)),  # corner to corner
        (Cylinder(3.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.0), 1.5),
        (Cylinder(3.0, 3.0, 1.0, 1.0), (0.0, 0.0, 0.0), math.hypot(2.5, 2.5) - 1.0),
        (Box(0.0, 0.0, 8.0, 0.1, 0.3, 1.0), (0.0, 0.0, 0.0), 0.0),  # a plank right through: no corner inside
        (Box(0.0, 0.0, 8.0, 8.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0),
        (Cylinder(0.1, 0.0, 0.1, 1.0), (0.0, 0.0, 0.0), 0.0),
        (Box(3.0, 0.0, 2.0, 8.0, 0.0, 1.0, base=1.5), (0.0, 0.0, 0.0), math.inf),  # hangs above it
    ],
)
def test_by_hand(shape, pose, expected):
    assert clearance([shape], *pose) == pytest.approx(expected, abs=1e-12)


def test_the_nearest_of_static_and_moving_counts():
    wall, part = Box(3.0, 0.0, 2.0, 8.0, 0.0, 1.0), Cylinder(0.0, 0.0, 0.25, 1.0)
    assert clearance([wall], 0.0, 0.0, 0.0, [part], np.array([(-1.0, 0.0, 0.0)])) == pytest.approx(0.25)
    assert clearance([wall], 0.0, 0.0, 0.0, [part], np.array([(-9.0, 0.0, 0.0)])) == pytest.approx(1.5)
    assert clearance([], 0.0, 0.0, 0.0) == math.inf


def test_beyond_a_limit_is_a_clearance_of_at_least_the_limit():
    wall, part = Box(3.0, 0.0, 2.0, 8.0, 0.0, 1.0), Cylinder(0.0, 0.0, 0.25, 1.0)
    footprint = FootprintClearance(pack_shapes([wall]), pack_shapes([part]), SQUARE, 1.0)
    for part_x, away in ((-1.0, 0.25), (-9.0, 1.5)):
        pose = 0.0, 0.0, 0.0, np.array([(part_x, 0.0, 0.0)])
        assert footprint.is_beyond(away - 1e-9, *pose)
        assert not footprint.is_beyond(away + 1e-9, *pose)
    nothing = FootprintClearance(pack_shapes([]), pack_shapes([]), SQUARE, 1.0)
    assert nothing.is_beyond(math.inf, 0.0, 0.0, 0.0, NO_POSES)


def test_agrees_with_dense_sampling_of_both_outlines():
    rng = np.random.default_rng(0)
    along = np.linspace(0.0, 1.0, 150)[:, None]

    def outline(corners):
        return np.concatenate([a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0))])

    for _ in range(40):
        x, y, length, width = rng.uniform((-3, -3, 0.1, 0.1), 3.0).tolist()
        box = Box(x, y, length, width, rng.uniform(-4, 4), 1.0)
        yaw = rng.uniform(-4, 4)
        half = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (box.length / 2, box.width / 2)
        turned = [corners @ np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
                  for corners, a in ((half, box.yaw), (SQUARE, yaw))]  # fmt: skip
        theirs, ours = outline(turned[0] + (box.x, box.y)), outline(turned[1])
        sampled = np.sqrt(((theirs[:, None] - ours[None]) ** 2).sum(axis=2).min())
        exact = clearance([box], 0.0, 0.0, yaw)
        assert exact <= sampled + 1e-9
        assert exact == 0.0 or sampled - exact < 0.02
