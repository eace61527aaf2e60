import time

import numpy as np
import pytest

from eval.bridge.remote_stack import FIRST_STAMP, Lockstep, PaceConfig, RealTime, RemoteStack, StackSilent
from eval.bridge.robot_wire import RobotWire
from robots.registry import make_body
from tests.eval.bridge.other_side import OtherSide
from tests.vuca_nav.deploy.loopback import Network
from vuca_nav.errors import BadArgument
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.types import STOP, Odometry, Pose2, Scan, Twist2, VelocityCommand

START, GOAL = Pose2(2.0, 3.0, 0.5), (5.0, 6.0)
FORWARD = VelocityCommand(0.4, 0.0, 0.1)
TICK = 33_333_333


@pytest.fixture(scope="module")
def body():
    return make_body("tiago")


@pytest.fixture
def network():
    return Network()


def remote(network, body, pace, **kwargs):
    return RemoteStack(RobotWire(network.join(), body), pace, **kwargs)


def readings(stamp=0.0, x=0.0):
    scan = Scan(stamp, np.full(360, 2.0))
    return scan, Odometry(stamp, Pose2(x, 0.0, 0.0), Twist2(0.0, 0.0, 0.0))


def test_lockstep_gives_the_command_that_answers_the_scan_and_no_other(network, body):
    other = OtherSide(network, lambda scan, odometry: VelocityCommand(scan.stamp, 0.0, 0.0))
    stack = remote(network, body, Lockstep(0.3))
    stack.reset(START, GOAL)
    other.send(VelocityCommand(9.0, 0.0, 0.0), 5)  # of long ago
    assert stack.step(*readings()) == STOP
    assert stack.step(*readings(TICK / 1e9)) == (TICK / 1e9, 0.0, 0.0)
    assert [stamp for stamp, _, _ in other.heard] == [FIRST_STAMP, FIRST_STAMP + TICK]
    assert (other.start, other.goal) == (START, GOAL)
    assert other.clocks.take()[-1].message.clock.nanosec == TICK


def test_lockstep_ends_with_one_line_where_nobody_answers(network, body):
    stack = remote(network, body, Lockstep(0.05))
    stack.reset(START, GOAL)
    with pytest.raises(StackSilent, match=r"no command on cmd_vel with the stamp 1\.0+ s in 0\.05 s \(none came\)"):
        stack.step(*readings())


def test_a_scan_that_comes_again_is_published_once(network, body):
    other = OtherSide(network, lambda scan, odometry: FORWARD)
    stack = remote(network, body, RealTime(50.0))
    stack.reset(START, GOAL)
    scan, odometry = readings()
    stack.step(scan, odometry)
    stack.step(scan, readings(0.1)[1])
    stack.step(*readings(0.2))
    assert [round((stamp - FIRST_STAMP) / 1e9, 6) for stamp, _, _ in other.heard] == [0.0, 0.2]
    assert other.odometry.stamp == 0.2


def test_the_next_mission_goes_on_in_time_and_begins_anew_otherwise(network, body):
    other = OtherSide(network, lambda scan, odometry: FORWARD)
    stack = remote(network, body, Lockstep(0.3))
    for start in (START, Pose2(-1.0, 0.0, 0.0)):
        stack.reset(start, GOAL)
        for k in range(3):
            stack.step(*readings(k * TICK / 1e9))
        assert (other.start, other.heard[-1][1].stamp) == (start, 2 * TICK / 1e9)
    stamps = [stamp for stamp, _, _ in other.heard]
    assert stamps[3] == stamps[2] + 1_000_000_000
    assert stamps[3:] == [stamps[3] + k * TICK for k in range(3)]


def test_the_estimate_is_the_transform_of_map_to_odom_over_the_odometry(network, body):
    other = OtherSide(network, lambda scan, odometry: FORWARD)
    stack = remote(network, body, Lockstep(0.3))
    stack.reset(Pose2(2.0, 3.0, 0.0), GOAL)
    stack.step(*readings(0.0, x=1.0))
    assert stack.map_from_base == (3.0, 3.0, 0.0)  # none yet: dead reckoning from the start
    other.publish_transform(Pose2(2.5, 3.0, np.pi / 2.0), FIRST_STAMP)
    stack.step(*readings(0.1, x=1.0))
    assert stack.map_from_base == pytest.approx((2.5, 4.0, np.pi / 2.0))


