"""The gait of a quadruped: from what it measures and a velocity command to its joints' targets, once a control step."""

import math
from enum import Enum, auto

import numpy as np

from robots.locomotion.kernels import (
    ACTION_SIZE,
    OBSERVATION_SIZE,
    advance_clock,
    advance_trim,
    fill_observation,
    joint_targets,
    leg_velocity,
    level_trunk,
    trot_angles,
)
from robots.locomotion.model import QuadrupedModel
from robots.locomotion.network import BadObservation, PolicyNetwork
from robots.locomotion.odometry import VELOCITY_GAIN
from vuca_nav.types import FloatArray, VelocityCommand

FOLD_TIME = 0.3
"""From however the legs lie to folded under the trunk [s]."""
RISE_TIME = 1.0
"""From lying to standing [s]."""
STEADY_TIME = 0.4
"""Standing on stiff legs before the policy takes over [s]."""
START_UP_TIME = FOLD_TIME + RISE_TIME + STEADY_TIME
FALLEN_UP = math.cos(math.radians(50.0))
"""Vertical part of the trunk's upward axis below which it is falling."""
FALLEN_TICKS = 3
"""So many control steps below it in a row: not one bad sample."""


class Mode(Enum):
    """What the legs are doing."""

    STARTING = auto()
    """Lying, then rising; commands are ignored."""
    WALKING = auto()
    """The policy is in charge; it stands still at a zero command."""
    FALLEN = auto()
    """The joints give way, damped; only a reset leads out."""


class Gait:
    """One robot's gait. Sensors in, joint targets out; borrowed arrays throughout, nothing is allocated.

    Args:
        model: The robot.
        policy: Corrects the nominal trot.
        control_dt: Time between two calls of ``step`` [s].

    Attributes:
        mode: What the legs are doing.
        velocity: Estimate of the body's velocity, forward and left (2,) [m/s].
        leg_velocity: What the standing legs say of it now, unfiltered (2,) [m/s].
        worth: How much of the weight says so, 0-1.
    """

    def __init__(self, model: QuadrupedModel, policy: PolicyNetwork, control_dt: float):
        self._legs, self._tuning, self._policy = model.legs, model.tuning(control_dt), policy
        self._folded = np.tile(model.config.lying, 4)
        self._start = np.zeros(ACTION_SIZE)
        self._action, self._targets, self._last_targets = (np.zeros(ACTION_SIZE) for _ in range(3))
        self._command, self._wanted, self._clock = np.zeros(3), np.zeros(3), np.zeros(2)
        self._trim, self._asked = np.zeros(3), np.zeros(3)
        self._tilt, self._lifts, self._standing = np.zeros(2), np.zeros(4), np.zeros(ACTION_SIZE)
        self._observation = np.zeros(OBSERVATION_SIZE)
        self.velocity, self.leg_velocity = np.zeros(2), np.zeros(2)
        self.worth = 0.0
        self.mode, self._time, self._low_ticks = Mode.STARTING, 0.0, 0

    def reset(self, q: FloatArray) -> None:
        """Begin with the start-up, from joint angles (12,) [rad]."""
        self._start[:] = q
        self._targets[:] = q
        self._last_targets[:] = q
        for array in (self._action, self._command, self._clock, self._trim, self._tilt, self._lifts):
            array[:] = 0.0
        self.velocity[:], self.leg_velocity[:] = 0.0, 0.0
        self.mode, self._time, self._low_ticks, self.worth = Mode.STARTING, 0.0, 0, 0.0

    def measure(self, gyro: FloatArray, up: FloatArray, q: FloatArray, dq: FloatArray) -> None:
        """Take in one sample of the sensors, before ``step``.

        Args:
            gyro: Angular velocity in base_link (3,) [rad/s].
            up: The vertical in base_link (3,), from the attitude.
            q: Joint angles (12,) [rad].
            dq: Joint speeds (12,) [rad/s].

        Raises:
            BadObservation: If a number is not finite.
        """
        if not math.isfinite(gyro.sum() + up.sum() + q.sum() + dq.sum()):
            raise BadObservation(f"gait measurement is not finite: gyro {gyro}, up {up}, angles {q}, speeds {dq}")
        self.worth = leg_velocity(
            self._legs, self._tuning, gyro, up, q, dq, self._targets, self._last_targets, self.leg_velocity
        )
        self.velocity += VELOCITY_GAIN * self.worth * (self.leg_velocity - self.velocity)
        self._low_ticks = self._low_ticks + 1 if up[2] < FALLEN_UP else 0
        if self._low_ticks >= FALLEN_TICKS:
            self.mode = Mode.FALLEN

    def step(
        self, command: VelocityCommand, gyro: FloatArray, up: FloatArray, q: FloatArray, dq: FloatArray
    ) -> FloatArray:
        """Joint targets (12,) [rad] for the next control step, from the sample just measured; borrowed.

        Raises:
            BadObservation: If the command is not finite, whatever the mode; what was asked before stays as it was.
        """
        if not (math.isfinite(command[0]) and math.isfinite(command[1]) and math.isfinite(command[2])):
            raise BadObservation(f"velocity command is not finite: {tuple(command)}")
        self._last_targets[:] = self._targets
        if self.mode is Mode.FALLEN:
            self._targets[:] = q
        elif self.mode is Mode.STARTING:
            self._rise(up)
        else:
            self._wanted[:] = command
            advance_clock(self._tuning, self._wanted, self._command, self._clock)
            yaw_rate = float(gyro @ up)
            advance_trim(self._tuning, self._command, self._clock, self.velocity, yaw_rate, self._trim, self._asked)
            fill_observation(
                self._tuning, gyro, up, self._asked, q, dq, self._action, self._clock, self.velocity,
                self._observation,
            )  # fmt: skip
            self._policy(self._observation, self._action)
            joint_targets(
                self._legs, self._tuning, self._asked, self._clock, self._lifts, self._action, self._targets
            )  # fmt: skip
        return self._targets

    def _rise(self, up: FloatArray) -> None:
        """From where the legs are to folded, from folded to standing level, each along a cosine."""
        self._time += self._tuning.dt
        if self._time < FOLD_TIME:
            _blend(self._start, self._folded, self._time / FOLD_TIME, self._targets)
        else:
            # Legs of one length would tip over on a slope: the lower ones, under more weight, give way the more.
            level_trunk(self._legs, self._tuning, up, self._tilt, self._lifts)
            trot_angles(self._legs, self._tuning, self._command, self._clock, self._lifts, self._standing)
            _blend(self._folded, self._standing, (self._time - FOLD_TIME) / RISE_TIME, self._targets)
        if self._time >= START_UP_TIME:
            self.mode = Mode.WALKING


def _blend(first: FloatArray, last: FloatArray, share: float, out: FloatArray) -> None:
    weight = 0.5 - 0.5 * math.cos(math.pi * min(max(share, 0.0), 1.0))
    np.subtract(last, first, out=out)
    out *= weight
    out += first
