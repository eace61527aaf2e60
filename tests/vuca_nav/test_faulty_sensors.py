"""Whatever the sensors say, the stack answers with a finite command or one clear error."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.random_safety import random_safety
from tests.vuca_nav.rooms import LIDAR, REST, disc_body, percept_of, ranges_to_boxes, room
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.critic import LearnedCritic, load_critic
from vuca_nav.geometry import compose
from vuca_nav.navigator import Navigator
from vuca_nav.policy.base import LocalGoal
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.observation import Kind, ObservationConfig, Observer
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.shield.shield import Shield
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, STOP, LidarSpec, Odometry, Pose2, Scan, Twist2

DT = 1.0 / 30.0
BODY = disc_body()
HALL = np.vstack([room(14.0, 8.0), [[6.0, 3.4, 6.6, 4.0]]])
START, GOAL = Pose2(2.0, 3.0, 0.0), (12.0, 4.0)
AHEAD = LocalGoal((2.0, 0.0), False)


class Events(Telemetry):
    def __init__(self):
        self.events = []

    def event(self, text, level="INFO"):
        self.events.append(text)


def learned(tmp_path, lidar: LidarSpec = LIDAR, kind: Kind = "tracked"):
    weights = load_weights(random_policy(tmp_path / f"{kind}.safetensors", ObservationConfig(kind=kind)))
    return LearnedPolicy(BODY, lidar, weights, rate=30.0)


def methods(tmp_path):
    """Navigators of all kinds of lower layers."""
    policies = [DynamicWindow(BODY, LIDAR), learned(tmp_path), learned(tmp_path, kind="paper")]
    policies.append(Shield(BODY, LIDAR, learned(tmp_path)))
    critic = LearnedCritic(BODY, LIDAR, load_critic(random_safety(tmp_path / "s.safetensors")))
    navigators = [Navigator(BODY, LIDAR, policy, critic=critic) for policy in policies]
    for navigator in navigators:
        navigator.reset(START, GOAL)
    return navigators


def drive(navigator, ticks, change=lambda ranges, tick: ranges, odometry=lambda pose, tick: pose):
    """Drive in the hall by clean sensors with these changes; the true poses and the commands."""
    pose, odom, twist, poses, commands = START, STANDING, REST, [], []
    for k in range(ticks):
        ranges = change(ranges_to_boxes(HALL, pose, navigator.perception.lidar), k)
        command = navigator.step(Scan(k * DT, ranges), Odometry(k * DT, odometry(odom, k), twist))
        motion, twist = Pose2(command.v_x * DT, command.v_y * DT, command.w_z * DT), Twist2(*command)
        pose, odom = compose(pose, motion), compose(odom, motion)
        poses.append(pose)
        commands.append(command)
    return poses, commands


@pytest.mark.parametrize("beams", [0, 1, 180, 359, 361, 720, 1440])
def test_a_scan_of_another_size_is_refused_by_every_method(tmp_path, beams):
    for navigator in methods(tmp_path):
        with pytest.raises(BadArgument, match="LidarSpec of the scans"):
            navigator.step(Scan(0.0, np.full(beams, 3.0)), Odometry(0.0, STANDING, REST))


@pytest.mark.parametrize("beams", [60, 180, 720])
def test_a_percept_of_another_lidar_is_refused_by_every_policy(tmp_path, beams):
    percept = percept_of(np.full(beams, 3.0), LidarSpec(num_beams=beams))
    shield = Shield(BODY, LIDAR, DynamicWindow(BODY, LIDAR))
    for policy in (learned(tmp_path), learned(tmp_path, kind="paper"), shield):
        with pytest.raises(BadArgument, match="give both the same LidarSpec"):
            policy.command(percept, AHEAD)


def test_an_observer_of_many_rows_takes_no_other_shapes():
    config = ObservationConfig()
    observer = Observer(config, [BODY, BODY], 360, 30.0)
    right = {
        "ranges": np.full((2, 360), 3.0), "goals_in_base": np.ones((2, 2)), "twists": np.zeros((2, 3)),
        "motions": np.zeros((2, 3)), "out": np.zeros((2, config.size), np.float32),
    }  # fmt: skip
    observer.observe(**right)
    for name, array in right.items():
        for wrong in (array[:1], array[:, :-1], array.ravel()):
            with pytest.raises(BadArgument, match=f"{name} has shape"):
                observer.observe(**right | {name: wrong})


def test_while_every_range_is_a_fault_every_method_stands(tmp_path):
    told = Events()
    for navigator in methods(tmp_path):
        navigator.telemetry = told
        _, commands = drive(navigator, 40, lambda ranges, tick: ranges if tick < 20 else np.full(360, np.nan))
        assert any(command != STOP for command in commands[:20])
        assert all(command == STOP for command in commands[20:])
    assert sum("360 of the scan's 360 ranges are NaN" in event for event in told.events) == len(methods(tmp_path))


@pytest.mark.parametrize("instead", [0.0, -1.0, 12.0, 65.533])
def test_what_a_driver_writes_for_no_return_makes_no_difference(tmp_path, instead):
    def lossy(ranges, tick):
        lost = np.random.default_rng(tick).random(360) < 0.3
        return np.where(lost | (ranges > 7.0), np.inf, ranges)

    def written(ranges, tick):
        ranges = lossy(ranges, tick)
        return np.where(np.isinf(ranges), instead, ranges)

    for usual, other in zip(methods(tmp_path), methods(tmp_path), strict=True):
        assert drive(usual, 45, lossy) == drive(other, 45, written)
        np.testing.assert_array_equal(usual.slam.navigation_grid.level, other.slam.navigation_grid.level)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 20_000.0, -1e300])
def test_odometry_that_jumps_and_comes_back_costs_neither_map_nor_pose(tmp_path, wrong):
    navigator, told = methods(tmp_path)[0], Events()
    navigator.telemetry = told
    poses, commands = drive(
        navigator, 90, odometry=lambda pose, tick: Pose2(wrong, 5.0, pose.yaw) if tick in (30, 31, 50) else pose
    )
    assert navigator.slam.navigation_grid.level.size < 2_000_000
    assert math.dist(navigator.map_from_base[:2], poses[-2][:2]) < 0.05
    assert any(command != STOP for command in commands[60:])
    assert any("odometry" in event for event in told.events)


def test_odometry_that_stays_elsewhere_after_a_jump_is_good_again(tmp_path):
    navigator = methods(tmp_path)[0]
    poses, _ = drive(
        navigator, 120, odometry=lambda pose, tick: compose(Pose2(300.0, -20.0, 2.0), pose) if tick >= 40 else pose
    )
    assert math.dist(navigator.map_from_base[:2], poses[-2][:2]) < 0.05
    assert math.dist(poses[-1][:2], START[:2]) > 1.0


@pytest.mark.parametrize("beams", [181, 270, 361, 541, 720, 1081, 1440])
def test_policies_of_sixty_sectors_drive_by_any_number_of_beams(tmp_path, beams):
    lidar = LidarSpec(num_beams=beams)
    for policy in (learned(tmp_path, lidar), learned(tmp_path, lidar, "paper"), DynamicWindow(BODY, lidar)):
        navigator = Navigator(BODY, lidar, Shield(BODY, lidar, policy))
        navigator.reset(START, GOAL)
        _, commands = drive(navigator, 10)
        assert all(math.isfinite(sum(command)) for command in commands)
        assert commands[-1] != STOP


def test_an_arrival_by_half_a_circle_of_ten_hertz():
    """180 degrees from the front edge, clockwise, a third of the ticks' rate."""
    lidar = LidarSpec(
        num_beams=361, rate=10.0, angle_min=math.pi / 2, angle_increment=-math.pi / 360, mount=Pose2(0.2, 0.0, 0.0)
    )
    navigator = Navigator(BODY, lidar, Shield(BODY, lidar, DynamicWindow(BODY, lidar, rate=30.0), rate=30.0))
    navigator.reset(START, GOAL)
    pose, odom, twist, scan, least = START, STANDING, REST, None, math.inf
    for k in range(900):
        x, y, _ = compose(pose, lidar.mount)
        if k % 3 == 0:
            scan = Scan(k * DT, ranges_to_boxes(HALL, Pose2(x, y, pose.yaw), lidar))
        assert scan is not None
        command = navigator.step(scan, Odometry(k * DT, odom, twist))
        motion, twist = Pose2(command.v_x * DT, 0.0, command.w_z * DT), Twist2(*command)
        pose, odom = compose(pose, motion), compose(odom, motion)
        least = min(least, float(ranges_to_boxes(HALL, pose).min()))
        if navigator.arrived:
            break
    assert math.dist(pose[:2], GOAL) < 0.2
    assert least > 0.28
    assert math.dist(navigator.map_from_base[:2], pose[:2]) < 0.05


