"""The node over the wire: what it hears becomes commands, and nothing else moves the robot."""

import math
import time
from collections.abc import Iterator

import numpy as np
import pytest

from tests.vuca_nav.deploy.node.robot_side import BEGINS, START, RobotSide, bundle, node, still
from vuca_nav.deploy.messages import transform_message
from vuca_nav.deploy.node.action import ACTION, Status
from vuca_nav.deploy.node.loop import Node, NodeConfig
from vuca_nav.deploy.safety.config import SafetyConfig
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.status import Tick
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.interface import LATCHED, RELIABLE, SENSOR, Qos
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.geometry import distance
from vuca_nav.types import STOP, LidarSpec, Pose2, VelocityCommand

DOMAIN = 103
LOCKSTEP = NodeConfig(lockstep=True, use_sim_time=True)
GOAL = (5.0, 3.0)


@pytest.fixture
def ours() -> Iterator[DdsTransport]:
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        yield transport


@pytest.fixture
def theirs() -> Iterator[DdsTransport]:
    with DdsTransport(NetworkConfig(DOMAIN)) as transport:
        yield transport


@pytest.fixture
def driven(ours: DdsTransport, theirs: DdsTransport) -> tuple[Node, RobotSide]:
    made, robot = node(ours, LOCKSTEP), RobotSide(theirs)
    robot.wait_for()
    return made, robot


def test_in_lockstep_its_commands_are_those_of_the_stack_under_its_safety_layer(
    driven: tuple[Node, RobotSide],
) -> None:
    made, robot = driven
    robot.place()
    robot.send_goal(*GOAL)
    parts = bundle()
    navigator, safety = parts.navigator(), SafetyLayer(parts.body, parts.lidar, SafetyConfig())
    navigator.reset(START, GOAL)
    commands = []
    for _ in range(120):
        scan, odometry = robot.readings()
        now = odometry.stamp
        proposed = navigator.step(scan, odometry)
        allowed = safety.step(Tick(now, now, scan, scan.stamp, odometry, now, has_goal=True), proposed)
        commands += robot.drive(made, 1)
        assert commands[-1] == allowed.command
    assert still(commands[:30])  # a healthy second
    assert not still(commands[30:40])
    assert made.navigator.map_from_base == navigator.map_from_base


def test_it_stands_without_a_goal_and_maps_and_drives_to_one_after_another(driven: tuple[Node, RobotSide]) -> None:
    made, robot = driven
    robot.place()
    assert still(robot.drive(made, 40))
    transforms = [received.message.transforms[0] for received in robot.tf.take()]
    assert {(transform.header.frame_id, transform.child_frame_id) for transform in transforms} == {("map", "odom")}
    assert transforms[-1].transform.translation.x == pytest.approx(START.x, abs=0.02)
    assert robot.map.take()[0].message.info.resolution == pytest.approx(0.05)
    for goal in (GOAL, (3.0, 4.0)):
        robot.send_goal(*goal)
        for _ in range(400):
            robot.drive(made, 1)
            if distance(robot.pose, goal) < 0.1:
                break
        assert distance(robot.pose, goal) < 0.1


@pytest.mark.parametrize("qos", [RELIABLE, SENSOR], ids=["reliable", "best effort"])
def test_an_emergency_stop_latches_until_it_is_released(driven: tuple[Node, RobotSide], qos: Qos) -> None:
    made, robot = driven
    stop, release = (
        robot.transport.advertise(topic, "std_msgs/msg/Bool", qos)
        for topic in ("emergency_stop", "emergency_stop/release")
    )
    end = time.monotonic() + 10.0
    while not (stop.subscribers and release.subscribers) and time.monotonic() < end:
        time.sleep(0.01)
    robot.place()
    robot.send_goal(*GOAL)
    assert not still(robot.drive(made, 45)[40:])
    stop.publish(new("std_msgs/msg/Bool", data=True))
    assert still(robot.drive(made, 1))
    stop.publish(new("std_msgs/msg/Bool", data=False))
    assert still(robot.drive(made, 40))
    release.publish(new("std_msgs/msg/Bool", data=True))
    assert not still(robot.drive(made, 40)[35:])


def test_what_cannot_be_true_is_refused_and_counted(driven: tuple[Node, RobotSide], ours: DdsTransport) -> None:
    made, robot = driven
    robot.place(Pose2(math.nan, 0.0, 0.0))
    robot.send_goal(*GOAL, frame="odom")
    robot.drive(made, 1)
    robot.tick += 1
    robot.sense(lambda message: setattr(message, "ranges", np.ones(100, np.float32)))
    for _ in range(20):
        assert not made.pace.wait()
    assert dict(ours.refusals.counts) == {
        ("/initialpose", "a position is not finite, or too far out"): 1,
        ("/goal_pose", "its frame is not map"): 1,
        ("/scan", "it has another number of ranges than the first scan"): 1,
    }
    robot.tick += 1
    assert still(robot.drive(made, 40))
    assert made.navigator.goal is None


def test_a_new_initial_pose_begins_anew(driven: tuple[Node, RobotSide]) -> None:
    made, robot = driven
    robot.place()
    robot.send_goal(*GOAL)
    robot.drive(made, 50)
    robot.place(robot.pose._replace(x=robot.pose.x + 1.0))
    assert still(robot.drive(made, 5))
    assert made.navigator.goal is None
    assert made.navigator.map_from_base.x == pytest.approx(robot.pose.x + 1.0, abs=0.05)


