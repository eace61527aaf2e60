import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.rooms import LIDAR, disc_body, ranges_to_boxes, room, scan_of
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose
from vuca_nav.navigator import Navigator
from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.policy.learned import BLIND_SHARE, LearnedPolicy
from vuca_nav.policy.network import UNIFORM_GATE
from vuca_nav.policy.observation import ObservationConfig, Observer, command_from_action, limits_of
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand

DT = 1.0 / 30.0
BODY = replace(disc_body(), min_v_x=-0.4, max_v_y=0.3, max_w_z=1.5)
ROOM = room(8.0, 6.0)
START = Pose2(1.0, 3.0, 0.0)


class Told(Telemetry):
    def __init__(self):
        self.shares: list[np.ndarray] = []

    def gate(self, shares):
        self.shares.append(shares.copy())


@pytest.fixture(params=["paper", "tracked"])
def weights(request, tmp_path):
    return load_weights(random_policy(tmp_path / "p.safetensors", ObservationConfig(kind=request.param)))


def seen(tick: int, waypoint=(2.0, 1.0), ranges=None, twist=(0.3, 0.0, 0.1)) -> LocalObservation:
    scan = ranges_to_boxes(ROOM, Pose2(2.0 + 0.01 * tick, 3.0, 0.01 * tick)) if ranges is None else ranges
    return LocalObservation(Scan(tick * DT, scan), waypoint, False, Twist2(*twist), Pose2(0.01, 0.0, 0.01))


def within_limits(command: VelocityCommand) -> bool:
    return BODY.min_v_x <= command.v_x <= BODY.max_v_x and all(
        abs(v) <= most for v, most in ((command.v_y, BODY.max_v_y), (command.w_z, BODY.max_w_z))
    )


def test_a_command_is_the_networks_action_on_the_observers_observation(weights):
    policy = LearnedPolicy(BODY, LIDAR, weights)
    observer = Observer(weights.observation, [BODY], 360, 30.0)
    out, action = np.empty((1, observer.size), np.float32), np.empty(3)
    command = STOP
    for tick in range(15):
        now = seen(tick)
        command = policy.command(now)
        observer.observe(
            now.scan.ranges[None], np.array([now.waypoint_in_base]), np.array([now.twist]), np.array([now.motion]), out
        )
        policy.network.act(out[0], action)
        assert command == tuple(command_from_action(action, limits_of(BODY)))
        assert within_limits(command)
    assert command != STOP


def test_looking_first_and_being_told_the_waypoint_later_is_the_same(weights):
    at_once, first = LearnedPolicy(BODY, LIDAR, weights), LearnedPolicy(BODY, LIDAR, weights)
    for tick in range(10):
        first.look(seen(tick, waypoint=(-1.0, -1.0)))
        assert first.command(seen(tick)) == at_once.command(seen(tick))


def test_after_a_reset_or_a_gap_in_time_the_past_is_forgotten(weights):
    new = LearnedPolicy(BODY, LIDAR, weights)
    after_reset, after_gap = LearnedPolicy(BODY, LIDAR, weights), LearnedPolicy(BODY, LIDAR, weights)
    for tick in range(10):
        after_reset.command(seen(tick))
        after_gap.command(seen(tick))
    after_reset.reset()
    for tick in range(20, 30):
        command = new.command(seen(tick))
        assert after_reset.command(seen(tick)) == command
        assert after_gap.command(seen(tick)) == command


def test_without_any_return_it_creeps(weights):
    policy = LearnedPolicy(BODY, LIDAR, weights)
    nothing = np.full(360, np.inf)
    command = policy.command(seen(0, ranges=nothing))
    one = nothing.copy()
    one[0] = 11.0  # too far to be told from nothing in the observation
    policy.reset()
    free = policy.command(seen(0, ranges=one))
    assert command == pytest.approx([BLIND_SHARE * v for v in free])
    assert all(math.isfinite(v) for v in command)


