"""Watchdogs: each looks at a tick and says what is wrong with it, or nothing. None reads a clock."""

import math
from collections.abc import Iterator

import numpy as np

from vuca_nav.deploy.safety.config import SafetyConfig, WatchdogConfig
from vuca_nav.deploy.safety.status import Reason, Tick
from vuca_nav.types import BodySpec, FloatArray, LidarSpec, Odometry, Scan, Twist2, VelocityCommand


class SourceWatch:
    """Watches the times of one source: silent, repeating itself, old, ahead of the clock, jumping.

    Args:
        source: Its name, "scan" or "odometry".
        period: Longest time between two of its messages as it should be [s].
        config: Thresholds.
    """

    def __init__(self, source: str, period: float, config: WatchdogConfig):
        self._source, self._config = source, config
        self.silence = config.silence if period <= 0.05 else max(config.silence, period + 0.1)
        self._stamp: float | None = None
        self._renewed = -math.inf

    def check(self, stamp: float | None, received: float, tick: Tick) -> Iterator[Reason]:
        """Look at the latest message.

        Args:
            stamp: Its stamp; None if there is none yet [s].
            received: When it was received, by the steady clock [s].
            tick: The tick.
        """
        name, c = self._source, self._config
        if stamp is None:
            yield Reason(f"{name}_silent", f"no {name} has come yet")
            return
        if not (math.isfinite(stamp) and math.isfinite(received)):
            yield Reason(f"{name}_time", f"the {name}'s time is not finite: stamp {stamp}, received {received}")
            return
        last, self._stamp = self._stamp, stamp
        if stamp != last:
            self._renewed = received
        if last is not None and stamp < last:
            yield Reason(f"{name}_time", f"the {name}'s stamp went back by {last - stamp:.3f} s")
        if tick.now - received > self.silence:
            yield Reason(f"{name}_silent", f"no {name} for {tick.now - received:.3f} s")
        elif tick.now - self._renewed > self.silence:
            yield Reason(f"{name}_repeated", f"the same {name} for {tick.now - self._renewed:.3f} s")
        age = tick.clock - stamp
        if age > self.silence + c.transport:
            yield Reason(f"{name}_old", f"the {name} is {age:.3f} s old by its stamp")
        elif age < -c.ahead:
            yield Reason(f"{name}_time", f"the {name}'s stamp is {-age:.3f} s ahead of the clock")

    def overdue(self, tick: Tick) -> str | None:
        """That the next message is overdue, after ``check``; None if it is not."""
        age = tick.now - self._renewed
        return f"the {self._source} is {age:.3f} s old" if age > self.silence - self._config.overdue else None


class ClockWatch:
    """Watches the clock that stamps are of, the steady clock, and the time between two ticks.

    Args:
        config: Thresholds.
    """

    def __init__(self, config: WatchdogConfig):
        self._config = config
        self._last: Tick | None = None

    def check(self, tick: Tick) -> Iterator[Reason]:
        """Look at a tick's times."""
        last, self._last, c = self._last, tick, self._config
        if not (math.isfinite(tick.now) and math.isfinite(tick.clock)):
            self._last = None
            yield Reason("clock_jump", f"the clock is not finite: {tick.clock}, steady {tick.now}")
            return
        if last is None:
            return
        steady, step = tick.now - last.now, tick.clock - last.clock
        if steady > c.late:
            yield Reason("late", f"{steady:.3f} s between two ticks")
        if step < 0.0 or steady < 0.0:
            yield Reason("clock_jump", f"the clock went back by {-min(step, steady):.3f} s")
        elif step > c.late if c.simulated_clock else abs(step - steady) > c.clock_jump:
            yield Reason("clock_jump", f"the clock went on by {step:.3f} s in {steady:.3f} s")


class FrozenScan:
    """Notices scans with new stamps and the ranges of the last one, while the body moves, until other ranges come.

    A scan without a single return is the same as any other such scan, and is left out.

    Args:
        config: Thresholds.
    """

    def __init__(self, config: WatchdogConfig):
        self._config = config
        self._scan: Scan | None = None
        self._since = math.inf
        self._is_frozen = False

    def check(self, stamp: float, ranges: FloatArray, received: float, twist: Twist2) -> Iterator[Reason]:
        """Look at the latest scan.

        Args:
            stamp: Its stamp [s].
            ranges: Its ranges as numbers, as they came.
            received: When it was received [s].
            twist: The body's velocity.
        """
        last, self._scan = self._scan, Scan(stamp, ranges.copy())
        is_same = last is not None and (stamp == last.stamp or np.array_equal(ranges, last.ranges, equal_nan=True))
        if not is_same:
            self._is_frozen = False
        if not is_same or not _moves(twist, self._config.moving) or not np.isfinite(ranges).any():
            self._since = received
        self._is_frozen |= received - self._since > self._config.identical
        if self._is_frozen:
            yield Reason("scan_frozen", "the ranges of the scans stay the same while the body moves")


class FrozenOdometry:
    """Notices odometry with new stamps and the pose of the last one, while the body moves or should.

    Args:
        body: The body.
        config: Thresholds.
    """

    def __init__(self, body: BodySpec, config: WatchdogConfig):
        self._config, self._patience = config, body.delay + config.unanswered
        self._odometry: Odometry | None = None
        self._moved = self._stood = math.inf

    def check(self, odometry: Odometry, received: float, reached: VelocityCommand) -> Iterator[Reason]:
        """Look at the latest odometry.

        Args:
            odometry: The odometry.
            received: When it was received [s].
            reached: Velocity that the commands given so far lead to.
        """
        last, self._odometry, c = self._odometry, odometry, self._config
        is_same = last is not None and tuple(last.odom_from_base) == tuple(odometry.odom_from_base)
        if not is_same or not _moves(odometry.twist, c.moving):
            self._moved = received
        if not is_same or not _moves(reached, c.moving):
            self._stood = received
        if received - self._moved > c.identical:
            yield Reason("odometry_frozen", "the pose of the odometry stays the same at a velocity that is not 0")
        elif received - self._stood > self._patience:
            yield Reason("odometry_frozen", "the pose of the odometry stays the same though the body should move")


def check_numbers(scan_invalid: int, lidar: LidarSpec, tick: Tick, config: WatchdogConfig) -> Iterator[Reason]:
    """Look at what is a number with a threshold.

    Args:
        scan_invalid: Number of the scan's ranges that are NaN.
        lidar: The lidar.
        tick: The tick.
        config: Thresholds.
    """
    share = scan_invalid / lidar.num_beams
    if share > config.invalid:
        yield Reason("scan_invalid", f"{share:.0%} of the ranges are NaN")
    quality = tick.localisation
    if quality is not None and not quality >= config.localisation:
        yield Reason("lost", f"the localisation has a quality of {quality:.2f}, {config.localisation:g} is needed")
    if tick.publishers > config.publishers:
        yield Reason("second_publisher", f"the velocity command has {tick.publishers} publishers")


def source_watches(lidar: LidarSpec, config: SafetyConfig) -> tuple[SourceWatch, SourceWatch]:
    """The watches of scan and odometry."""
    dogs, period = config.watchdogs, 1.0 / config.rate
    return (
        SourceWatch("scan", max(1.0 / lidar.rate, period), dogs),
        SourceWatch("odometry", max(1.0 / config.odometry_rate, period), dogs),
    )


def _moves(velocity: Twist2 | VelocityCommand, threshold: float) -> bool:
    return max(abs(velocity[0]), abs(velocity[1]), abs(velocity[2])) > threshold
