import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.rooms import LIDAR, NOTHING, Sensors, disc_body, percept_of, ranges_to_boxes, room, scan_of
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.perception import PerceptionConfig
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.learned import BLIND_SHARE, LearnedPolicy
from vuca_nav.policy.network import UNIFORM_GATE
from vuca_nav.policy.observation import ObservationConfig, Observer, command_from_action, limits_of
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, STOP, LidarSpec, Odometry, Pose2, Twist2, VelocityCommand

DT = 1.0 / 30.0
BODY = replace(disc_body(), min_v_x=-0.4, max_v_y=0.3, max_w_z=1.5)
ROOM = room(8.0, 6.0)
START = Pose2(1.0, 3.0, 0.0)
STEP, TWIST = Pose2(0.01, 0.0, 0.01), Twist2(0.3, 0.0, 0.1)
GOAL = LocalGoal((2.0, 1.0), False)


class Told(Telemetry):
    def __init__(self):
        self.shares: list[np.ndarray] = []

    def gate(self, shares):
        self.shares.append(shares.copy())


@pytest.fixture(params=["paper", "tracked"])
def weights(request, tmp_path):
    return load_weights(random_policy(tmp_path / "p.safetensors", ObservationConfig(kind=request.param)))


def ranges_at(tick: int) -> np.ndarray:
    return ranges_to_boxes(ROOM, Pose2(2.0 + 0.01 * tick, 3.0, 0.01 * tick))


def next_percept(sensors: Sensors, tick: int) -> Percept:
    return sensors.see(ranges_at(tick), STEP, TWIST)


def within_limits(command: VelocityCommand) -> bool:
    return BODY.min_v_x <= command.v_x <= BODY.max_v_x and all(
        abs(v) <= most for v, most in ((command.v_y, BODY.max_v_y), (command.w_z, BODY.max_w_z))
    )


def test_a_command_is_the_networks_action_on_the_observers_observation(weights):
    policy, sensors = LearnedPolicy(BODY, LIDAR, weights), Sensors()
    observer = Observer(weights.observation, [BODY], 360, 30.0)
    out, action = np.empty((1, observer.size), np.float32), np.empty(3)
    command = STOP
    for tick in range(15):
        percept = next_percept(sensors, tick)
        command = policy.command(percept, GOAL)
        observer.observe(
            percept.scan.ranges[None],
            np.array([GOAL.point_in_base]),
            np.array([percept.twist]),
            np.array([percept.motion]),
            out,
        )
        policy.network.act(out[0], action)
        assert command == tuple(command_from_action(action, limits_of(BODY)))
        assert within_limits(command)
    assert command != STOP


def test_it_remembers_nothing_of_its_own(weights):
    always, seldom, sensors = LearnedPolicy(BODY, LIDAR, weights), LearnedPolicy(BODY, LIDAR, weights), Sensors()
    for tick in range(10):
        percept = next_percept(sensors, tick)
        command = always.command(percept, GOAL)
        if tick % 4 == 1:
            seldom.command(percept, LocalGoal((-1.0, -1.0), False))
            assert seldom.command(percept, GOAL) == command
        elif tick % 4 == 2:
            assert seldom.command(percept, None) == STOP
        elif tick % 4 == 3:
            seldom.reset()
            assert seldom.command(percept, GOAL) == command


def test_after_a_reset_or_a_gap_in_time_the_past_is_forgotten(weights):
    policy = LearnedPolicy(BODY, LIDAR, weights)
    new, after_reset, after_gap = Sensors(), Sensors(), Sensors()
    for tick in range(10):
        next_percept(after_reset, tick)
        next_percept(after_gap, tick)
    after_reset.perception.reset()
    after_gap.skip(10)
    for tick in range(20, 30):
        command = policy.command(next_percept(new, tick), GOAL)
        for sensors in (after_reset, after_gap):
            assert policy.command(next_percept(sensors, tick), GOAL) == pytest.approx(command, abs=1e-9)


def test_without_any_return_it_creeps(weights):
    policy = LearnedPolicy(BODY, LIDAR, weights)
    command = policy.command(percept_of(NOTHING), GOAL)
    one = NOTHING.copy()
    one[0] = 11.0  # too far to be told from nothing in the observation
    free = policy.command(percept_of(one), GOAL)
    assert free != STOP
    assert command == pytest.approx([BLIND_SHARE * v for v in free])
    assert all(math.isfinite(v) for v in command)


