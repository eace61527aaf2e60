"""What one scan holds that may move, in analytic scenes."""

import numpy as np
import pytest

from tests.vuca_nav.rooms import NO_BOXES, ranges_to_discs, room
from vuca_nav.perception.detections import DETECTION_SIZE, WHOLE, _pair_legs, find_detections
from vuca_nav.types import STANDING, LidarSpec, Pose2

LIDAR = LidarSpec(num_beams=180)
REACH = 6.3


def look(discs, boxes=NO_BOXES, pose=STANDING):
    """(180,) ranges."""
    return ranges_to_discs(discs, boxes, pose, LIDAR)


def found(ranges):
    """Centres of what may begin a track, (k, 2) in base_link."""
    angles, out = LIDAR.angles_in_base(), np.zeros((180, DETECTION_SIZE))
    count = find_detections(ranges, np.column_stack([np.cos(angles), np.sin(angles)]), REACH, out)
    return out[:count][out[:count, 3] == WHOLE, :2]


@pytest.mark.parametrize("seed", range(20))
def test_legs_are_paired_whatever_their_order(seed):
    rng = np.random.default_rng(seed)
    people, posts = 3.0 * np.arange(1, 5), 3.0 * np.arange(5, 9)
    legs = [(x, side * 0.15, 0.1, WHOLE, 0.0) for x in people for side in (-1.0, 1.0)]
    found = np.array(legs + [(x, 0.0, 0.3, WHOLE, 0.0) for x in posts])[rng.permutation(12)]
    count = _pair_legs(found, 12)
    assert np.array_equal(np.sort(found[:count, 0]), [*people, *posts])
    assert found[:count, 1] == pytest.approx(0.0, abs=1e-12)
    assert np.sort(found[:count, 2]) == pytest.approx([0.25] * 4 + [0.3] * 4)


def test_people_are_counted_by_what_they_are():
    people = [(2.0, -1.5), (3.0, 1.5), (-2.0, 2.0), (-1.5, -2.5)]
    legs = [(x + side * 0.02, y + side * 0.14, 0.08) for x, y in people for side in (-1.0, 1.0)]
    posts = [(4.0, 0.1, 0.25), (0.3, 3.0, 0.3), (-4.0, -0.2, 0.3)]
    centres = found(look(legs + posts))
    assert len(centres) == len(people) + len(posts)
    for x, y in [*people, *(post[:2] for post in posts)]:
        assert np.hypot(*(centres - (x, y)).T).min() < 0.2


def test_bars_behind_do_not_hide_a_post_in_front():
    ranges = look([(1.5, 0.0, 0.2)])
    behind = np.abs(LIDAR.angles_in_base()) > 0.5 * np.pi
    ranges[behind & (np.arange(180) % 2 == 0)] = 3.0
    assert np.hypot(*(found(ranges) - (1.5, 0.0)).T).min() < 0.1


def test_a_wall_is_not_detected():
    assert len(found(look([], room(10.0, 8.0), Pose2(4.0, 3.0, 0.3)))) == 0
    # The end of a long wall sticks out, and is wide.
    assert len(found(look([], np.array([[2.0, -1.0, 2.2, 1.0]])))) == 0
    post = found(look([(2.0, 0.0, 0.3)]))
    assert post == pytest.approx(np.array([[2.0, 0.0]]), abs=0.1)


def test_a_piece_of_wall_between_nearer_objects_is_not_detected():
    wall = np.array([[4.0, -9.0, 4.2, 9.0]])
    posts = [(2.0, 0.5, 0.3), (2.0, -0.5, 0.3)]
    ranges = look(posts, wall)
    between = ranges[90]  # straight ahead
    assert between == pytest.approx(4.0)
    positions = found(ranges)
    assert len(positions) == 2
    assert positions[np.argsort(positions[:, 1])] == pytest.approx(np.array([[2.0, -0.5], [2.0, 0.5]]), abs=0.1)


def test_one_lost_beam_does_not_cut_an_object_in_two():
    ranges = look([(2.0, 0.0, 0.3)])
    ranges[90] = np.inf
    assert len(found(ranges)) == 1


@pytest.mark.parametrize("door", [0.6, 0.9, 1.1])
def test_a_room_behind_its_door_is_not_detected(door):
    """From one post of the door all round to the other the walls are one surface, whose ends are near each other."""
    posts = np.array([[-0.1, -2.0, 0.0, -0.5 * door], [-0.1, 0.5 * door, 0.0, 2.0]])
    walls = np.array([[3.8, -2.0, 3.9, 2.0], [-0.1, -2.1, 3.9, -2.0], [-0.1, 2.0, 3.9, 2.1]])
    beyond = np.array([[-9.0, -9.0, -8.9, 9.0]])
    for pose in (Pose2(2.5, 0.0, 0.0), Pose2(1.0, 0.8, 2.0), Pose2(2.0, -1.0, -1.0)):
        assert len(found(look([], np.vstack([posts, walls, beyond]), pose))) == 0
