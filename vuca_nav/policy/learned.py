"""The cerebellum (Section III-B): a trained network as a local policy."""

import math

import numpy as np

from vuca_nav.policy.base import LocalObservation, LocalPolicy, is_gap
from vuca_nav.policy.network import LEARNED_GATE, Gate, PolicyNetwork
from vuca_nav.policy.observation import Observer, command_from_action, goal_features, limits_of
from vuca_nav.policy.weights_file import ACTION_SIZE, PolicyWeights, Single
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, BodySpec, LidarSpec, VelocityCommand

BLIND_SHARE = 0.3
"""Of the command that is given while no beam returns at all: on an open field, or behind a lidar that died."""


class LearnedPolicy(LocalPolicy):
    """The mean action of a network, at every tick.

    It stops while what it is given cannot be trusted (``LocalObservation.is_trustworthy``).

    Args:
        body: What is driven.
        lidar: What it sees with.
        weights: Of ``load_weights``.
        gate: Who decides on the experts' shares.
        telemetry: Told the shares at every tick.

    Raises:
        BadArgument: If the weights' observation does not go with the lidar, or there is no such expert.
    """

    def __init__(
        self,
        body: BodySpec,
        lidar: LidarSpec,
        weights: PolicyWeights,
        gate: Gate = LEARNED_GATE,
        telemetry: Telemetry = Telemetry(),
    ):
        self.network = PolicyNetwork(weights, gate)
        self.telemetry = telemetry
        self._observer = Observer(weights.observation, [body], lidar.num_beams, lidar.rate)
        self._rate = lidar.rate
        self._limits = limits_of(body)
        self._observation = np.zeros((1, self._observer.size), np.float32)
        self._action = np.zeros(ACTION_SIZE)
        self._goal, self._twist, self._motion = np.zeros((1, 2)), np.zeros((1, 3)), np.zeros((1, 3))
        self.reset()

    def reset(self) -> None:
        """Forget the last episode."""
        self._observer.reset()
        self._seen_at = -math.inf
        self._usable = False
        self._blind = False

    @property
    def observation(self) -> Single | None:
        """(x,) the last one, O_g as it was then; None before the first that could be trusted."""
        return self._observation[0] if self._usable else None

    def look(self, observation: LocalObservation) -> None:
        """Take in what the sensors say now; a gap in time makes it forget what was before."""
        scan = observation.scan
        if is_gap(self._seen_at, scan.stamp, self._rate):
            self._observer.reset()
        self._seen_at = scan.stamp
        self._goal[0], self._twist[0], self._motion[0] = (
            observation.waypoint_in_base,
            observation.twist,
            observation.motion,
        )
        self._usable = observation.is_trustworthy
        if not self._usable:
            self._observer.reset()
            return
        self._blind = not (scan.ranges < math.inf).any()
        self._observer.observe(scan.ranges[None], self._goal, self._twist, self._motion, self._observation)

    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The mean action, as velocities within the body's limits."""
        if observation.scan.stamp != self._seen_at:
            self.look(observation)
        elif self._usable:  # looked at before it was known where to go
            self._observation[0, self._observer.config.goal_slice] = goal_features(
                np.array([observation.waypoint_in_base])
            )[0]
        if not self._usable or not self.network.act(self._observation[0], self._action):
            return STOP
        if self.network.weights.experts > 1:
            self.telemetry.gate(self.network.shares)
        v_x, v_y, w_z = command_from_action(self._action, self._limits) * (BLIND_SHARE if self._blind else 1.0)
        return VelocityCommand(float(v_x), float(v_y), float(w_z))
