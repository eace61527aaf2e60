"""NavigateToPose as Nav2's clients see it."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from vuca_nav.deploy.node.action import ACTION, CancelCode, NavigateToPose, Progress, Status
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.interface import LATCHED
from vuca_nav.deploy.transport.network import NetworkConfig
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.types import Pose2

DOMAIN = 104
NAME = "navigate_to_pose/_action"


class Caller:
    """A client of the action."""

    def __init__(self, transport: DdsTransport):
        self.send = transport.client(f"{NAME}/send_goal", f"{ACTION}_SendGoal")
        self.result = transport.client(f"{NAME}/get_result", f"{ACTION}_GetResult")
        self.cancel = transport.client(f"{NAME}/cancel_goal", "action_msgs/srv/CancelGoal")
        self.feedback = transport.subscribe(f"{NAME}/feedback", f"{ACTION}_FeedbackMessage")
        self.status = transport.subscribe(f"{NAME}/status", "action_msgs/msg/GoalStatusArray", LATCHED)

    def is_ready(self) -> bool:
        return self.send.is_served and self.result.is_served and self.cancel.is_served and self.feedback.publishers > 0

    def ask(self, number: int, x: float = 1.0, frame: str = "map") -> None:
        request = new(f"{ACTION}_SendGoal_Request")
        request.goal_id.uuid = identity(number)
        request.goal.pose.header.frame_id = frame
        request.goal.pose.pose.position.x = x
        request.goal.pose.pose.orientation.w = 1.0
        self.send.call(request)

    def want_result(self, number: int) -> None:
        request = new(f"{ACTION}_GetResult_Request")
        request.goal_id.uuid = identity(number)
        self.result.call(request)


def identity(number: int) -> Any:
    return np.full(16, number, np.uint8)


@pytest.fixture
def action() -> Iterator[tuple[NavigateToPose, Caller]]:
    with DdsTransport(NetworkConfig(DOMAIN)) as ours, DdsTransport(NetworkConfig(DOMAIN)) as theirs:
        server, caller = NavigateToPose(ours, "map"), Caller(theirs)
        assert eventually(caller.is_ready)
        yield server, caller


def eventually(get: Callable[[], Any], seconds: float = 10.0) -> Any:
    end = time.monotonic() + seconds
    while not (value := get()) and time.monotonic() < end:
        time.sleep(0.01)
    return value


def test_a_goal_is_accepted_and_its_result_comes_when_it_is_over(action: tuple[NavigateToPose, Caller]) -> None:
    server, caller = action
    caller.ask(1, x=2.5)
    assert eventually(lambda: server.take(7)) == Pose2(2.5, 0.0, 0.0)
    ((_, answer),) = eventually(caller.send.take)
    assert answer.accepted
    assert answer.stamp.nanosec == 7
    caller.want_result(1)
    time.sleep(0.2)
    assert server.take(8) is None
    assert caller.result.take() == []
    server.tell(Progress(Pose2(1.0, 0.0, 0.0), 2.0, 3.0, 1.5), 9)
    (received,) = eventually(caller.feedback.take)
    feedback = received.message.feedback
    assert (feedback.distance_remaining, feedback.navigation_time.sec) == (1.5, 2)
    assert received.message.goal_id.uuid.tolist() == identity(1).tolist()
    server.finish(Status.SUCCEEDED)
    ((_, result),) = eventually(caller.result.take)
    assert result.status == Status.SUCCEEDED
    statuses = caller.status.take()[-1].message.status_list
    assert [status.status for status in statuses] == [Status.SUCCEEDED]


def test_a_goal_that_is_none_is_not_accepted(action: tuple[NavigateToPose, Caller]) -> None:
    server, caller = action
    for number, x, frame in ((1, float("nan"), "map"), (2, 1.0, "odom")):
        caller.ask(number, x, frame)
        answers: list[Any] = []
        assert eventually(lambda: server.take(1) or answers.extend(caller.send.take()) or answers)  # noqa: B023
        assert not answers[0][1].accepted
    assert not server.is_active


def test_another_goal_aborts_the_first(action: tuple[NavigateToPose, Caller]) -> None:
    server, caller = action
    caller.ask(1)
    assert eventually(lambda: server.take(1))
    caller.ask(2, x=4.0)
    assert eventually(lambda: server.take(2)) == Pose2(4.0, 0.0, 0.0)
    caller.want_result(1)
    assert eventually(lambda: server.take(3) or caller.result.take())[0][1].status == Status.ABORTED


def test_cancellation_ends_the_goal_it_means(action: tuple[NavigateToPose, Caller]) -> None:
    server, caller = action

    def cancel(number: int) -> Any:
        request = new("action_msgs/srv/CancelGoal_Request")
        request.goal_info.goal_id.uuid = identity(number)
        caller.cancel.call(request)
        canceled: list[bool] = []
        answers: list[Any] = []
        eventually(lambda: canceled.append(server.was_canceled()) or answers.extend(caller.cancel.take()) or answers)
        return any(canceled), answers[0][1]

    caller.ask(1)
    assert eventually(lambda: server.take(1))
    was_canceled, answer = cancel(9)
    assert not was_canceled
    assert answer.return_code == CancelCode.UNKNOWN_GOAL
    was_canceled, answer = cancel(1)
    assert was_canceled
    assert (answer.return_code, len(answer.goals_canceling)) == (CancelCode.NONE, 1)
    assert not server.is_active
    was_canceled, answer = cancel(1)
    assert answer.return_code == CancelCode.TERMINATED
    caller.ask(2)
    assert eventually(lambda: server.take(2))
    assert cancel(0)[0]  # all goals
    caller.want_result(2)
    assert eventually(lambda: server.take(3) or caller.result.take())[0][1].status == Status.CANCELED