@pytest.mark.parametrize(
    "bad",
    [
        {"ranges": np.full(360, np.nan)},
        {"ranges": np.where(np.arange(360) < 200, np.nan, 3.0)},
        {"waypoint": (math.nan, 0.0)},
        {"waypoint": (math.inf, 0.0)},
        {"twist": (0.0, 0.0, math.nan)},
    ],
)
def test_what_cannot_be_trusted_stops_it_and_is_not_remembered(weights, bad):
    policy, new = LearnedPolicy(BODY, LIDAR, weights), LearnedPolicy(BODY, LIDAR, weights)
    assert policy.command(seen(0)) != STOP
    assert policy.command(seen(1, **bad)) == STOP
    assert policy.observation is None
    for tick in range(2, 12):
        assert policy.command(seen(tick)) == new.command(seen(tick)) != STOP


def test_a_few_invalid_beams_are_left_out(weights):
    policy, other = LearnedPolicy(BODY, LIDAR, weights), LearnedPolicy(BODY, LIDAR, weights)
    ranges = ranges_to_boxes(ROOM, Pose2(4.0, 3.0, 0.0))
    for invalid in (np.nan, np.inf):
        ranges[100:105] = invalid
        (policy if np.isnan(invalid) else other).command(seen(0, ranges=ranges.copy()))
    assert np.array_equal(np.asarray(policy.observation), np.asarray(other.observation))


def test_the_shares_are_told_at_every_tick(weights):
    told = Told()
    policy = LearnedPolicy(BODY, LIDAR, weights, telemetry=told)
    for tick in range(4):
        policy.command(seen(tick))
    assert len(told.shares) == 4
    assert told.shares[-1] == pytest.approx(policy.network.shares)
    assert sum(policy.network.shares) == pytest.approx(1.0)
    uniform = LearnedPolicy(BODY, LIDAR, weights, UNIFORM_GATE)
    uniform.command(seen(0))
    assert uniform.network.shares == pytest.approx([0.25] * 4)


def test_a_lidar_that_does_not_fit_is_refused(weights):
    with pytest.raises(BadArgument, match="do not divide"):
        LearnedPolicy(BODY, LidarSpec(num_beams=361), weights)
    with pytest.raises(BadArgument, match="spaced by"):
        LearnedPolicy(BODY, LidarSpec(rate=25.0), weights)


class Recorder(LocalPolicy):
    """Goes in an arc; keeps what it is given."""

    def __init__(self):
        self.looked: list[LocalObservation] = []
        self.commanded: list[LocalObservation] = []

    def reset(self):
        self.looked, self.commanded = [], []

    def look(self, observation):
        self.looked.append(observation)

    def command(self, observation):
        self.commanded.append(observation)
        return VelocityCommand(0.3, 0.0, 0.2)


def drive(navigator: Navigator, ticks: int, start=START) -> list[VelocityCommand]:
    """In a corridor with an open end, so that there are frontiers."""
    walls = np.array([[0.0, 1.0, 30.0, 1.2], [0.0, 5.0, 30.0, 5.2], [-0.2, 1.0, 0.0, 5.2]])
    navigator.reset(start, (40.0, 3.0))
    pose, odom, commands = start, Pose2(0.0, 0.0, 0.0), []
    for k in range(ticks):
        twist = Twist2(*(commands[-1] if commands else STOP))
        command = navigator.step(scan_of(walls, pose, k * DT), Odometry(k * DT, odom, twist))
        step = Pose2(command.v_x * DT, command.v_y * DT, command.w_z * DT)
        pose, odom = compose(pose, step), compose(odom, step)
        commands.append(command)
    return commands


def test_the_navigator_hands_on_the_odometrys_motion_at_every_tick():
    recorder = Recorder()
    navigator = Navigator(BODY, LIDAR, recorder)
    commands = drive(navigator, 12)
    assert len(recorder.looked) == 12
    assert recorder.looked[0].motion == (0.0, 0.0, 0.0)
    for before, observation in zip(commands[:-1], recorder.looked[1:]):
        assert observation.motion == pytest.approx((before.v_x * DT, 0.0, before.w_z * DT), abs=1e-9)
    assert [o.motion for o in recorder.commanded] == [o.motion for o in recorder.looked]


def test_in_the_stack_the_same_drive_gives_the_same_commands(weights):
    told = Told()
    policy = LearnedPolicy(BODY, LIDAR, weights, telemetry=told)
    navigator = Navigator(BODY, LIDAR, policy, telemetry=told)
    commands = drive(navigator, 30)
    assert len(told.shares) == 30
    assert all(within_limits(command) for command in commands)
    assert drive(navigator, 30) == commands
