"""A robot that loses its place: carried off, held up by a hand before its lidar, in two rooms that look alike."""

import math

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, moved, room, scan_of
from vuca_nav.geometry import compose, distance, wrap_angle
from vuca_nav.mapping.graph_slam import GraphSlam
from vuca_nav.mapping.tracking import TrackingMonitor
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import STANDING, Pose2

ANGLES = LIDAR.angles_in_base()
BEAMS, STATIC = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]), np.zeros(LIDAR.num_beams, np.bool_)
FURNISHED = np.vstack([room(9.0, 6.0), [[2.0, 3.5, 3.2, 4.0], [6.0, 1.0, 6.4, 2.5], [7.5, 4.5, 8.2, 6.0]]])


class Robot:
    """Drives in a place, with exact odometry that does not notice when it is carried."""

    def __init__(self, boxes, start):
        self.boxes, self.truth, self.odometry, self.time = boxes, start, STANDING, 0.0
        self.period = 1.0 / 30.0
        self.rng, self.slam = np.random.default_rng(5), GraphSlam(LIDAR)
        self.slam.reset(start)

    def go(self, scans, forward, turn, hand=None):
        for _ in range(scans):
            ranges = scan_of(self.boxes, self.truth, rng=self.rng).ranges
            if hand is not None:
                ranges[hand] = 0.3
            estimate = self.slam.update(LevelScan(ranges, BEAMS, STATIC), self.odometry, self.time)
            self.error = distance(estimate, self.truth), abs(wrap_angle(estimate.yaw - self.truth.yaw))
            self.time += self.period
            self.truth = moved(self.truth, forward, turn)
            self.odometry = compose(self.odometry, Pose2(forward, 0.0, turn))


def in_the_room():
    robot = Robot(FURNISHED, Pose2(1.0, 1.5, 0.0))
    robot.go(80, 0.05, 0.0)
    robot.go(30, 0.0, math.pi / 60)
    robot.go(40, 0.05, 0.0)
    assert robot.slam.tracking == "tracked"
    return robot


@pytest.mark.parametrize("place", [Pose2(2.0, 1.2, -1.4), Pose2(7.5, 3.5, 0.4), Pose2(4.5, 5.0, 2.5)])
def test_a_robot_that_is_carried_off_is_found_again(place):
    robot = in_the_room()
    keyframes = len(robot.slam.store.keyframes)
    robot.truth = place
    robot.go(1, 0.0, 0.0)
    assert robot.slam.tracking == "lost"
    robot.go(150, 0.0, 0.0)
    assert len(robot.slam.store.keyframes) == keyframes  # nothing was drawn meanwhile
    assert robot.slam.tracking == "tracked"
    assert robot.slam.num_found == 1
    robot.go(20, 0.03, 0.03)
    assert robot.error[0] < 0.05
    assert robot.error[1] < 0.02


def test_what_stands_in_its_light_does_not_move_a_robot():
    robot = in_the_room()
    robot.go(5, 0.0, 0.0, hand=slice(40, 300))
    assert robot.slam.tracking == "lost"
    robot.go(10, 0.0, 0.0)
    assert robot.slam.tracking == "tracked"
    assert robot.slam.num_found == 0
    assert robot.error[0] < 0.03


def test_one_of_two_rooms_alike_is_not_guessed():
    """Two equal rooms, both driven through: whoever is put into one cannot be in the other, and does not claim so."""
    walls = []
    for x in (0.0, 5.0):
        walls += [[x, 2.0, x + 1.0, 2.2], [x + 2.2, 2.0, x + 5.0, 2.2], [x, 2.0, x + 0.2, 6.0], [x, 6.0, x + 5.0, 6.2]]
        walls += [[x + 3.2, 4.0, x + 4.2, 4.8]]
    walls += [[10.0, -0.2, 10.2, 6.2], [-0.2, -0.2, 10.2, 0.0], [-0.2, -0.2, 0.0, 6.2]]
    robot = Robot(np.array(walls), Pose2(1.6, 1.0, 0.0))
    visit = [
        (15, 0.0, math.pi / 30),
        (50, 0.06, 0.0),
        (30, 0.0, math.pi / 30),
        (50, 0.06, 0.0),
        (15, 0.0, math.pi / 30),
    ]
    for leg in [*visit, (100, 0.05, 0.0), *visit]:
        robot.go(*leg)
    assert robot.error[0] < 0.06
    doors = robot.truth
    robot.truth = Pose2(doors.x + 1.0, 5.2, 0.3)  # deep in the second room, where the door is out of sight
    robot.go(200, 0.0, 0.0)
    assert robot.slam.tracking == "lost" or robot.error[0] < 0.1


@pytest.mark.parametrize(
    ("way", "turn", "period", "tells"), [(0.05, 0.0, 0.1, True), (1.0, 0.0, 0.1, False), (0.0, 0.5, 0.1, False),
                                         (0.05, 0.0, 4.0, False), (0.05, 0.0, 0.0, False)]
)  # fmt: skip
def test_only_scans_close_together_tell_of_a_robot_that_is_carried(way, turn, period, tells):
    """Sparse logs keep a scan a metre, or one in some seconds: other things are seen behind each pier."""
    monitor = TrackingMonitor(LIDAR)
    for k, place in enumerate((Pose2(1.0, 1.5, 0.0), Pose2(7.5, 3.5, 1.4))):
        level = LevelScan(scan_of(FURNISHED, place).ranges, BEAMS, STATIC)
        has_jumped = monitor.has_jumped(level, Pose2(way, 0.0, turn), 10.0 + k * period)
    assert has_jumped == tells
    assert monitor.is_sparse != tells