@pytest.mark.parametrize(
    "bad",
    [
        {"ranges": np.full(360, np.nan)},
        {"ranges": np.where(np.arange(360) < 200, np.nan, 3.0)},
        {"twist": Twist2(0.0, 0.0, math.nan)},
        {"twist": Twist2(math.inf, 0.0, 0.0)},
    ],
)
def test_what_is_not_valid_stops_it_and_is_not_remembered(weights, bad):
    policy, sensors, new = LearnedPolicy(BODY, LIDAR, weights), Sensors(), Sensors()
    assert policy.command(next_percept(sensors, 0), GOAL) != STOP
    percept = sensors.see(bad.get("ranges", ranges_at(1)), STEP, bad.get("twist", TWIST))
    assert policy.command(percept, GOAL) == STOP
    for tick in range(2, 12):
        command = policy.command(next_percept(new, tick), GOAL)
        assert policy.command(next_percept(sensors, tick), GOAL) == pytest.approx(command, abs=1e-9)
        assert command != STOP


@pytest.mark.parametrize("waypoint", [(math.nan, 0.0), (math.inf, 0.0)])
def test_a_waypoint_that_is_not_finite_stops_it(weights, waypoint):
    policy, percept = LearnedPolicy(BODY, LIDAR, weights), percept_of(ranges_at(0))
    assert policy.command(percept, LocalGoal(waypoint, False)) == STOP
    assert policy.command(percept, GOAL) != STOP


def test_a_few_invalid_beams_are_left_out(weights):
    policy, ranges, commands = LearnedPolicy(BODY, LIDAR, weights), ranges_to_boxes(ROOM, Pose2(4.0, 3.0, 0.0)), []
    for invalid in (np.nan, np.inf):
        ranges[100:105] = invalid
        commands.append(policy.command(percept_of(ranges.copy()), GOAL))
    assert commands[0] == commands[1] != STOP


def test_the_shares_are_told_at_every_tick(weights):
    told, sensors = Told(), Sensors()
    policy = LearnedPolicy(BODY, LIDAR, weights, telemetry=told)
    for tick in range(4):
        policy.command(next_percept(sensors, tick), GOAL)
    assert len(told.shares) == 4
    assert told.shares[-1] == pytest.approx(policy.network.shares)
    assert sum(policy.network.shares) == pytest.approx(1.0)
    uniform = LearnedPolicy(BODY, LIDAR, weights, UNIFORM_GATE)
    uniform.command(percept_of(ranges_at(0)), GOAL)
    assert uniform.network.shares == pytest.approx([0.25] * 4)


def test_a_rate_that_does_not_fit_is_refused(weights):
    with pytest.raises(BadArgument, match="spaced by"):
        LearnedPolicy(BODY, LidarSpec(rate=25.0), weights)


class Recorder(LocalPolicy):
    """Goes in an arc; keeps the motions and waypoints that it is given."""

    def __init__(self):
        self.motions: list[Pose2] = []
        self.goals: list[LocalGoal | None] = []

    def reset(self):
        self.motions, self.goals = [], []

    def command(self, percept, goal):
        self.motions.append(percept.motion)
        self.goals.append(goal)
        return VelocityCommand(0.3, 0.0, 0.2)


def drive(navigator: Navigator, ticks: int, start=START) -> list[VelocityCommand]:
    """In a corridor with an open end, so that there are frontiers."""
    walls = np.array([[0.0, 1.0, 30.0, 1.2], [0.0, 5.0, 30.0, 5.2], [-0.2, 1.0, 0.0, 5.2]])
    navigator.reset(start, (40.0, 3.0))
    pose, odom, commands = start, STANDING, []
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
    assert len(recorder.motions) == 12
    assert recorder.motions[0] == STANDING
    for before, motion in zip(commands[:-1], recorder.motions[1:]):
        assert motion == pytest.approx((before.v_x * DT, 0.0, before.w_z * DT), abs=1e-9)
    assert all(goal is not None and not goal.is_final for goal in recorder.goals)


def test_in_the_stack_the_same_drive_gives_the_same_commands(weights):
    told = Told()
    policy = LearnedPolicy(BODY, LIDAR, weights, telemetry=told)
    navigator = Navigator(BODY, LIDAR, policy, telemetry=told)
    commands = drive(navigator, 30)
    assert len(told.shares) == 30
    assert all(within_limits(command) for command in commands)
    assert drive(navigator, 30) == commands


def test_a_perception_that_does_not_remember_enough_is_refused_in_the_stack(tmp_path):
    weights = load_weights(random_policy(tmp_path / "p.safetensors", ObservationConfig(history=3)))
    config = NavigatorConfig(perception=PerceptionConfig(memory=0.2))
    navigator = Navigator(BODY, LIDAR, LearnedPolicy(BODY, LIDAR, weights), config)
    with pytest.raises(BadArgument, match="give it a greater memory"):
        drive(navigator, 1)
