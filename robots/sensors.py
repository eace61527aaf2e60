"""Models of the imperfect sensors: the lidar's noise, and dead reckoning from wheel encoders and a gyro."""

import math

import numpy as np

from robots.noise import NoiseConfig
from vuca_nav.geometry import wrap_angle
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray, LidarSpec, Odometry, Pose2, Twist2

_BLOCK = 64
"""Number of scans, or of odometry updates, whose noise is drawn at once."""


class LidarNoise:
    """Gaussian range noise and dropped beams.

    Args:
        lidar: Number of beams and valid ranges.
        noise: Size of the errors.
        rng: Source of randomness, which nothing else draws from.
    """

    def __init__(self, lidar: LidarSpec, noise: NoiseConfig, rng: np.random.Generator):
        self._lidar, self._noise, self._rng = lidar, noise, rng
        self._normal = np.empty((_BLOCK, lidar.num_beams))
        self._uniform = np.empty((_BLOCK, lidar.num_beams))
        self._next = _BLOCK

    def corrupt(self, clean: FloatArray) -> FloatArray:
        """Corrupt true ranges (num_beams,) [m] into a new array.

        A dropped beam and a return outside the valid ranges become ``inf``; the others have single precision, as a
        LaserScan carries them.
        """
        if self._next == _BLOCK:
            self._rng.standard_normal(out=self._normal)
            self._rng.random(out=self._uniform)
            self._next = 0
        lidar, noise, n = self._lidar, self._noise, self._next
        self._next += 1
        reported = np.empty(lidar.num_beams)
        _corrupt(
            clean, self._normal[n], self._uniform[n], noise.range_sigma, noise.dropout,
            lidar.min_range, lidar.max_range, reported,
        )  # fmt: skip
        return reported


@njit(cache=True)
def _corrupt(clean, normal, uniform, sigma, dropout, min_range, max_range, reported):
    for i in range(len(clean)):
        value = clean[i] + sigma * normal[i]
        if uniform[i] < dropout or value < min_range or not value <= max_range:
            value = math.inf
        reported[i] = np.float32(value)


class WheelOdometer:
    """Dead reckoning of a base with wheels on both sides: distance from their encoders, heading from the gyro.

    Encoders alone would turn a 1% difference of the wheels' radii into a turn; taking the heading from a gyro is
    what wheeled bases with an IMU do.

    Args:
        noise: Size of the errors.
        rng: Source of randomness, which nothing else draws from.
        wheel_radius: Radius of the wheels by which distances are computed [m].
        dt: Time between two updates [s].
        track: Distance of the wheels by which the heading follows from the encoders [m]; None takes it from the gyro.
    """

    def __init__(
        self,
        noise: NoiseConfig,
        rng: np.random.Generator,
        wheel_radius: float,
        dt: float,
        track: float | None = None,
    ):
        self._rng, self._dt, self._track = rng, dt, track
        self._slip_sigma, self._slip_length = noise.slip_sigma, noise.slip_length
        scale_left, scale_right, gyro_scale, gyro_bias = rng.standard_normal(4)
        self._left_radius = wheel_radius * (1.0 + noise.encoder_scale_sigma * float(scale_left))
        self._right_radius = wheel_radius * (1.0 + noise.encoder_scale_sigma * float(scale_right))
        self._gyro_scale = 1.0 + noise.gyro_scale_sigma * float(gyro_scale)
        self._gyro_bias = noise.gyro_bias_sigma * float(gyro_bias)
        # Noise density over the bandwidth of samples dt apart (Nyquist: 1 / (2 dt)).
        self._gyro_sigma = noise.gyro_noise_density / math.sqrt(2.0 * dt)
        self._left_slip, self._right_slip = (self._slip_sigma * float(n) for n in rng.standard_normal(2))
        self._block: list[list[float]] = []
        self._left = self._right = self._rate = 0.0
        self._x = self._y = self._yaw = self._v_x = 0.0

    def start(self, left_angle: float, right_angle: float) -> None:
        """Take the encoders' present readings [rad] as zero, and the present pose as the origin."""
        self._left, self._right = left_angle, right_angle
        self._x = self._y = self._yaw = self._v_x = self._rate = 0.0

    def update(self, left_angle: float, right_angle: float, gyro_rate: float) -> None:
        """Integrate one step, ``dt`` after the last one.

        Args:
            left_angle: Angle of the left wheel's joint [rad].
            right_angle: Angle of the right wheel's joint [rad].
            gyro_rate: True angular velocity about base_link's z axis [rad/s].
        """
        if not self._block:
            self._block = self._rng.standard_normal((_BLOCK, 3)).tolist()
        left_normal, right_normal, gyro_normal = self._block.pop()
        left = (left_angle - self._left) * self._left_radius
        right = (right_angle - self._right) * self._right_radius
        self._left, self._right = left_angle, right_angle
        self._left_slip = self._next_slip(self._left_slip, left, left_normal)
        self._right_slip = self._next_slip(self._right_slip, right, right_normal)
        left += left * self._left_slip
        right += right * self._right_slip
        if self._track is None:
            rate = gyro_rate * self._gyro_scale + self._gyro_bias + self._gyro_sigma * gyro_normal
        else:
            rate = (right - left) / (self._track * self._dt)

        distance = 0.5 * (left + right)
        turn = 0.5 * (rate + self._rate) * self._dt  # trapezoid: the gyro is sampled, not integrated, by the sensor
        middle = self._yaw + 0.5 * turn
        self._x += distance * math.cos(middle)
        self._y += distance * math.sin(middle)
        self._yaw = wrap_angle(self._yaw + turn)
        self._v_x, self._rate = distance / self._dt, rate

    def odometry(self, stamp: float) -> Odometry:
        """The estimate after the last update."""
        return Odometry(stamp, Pose2(self._x, self._y, self._yaw), Twist2(self._v_x, 0.0, self._rate))

    def _next_slip(self, slip: float, distance: float, normal: float) -> float:
        """Slip after a further ``distance``: an Ornstein-Uhlenbeck process along the way, exactly discretised."""
        if distance == 0.0:
            return slip
        keep = math.exp(-abs(distance) / self._slip_length)
        return keep * slip + self._slip_sigma * math.sqrt(1.0 - keep * keep) * normal
