"""When the node ticks: in real time with the scans, or in lockstep with a simulator."""

import math
import time
from abc import ABC, abstractmethod

from vuca_nav.deploy.node.inputs import Inputs
from vuca_nav.deploy.transport.interface import Transport
from vuca_nav.types import LidarSpec
from vuca_nav.wire import NANOSECONDS

SPIN = 0.0005
"""Time before a deadline for which the loop spins: what a sleep is late by on an idle machine [s]."""
EARLY = 1.0 / 3.0
"""Share of a period by which a scan may come early and still begin a tick."""
LATE = 0.15
"""Share of a period for which a scan that is late is waited for: 5 ms."""
SILENCE = 0.1
"""Longest time without a tick, whatever the simulated clock does [s]: half of a fault's way to the zero command."""
_LOOK = 0.02
"""Longest sleep of the loop: after it signals are seen [s]."""
_SCAN_WAIT = 0.05
"""Time for which a slow lidar's scan that may be due is waited for after the odometry of its time, in lockstep [s]."""


class Pace(ABC):
    """Waits for the next tick."""

    @abstractmethod
    def wait(self) -> bool:
        """Wait a while, taking in what comes; whether it is time for a tick."""


class Lockstep(Pace):
    """A tick for each odometry and the scan of its time; the wall clock does not matter.

    A lidar slower than the ticks has no scan at some of them. Sooner after a scan than two scans have ever followed
    each other, and than the lidar's rate allows, none is waited for; where one may be due, it is waited for shortly.

    Args:
        transport: The network.
        inputs: What the node hears.
        rate: Rate of the ticks [Hz].
        lidar: The robot's lidar.
    """

    def __init__(self, transport: Transport, inputs: Inputs, rate: float, lidar: LidarSpec):
        self._transport, self._inputs, self._rate = transport, inputs, rate
        self._is_slow = lidar.rate < 0.99 * rate
        self._last = -1
        self._scan: int | None = None
        self._least: int = math.floor(rate / lidar.rate + 1e-9)
        self._is_known = False

    def wait(self) -> bool:
        """Wait for a pair of odometry and scan with one stamp."""
        inputs = self._inputs
        if not self._transport.wait(_LOOK) and not self._is_slow:
            return False
        inputs.take()
        scan, odometry = inputs.scan, inputs.odometry
        if scan is None or odometry is None or odometry.stamp == self._last or inputs.clock is None:
            return False  # without a clock it is no simulator
        if self._is_slow:
            self._learn(scan.stamp)
        if scan.stamp != odometry.stamp and not (self._is_slow and self._has_none(scan.stamp, odometry.stamp)):
            return False
        self._last = odometry.stamp
        return True

    def _learn(self, scan: int) -> None:
        """Note how soon the scan of a stamp [ns] follows the one before."""
        before, self._scan = self._scan, scan
        if before is not None and scan > before:
            self._least, self._is_known = min(self._least, self._ticks(scan - before)), True

    def _has_none(self, scan: int, odometry: int) -> bool:
        """Whether there is no scan of the odometry's time, as far as can be known now, by the stamps of both [ns]."""
        if self._is_known and 0 < self._ticks(odometry - scan) < self._least:
            return True
        return time.monotonic() - self._inputs.odometry_received > _SCAN_WAIT

    def _ticks(self, elapsed: int) -> int:
        return round(elapsed / NANOSECONDS * self._rate)


class RealTime(Pace):
    """Ticks at a rate, in step with the scans where the lidar has about the same rate.

    With a simulated clock its time decides, however fast it goes.

    Args:
        transport: The network.
        inputs: What the node hears.
        rate: Rate of the ticks [Hz].
        lidar: The robot's lidar.
        use_sim_time: Whether time is that of ``/clock``.
    """

    def __init__(self, transport: Transport, inputs: Inputs, rate: float, lidar: LidarSpec, use_sim_time: bool):
        self._transport, self._inputs, self._use_sim_time = transport, inputs, use_sim_time
        self._period = round(NANOSECONDS / rate)
        self._follows_scans = abs(lidar.rate - rate) < 0.1 * rate
        self._scan_stamp: int | None = None
        self._due: int | None = None
        self._ticked = time.monotonic()

    def wait(self) -> bool:
        """Wait until a scan comes that is due, or until it is late."""
        inputs, now = self._inputs, self._time()
        if self._due is None:
            self._due = now
        late = self._due + (round(LATE * self._period) if self._follows_scans else 0)
        left = (late - now) / NANOSECONDS
        if self._use_sim_time:
            self._transport.wait(_LOOK)
        elif left < SPIN:
            while self._time() < late:
                pass
        else:
            self._transport.wait(min(left - SPIN, _LOOK))
        inputs.take()
        now, scan = self._time(), inputs.scan
        is_silent = time.monotonic() - self._ticked > SILENCE
        if self._follows_scans and scan is not None and scan.stamp != self._scan_stamp:
            before = self._scan_stamp
            if before is None or is_silent or abs(scan.stamp - before) >= (1.0 - EARLY) * self._period:
                self._scan_stamp = scan.stamp
                self._begin(now + self._period)
                return True
        if now >= late or is_silent:
            # On time, the next one keeps to the beat; after a pause there is nothing to make up for.
            self._begin(self._due + self._period if 0 <= now - self._due < self._period else now + self._period)
            return True
        return False

    def _time(self) -> int:
        """The time that ticks go by [ns]."""
        return (self._inputs.clock or 0) if self._use_sim_time else time.monotonic_ns()

    def _begin(self, due: int) -> None:
        self._due, self._ticked = due, time.monotonic()
