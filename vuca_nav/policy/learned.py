"""The cerebellum (Zhang et al., Section III-B): a trained network as a local policy."""

import numpy as np

from vuca_nav.perception.percept import Percept
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.network import LEARNED_GATE, Gate, make_network
from vuca_nav.policy.observation import PerceptObserver, command_from_action, limits_of
from vuca_nav.policy.weights_file import ACTION_SIZE, PolicyWeights
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, BodySpec, LidarSpec, VelocityCommand

BLIND_SHARE = 0.3
"""Share of the command that is given while no beam returns at all: on an open field, or with a dead lidar."""


class LearnedPolicy(LocalPolicy):
    """The mean action of a network, at every tick. It stands while the percept is not valid.

    Args:
        body: The body that is driven.
        lidar: The body's lidar.
        weights: Result of ``load_weights``.
        gate: Source of the experts' shares.
        telemetry: Receives the shares at every tick.
        rate: Rate of the ticks [Hz]; by default the lidar's.

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
        rate: float | None = None,
    ):
        self.rate = lidar.rate if rate is None else rate
        self.network = make_network(weights, gate)
        self.telemetry = telemetry
        self._observer = PerceptObserver(weights.observation, body, lidar, self.rate)
        self._limits = limits_of(body)
        self._action = np.zeros(ACTION_SIZE)

    def reset(self) -> None:
        """Do nothing: the policy keeps no memory."""

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The mean action, as velocities within the body's limits."""
        if goal is None or not percept.is_valid:
            return STOP
        observation = self._observer.observe(percept, goal.point_in_base)
        if not self.network.act(observation, self._action):
            return STOP
        if self.network.weights.experts > 1:
            self.telemetry.gate(self.network.shares)
        command = command_from_action(self._action, self._limits)
        v_x, v_y, w_z = (command * BLIND_SHARE if percept.is_blind else command).tolist()
        return VelocityCommand(v_x, v_y, w_z)
