"""Tracks that the map explains do not move, others do."""

import numpy as np

from vuca_nav.geometry import compose
from vuca_nav.perception.percept import LevelScan
from vuca_nav.perception.standing_map import AGE, StandingMap
from vuca_nav.perception.tracks import RADIUS, TRACK_SIZE, X, Y
from vuca_nav.types import FloatArray, Pose2

RATE, STEP, ORIGIN = 30.0, 0.05, (-5.0, -5.0)
HERE, ODOMETRY = Pose2(1.0, -0.5, 0.7), Pose2(3.0, 2.0, -0.4)
POSTS = np.array([[2.0, 0.0], [2.0, 0.2], [2.0, 0.4]])
"""Places in base_link."""


def seen(points: FloatArray) -> LevelScan:
    """A scan that ends on these points of base_link."""
    ranges = np.hypot(points[:, 0], points[:, 1])
    return LevelScan(ranges, points / ranges[:, None], np.zeros(len(points), np.bool_))


def tracks(*places: tuple[float, float]) -> FloatArray:
    """Tracks of a radius of 0.1 m at places in base_link."""
    found = np.zeros((len(places), TRACK_SIZE))
    found[:, [X, Y]], found[:, RADIUS] = places, 0.1
    return found


def mapped(seconds: float, points: FloatArray = POSTS) -> StandingMap:
    """The posts have been in the map for so long."""
    level = np.full((200, 200), -5, np.int8)
    for x, y in points:
        in_map = compose(HERE, Pose2(x, y, 0.0))
        level[int((in_map.y - ORIGIN[1]) / STEP), int((in_map.x - ORIGIN[0]) / STEP)] = 9
    standing = StandingMap(RATE)
    for _ in range(round(seconds * RATE)):
        standing.take(level, ORIGIN, STEP, (HERE, ODOMETRY))
    return standing


def test_a_track_on_what_has_stood_for_long_does_not_move():
    moving = tracks((2.0, 0.1), (2.0, -2.0))
    points = np.vstack([POSTS, [[1.9, -2.0]]])
    left = mapped(2.5 * AGE).unexplained(moving, seen(points), ODOMETRY)
    assert left[:, [X, Y]].tolist() == [[2.0, -2.0]]


def test_what_has_been_mapped_a_moment_ago_may_move():
    assert len(mapped(0.5 * AGE).unexplained(tracks((2.0, 0.1)), seen(POSTS), ODOMETRY)) == 1


def test_a_mover_beside_a_post_moves():
    mover = np.array([[1.8, 0.1], [1.82, 0.15], [1.8, 0.05], [1.79, 0.12]])
    moving = tracks((1.85, 0.1))
    assert len(mapped(2.5 * AGE).unexplained(moving, seen(np.vstack([POSTS, mover])), ODOMETRY)) == 1


def test_the_map_goes_with_the_robot():
    """Half a metre on by odometry since the map was taken in, the same posts are nearer."""
    on = compose(ODOMETRY, Pose2(0.5, 0.0, 0.0))
    nearer = POSTS - [0.5, 0.0]
    assert len(mapped(2.5 * AGE).unexplained(tracks((1.5, 0.1)), seen(nearer), on)) == 0
    assert len(mapped(2.5 * AGE).unexplained(tracks((1.5, 0.1)), seen(nearer), ODOMETRY)) == 1


def test_nothing_mapped_leaves_all_tracks():
    standing = mapped(2.5 * AGE)
    standing.reset()
    assert len(standing.unexplained(tracks((2.0, 0.1)), seen(POSTS), ODOMETRY)) == 1
