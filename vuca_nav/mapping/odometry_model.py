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
FEWEST = 6.0
"""Least number of motions for that."""
NARROWEST, WIDEST = 0.8, 1.25
"""Scales stay between these: an odometer that is farther off errs in other ways."""


@dataclass(frozen=True, slots=True)
class OdometryModelConfig:
    """Rates before anything is learnt, those of a common wheeled base, and how quickly they follow."""

    position_per_metre: float = 5e-4
    """Variance of the position [m^2 / m]: 2 cm after a metre."""
    position_per_radian: float = 6e-4
    """Variance of the position [m^2 / rad]."""
    yaw_per_metre: float = 5e-5
    """Variance of the yaw [rad^2 / m]: 0.4 degrees after a metre. With 1 degree a perfect odometer was spoiled by 4 cm
    in a ring before its quality had been learnt ..."""
    searched_yaw_per_metre: float = 3e-4
    """... but the search goes as far as if it were 1 degree [rad^2 / m]."""
    yaw_per_radian: float = 2.7e-3
    """Variance of the yaw [rad^2 / rad]: 3 degrees after a radian."""
    rate: float = 0.1
    """Least share by which one motion may change the rates."""
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
    """Factor on odometry's ways or turns: slope of a line through the origin, 1 until another one is beyond doubt."""

    def __init__(self):
        self.factor = 1.0
        self._count = self._oo = self._om = self._mm = 0.0

    def learn(self, by_odometry: float, by_match: float, noise: float) -> None:
        """Take in a motion [m or rad].

        Args:
            by_odometry: The motion by the scaled odometry.
            by_match: The same by the matches.
            noise: Variance of the matches.
        """
        raw = by_odometry / self.factor
        self._count = FORGETTING * self._count + 1.0
        self._oo = FORGETTING * self._oo + raw * raw / noise
        self._om = FORGETTING * self._om + raw * by_match / noise
        self._mm = FORGETTING * self._mm + by_match * by_match / noise
        if self._count < FEWEST or self._oo <= 0.0:
            return
        scale = self._om / self._oo
        scatter = max((self._mm - scale * self._om) / (self._count - 1.0), 1.0)  # in variances of the matches
        is_sure = abs(scale - 1.0) > SIGNIFICANT * math.sqrt(scatter / self._oo)
        self.factor = min(max(scale, NARROWEST), WIDEST) if is_sure else 1.0


class _Rates:
    """Variance of one kind of error for each metre and for each radian."""

    def __init__(self, per_metre: float, per_radian: float):
        self.values = [per_metre, per_radian]
        self._num_learnt = 0

    def variance(self, way: float, turn: float) -> float:
        """Variance after a motion."""
        return self.values[0] * way + self.values[1] * turn

    def learn(self, way: float, turn: float, squared: float, noise: float, config: OdometryModelConfig) -> None:
        """Scale each rate by its part in what was expected, towards what was seen: the first ones count for more.

        Args:
            way: Length of the way [m].
            turn: Sum of the turning [rad].
            squared: Squared error that was seen.
            noise: Variance of what it was measured by.
            config: Settings.
        """
        self._num_learnt += 1
        gain = max(config.rate, 1.0 / (1.0 + self._num_learnt))
        total = self.variance(way, turn) + noise
        surprise = min(squared / total, config.most) - 1.0
        for k, amount in enumerate((way, turn)):
            share = self.values[k] * amount / total
            self.values[k] = max(self.values[k] * (1.0 + gain * surprise * share), 1e-9)


class OdometryModel:
    """Variance of odometry's motions. ``spread(motion)`` before a match, ``learn`` after good ones."""

    def __init__(self, config: OdometryModelConfig = OdometryModelConfig()):
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget what has been learnt."""
        c = self.config
        self._position = _Rates(c.position_per_metre, c.position_per_radian)
        self._yaw = _Rates(c.yaw_per_metre, c.yaw_per_radian)
        self._way_scale, self._turn_scale = _Scale(), _Scale()

    @property
    def rates(self) -> tuple[float, float, float, float]:
        """Variances of position per metre and radian, of yaw per metre and radian."""
        return (self._position.values[0], self._position.values[1], self._yaw.values[0], self._yaw.values[1])

    def variances(self, way: float, turn: float) -> tuple[float, float]:
        """Variances of position and yaw after a motion.

        Args:
            way: Length of the way [m].
            turn: Sum of the turning, whichever way [rad].
        """
        return self._position.variance(way, turn), self._yaw.variance(way, turn)

    def spread(self, way: float, turn: float) -> Spread:
        """Standard deviations after a motion; arguments as of ``variances``.

        The search goes as far as before anything was learnt: an odometer that was good so far may slip.
        """
        position, yaw = self.variances(way, turn)
        c = self.config
        least_position = c.position_per_metre * way + c.position_per_radian * turn
        least_yaw = c.searched_yaw_per_metre * way + c.yaw_per_radian * turn
        return Spread(math.sqrt(position), math.sqrt(yaw), way, turn, math.sqrt(least_position), math.sqrt(least_yaw))

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
            if length > 0.0 and residual.x**2 + residual.y**2 < 2.0 * c.most * (position + noise[0]):
                ahead = (residual.x * by_match.x + residual.y * by_match.y) / length
                self._way_scale.learn(length + ahead, length, noise[0])
            seen = 0.5 * (residual.x * residual.x + residual.y * residual.y)
            self._position.learn(way, turn, seen, noise[0], c)
        if noise[1] < yaw:
            if residual.yaw**2 < c.most * (yaw + noise[1]):
                self._turn_scale.learn(by_match.yaw + residual.yaw, by_match.yaw, noise[1])
            self._yaw.learn(way, turn, residual.yaw * residual.yaw, noise[1], c)
