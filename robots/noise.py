"""Sizes of all errors of the sensors."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NoiseConfig:
    """Noise of the lidar, the wheel and joint encoders, the gyro and the attitude.

    An error "per episode" is drawn once at the start from a normal distribution of this standard deviation.
    Together they make dead reckoning drift by 2-4% of the distance travelled, on wheels and on legs
    (tests/robots/test_odometry.py).
    """

    range_sigma: float = 0.02
    """Standard deviation of a range [m]. SICK TiM571, the PMB2 base's laser: statistical error 20 mm (data sheet)."""
    dropout: float = 0.01
    """Share of beams without a return, as from black, shiny or grazed surfaces. Assumed."""
    encoder_scale_sigma: float = 0.03
    """Relative error of a wheel's effective radius, per episode and wheel: 3 mm of a
    98.5 mm radius, from wear and load."""
    slip_sigma: float = 0.022
    """Relative slip of a wheel, varying along the way. With ``slip_length`` it makes a variance of
    2 * 0.022^2 * 1 m = 0.001 m^2 a metre: the ``error_constant_left/right`` of PAL's odometry (pmb2_robot,
    mobile_base_controller.yaml)."""
    slip_length: float = 1.0
    """Correlation length of slip along the way [m]."""
    gyro_scale_sigma: float = 0.02
    """Relative error of the gyro's scale, per episode. MPU-9250 data sheet: +-3%."""
    gyro_bias_sigma: float = math.radians(0.06)
    """Bias left after calibration at standstill, per episode [rad/s]. 216 deg/h, a consumer MEMS gyro."""
    gyro_noise_density: float = math.radians(0.01)
    """Noise density of the turn rate [rad/s/sqrt(Hz)]. MPU-9250 data sheet: 0.01 deg/s/sqrt(Hz)."""
    tilt_sigma: float = math.radians(0.5)
    """Error of roll and of pitch, per episode [rad]. VectorNav VN-100 and its like: 0.5 deg RMS, dynamic."""
    tilt_noise: float = math.radians(0.1)
    """Standard deviation of roll and of pitch, per sample [rad]. Assumed: a fifth of the error per episode."""
    joint_zero_sigma: float = 0.01
    """Error of a leg joint's zero after calibration, per episode [rad]: half a degree."""
    joint_angle_noise: float = 0.002
    """Standard deviation of a leg joint's angle, per sample [rad]: ten steps of a 15 bit encoder."""
    joint_speed_noise: float = 0.1
    """Standard deviation of a leg joint's speed, per sample [rad/s]. Assumed."""
    leg_length_sigma: float = 0.02
    """Relative error of the distance a stride is taken to cover, per episode and direction: worn, yielding feet."""

    @classmethod
    def none(cls) -> "NoiseConfig":
        """Make perfect sensors."""
        return cls(
            range_sigma=0.0,
            dropout=0.0,
            encoder_scale_sigma=0.0,
            slip_sigma=0.0,
            gyro_scale_sigma=0.0,
            gyro_bias_sigma=0.0,
            gyro_noise_density=0.0,
            tilt_sigma=0.0,
            tilt_noise=0.0,
            joint_zero_sigma=0.0,
            joint_angle_noise=0.0,
            joint_speed_noise=0.0,
            leg_length_sigma=0.0,
        )
