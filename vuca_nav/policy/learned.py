"""The cerebellum (Section III-B): a trained network as a local policy."""

import math

import numpy as np

from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.policy.network import LEARNED_GATE, Gate, PolicyNetwork
from vuca_nav.policy.observation import Observer, command_from_action, goal_features, limits_of
from vuca_nav.policy.weights_file import ACTION_SIZE, PolicyWeights, Single
from vuca_nav.telemetry import Telemetry
from vuca_nav.types import STOP, BodySpec, FloatArray, LidarSpec, VelocityCommand

BLIND_SHARE = 0.3
"""Of the command that is given while no beam returns at all: on an open field, or behind a lidar that died."""
MOST_PERIODS = 2.5
"""Between two scans; after a longer gap what was seen before it is forgotten. A single lost scan is no gap."""
MOST_INVALID = 0.5
"""Share of a scan's beams that may be NaN (REP-117: a fault, not an empty beam) before the robot stops."""


class LearnedPolicy(LocalPolicy):
    """The mean action of a network, at every tick.

    It stops while what it is given cannot be trusted: a scan more than half NaN, a waypoint, velocity or motion that
    is not a finite number.

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
        self._period = 1.0 / lidar.rate
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
    def gate_shares(self) -> FloatArray:
        """(E,) shares of the experts in the last command."""
        return self.network.shares

    @property
    def observation(self) -> Single | None:
        """(x,) the last one, O_g as it was then; None before the first that could be trusted."""
        return self._observation[0] if self._usable else None

    def look(self, observation: LocalObservation) -> None:
        """Take in what the sensors say now; a gap in time makes it forget what was before."""
        scan = observation.scan
        if not 0.0 < scan.stamp - self._seen_at < MOST_PERIODS * self._period:
            self._observer.reset()
        self._seen_at = scan.stamp
        self._goal[0], self._twist[0], self._motion[0] = (
            observation.waypoint_in_base,
            observation.twist,
            observation.motion,
        )
        invalid = np.count_nonzero(np.isnan(scan.ranges))
        numbers = self._goal.sum() + self._twist.sum() + self._motion.sum()
        self._usable = invalid <= MOST_INVALID * len(scan.ranges) and math.isfinite(numbers)
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