def test_the_robots_own_lidar_is_taken(ours: DdsTransport, theirs: DdsTransport) -> None:
    made = node(ours, LOCKSTEP)
    robot = RobotSide(theirs, LidarSpec(num_beams=241, angle_min=-2.0943951, angle_increment=0.0174532925))
    robot.wait_for()
    robot.place()
    robot.send_goal(*GOAL)
    assert not still(robot.drive(made, 45))
    assert made.navigator.slam.lidar.num_beams == 241
    assert len(made.navigator.percept.scan.ranges) == 241 if made.navigator.percept else False


def test_a_mount_that_is_told_late_is_taken_and_the_robot_stands_until_then(driven: tuple[Node, RobotSide]) -> None:
    made, robot = driven
    robot.place()
    robot.send_goal(*GOAL)
    assert not still(robot.drive(made, 45)[40:])
    mount = transform_message(Pose2(0.15, 0.0, 0.0), BEGINS, "base_link", "laser")
    robot.transport.advertise("/tf_static", "tf2_msgs/msg/TFMessage", LATCHED).publish(mount)
    end = time.monotonic() + 10.0
    while made.inputs.scan is not None and time.monotonic() < end:
        made.inputs.take()
    assert still(robot.drive(made, 20))
    assert made.navigator.slam.lidar.mount == Pose2(0.15, 0.0, 0.0)
    assert made.navigator.map_from_base.x == pytest.approx(robot.pose.x, abs=0.1)
    assert not still(robot.drive(made, 30)[20:])


def test_an_action_is_driven_to_its_end_with_feedback(driven: tuple[Node, RobotSide], theirs: DdsTransport) -> None:
    made, robot = driven
    name = "navigate_to_pose/_action"
    send = theirs.client(f"{name}/send_goal", f"{ACTION}_SendGoal")
    result = theirs.client(f"{name}/get_result", f"{ACTION}_GetResult")
    feedback = theirs.subscribe(f"{name}/feedback", f"{ACTION}_FeedbackMessage")
    end = time.monotonic() + 10.0
    while not (send.is_served and result.is_served and feedback.publishers) and time.monotonic() < end:
        time.sleep(0.01)
    robot.place()
    request = new(f"{ACTION}_SendGoal_Request")
    request.goal_id.uuid = np.arange(16, dtype=np.uint8)
    request.goal.pose.header.frame_id = "map"
    position = request.goal.pose.pose.position
    position.x, position.y = GOAL
    request.goal.pose.pose.orientation.w = 1.0
    send.call(request)
    wanted = new(f"{ACTION}_GetResult_Request")
    wanted.goal_id.uuid = request.goal_id.uuid
    distances, results, accepted = [], [], []
    for k in range(500):
        robot.drive(made, 1)
        accepted += send.take()
        if k == 5:
            result.call(wanted)
        distances += [received.message.feedback.distance_remaining for received in feedback.take()]
        results += result.take()
        if results:
            break
    assert [answer.accepted for _, answer in accepted] == [True]
    assert [answer.status for _, answer in results] == [Status.SUCCEEDED]
    assert distance(robot.pose, GOAL) < 0.1
    assert len(distances) > 5
    assert distances[0] > 3.0 > 0.5 > distances[-1]
    assert still(robot.drive(made, 5))
    assert made.navigator.goal is None


def test_whatever_ends_it_the_last_command_is_zero(
    driven: tuple[Node, RobotSide], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, robot = driven
    robot.place()
    robot.send_goal(*GOAL)
    assert not still(robot.drive(made, 45)[40:])

    def fails(*_: object) -> VelocityCommand:
        raise ArithmeticError("a fault of the stack")

    monkeypatch.setattr(made.navigator, "step", fails)
    robot.sense()
    with pytest.raises(ArithmeticError):
        made.run()
    robot.transport.wait(2.0)
    last = robot.commands.take()[-1].message.twist
    assert (last.linear.x, last.angular.z) == (STOP.v_x, STOP.w_z)


def test_in_real_time_it_ticks_with_the_scans_and_stops_when_they_stop(
    ours: DdsTransport, theirs: DdsTransport
) -> None:
    made, robot = node(ours, NodeConfig()), RobotSide(theirs)
    robot.wait_for()

    def sense() -> None:
        """Publish readings with the time of the wall clock."""
        robot.tick = round((time.time_ns() - 1_000_000_000) * 30 / 1e9)
        robot.sense()

    sense()
    robot.send_goal(*GOAL)
    actions, due, ticks = [], time.monotonic(), 0
    end = due + 2.5
    while time.monotonic() < end:
        if time.monotonic() >= due and time.monotonic() < end - 0.5:
            sense()
            due += 1.0 / 30.0
        if made.pace.wait():
            made.tick()
            ticks += 1
            actions.append(made.safety.state.action)
    assert 40 < ticks < 100
    assert {"passed", "limited", "waiting"} & set(actions)
    assert actions[-1] == "fault"
    assert made.safety.state.reasons[0].name == "scan_silent"
    received = robot.commands.take()
    assert received[-1].message.twist.linear.x == 0.0


def test_in_lockstep_it_says_what_it_waits_for(driven: tuple[Node, RobotSide]) -> None:
    made, robot = driven
    said = []

    def say() -> None:
        said.append(made.status())
        raise InterruptedError  # once is enough

    made.after_tick = say
    with pytest.raises(InterruptedError):
        made.run()
    assert said == ["waiting for clock and scan and odometry"]
    made.after_tick = lambda: None
    robot.drive(made, 1)
    assert made.status().endswith("no goal")
