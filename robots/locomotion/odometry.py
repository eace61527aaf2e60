"""Dead reckoning of a walking robot: distance from its standing legs, heading from the gyro."""

import math

import numpy as np

from robots.bodies.kinematics import heading_rate
from robots.noise import NoiseConfig
from vuca_nav.geometry import wrap_angle
from vuca_nav.types import FloatArray, Odometry, Pose2, Twist2

VELOCITY_GAIN = 0.3
"""Share by which the velocity estimate follows the standing legs each control step: a low-pass of 0.05 s."""
_BLOCK = 64
"""Samples whose noise is drawn at once."""
_NUM_NORMAL = 29
"""Gyro 3, tilt 2, joint angles 12, joint speeds 12."""


class LegSensors:
    """The robot's IMU and encoders: true values in, what they report out.

    Args:
        noise: How much.
        rng: Source of randomness; used by nothing else.
        dt: Time between samples [s].

    Attributes:
        gyro: Angular velocity in base_link (3,) [rad/s].
        up: The vertical in base_link (3,).
        q: Joint angles (12,) [rad].
        dq: Joint speeds (12,) [rad/s].
    """

    def __init__(self, noise: NoiseConfig, rng: np.random.Generator, dt: float):
        self._noise, self._rng = noise, rng
        self._gyro_scale = 1.0 + noise.gyro_scale_sigma * rng.standard_normal(3)
        self._gyro_bias = noise.gyro_bias_sigma * rng.standard_normal(3)
        self._gyro_sigma = noise.gyro_noise_density / math.sqrt(2.0 * dt)
        self._tilt = noise.tilt_sigma * rng.standard_normal(2)
        self._zeros = noise.joint_zero_sigma * rng.standard_normal(12)
        self.gyro, self.up = np.zeros(3), np.zeros(3)
        self.q, self.dq = np.zeros(12), np.zeros(12)
        self._normal, self._next = np.empty((_BLOCK, _NUM_NORMAL)), _BLOCK

    def sample(self, gyro: FloatArray, attitude: FloatArray, q: FloatArray, dq: FloatArray) -> None:
        """Read the sensors.

        Args:
            gyro: (3,) [rad/s].
            attitude: Of base_link in the world, unit quaternion w, x, y, z.
            q: (12,) [rad].
            dq: (12,) [rad/s].
        """
        if self._next == _BLOCK:
            self._rng.standard_normal(out=self._normal)
            self._next = 0
        noise, n = self._noise, self._normal[self._next]
        self._next += 1
        np.multiply(gyro, self._gyro_scale, out=self.gyro)
        self.gyro += self._gyro_bias + self._gyro_sigma * n[:3]
        w, x, y, z = attitude.tolist()
        up_x, up_y = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
        up_z = 1.0 - 2.0 * (x * x + y * y)
        # A small wrong pitch and roll turn the vertical about y and x.
        pitch = self._tilt[0] + noise.tilt_noise * n[3]
        roll = self._tilt[1] + noise.tilt_noise * n[4]
        up = self.up
        up[0], up[1], up[2] = up_x - pitch * up_z, up_y + roll * up_z, up_z + pitch * up_x - roll * up_y
        up /= math.sqrt(up @ up)
        np.multiply(n[5:17], noise.joint_angle_noise, out=self.q)
        self.q += q
        self.q += self._zeros
        np.multiply(n[17:29], noise.joint_speed_noise, out=self.dq)
        self.dq += dq


class LegOdometer:
    """Integrates the standing legs' velocity along the heading, and the heading from the gyro.

    Args:
        noise: How much.
        rng: Source of randomness; used by nothing else.
        dt: Time between updates [s].
    """

    def __init__(self, noise: NoiseConfig, rng: np.random.Generator, dt: float):
        self._dt = dt
        forward, left = (1.0 + noise.leg_length_sigma * rng.standard_normal(2)).tolist()
        self._forward_scale, self._left_scale = forward, left
        self._x = self._y = self._yaw = self._rate = 0.0
        self._v_x = self._v_y = 0.0

    def start(self) -> None:
        """Take here and now as the origin."""
        self._x = self._y = self._yaw = self._rate = 0.0
        self._v_x = self._v_y = 0.0

    def update(self, velocity: FloatArray, gyro: FloatArray, up: FloatArray) -> None:
        """One step, ``dt`` after the last one.

        Args:
            velocity: Forward and left along the floor (2,) [m/s].
            gyro: As measured (3,) [rad/s].
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
