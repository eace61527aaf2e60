import math

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, moved, room, scan_of
from vuca_nav.geometry import compose, distance
from vuca_nav.mapping.graph_slam import GraphSlam
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import STANDING, Pose2

ANGLES = LIDAR.angles_in_base()
BEAMS, STATIC = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]), np.zeros(LIDAR.num_beams, np.bool_)


def drive(boxes, start, legs, *, scale=0.0, turn=0.0, offset=0.0, slip=(10**9, 0.0)):
    """Run SLAM along legs of (scans, metres, radians): the slam, and errors of SLAM and of odometry in each scan.

    From the scan ``slip[0]`` on odometry goes ``slip[1]`` too far, beside its error of scale.
    """
    rng = np.random.default_rng(7)
    slam = GraphSlam(LIDAR)
    slam.reset(start)
    truth, odometry, errors = start, STANDING, []
    for scans, forward, yaw in legs:
        for _ in range(scans):
            ranges = scan_of(boxes, truth, rng=rng).ranges
            pose = slam.update(LevelScan(ranges, BEAMS, STATIC), odometry)
            errors.append((distance(pose, truth), distance(compose(start, odometry), truth)))
            truth = moved(truth, forward, yaw)
            ahead = 1.0 + scale + (slip[1] if len(errors) > slip[0] else 0.0)
            odometry = compose(odometry, Pose2(ahead * forward, 0.0, (1.0 + turn) * yaw + offset * forward))
    return slam, np.array(errors)


@pytest.mark.parametrize("scale", [0.0, 0.03])
def test_a_bare_corridor_is_no_worse_than_dead_reckoning(scale):
    _, errors = drive(room(60.0, 2.0), Pose2(2.0, 1.0, 0.0), [(560, 0.1, 0.0)], scale=scale)
    assert errors[-1, 1] == pytest.approx(scale * 55.9, abs=0.01)
    assert errors[-1, 0] < errors[-1, 1] + 0.02


def test_a_loop_closes_with_odometry_that_turns_too_far():
    blocks = [[4.0, 4.0, 26.0, 10.0], [4.0, 10.0, 12.0, 20.0], [15.0, 13.0, 26.0, 20.0], [20.0, 0.5, 20.6, 1.1]]
    legs = [(260, 0.1, 0.0), (30, 0.0, math.pi / 60), (200, 0.1, 0.0), (30, 0.0, math.pi / 60)] * 3
    slam, errors = drive(np.vstack([room(30.0, 24.0), blocks]), Pose2(2.0, 2.0, 0.0), legs, scale=0.03, turn=0.04)
    assert errors[:, 1].max() > 3.0
    assert errors[:, 0].max() < 0.2
    assert errors[-300:, 0].max() < 0.08  # in the third lap
    assert slam.back_end.num_closed > 0


def test_two_rooms_alike_stay_two_rooms():
    """Along a corridor with two equal rooms; back and forth, so that there are finished submaps to be mistaken for."""
    walls = []
    for x in (0.0, 8.0):
        walls += [[x, 2.0, x + 2.0, 2.2], [x + 3.5, 2.0, x + 8.0, 2.2], [x, 2.0, x + 0.2, 7.0], [x, 7.0, x + 8.0, 7.2]]
        walls += [[x + 5.0, 4.0, x + 6.0, 4.8]]
    walls += [[16.0, -0.2, 16.2, 7.2], [-0.2, -0.2, 16.2, 0.0], [-0.2, -0.2, 0.0, 7.2]]
    about = [(24, 0.0, math.pi / 24)]
    aside = [(12, 0.0, math.pi / 24), (40, 0.1, 0.0), *about, (40, 0.1, 0.0), (12, 0.0, math.pi / 24)]
    between_rooms = [(80, 0.1, 0.0)]
    legs = (aside + between_rooms + aside + about + [(80, 0.1, 0.0)] + about) * 2
    truth = Pose2(2.7, 1.0, 0.0)
    boxes = np.array(walls)
    _, errors = drive(boxes, truth, legs, scale=0.02, turn=0.02)
    assert errors[:, 0].max() < 0.06


def test_matches_do_not_confirm_odometry_by_its_own_pull():
    """Odometry that is perfect for 18 m, and then slips for as long: doors and niches show where the robot is."""
    doors = [[x, 1.9, x + 1.0, 2.3] for x in np.arange(1.0, 58.0, 3.7)] + [
        [x, -0.3, x + 1.2, 0.1] for x in np.arange(2.0, 58.0, 5.3)
    ]
    boxes = np.vstack([[[-0.5, -0.7, 60.5, -0.5], [-0.5, 2.5, 60.5, 2.7], [-0.7, -0.7, -0.5, 2.7]], doors])
    start = Pose2(2.0, 1.0, 0.0)
    _, errors = drive(boxes, start, [(600, 0.03, 0.0), (600, 0.03, 0.0)], slip=(600, 0.015))
    assert errors[-1, 1] == pytest.approx(0.27, abs=0.01)
    assert errors[:, 0].max() < 0.05
