"""Dead reckoning of a quadruped: distance from its standing legs, heading from the gyro."""

import math
from typing import NamedTuple

import numpy as np

from robots.bodies.kinematics import heading_rate
from robots.noise import NoiseConfig
from vuca_nav.geometry import wrap_angle
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, Odometry, Pose2, Twist2

VELOCITY_GAIN = 0.3
"""Share by which the velocity estimate follows the standing legs each control step: a low-pass of 0.05 s."""
_BLOCK = 64
"""Number of samples whose noise is drawn at once."""
_NUM_NORMAL = 29
"""Number of normal deviates of a sample: gyro 3, tilt 2, joint angles 12, joint speeds 12."""


class SensorFlaws(NamedTuple):
    """Errors of an episode, and sizes of the errors of a sample."""

    gyro_scale: FloatArray
    """Factors of the gyro's scale (3,)."""
    gyro_bias: FloatArray
    """Bias of the gyro (3,) [rad/s]."""
    gyro_sigma: float
    """Noise of the gyro, a standard deviation [rad/s]."""
    pitch: float
    """Error of the pitch [rad]."""
    roll: float
    """Error of the roll [rad]."""
    tilt_noise: float
    """Noise of pitch and roll, a standard deviation [rad]."""
    zeros: FloatArray
    """Errors of the joints' zeros (12,) [rad]."""
    angle_noise: float
    """Noise of the joint angles, a standard deviation [rad]."""
    speed_noise: float
    """Noise of the joint speeds, a standard deviation [rad/s]."""


class SensorReadings(NamedTuple):
    """Readings of the sensors, in the arrays of :class:`LegSensors`."""

    gyro: FloatArray
    up: FloatArray
    q: FloatArray
    dq: FloatArray


class LegSensors:
    """The robot's IMU and encoders, which corrupt true values.

    Args:
        noise: Size of the errors.
        rng: Source of randomness, which nothing else draws from.
        dt: Time between samples [s].

    Attributes:
        gyro: Angular velocity in base_link (3,) [rad/s].
        up: The vertical in base_link (3,).
        q: Joint angles (12,) [rad].
        dq: Joint speeds (12,) [rad/s].
        flaws: The errors of this episode.
    """

    def __init__(self, noise: NoiseConfig, rng: np.random.Generator, dt: float):
        self._rng = rng
        gyro_scale = 1.0 + noise.gyro_scale_sigma * rng.standard_normal(3)
        gyro_bias = noise.gyro_bias_sigma * rng.standard_normal(3)
        pitch, roll = (noise.tilt_sigma * rng.standard_normal(2)).tolist()
        self.flaws = SensorFlaws(
            gyro_scale, gyro_bias, noise.gyro_noise_density / math.sqrt(2.0 * dt), pitch, roll, noise.tilt_noise,
            noise.joint_zero_sigma * rng.standard_normal(12), noise.joint_angle_noise, noise.joint_speed_noise,
        )  # fmt: skip
        self.gyro, self.up = np.zeros(3), np.zeros(3)
        self.q, self.dq = np.zeros(12), np.zeros(12)
        self._readings = SensorReadings(self.gyro, self.up, self.q, self.dq)
        self._normal, self._next = np.empty((_BLOCK, _NUM_NORMAL)), _BLOCK

    def sample(self, gyro: FloatArray, attitude: FloatArray, q: FloatArray, dq: FloatArray) -> None:
        """Read the sensors.

        Args:
            gyro: True angular velocity in base_link (3,) [rad/s].
            attitude: Attitude of base_link in the world, unit quaternion w, x, y, z.
            q: True joint angles (12,) [rad].
            dq: True joint speeds (12,) [rad/s].
        """
        if self._next == _BLOCK:
            self._rng.standard_normal(out=self._normal)
            self._next = 0
        _sample(gyro, attitude, q, dq, self._normal[self._next], self.flaws, self._readings)
        self._next += 1
        x, y, z = self.up.tolist()
        self.up /= math.sqrt(x * x + y * y + z * z)


@njit(cache=True)
def _sample(gyro, attitude, q, dq, normal, flaws, readings):
    """Corrupt one sample; the vertical is left to be normalised."""
    for i in range(3):
        readings.gyro[i] = gyro[i] * flaws.gyro_scale[i] + (flaws.gyro_bias[i] + flaws.gyro_sigma * normal[i])
    w, x, y, z = attitude[0], attitude[1], attitude[2], attitude[3]
    up_x, up_y = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
    up_z = 1.0 - 2.0 * (x * x + y * y)
    # A small wrong pitch and roll turn the vertical about y and x.
    pitch, roll = flaws.pitch + flaws.tilt_noise * normal[3], flaws.roll + flaws.tilt_noise * normal[4]
    up = readings.up
    up[0], up[1], up[2] = up_x - pitch * up_z, up_y + roll * up_z, up_z + pitch * up_x - roll * up_y
    for j in range(12):
        readings.q[j] = normal[5 + j] * flaws.angle_noise + q[j] + flaws.zeros[j]
        readings.dq[j] = normal[17 + j] * flaws.speed_noise + dq[j]


class LegOdometer:
    """Integrates the standing legs' velocity along the heading, and the heading from the gyro.

    Args:
        noise: Size of the errors.
        rng: Source of randomness, which nothing else draws from.
        dt: Time between updates [s].
    """

    def __init__(self, noise: NoiseConfig, rng: np.random.Generator, dt: float):
        self._dt = dt
        forward, left = (1.0 + noise.leg_length_sigma * rng.standard_normal(2)).tolist()
        self._forward_scale, self._left_scale = forward, left
        self._x = self._y = self._yaw = self._rate = 0.0
        self._v_x = self._v_y = 0.0

    def start(self) -> None:
        """Take the present pose as the origin."""
        self._x = self._y = self._yaw = self._rate = 0.0
        self._v_x = self._v_y = 0.0

    def update(self, velocity: FloatArray, gyro: FloatArray, up: FloatArray) -> None:
        """Integrate one step, ``dt`` after the last one.

        Args:
            velocity: Velocity forward and left along the floor (2,) [m/s].
            gyro: Angular velocity as measured (3,) [rad/s].
            up: The vertical in base_link, as measured (3,).
        """
        rate = heading_rate(gyro, up)
        turn = 0.5 * (rate + self._rate) * self._dt
        middle = self._yaw + 0.5 * turn
        self._v_x, self._v_y = float(velocity[0]) * self._forward_scale, float(velocity[1]) * self._left_scale
        c, s = math.cos(middle), math.sin(middle)
        self._x += (c * self._v_x - s * self._v_y) * self._dt
        self._y += (s * self._v_x + c * self._v_y) * self._dt
        self._yaw, self._rate = wrap_angle(self._yaw + turn), rate

    def odometry(self, stamp: float) -> Odometry:
        """The estimate after the last update."""
        return Odometry(stamp, Pose2(self._x, self._y, self._yaw), Twist2(self._v_x, self._v_y, self._rate))
