import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vuca_nav.geometry import between, compose, distance, inverse, multiplied, transform_points, wrap_angle
from vuca_nav.types import Pose2

coordinate = st.floats(-50.0, 50.0)
poses = st.builds(Pose2, coordinate, coordinate, st.floats(-math.pi, math.pi, exclude_max=True))


def same(a: Pose2, b: Pose2) -> bool:
    return distance(a, b) < 1e-9 and abs(wrap_angle(a.yaw - b.yaw)) < 1e-9


@given(poses, poses, poses)
def test_composition_is_a_group(a, b, c):
    identity = Pose2(0.0, 0.0, 0.0)
    assert same(compose(a, inverse(a)), identity)
    assert same(compose(identity, a), a)
    assert same(compose(compose(a, b), c), compose(a, compose(b, c)))
    assert same(compose(a, between(a, b)), b)


@given(poses, coordinate, coordinate)
def test_points_move_like_poses(a_from_b, x, y):
    by_pose = compose(a_from_b, Pose2(x, y, 0.0))
    by_points = transform_points(a_from_b, np.array([[x, y]]))[0]
    np.testing.assert_allclose(by_points, by_pose[:2], atol=1e-9)


def test_points_are_rotated_in_a_fixed_order():
    """Every product and sum is rounded once, as plain Python does it: no order or fused product of a BLAS."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(1000, 2))
    pose = Pose2(*rng.normal(size=3).tolist())
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    by_hand = [((c * x + -s * y) + pose.x, (s * x + c * y) + pose.y) for x, y in points.tolist()]
    assert transform_points(pose, points).tolist() == [list(point) for point in by_hand]
    assert multiplied(np.array([[c, -s], [s, c]]), points).tolist() == [
        [c * x + -s * y, s * x + c * y] for x, y in points.tolist()
    ]


def test_a_quarter_turn():
    moved = compose(Pose2(1.0, 2.0, math.pi / 2), Pose2(3.0, 0.0, 0.0))
    np.testing.assert_allclose(moved, (1.0, 5.0, math.pi / 2), atol=1e-12)


@given(st.floats(-1e3, 1e3))
def test_wrapped_angles_point_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert abs(math.sin(wrapped) - math.sin(angle)) < 1e-9
    assert abs(math.cos(wrapped) - math.cos(angle)) < 1e-9
