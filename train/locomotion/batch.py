"""State that a batch of robots carries from step to step, and the noise of their sensors."""

import math
from typing import NamedTuple

import numpy as np

from robots.locomotion.kernels import ACTION_SIZE, joint_targets
from robots.noise import NoiseConfig
from vuca_nav.kernel_cache import njit

NUM_ERRORS = 20
"""Number of the sensors' errors over an episode."""


class SensorNoise(NamedTuple):
    """Standard deviations of the sensors' errors, as ``robots.noise.NoiseConfig`` names and explains them."""

    gyro_scale: float
    gyro_bias: float
    gyro: float
    """Noise of a sample [rad/s]."""
    tilt: float
    tilt_noise: float
    joint_zero: float
    joint_angle: float
    joint_speed: float

    @classmethod
    def of(cls, noise: NoiseConfig, dt: float, factor: float) -> "SensorNoise":
        """Make the simulation's noise, sampled every ``dt`` [s], times a factor."""
        sigmas = (
            noise.gyro_scale_sigma, noise.gyro_bias_sigma, noise.gyro_noise_density / math.sqrt(2.0 * dt),
            noise.tilt_sigma, noise.tilt_noise, noise.joint_zero_sigma, noise.joint_angle_noise,
            noise.joint_speed_noise,
        )  # fmt: skip
        return cls(*(factor * sigma for sigma in sigmas))


class Batch(NamedTuple):
    """State that each robot carries from step to step, (n, ...)."""

    state: np.ndarray
    """MuJoCo's state: time, position 19, velocity 18."""
    action: np.ndarray
    last_action: np.ndarray
    older_action: np.ndarray
    targets: np.ndarray
    """Targets of the joints [rad]."""
    last_targets: np.ndarray
    wanted: np.ndarray
    """Command as drawn (n, 3)."""
    command: np.ndarray
    """Command after the slew limit (n, 3)."""
    clock: np.ndarray
    velocity: np.ndarray
    """Velocity as the robot estimates it (n, 2) [m/s]."""
    slow_error: np.ndarray
    """Low-passed tracking error (n, 3)."""
    up_world: np.ndarray
    """Direction against gravity, in the world (n, 3)."""
    delay: np.ndarray
    """Physics steps until new targets reach the servos."""
    age: np.ndarray
    """Control steps since the start of the episode."""
    until_command: np.ndarray
    """Control steps until the next command."""
    must_reset: np.ndarray
    height: np.ndarray
    """Height of base_link over the standing feet (n,) [m]."""
    sensor_errors: np.ndarray
    """Errors of the episode (n, 20): gyro's scale 3, its bias 3 [rad/s], pitch and roll [rad], joints' zeros 12
    [rad]."""

    @classmethod
    def zeros(cls, n: int, state_size: int) -> "Batch":
        """Make robots that will all be reset."""
        widths = (state_size, *(ACTION_SIZE,) * 5, 3, 3, 2, 2, 3, 3)
        ints = [np.zeros(n, np.int64) for _ in range(3)]
        arrays = [np.zeros((n, width)) for width in widths]
        return cls._make((*arrays, *ints, np.ones(n, np.bool_), np.zeros(n), np.zeros((n, NUM_ERRORS))))

    def targets_for(self, legs, tuning, control: np.ndarray) -> None:
        """Joint targets of the actions, each robot's late by its delay. control: (n, substeps, ACTION_SIZE)."""
        _targets(
            legs, tuning, self.command, self.clock, self.action, self.targets, self.last_targets, self.delay, control
        )


@njit(cache=True)
def _targets(legs, tuning, command, clock, action, targets, last_targets, delay, control):
    lifts = np.zeros(4)  # none is left of the start-up
    for i in range(len(action)):
        last_targets[i] = targets[i]
        joint_targets(legs, tuning, command[i], clock[i], lifts, action[i], targets[i])
        for s in range(control.shape[1]):
            control[i, s] = last_targets[i] if s < delay[i] else targets[i]
