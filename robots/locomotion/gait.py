"""The gait of a quadruped: from measurements and a velocity command to the joints' targets, once a control step."""

import math
from enum import Enum, auto
from typing import NamedTuple

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
from robots.locomotion.network import BadObservation, PolicyNetwork, forward, refuse_bad
from robots.locomotion.odometry import VELOCITY_GAIN
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, VelocityCommand

FOLD_TIME = 0.3
"""Time to fold the legs under the trunk, however they lie [s]."""
RISE_TIME = 1.0
"""Time to rise from lying to standing [s]."""
STEADY_TIME = 0.4
"""Time on stiff legs before the policy takes over [s]."""
START_UP_TIME = FOLD_TIME + RISE_TIME + STEADY_TIME
FALLEN_UP = math.cos(math.radians(50.0))
"""Vertical part of the trunk's upward axis below which the robot is falling."""
FALLEN_TICKS = 3
"""Number of control steps in a row below it that count as a fall; a single one may be a bad sample."""


class Mode(Enum):
    """Mode of the legs."""

    STARTING = auto()
    """The robot lies, then rises; commands are ignored."""
    WALKING = auto()
    """The policy is in charge; it stands still at a zero command."""
    FALLEN = auto()
    """The joints give way, damped; only a reset leads out."""


class GaitState(NamedTuple):
    """Memory of one gait from a control step to the next, as its kernels take it; changed in place."""

    wanted: FloatArray
    """Velocity command (3,) [m/s, m/s, rad/s]."""
    command: FloatArray
    """Velocity command behind the slew limit (3,) [m/s, m/s, rad/s]."""
    clock: FloatArray
    """Phase of the gait, and share of stepping that has faded in, 0-1 (2,)."""
    trim: FloatArray
    """Integral of the difference of command and velocity (3,)."""
    asked: FloatArray
    """Command plus trim (3,)."""
    lifts: FloatArray
    """Height of each foot above the nominal trot's (4,) [m]."""
    action: FloatArray
    """Last action of the policy (ACTION_SIZE,)."""
    targets: FloatArray
    """Targets of the joints (ACTION_SIZE,) [rad]."""
    last_targets: FloatArray
    """Targets of the control step before (ACTION_SIZE,) [rad]."""
    velocity: FloatArray
    """Estimate of the body's velocity, forward and left (2,) [m/s]."""
    leg_velocity: FloatArray
    """The velocity that the standing legs measure now, unfiltered (2,) [m/s]."""
    observation: FloatArray
    """Observation of the policy (OBSERVATION_SIZE,)."""


@njit(cache=True)
def _estimate(legs, tuning, gyro, up, q, dq, state):
    """Update the velocity estimate by one sample; returns its worth, -1 if a number is not finite."""
    for values in (gyro, up, q, dq):
        for value in values:
            if not math.isfinite(value):
                return -1.0
    worth = leg_velocity(legs, tuning, gyro, up, q, dq, state.targets, state.last_targets, state.leg_velocity)
    for i in range(2):
        state.velocity[i] += VELOCITY_GAIN * worth * (state.leg_velocity[i] - state.velocity[i])
    return worth


@njit(cache=True)
def _walk(legs, tuning, gyro, up, q, dq, yaw_rate, state, layers):
    """Set the joints' targets for one control step of walking; returns the result of ``forward``."""
    advance_clock(tuning, state.wanted, state.command, state.clock)
    advance_trim(tuning, state.command, state.clock, state.velocity, yaw_rate, state.trim, state.asked)
    fill_observation(
        tuning, gyro, up, state.asked, q, dq, state.action, state.clock, state.velocity, state.observation
    )  # fmt: skip
    bad = forward(state.observation, state.action, layers)
    if bad < 0:
        joint_targets(legs, tuning, state.asked, state.clock, state.lifts, state.action, state.targets)
    return bad


