import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, moved, room, scan_of
from vuca_nav.geometry import compose, distance
from vuca_nav.mapping.graph_slam import GraphSlam
from vuca_nav.perception.percept import LevelScan
from vuca_nav.types import STANDING, Pose2

ANGLES = LIDAR.angles_in_base()
BEAMS, STATIC = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]), np.zeros(LIDAR.num_beams, np.bool_)
TURN = (30, 0.0, math.pi / 60)
"""A quarter to the left: scans, metres and radians a scan."""

Odometer = Callable[[float, float, float], Pose2]
"""What odometry makes of a motion, given the way up to it [m], its length [m] and its turn [rad]."""


def scaled(scale: float = 0.0, turn: float = 0.0) -> Odometer:
    """Ways and turns too large by these shares."""
    return lambda _, forward, yaw: Pose2((1.0 + scale) * forward, 0.0, (1.0 + turn) * yaw)


def slipping() -> Odometer:
    """Wheels that slip by a few percent, alike over about a metre."""
    rng, slip = np.random.default_rng(11), np.zeros(2)

    def odometer(_: float, forward: float, yaw: float) -> Pose2:
        keep = math.exp(-abs(forward))
        slip[:] = keep * slip + math.sqrt(1.0 - keep**2) * rng.normal(0.0, (0.04, 0.015))
        return Pose2((1.0 + slip[0]) * forward, 0.0, yaw + slip[1] * forward)

    return odometer


def drive(boxes, start, legs, odometer: Odometer):
    """Run SLAM along legs of (scans, metres, radians): the slam, and errors of SLAM and of odometry in each scan."""
    rng = np.random.default_rng(7)
    slam = GraphSlam(LIDAR)
    slam.reset(start)
    truth, odometry, errors, way = start, STANDING, [], 0.0
    for scans, forward, yaw in legs:
        for _ in range(scans):
            ranges = scan_of(boxes, truth, rng=rng).ranges
            pose = slam.update(LevelScan(ranges, BEAMS, STATIC), odometry, 0.1 * len(errors))
            errors.append((distance(pose, truth), distance(compose(start, odometry), truth)))
            truth, odometry = moved(truth, forward, yaw), compose(odometry, odometer(way, forward, yaw))
            way += abs(forward)
    return slam, np.array(errors)


RING = np.vstack([room(24.0, 16.0), [[2.0, 2.0, 22.0, 14.0]]])
FURNISHED = np.vstack([room(12.0, 9.0), [[3.0, 3.0, 5.0, 6.0], [7.5, 2.5, 9.5, 4.0], [7.0, 6.5, 8.0, 7.0]]])
PLACES = {
    "corridor": (room(60.0, 2.0), Pose2(2.0, 1.0, 0.0), [(560, 0.1, 0.0)]),
    "ring": (RING, Pose2(1.0, 1.0, 0.0), [(220, 0.1, 0.0), TURN, (140, 0.1, 0.0), TURN] * 3),
    "room": (FURNISHED, Pose2(1.5, 1.5, 0.0), [(90, 0.1, 0.0), TURN, (60, 0.1, 0.0), TURN] * 4),
}
ODOMETERS = {
    "perfect": scaled,
    "3% too far": lambda: scaled(scale=0.03),
    "5% too far and turned": lambda: scaled(scale=0.05, turn=0.05),
    "slips": slipping,
}


@pytest.mark.parametrize("odometer", ODOMETERS)
@pytest.mark.parametrize("place", PLACES)
def test_no_odometer_is_made_worse(place, odometer):
    """By no more than 2 cm, and a ten-thousandth of the way, since how good it is has to be learnt first."""
    boxes, start, legs = PLACES[place]
    _, errors = drive(boxes, start, legs, ODOMETERS[odometer]())
    print(f"{place:9s} {odometer:22s} SLAM {errors[-1, 0]:.3f} m, odometry {errors[-1, 1]:.3f} m")
    way = sum(scans * forward for scans, forward, _ in legs)
    assert errors[-1, 0] < errors[-1, 1] + 0.02 + 1e-4 * way


def test_a_loop_closes_with_odometry_that_turns_too_far():
    blocks = [[4.0, 4.0, 26.0, 10.0], [4.0, 10.0, 12.0, 20.0], [15.0, 13.0, 26.0, 20.0], [20.0, 0.5, 20.6, 1.1]]
    legs = [(260, 0.1, 0.0), TURN, (200, 0.1, 0.0), TURN] * 3
    boxes = np.vstack([room(30.0, 24.0), blocks])
    slam, errors = drive(boxes, Pose2(2.0, 2.0, 0.0), legs, scaled(scale=0.03, turn=0.04))
    assert errors[:, 1].max() > 3.0
    assert errors[:, 0].max() < 0.2
    assert errors[-300:, 0].max() < 0.08  # in the third lap
    assert slam.back_end.num_closed > 0


def test_a_loop_of_300_metres_closes():
    """Corridors 2.4 m wide with doorways at irregular places, once round and 40 m on."""
    rng = np.random.default_rng(2)
    inner = [[2.4, 2.4, 89.6, 59.6]]
    piers = []
    for x in np.cumsum(rng.uniform(3.0, 7.0, 16)):
        piers += [[x, 0.0, x + 0.3, 0.35], [x + 1.7, 61.7, x + 2.0, 62.0]]
    for y in np.cumsum(rng.uniform(3.0, 7.0, 11)):
        piers += [[0.0, y, 0.4, y + 0.3], [91.6, y + 1.3, 92.0, y + 1.6]]
    lap = [(448, 0.2, 0.0), TURN, (298, 0.2, 0.0), TURN]
    boxes = np.vstack([room(92.0, 62.0), inner, piers])
    slam, errors = drive(boxes, Pose2(1.2, 1.2, 0.0), [*lap, *lap, (200, 0.2, 0.0)], slipping())
    print(f"300 m: odometry {errors[:, 1].max():.2f} m, SLAM {errors[:, 0].max():.3f} m, end {errors[-1, 0]:.3f} m")
    assert errors[:, 1].max() > 1.0
    assert slam.back_end.num_closed > 0
    assert errors[-100:, 0].max() < 0.1


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
    _, errors = drive(boxes, truth, legs, scaled(scale=0.02, turn=0.02))
    assert errors[:, 0].max() < 0.06


def test_matches_do_not_confirm_odometry_by_its_own_pull():
    """Odometry that is perfect for 18 m, then goes too far for as long. Doors and niches show where it is."""
    doors = [[x, 1.9, x + 1.0, 2.3] for x in np.arange(1.0, 58.0, 3.7)]
    niches = [[x, -0.3, x + 1.2, 0.1] for x in np.arange(2.0, 58.0, 5.3)]
    ends = [[-0.5, -0.7, 60.5, -0.5], [-0.5, 2.5, 60.5, 2.7], [-0.7, -0.7, -0.5, 2.7]]

    def odometer(way: float, forward: float, yaw: float) -> Pose2:
        return Pose2((1.015 if way > 18.0 else 1.0) * forward, 0.0, yaw)

    _, errors = drive(np.array(ends + doors + niches), Pose2(2.0, 1.0, 0.0), [(1200, 0.03, 0.0)], odometer)
    assert errors[-1, 1] == pytest.approx(0.27, abs=0.01)
    assert errors[:, 0].max() < 0.05
