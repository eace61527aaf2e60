"""Settings of the safety layer: plain numbers, with Nav2's names and defaults beside ours.

Nav2's are those of nav2_collision_monitor and nav2_velocity_smoother, as their sources declare them.
"""

import math
from dataclasses import dataclass, field

from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive, check_shares


@dataclass(frozen=True, slots=True)
class MonitorConfig:
    """Settings of the collision monitor."""

    margin: float = 0.05
    """Clearance of the footprint within which nothing is approached any further [m]. Nav2: the polygon of action
    ``stop``."""
    smoothing: int = 2
    """Number of beams to each side that a range is averaged with if they end on the same surface: five halve the noise.
    Nav2 waits for ``min_points`` (4) in a polygon instead, and misses what is thin."""
    surface: float = 0.1
    """Difference of two ranges up to which they are of the same surface [m]: five standard deviations of a range."""
    hold: float = 0.2
    """Time for which a command is taken to go on before the body brakes [s]: within it a fault is noticed and the zero
    command is out, or the base times out. Nav2's ``approach`` keeps ``time_before_collision`` (2.0 s) instead, and
    takes the body to stop at once."""
    deceleration: float = 1.0
    """Share of the body's greatest deceleration that braking is counted on to have. Nav2: none."""
    slow_distance: float = 0.1
    """Clearance that a body must keep while braking, or it goes slowly [m]. Nav2: a polygon of action ``slowdown``."""
    slow_ratio: float = 0.5
    """Share of the greatest speed that going slowly is; 1 switches it off. Nav2: ``slowdown_ratio``, 0.5, a factor on
    the command."""
    blind_speed: float = 0.2
    """Greatest speed of any point of the footprint towards where the lidar does not look [m/s]; 0 forbids it. PAL's
    greatest backward speed of a TIAGo, whose rear has no laser. Nav2: no rule."""
    blind_gap: float = 0.2
    """Angle from which on a gap between measured beams counts as not looked into [rad]: 0.1 m at half a metre."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_not_negative(self, "margin", "smoothing", "surface", "slow_distance", "blind_speed")
        check_positive(self, "hold", "blind_gap")
        check_fields(self, "above 0 and at most 1", lambda share: 0.0 < share <= 1.0, "deceleration", "slow_ratio")


@dataclass(frozen=True, slots=True)
class WatchdogConfig:
    """Thresholds of the watchdogs."""

    silence: float = 0.12
    """Longest time between two new messages of scan or odometry [s]: three periods of 30 Hz and some delay, and the
    zero command is out within 0.2 s, the tick of 1/30 s included. A source whose period is above 0.05 s gets its period
    and 0.1 s. Nav2: ``source_timeout``, 2.0 s."""
    overdue: float = 0.035
    """Time by which a source is overdue before it counts as silent or repeated [s]: from then on the body stands until
    the next message, without a healthy time after it. At 30 Hz two messages are missing then: jitter of 20 ms does not
    do it, nor does a lost message most of the time."""
    transport: float = 0.1
    """Longest way of a message from its stamp to here, beyond ``silence`` [s]. Nav2: ``transform_tolerance``, 0.1 s."""
    ahead: float = 0.1
    """Greatest time by which a stamp may be ahead of the clock [s]."""
    identical: float = 0.08
    """Longest time for which a moving body's scans, or its odometry, may be the same to the bit [s]: at 30 Hz the third
    one in a row is a fault, and a driver that gives each of 10 Hz three times is none."""
    unanswered: float = 0.4
    """Longest time, beyond the body's delay, for which odometry may stay the same to the bit although motion is
    commanded [s]."""
    moving: float = 0.05
    """Speed from which on a body moves [m/s, and rad/s]."""
    clock_jump: float = 0.1
    """Greatest difference between a step of the clock that stamps are of and one of the steady clock [s]."""
    simulated_clock: bool = False
    """Whether stamps are of a simulated clock (``use_sim_time``), which may go faster or slower than the steady one:
    then it must not go backwards, nor by more than ``late`` at a time."""
    late: float = 0.15
    """Longest time between two ticks [s]: the base holds the last command all the while."""
    invalid: float = 0.1
    """Share of a scan's ranges that may be NaN."""
    localisation: float = 0.1
    """Quality of the localisation below which it is lost, 0 to 1."""
    publishers: int = 1
    """Greatest number of publishers of the velocity command, with our own."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a threshold out of its range."""
        names = ("silence", "overdue", "transport", "ahead", "identical", "unanswered", "moving", "clock_jump", "late")
        check_positive(self, *names)
        check_shares(self, "invalid", "localisation")
        check_counts(self, "publishers")


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """Settings of the safety layer."""

    monitor: MonitorConfig = field(default_factory=MonitorConfig)
    watchdogs: WatchdogConfig = field(default_factory=WatchdogConfig)
    rate: float = 30.0
    """Rate of the ticks [Hz]."""
    odometry_rate: float = 30.0
    """Least rate of the odometry [Hz]."""
    healthy: float = 1.0
    """Time without a fault after which the body may move, at the start and after each fault [s]."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_positive(self, "rate", "odometry_rate")
        check_fields(self, "0 or more and finite", lambda t: 0.0 <= t < math.inf, "healthy")


DEFAULTS = SafetyConfig()
