"""Nav2's action NavigateToPose, served: goals, cancellation, feedback, results, as Nav2's clients expect them.

An action is three services and two topics (REP-2011 names their types). One goal is active at a time; a new one aborts
it, as Nav2's own server does.
"""

from collections import OrderedDict
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, NamedTuple

from vuca_nav.deploy.messages import Refused, duration_message, pose_of, pose_stamped_message, stamp_of, time_message
from vuca_nav.deploy.transport.interface import LATCHED, Qos, Request, Transport
from vuca_nav.deploy.transport.ros_types import new
from vuca_nav.types import Pose2

ACTION = "nav2_msgs/action/NavigateToPose"
MOST_GOALS = 100
"""Greatest number of goals that are remembered: clients ask for results of the last few."""
MOST_WAITING = 100
"""Greatest number of clients that wait for results."""


class Status(IntEnum):
    """Status of a goal, action_msgs/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class CancelCode(IntEnum):
    """Answer to a cancellation, action_msgs/CancelGoal."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL = 2
    TERMINATED = 3


class Progress(NamedTuple):
    """How far the active goal is."""

    map_from_base: Pose2
    elapsed: float
    """Time since it was accepted [s]."""
    remaining: float
    """Time to go, by the mean speed so far [s]."""
    distance: float
    """Way to go [m]."""


@dataclass(slots=True)
class _Goal:
    identity: bytes
    stamp: int
    """When it was accepted [ns]."""
    status: Status
    waiting: list[Request] = field(default_factory=list)
    """Requests for its result."""

    @property
    def is_over(self) -> bool:
        return self.status >= Status.SUCCEEDED


class NavigateToPose:
    """The action's server. Ask it once a tick: ``take`` for a new goal, ``was_canceled`` for the end of the old one.

    Args:
        transport: The network.
        frame: Frame that goals must be in, the map's.
        name: Name of the action.
    """

    def __init__(self, transport: Transport, frame: str, name: str = "navigate_to_pose"):
        self._refusals, self._name, self._frame = transport.refusals, transport.full_name(name), frame
        self._send_goal = transport.serve(f"{name}/_action/send_goal", f"{ACTION}_SendGoal")
        self._get_result = transport.serve(f"{name}/_action/get_result", f"{ACTION}_GetResult")
        self._cancel = transport.serve(f"{name}/_action/cancel_goal", "action_msgs/srv/CancelGoal")
        self._feedback = transport.advertise(f"{name}/_action/feedback", f"{ACTION}_FeedbackMessage", Qos())
        self._status = transport.advertise(f"{name}/_action/status", "action_msgs/msg/GoalStatusArray", LATCHED)
        self._goals: OrderedDict[bytes, _Goal] = OrderedDict()
        self._active: _Goal | None = None

    @property
    def is_active(self) -> bool:
        """Whether a goal is being driven to."""
        return self._active is not None

    def take(self, now: int) -> Pose2 | None:
        """Answer what clients ask; the pose of a new goal, None if there is none.

        Args:
            now: The time [ns].
        """
        pose = None
        for request in self._send_goal.take():
            pose = self._accept(request, now) or pose
        for request in self._get_result.take():
            self._promise(request)
        return pose

    def was_canceled(self) -> bool:
        """Answer cancellations; whether the active goal was canceled: the robot has to stop."""
        canceled = False
        for request in self._cancel.take():
            canceled |= self._cancel_by(request)
        return canceled

    def tell(self, progress: Progress, stamp: int) -> None:
        """Publish feedback on the active goal.

        Args:
            progress: How far it is.
            stamp: The time [ns].
        """
        if self._active is None:
            return
        feedback = new(f"{ACTION}_Feedback")
        feedback.current_pose = pose_stamped_message(progress.map_from_base, stamp, self._frame)
        feedback.navigation_time = duration_message(progress.elapsed)
        feedback.estimated_time_remaining = duration_message(progress.remaining)
        feedback.distance_remaining = progress.distance
        message = new(f"{ACTION}_FeedbackMessage", feedback=feedback)
        message.goal_id.uuid = _uuid(self._active.identity)
        self._feedback.publish(message)

    def finish(self, status: Status) -> None:
        """End the active goal.

        Args:
            status: SUCCEEDED, CANCELED or ABORTED.
        """
        goal, self._active = self._active, None
        if goal is None:
            return
        goal.status = status
        for request in goal.waiting:
            self._get_result.reply(request, _result(status))
        goal.waiting.clear()
        self._publish_status()

    def _accept(self, request: Request, now: int) -> Pose2 | None:
        message, identity = request.message, request.message.goal_id.uuid.tobytes()
        pose = None
        try:
            if identity in self._goals:
                raise Refused("a goal of this identity was accepted before")
            pose = pose_of(message.goal.pose.header, message.goal.pose.pose, self._frame)
        except Refused as error:
            self._refusals.add(self._name, str(error))
        accepted = pose is not None
        if accepted:
            self.finish(Status.ABORTED)
            self._active = self._goals[identity] = _Goal(identity, now, Status.EXECUTING)
            while len(self._goals) > MOST_GOALS:
                self._goals.popitem(last=False)
        response = new(f"{ACTION}_SendGoal_Response", accepted=accepted, stamp=time_message(now))
        self._send_goal.reply(request, response)
        if accepted:
            self._publish_status()
        return pose

    def _promise(self, request: Request) -> None:
        """Answer a request for a result now, or when the goal is over."""
        goal = self._goals.get(request.message.goal_id.uuid.tobytes())
        if goal is None or goal.is_over or sum(len(goal.waiting) for goal in self._goals.values()) >= MOST_WAITING:
            self._get_result.reply(request, _result(Status.UNKNOWN if goal is None else goal.status))
        else:
            goal.waiting.append(request)

    def _cancel_by(self, request: Request) -> bool:
        """Answer a cancellation: of one goal, of all, or of those accepted up to a time."""
        info = request.message.goal_info
        identity, active = info.goal_id.uuid.tobytes(), self._active
        response = new("action_msgs/srv/CancelGoal_Response")
        try:
            until = stamp_of(info.stamp, may_be_zero=True)
        except Refused as error:
            self._refusals.add(self._name, str(error))
            response.return_code = int(CancelCode.REJECTED)
            self._cancel.reply(request, response)
            return False
        of_all = identity == bytes(16) and until == 0
        by_time = until > 0 and active is not None and active.stamp <= until
        is_meant = active is not None and (of_all or by_time or identity == active.identity)
        if active is not None and is_meant:
            active.status = Status.CANCELING
            canceled = new("action_msgs/msg/GoalInfo", stamp=time_message(active.stamp))
            canceled.goal_id.uuid = _uuid(active.identity)
            response.goals_canceling = [canceled]
        elif identity != bytes(16):
            code = CancelCode.TERMINATED if identity in self._goals else CancelCode.UNKNOWN_GOAL
            response.return_code = int(code)
        self._cancel.reply(request, response)
        if is_meant:
            self._publish_status()
            self.finish(Status.CANCELED)
        return is_meant

    def _publish_status(self) -> None:
        array = new("action_msgs/msg/GoalStatusArray")
        for goal in self._goals.values():
            status = new("action_msgs/msg/GoalStatus", status=int(goal.status))
            status.goal_info.goal_id.uuid = _uuid(goal.identity)
            status.goal_info.stamp = time_message(goal.stamp)
            array.status_list.append(status)
        self._status.publish(array)


def _uuid(identity: bytes) -> Any:
    import numpy as np

    return np.frombuffer(identity, np.uint8)


def _result(status: Status) -> Any:
    return new(f"{ACTION}_GetResult_Response", status=int(status))