def test_a_transform_of_the_mission_before_is_no_estimate(network, body):
    other = OtherSide(network, lambda scan, odometry: FORWARD)
    stack = remote(network, body, Lockstep(0.3))
    stack.reset(Pose2(2.0, 3.0, 0.0), GOAL)
    stack.step(*readings())
    stack.reset(Pose2(7.0, 3.0, 0.0), GOAL)
    other.publish_transform(Pose2(2.5, 3.0, 0.0), FIRST_STAMP)
    stack.step(*readings())
    assert stack.map_from_base == (7.0, 3.0, 0.0)


def test_in_real_time_the_base_holds_a_command_and_stops_when_it_is_old(network, body):
    answers = iter([FORWARD])
    other = OtherSide(network, lambda scan, odometry: next(answers))
    pace = RealTime()
    stack = remote(network, body, pace)
    stack.reset(START, GOAL)
    began = time.perf_counter()
    first = stack.step(*readings())
    other.decide = None
    given = [first]
    while given[-1] == FORWARD and len(given) < 60:
        given.append(stack.step(*readings(len(given) / 30.0)))
    held = time.perf_counter() - began
    assert (first, given[-1], pace.stale) == (FORWARD, STOP, 1)
    assert 2 <= len(given) <= 8  # 0.2 s are 6 ticks; a machine that is busy makes them longer, and then fewer
    assert held >= 0.2 - 1.0 / 30.0 - 0.005  # none is carried out that is older, to the end of its tick
    assert len(pace.latencies) == 1


def test_in_real_time_ticks_keep_to_the_clock(network, body):
    OtherSide(network, lambda scan, odometry: FORWARD)
    stack = remote(network, body, RealTime(2.0))
    stack.reset(START, GOAL)
    began = time.perf_counter()
    for k in range(12):
        stack.step(*readings(k / 30.0))
    assert time.perf_counter() - began >= 12 / 60.0 - 1e-3


def test_commands_that_are_none_are_not_believed(network, body):
    OtherSide(network, lambda scan, odometry: VelocityCommand(np.nan, 0.0, 0.0))
    stack = remote(network, body, RealTime(10.0))
    stack.reset(START, GOAL)
    assert stack.step(*readings()) == STOP
    assert stack.wire.refused == {"cmd_vel": 1}


def test_before_the_mission_a_stack_is_warmed_up_without_a_goal(network, body):
    goals = []
    other = OtherSide(network, lambda scan, odometry: goals.append(other.goal) or FORWARD)
    stack = remote(network, body, RealTime(20.0), warm_up=0.5)
    stack.reset(START, GOAL)
    stack.step(*readings())
    assert goals == 15 * [None] + [GOAL]
    stamps = [stamp for stamp, _, _ in other.heard]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] - FIRST_STAMP == 500_000_000


def test_a_map_that_is_known_is_published_for_those_who_come_later(network, body):
    stack = remote(network, body, Lockstep(0.3))
    stack.reset(START, GOAL, OccupancyGrid(GridConfig()))
    (received,) = OtherSide(network).maps.take()
    assert received.message.info.resolution == pytest.approx(0.05)


@pytest.mark.parametrize("settings", [{"factor": 0.0}, {"factor": float("nan")}, {"timeout": -1.0}])
def test_paces_that_cannot_be_are_refused(settings):
    with pytest.raises(BadArgument):
        PaceConfig(**settings)


def test_what_is_missing_is_named(network, body):
    wire = RobotWire(network.join(), body)
    assert len(wire.missing()) == 4
    assert "cmd_vel as TwistStamped" in wire.missing()[-1]
    OtherSide(network)
    assert wire.missing() == []


def test_a_scan_that_is_answered_late_has_the_time_of_its_own_answer(network, body):
    other = OtherSide(network, lambda scan, odometry: FORWARD)
    pace = RealTime(20.0)
    stack = remote(network, body, pace)
    stack.reset(START, GOAL)
    stack.step(*readings())
    other.decide = None
    stack.step(*readings(0.1))
    other.send(FORWARD, FIRST_STAMP)  # of the first scan again: no answer to the second
    stack.step(*readings(0.2))
    assert len(pace.latencies) == 1
    other.send(FORWARD, FIRST_STAMP + 200_000_000)
    stack.step(*readings(0.3))
    assert len(pace.latencies) == 3
    assert pace.latencies[1] > pace.latencies[2] > 0.0
