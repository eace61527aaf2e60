"""What stands and what may walk, in the open and among walls."""

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, NOTHING, Sensors, moved, room, scan_of
from vuca_nav.geometry import compose, distance
from vuca_nav.mapping.graph_slam import GraphSlam
from vuca_nav.mapping.slam import Slam
from vuca_nav.mapping.standing import PROOF, Standing
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import STANDING, Pose2

ANGLES = LIDAR.angles_in_base()
BEAMS, STATIC = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]), np.zeros(LIDAR.num_beams, np.bool_)
PERIOD = 1.0 / 30.0
START = Pose2(0.0, 0.0, 0.0)
PEOPLE = np.array(
    [[3.0, 2.0], [4.5, -2.5], [7.0, 1.0], [8.0, -4.0], [10.0, 3.0], [12.0, -1.0], [-3.0, 2.5], [1.0, 5.0]]
)


def squares(centres, side=0.4):
    return np.hstack([centres - 0.5 * side, centres + 0.5 * side])


def drive(boxes_at, scans, odometry_scale=1.0):
    """Drive straight at 1 m/s; errors of SLAM and of odometry at the end."""
    rng, slam = np.random.default_rng(3), GraphSlam(LIDAR)
    slam.reset(START)
    truth, odometry, estimate = START, STANDING, START
    for k in range(scans):
        ranges = scan_of(boxes_at(k * PERIOD), truth, rng=rng).ranges
        estimate = slam.update(LevelScan(ranges, BEAMS, STATIC), odometry, k * PERIOD)
        errors = distance(estimate, truth), distance(odometry, truth)
        truth = moved(truth, PERIOD, 0.0)
        odometry = compose(odometry, Pose2(odometry_scale * PERIOD, 0.0, 0.0))
    return slam, errors


@pytest.mark.parametrize("velocity", [(1.2, 0.0), (0.6, 0.0), (0.0, 1.0)])
def test_nobody_is_followed_across_an_open_field(velocity):
    slam, (error, _) = drive(lambda t: squares(PEOPLE + t * np.array(velocity)), 240)
    assert error < 0.01
    assert slam.tracking == "tracked"


def test_posts_in_an_open_field_are_landmarks():
    posts = squares(np.array([[x, y] for x in range(-2, 16, 3) for y in (-3.0, 2.5)]))
    _, (error, by_odometry) = drive(lambda _: posts, 300, odometry_scale=1.04)
    assert by_odometry > 0.35
    assert error < 0.4 * by_odometry


def level_of(boxes, pose=START):
    return LevelScan(scan_of(boxes, pose).ranges, BEAMS, STATIC)


def marked(standing, boxes, stamp):
    """Share of the returns that are marked."""
    level = standing.mark(level_of(boxes), STANDING, stamp)
    return level.is_mover[np.isfinite(level.ranges)].mean()


def test_something_slight_stands_once_it_has_been_seen_for_long():
    standing, box = Standing(LIDAR, 20.0), squares(np.array([[3.0, 0.0]]))
    times = np.arange(0.0, PROOF + 0.2, 0.1)
    shares = np.array([marked(standing, box, t) for t in times])
    assert (shares[times < PROOF - 0.05] == 1.0).all()
    assert (shares[times > PROOF + 0.05] == 0.0).all()
    for k in range(1, 10):
        standing.mark(LevelScan(NOTHING, BEAMS, STATIC), STANDING, times[-1] + 0.1 * k)
    assert marked(standing, box, times[-1] + 1.0) == 1.0


def test_something_slight_that_moves_never_stands():
    standing = Standing(LIDAR, 20.0)
    shares = [marked(standing, squares(np.array([[3.0 + 0.04 * k, 0.5]])), 0.1 * k) for k in range(100)]
    assert min(shares) == 1.0


def test_a_wall_stands_at_once():
    assert marked(Standing(LIDAR, 20.0), np.array([[3.0, -2.0, 3.3, 2.0]]), 0.0) == 0.0


def test_among_walls_everything_counts():
    boxes = np.vstack([room(10.0, 8.0), squares(np.array([[4.0, 3.0]]))])
    level = Standing(LIDAR, 20.0).mark(level_of(boxes, Pose2(2.0, 2.0, 0.0)), STANDING, 0.0)
    assert not level.is_mover.any()


def test_an_open_field_is_mapped_by_odometry():
    """Though nothing is matched there, the robot has to see where it is free."""
    slam, sensors, truth, path = Slam(LIDAR), Sensors(), START, moved(START, 0.05, 0.0)
    slam.reset(START)
    for k in range(60):
        walker = squares(np.array([[5.0, 2.0 + 0.04 * k]]))
        estimate = slam.update(sensors.see(scan_of(walker, truth).ranges, path if k else STANDING))
        truth = moved(truth, 0.05 if k < 59 else 0.0, 0.0)
    assert distance(estimate.map_from_base, truth) < 0.01
    assert (estimate.score, estimate.tracking) == (1.0, "tracked")
    states = [estimate.navigation_grid.state(14.0, 0.02 + 0.05 * k) for k in range(-4, 5)]
    assert -1 in states  # 12 m are seen, by a beam each 0.2 m there