class Gait:
    """The gait of one robot: it takes the sensors' readings and returns joint targets.

    Arrays are borrowed throughout; a step allocates nothing.

    Args:
        model: The robot.
        policy: Policy that corrects the nominal trot.
        control_dt: Time between two calls of ``step`` [s].

    Attributes:
        mode: Mode of the legs.
        state: Memory of the gait from a control step to the next.
        velocity: Estimate of the body's velocity, forward and left (2,) [m/s].
        leg_velocity: The velocity that the standing legs measure now, unfiltered (2,) [m/s].
        worth: Share of the weight on the standing legs, 0-1, by which ``leg_velocity`` is weighted.
    """

    def __init__(self, model: QuadrupedModel, policy: PolicyNetwork, control_dt: float):
        self._legs, self._tuning, self._policy = model.legs, model.tuning(control_dt), policy
        self._folded = np.tile(model.config.lying, 4)
        self._start, self._standing, self._tilt = np.zeros(ACTION_SIZE), np.zeros(ACTION_SIZE), np.zeros(2)
        self.state = GaitState(
            wanted=np.zeros(3), command=np.zeros(3), clock=np.zeros(2), trim=np.zeros(3), asked=np.zeros(3),
            lifts=np.zeros(4), action=np.zeros(ACTION_SIZE), targets=np.zeros(ACTION_SIZE),
            last_targets=np.zeros(ACTION_SIZE), velocity=np.zeros(2), leg_velocity=np.zeros(2),
            observation=np.zeros(OBSERVATION_SIZE),
        )  # fmt: skip
        self.velocity, self.leg_velocity = self.state.velocity, self.state.leg_velocity
        self.worth = 0.0
        self.mode, self._time, self._low_ticks = Mode.STARTING, 0.0, 0

    def reset(self, q: FloatArray) -> None:
        """Begin with the start-up, from joint angles (12,) [rad]."""
        for array in (*self.state, self._tilt):
            array[:] = 0.0
        for array in (self._start, self.state.targets, self.state.last_targets):
            array[:] = q
        self.mode, self._time, self._low_ticks, self.worth = Mode.STARTING, 0.0, 0, 0.0

    def measure(self, gyro: FloatArray, up: FloatArray, q: FloatArray, dq: FloatArray) -> None:
        """Take in one sample of the sensors, before ``step``.

        Args:
            gyro: Angular velocity in base_link (3,) [rad/s].
            up: The vertical in base_link (3,).
            q: Joint angles (12,) [rad].
            dq: Joint speeds (12,) [rad/s].

        Raises:
            BadObservation: If a number is not finite.
        """
        worth = _estimate(self._legs, self._tuning, gyro, up, q, dq, self.state)
        if worth < 0.0:
            raise BadObservation(f"gait measurement is not finite: gyro {gyro}, up {up}, angles {q}, speeds {dq}")
        self.worth = worth
        self._low_ticks = self._low_ticks + 1 if up[2] < FALLEN_UP else 0
        if self._low_ticks >= FALLEN_TICKS:
            self.mode = Mode.FALLEN

    def step(
        self, command: VelocityCommand, gyro: FloatArray, up: FloatArray, q: FloatArray, dq: FloatArray
    ) -> FloatArray:
        """Compute joint targets (12,) [rad] for the next control step, from the sample just measured; borrowed.

        Raises:
            BadObservation: If the command is not finite, whatever the mode; the last command stays.
        """
        if not (math.isfinite(command[0]) and math.isfinite(command[1]) and math.isfinite(command[2])):
            raise BadObservation(f"velocity command is not finite: {tuple(command)}")
        state = self.state
        state.last_targets[:] = state.targets
        if self.mode is Mode.FALLEN:
            state.targets[:] = q
        elif self.mode is Mode.STARTING:
            self._rise(up)
        else:
            state.wanted[:] = command
            yaw_rate = float(gyro[0] * up[0] + gyro[1] * up[1] + gyro[2] * up[2])
            bad = _walk(self._legs, self._tuning, gyro, up, q, dq, yaw_rate, state, self._policy.layers)
            refuse_bad(bad, state.observation)
        return state.targets

    def _rise(self, up: FloatArray) -> None:
        """Bring the legs from where they are to folded, and from folded to standing level, each along a cosine."""
        self._time += self._tuning.dt
        state = self.state
        if self._time < FOLD_TIME:
            _blend(self._start, self._folded, self._time / FOLD_TIME, state.targets)
        else:
            # Legs of one length would tip over on a slope: the lower ones, under more weight, give way the more.
            level_trunk(self._legs, self._tuning, up, self._tilt, state.lifts)
            trot_angles(self._legs, self._tuning, state.command, state.clock, state.lifts, self._standing)
            _blend(self._folded, self._standing, (self._time - FOLD_TIME) / RISE_TIME, state.targets)
        if self._time >= START_UP_TIME:
            self.mode = Mode.WALKING


def _blend(first: FloatArray, last: FloatArray, share: float, out: FloatArray) -> None:
    weight = 0.5 - 0.5 * math.cos(math.pi * min(max(share, 0.0), 1.0))
    np.subtract(last, first, out=out)
    out *= weight
    out += first