numbers = (
    st.sampled_from([0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 12.0, 0.05])
    | st.floats()
)
readings = st.tuples(
    st.lists(st.tuples(st.integers(0, 359), st.integers(1, 360), numbers), max_size=4),
    st.tuples(numbers, numbers, numbers) | st.just((0.0, 0.0, 0.0)),
    st.tuples(numbers, numbers, numbers) | st.just((0.0, 0.0, 0.0)),
    st.tuples(numbers, numbers, numbers) | st.just((0.0, 0.0, 1.0)),
    numbers | st.none(),
)


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    part = LidarSpec(num_beams=360, angle_min=-2.0, angle_increment=4.0 / 360, mount=Pose2(0.2, 0.1, 0.3), rate=20.0)
    by_part = Navigator(BODY, part, Shield(BODY, part, learned(folder, part), rate=30.0))
    return [*methods(folder), by_part]


@given(st.lists(readings, min_size=1, max_size=6))
@settings(max_examples=60, deadline=None)
def test_no_reading_does_more_than_stop_the_robot(fuzzed, sequence):
    for navigator in fuzzed:
        navigator.reset(START, GOAL)
        for k, (changes, pose, twist, up, stamp) in enumerate(sequence):
            ranges = ranges_to_boxes(HALL, START)
            for first, count, value in changes:
                ranges[first : first + count] = value
            stamp = k * DT if stamp is None else stamp
            command = navigator.step(Scan(stamp, ranges), Odometry(stamp, Pose2(*pose), Twist2(*twist), up))
            assert all(math.isfinite(value) for value in (*command, *navigator.map_from_base))
            assert BODY.min_v_x - 1e-9 <= command.v_x <= BODY.max_v_x + 1e-9
        assert navigator.slam.navigation_grid.level.size < 4_000_000
        for k in range(8):
            navigator.step(Scan(1e6 + k * DT, ranges_to_boxes(HALL, START)), Odometry(1e6 + k * DT, STANDING, REST))
        assert navigator.percept is not None
        assert navigator.percept.is_valid


def test_a_faulty_tick_is_told_as_it_begins_and_as_it_ends():
    told = Events()
    navigator = Navigator(BODY, LIDAR, DynamicWindow(BODY, LIDAR), telemetry=told)
    navigator.reset(START, GOAL)
    drive(navigator, 30, lambda ranges, tick: np.full(360, np.nan) if 10 <= tick < 20 else ranges)
    assert [event for event in told.events if "NaN" in event or "valid" in event] == [
        "the robot stands: 360 of the scan's 360 ranges are NaN",
        "the sensors are valid",
    ]
