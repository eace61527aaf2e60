"""Odometry of robots of one's own, beside that of wheels in ``robots.sensors``."""

import math

import numpy as np

from robots.noise import NoiseConfig
from vuca_nav.geometry import wrap_angle
from vuca_nav.types import Odometry, Pose2, Twist2


class VelocityOdometer:
    """Dead reckoning from a measured velocity, with the errors of wheels and of a gyro.

    Args:
        noise: Size of the errors: a scale along each axis and a slip that varies along the way, as of wheels.
        rng: Source of randomness, which nothing else draws from.
        dt: Time between two updates [s].
    """

    def __init__(self, noise: NoiseConfig, rng: np.random.Generator, dt: float):
        self._rng, self._dt, self._noise = rng, dt, noise
        forward, left, gyro_scale, gyro_bias = rng.standard_normal(4).tolist()
        self._scales = (1.0 + noise.encoder_scale_sigma * forward, 1.0 + noise.encoder_scale_sigma * left)
        self._gyro_scale, self._gyro_bias = 1.0 + noise.gyro_scale_sigma * gyro_scale, noise.gyro_bias_sigma * gyro_bias
        self._gyro_sigma = noise.gyro_noise_density / math.sqrt(2.0 * dt)
        self._slips = [noise.slip_sigma * normal for normal in rng.standard_normal(2).tolist()]
        self.start()

    def start(self) -> None:
        """Take the present pose as the origin."""
        self._x = self._y = self._yaw = self._rate = self._v_x = self._v_y = 0.0

    def update(self, v_x: float, v_y: float, w_z: float) -> None:
        """Integrate one step, ``dt`` after the last one.

        Args:
            v_x: True forward velocity [m/s].
            v_y: True velocity to the left [m/s].
            w_z: True turn rate [rad/s].
        """
        noise = self._noise
        *normals, gyro_normal = self._rng.standard_normal(3).tolist()
        keep = math.exp(-math.hypot(v_x, v_y) * self._dt / noise.slip_length)
        spread = noise.slip_sigma * math.sqrt(1.0 - keep * keep)
        self._slips = [keep * slip + spread * normal for slip, normal in zip(self._slips, normals)]
        self._v_x = v_x * self._scales[0] * (1.0 + self._slips[0])
        self._v_y = v_y * self._scales[1] * (1.0 + self._slips[1])
        rate = w_z * self._gyro_scale + self._gyro_bias + self._gyro_sigma * gyro_normal
        turn = 0.5 * (rate + self._rate) * self._dt
        middle = self._yaw + 0.5 * turn
        c, s = math.cos(middle), math.sin(middle)
        self._x += (c * self._v_x - s * self._v_y) * self._dt
        self._y += (s * self._v_x + c * self._v_y) * self._dt
        self._yaw, self._rate = wrap_angle(self._yaw + turn), rate

    def odometry(self, stamp: float) -> Odometry:
        """The estimate after the last update."""
        return Odometry(stamp, Pose2(self._x, self._y, self._yaw), Twist2(self._v_x, self._v_y, self._rate))
