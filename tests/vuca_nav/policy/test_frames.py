"""The observation of Long et al.: frames of the scan ahead, goal and speed, against numbers worked by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.vuca_nav.rooms import disc_body
from vuca_nav.errors import BadArgument
from vuca_nav.perception.perception import Perception, PerceptionConfig
from vuca_nav.policy.observation import ObservationConfig, Observer, PerceptObserver
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2

FRAMES = ObservationConfig(kind="frames", sectors=90, history=2)
RADIUS = 0.28
BODY = disc_body(RADIUS)


def observe(observer, ranges, goal=(1.0, 0.0), twist=(0.0, 0.0, 0.0)):
    out = np.zeros((1, observer.size), np.float32)
    observer.observe(np.asarray(ranges, float)[None], np.array([goal]), np.array([twist]), np.zeros((1, 3)), out)
    return out[0]


def test_sizes():
    assert FRAMES.size == 3 * 90 + 2 + 2
    assert FRAMES.goal_slice == slice(270, 272)
    assert FRAMES.memory == pytest.approx(0.2)


def test_a_sector_holds_the_least_clearance_of_its_beams_as_x_by_6_less_a_half():
    ranges = np.full(360, np.inf)
    ranges[180] = 3.0 + RADIUS  # straight ahead: the border of the middle sectors, 44 and 45
    ranges[90 + 21] = 1.5 + RADIUS  # within sector 10, at -69 degrees
    ranges[89] = ranges[271] = 0.5  # behind the half ahead
    seen = observe(Observer(FRAMES, [BODY], 360, 10.0), ranges)
    expected = np.full(90, 0.5)
    expected[[44, 45]], expected[10] = 0.0, -0.25
    for frame in range(3):  # the first scan stands for the past, too
        assert seen[90 * frame : 90 * (frame + 1)] == pytest.approx(expected, abs=2e-3)


def test_what_is_not_there_or_too_near_or_far_reads_as_the_ends_of_the_range():
    ranges = np.full(360, np.nan)
    ranges[150:160], ranges[160:170] = 0.1, 9.0
    seen = observe(Observer(FRAMES, [BODY], 360, 10.0), ranges)[180:270]
    assert seen.min() == -0.5
    assert (seen[36:40] == 0.5).all()
    assert (seen[:29] == 0.5).all()


def test_frames_are_a_tenth_of_a_second_apart_the_oldest_first():
    observer = Observer(FRAMES, [BODY], 360, 30.0)
    seen = [observe(observer, np.full(360, 1.0 + 0.1 * k)) for k in range(12)]
    now = [(frames[180], frames[90], frames[0]) for frames in seen]
    for k in range(6, 12):
        assert (now[k][1], now[k][2]) == (now[k - 3][0], now[k - 6][0])
    assert all(later[0] > sooner[0] for sooner, later in pairwise(now))


@pytest.mark.parametrize(
    ("goal", "shown"), [((3.0, -4.0), (3.0, -4.0)), ((0.0, 25.0), (0.0, 10.0)), ((-30.0, 40.0), (-6.0, 8.0))]
)
def test_the_goal_is_given_in_metres_in_the_robots_frame_and_at_most_10_away(goal, shown):
    seen = observe(Observer(FRAMES, [BODY], 360, 10.0), np.full(360, 3.0), goal)
    assert seen[270:272] == pytest.approx(shown)


def test_speeds_are_shares_of_the_bodys_limits():
    observer = Observer(FRAMES, [BODY], 360, 10.0)
    seen = observe(observer, np.full(360, 3.0), twist=(0.5 * BODY.max_v_x, 0.3, -0.25 * BODY.max_w_z))
    assert seen[272:] == pytest.approx((0.5, -0.25))
    assert observe(observer, np.full(360, 3.0), twist=(99.0, 0.0, -99.0))[272:].tolist() == [2.0, -2.0]


def test_sectors_that_do_not_divide_the_half_ahead_are_refused():
    with pytest.raises(BadArgument, match="100 sectors ahead"):
        PerceptObserver(ObservationConfig(kind="frames", sectors=100), BODY, LidarSpec())
    with pytest.raises(BadArgument, match="quarter"):
        Observer(ObservationConfig(kind="frames", sectors=3), [BODY], 6, 10.0)


def test_the_goal_where_the_robot_is_has_no_direction():
    seen = observe(Observer(FRAMES, [BODY], 360, 10.0), np.full(360, 3.0), (0.0, 0.0))
    assert all(math.isfinite(value) for value in seen)
    assert seen[270:272].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    "lidar",
    [
        LidarSpec(num_beams=720, angle_min=-2.356, angle_increment=0.00655, mount=Pose2(0.12, 0.0, 0.0)),
        LidarSpec(num_beams=181, angle_min=0.5 * math.pi, angle_increment=-math.pi / 180.0),
    ],
)
def test_any_lidar_shows_the_wall_where_it_stands(lidar):
    """A wall 2 m ahead of base_link, seen by lidars that are no rings."""
    directions = lidar.angles_in_base()
    with np.errstate(divide="ignore"):
        ranges = (2.0 - lidar.mount.x) / np.cos(directions)
    ranges[(ranges <= 0.0) | (ranges > 9.0)] = np.inf
    perception = Perception(lidar, PerceptionConfig(memory=FRAMES.memory), BODY)
    percept = perception.update(Scan(0.0, ranges), Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
    seen = PerceptObserver(FRAMES, BODY, lidar).observe(percept, (1.0, 0.0))
    ahead = (seen[180:270] + 0.5) * FRAMES.max_range + RADIUS
    bearings = -0.5 * math.pi + (np.arange(90) + 0.5) * math.pi / 90.0
    near = np.abs(bearings) < 1.0
    assert ahead[near] == pytest.approx(2.0 / np.cos(bearings[near]), rel=0.04)
    np.testing.assert_array_equal(seen[180:270], seen[:90])
