"""How far odometry may be trusted: the variance of its motions, learnt from what good matches say.

The variance of a motion is the sum of independent errors, one for each metre and one for each radian that it goes: so
it depends on the motion and not on how many scans it is cut into, and a robot that stands gathers none (Thrun, Burgard
and Fox 2005, Section 5.4). Whatever the matches leave over scales the rates up and down.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from vuca_nav.mapping.alignment import Spread
from vuca_nav.types import Pose2

FORGETTING, SIGNIFICANT = 0.998, 3.0
"""Share that an error of scale keeps from one motion to the next; deviations from which on it is one and no chance."""
NARROWEST, WIDEST = 0.8, 1.25
"""Scales stay between these: an odometer that is farther off errs in other ways."""


@dataclass(frozen=True, slots=True)
class OdometryModelConfig:
    """Rates before anything is learnt, those of a common wheeled base, and how quickly they follow."""

    position_per_metre: float = 5e-4
    """Variance of the position [m^2 / m]: 2 cm after a metre."""
    position_per_radian: float = 6e-4
    """Variance of the position [m^2 / rad]."""
    yaw_per_metre: float = 3e-4
    """Variance of the yaw [rad^2 / m]: 1 degree after a metre."""
    yaw_per_radian: float = 2.7e-3
    """Variance of the yaw [rad^2 / rad]: 3 degrees after a radian."""
    rate: float = 0.1
    """Share by which one motion may change the rates."""
    most: float = 9.0
    """A residual beyond three deviations counts as one of three: slips must not spoil the rates."""


class Motion(NamedTuple):
    """A stretch of the way."""

    way: float
    """Its length [m]."""
    turn: float
    """Sum of the turning, whichever way [rad]."""
    by_match: Pose2
    """The whole motion by matches."""


class _Scale:
    """Factor on odometry's ways or turns; 1 until an error of scale is beyond doubt."""

    def __init__(self):
        self.factor = 1.0
        self._information, self._scaled = 0.0, 0.0

    def learn(self, ahead: float, length: float, variance: float) -> None:
        """Take in a motion.

        Args:
            ahead: How far the scaled odometry was ahead of the matches [m or rad].
            length: The motion by the matches, with its sign.
            variance: Variance that ``ahead`` would have without an error of scale.
        """
        self._information = FORGETTING * self._information + length * length / variance
        self._scaled = FORGETTING * self._scaled + self.factor * length * (length - ahead) / variance
        if self._information > 0.0:
            scale = self._scaled / self._information
            is_sure = abs(scale - 1.0) * math.sqrt(self._information) > SIGNIFICANT
            self.factor = min(max(scale, NARROWEST), WIDEST) if is_sure else 1.0


class OdometryModel:
    """Variance of odometry's motions. ``spread(motion)`` before a match, ``learn`` after good ones."""

    def __init__(self, config: OdometryModelConfig = OdometryModelConfig()):
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget what has been learnt."""
        c = self.config
        self._position = [c.position_per_metre, c.position_per_radian]
        self._yaw = [c.yaw_per_metre, c.yaw_per_radian]
        self._way_scale, self._turn_scale = _Scale(), _Scale()

    @property
    def rates(self) -> tuple[float, float, float, float]:
        """Variances of position per metre and radian, of yaw per metre and radian."""
        return (self._position[0], self._position[1], self._yaw[0], self._yaw[1])

    def variances(self, way: float, turn: float) -> tuple[float, float]:
        """Variances of position and yaw after a motion.

        Args:
            way: Length of the way [m].
            turn: Sum of the turning, whichever way [rad].
        """
        return (
            self._position[0] * way + self._position[1] * turn,
            self._yaw[0] * way + self._yaw[1] * turn,
        )

    def spread(self, way: float, turn: float) -> Spread:
        """Standard deviations after a motion; arguments as of ``variances``."""
        position, yaw = self.variances(way, turn)
        return Spread(math.sqrt(position), math.sqrt(yaw), way, turn)

    def corrected(self, motion: Pose2) -> Pose2:
        """A motion without the errors of scale that matches have shown."""
        way, turn = self._way_scale.factor, self._turn_scale.factor
        return Pose2(motion.x * way, motion.y * way, motion.yaw * turn)

    def learn(self, motion: Motion, residual: Pose2, noise: tuple[float, float]) -> None:
        """Take in how odometry and two matches differ over a motion, where the matches know more than odometry.

        Args:
            motion: The motion.
            residual: Motion by odometry, in the frame of the motion by matches.
            noise: Variances of what the two matches say: of position along an axis [m^2], and of yaw [rad^2].
        """
        c, (way, turn, by_match) = self.config, motion
        position, yaw = self.variances(way, turn)
        if noise[0] < position:
            length = math.hypot(by_match.x, by_match.y)
            variance = 2.0 * (position + noise[0])  # if all of it is along the way
            if length > 0.0 and residual.x**2 + residual.y**2 < c.most * variance:
                self._way_scale.learn((residual.x * by_match.x + residual.y * by_match.y) / length, length, variance)
            seen = 0.5 * (residual.x * residual.x + residual.y * residual.y)
            _scale(self._position, (way, turn), seen, position, noise[0], c)
        if noise[1] < yaw:
            if residual.yaw**2 < c.most * (yaw + noise[1]):
                self._turn_scale.learn(residual.yaw, by_match.yaw, yaw + noise[1])
            _scale(self._yaw, (way, turn), residual.yaw * residual.yaw, yaw, noise[1], c)


def _scale(rates: list[float], motion: tuple[float, float], seen: float, expected: float, noise: float, c) -> None:
    """Scale each rate by its part in what was expected, towards what was seen."""
    total = expected + noise
    if total <= 0.0:
        return
    surprise = min(seen / total, c.most) - 1.0
    for k in range(2):
        rates[k] = max(rates[k] * (1.0 + c.rate * surprise * rates[k] * motion[k] / total), 1e-9)
