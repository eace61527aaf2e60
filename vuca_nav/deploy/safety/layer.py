"""The safety layer: the last thing that a command passes before it goes to the body."""

import math
from collections import deque

import numpy as np

from vuca_nav.deploy.safety.config import DEFAULTS, SafetyConfig
from vuca_nav.deploy.safety.limits import CommandLimits
from vuca_nav.deploy.safety.monitor import CollisionMonitor, Decision, Motion
from vuca_nav.deploy.safety.status import Action, Allowed, Level, Reason, SafetyState, Tick
from vuca_nav.deploy.safety.watchdogs import ClockWatch, FrozenOdometry, FrozenScan, check_numbers, source_watches
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import between, compose
from vuca_nav.perception.readings import CheckedOdometry, OdometryCheck, ScanCheck, as_numbers
from vuca_nav.types import STOP, BodySpec, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand

_STILL = Twist2(0.0, 0.0, 0.0)
_REMEMBERED = 1.0
"""Time over which odometry is remembered, to know where the body was when a scan was taken [s]."""
_LONGEST_AHEAD = 0.2
"""Longest time over which the body's pose is carried on at its velocity [s]."""


class SafetyLayer:
    """Watches the sensors and the clocks, and lets through what is safe of a command.

    With a fault the command is zero in the same tick, and until ``healthy`` seconds after its end. Nothing moves before
    a goal and a first healthy time. An emergency stop holds until it is released.

    Args:
        body: The body: footprint, limits of velocity and acceleration, delay.
        lidar: Its lidar, as the scans come.
        config: Settings.

    Attributes:
        state: State after the last tick.
        monitor: The collision monitor.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, config: SafetyConfig = DEFAULTS):
        self.config, self._body, self._lidar = config, body, lidar
        self.monitor = CollisionMonitor(body, lidar, config.monitor)
        self._emergency: str | None = None
        self.reset()

    def reset(self) -> None:
        """Begin anew, as after the start of the program; a latched emergency stop stays."""
        body, lidar, config = self._body, self._lidar, self.config
        self._limits = CommandLimits(body)
        self._scan_check = ScanCheck(lidar, body.footprint)
        self._odometry_check = OdometryCheck(body, config.odometry_rate)
        self._scan_watch, self._odometry_watch = source_watches(lidar, config)
        self._clock_watch = ClockWatch(config.watchdogs)
        self._frozen_scan = FrozenScan(config.watchdogs)
        self._frozen_odometry = FrozenOdometry(body, config.watchdogs)
        self._scan: Scan | None = None
        self._raw = np.empty(0)
        self._scan_invalid = 0
        self._odometry: Odometry | None = None
        self._measured: CheckedOdometry | None = None
        self._poses: deque[tuple[float, Pose2]] = deque()
        self._tick: Tick | None = None
        self._healthy_since: float | None = None
        self._last_fault = ""
        self.state = SafetyState(Level.STALE, "waiting", "not started")

    def stop(self, reason: str) -> None:
        """Latch the emergency stop: every command is zero from the next tick on.

        Args:
            reason: Who or what asks for it, for the message.
        """
        self._emergency = reason

    def release(self) -> None:
        """Release the emergency stop. The body moves again after another healthy time."""
        self._emergency, self._healthy_since = None, None

    def step(self, tick: Tick, proposed: VelocityCommand | None) -> Allowed:
        """Decide on a command.

        Args:
            tick: What is known now.
            proposed: The command that is proposed; None for none, which is zero.

        Returns:
            The command that may go to the body, and the state.
        """
        before, self._tick = self._tick, tick
        dt = 1.0 / self.config.rate
        if before is not None and math.isfinite(tick.now - before.now):
            dt = min(max(tick.now - before.now, 0.0), self.config.watchdogs.late)
        reasons = self._faults(tick, proposed)
        waits = self._wait(tick, reasons)
        if self._emergency is not None:
            command, state = STOP, self._stands(Level.ERROR, "emergency", f"emergency stop: {self._emergency}", reasons)
        elif reasons:
            level = Level.STALE if reasons[0].name.endswith("_silent") else Level.ERROR
            command, state = STOP, self._stands(level, "fault", reasons[0].text, reasons)
        elif waits > 0.0:
            after = f" after: {self._last_fault}" if self._last_fault else ""
            command, state = STOP, self._stands(Level.WARN, "waiting", f"moves in {waits:.2f} s{after}")
        elif overdue := self._scan_watch.overdue(tick) or self._odometry_watch.overdue(tick):
            command, state = STOP, self._stands(Level.WARN, "overdue", overdue)
        elif not tick.has_goal or proposed is None:
            what = "no goal" if not tick.has_goal else "no command"
            command, state = STOP, self._stands(Level.OK, "standing", what)
        else:
            command, state = self._pass(tick, proposed, dt)
        self._limits.add(command, tick.clock, dt)
        self.state = state
        return Allowed(command, state)

    def values(self) -> tuple[tuple[str, str], ...]:
        """Key-value pairs of the last tick for ``/diagnostics``."""
        tick, state = self._tick, self.state
        values = {"action": state.action, "reasons": ", ".join(reason.name for reason in state.reasons)}
        if tick is None:
            return tuple(values.items())
        values["scan age [s]"] = f"{tick.now - tick.scan_received:.3f}"
        values["odometry age [s]"] = f"{tick.now - tick.odometry_received:.3f}"
        if self._scan is not None and self._measured is not None:
            values["clearance [m]"] = f"{self.monitor.clearance(self._motion(tick)):.3f}"
        values["localisation"] = "" if tick.localisation is None else f"{tick.localisation:.2f}"
        values["publishers"] = str(tick.publishers)
        values["emergency stop"] = self._emergency or ""
        return tuple(values.items())

    def _pass(self, tick: Tick, proposed: VelocityCommand, dt: float) -> tuple[VelocityCommand, SafetyState]:
        """What limits and monitor let through."""
        within = self._limits.clamp(proposed, dt)
        decision: Decision = self.monitor.allow(within, self._motion(tick))
        if decision.action != "passed":
            return decision.command, SafetyState(Level.WARN, decision.action, decision.message)
        action: Action = "passed" if within == proposed else "limited"
        return within, SafetyState(Level.OK, action, "healthy")

    def _faults(self, tick: Tick, proposed: VelocityCommand | None) -> tuple[Reason, ...]:
        """All that is wrong now."""
        dogs = self.config.watchdogs
        clock = list(self._clock_watch.check(tick))
        if any(reason.name == "clock_jump" for reason in clock):
            self._limits.reset()
            self._poses.clear()
        scan, odometry = tick.scan, tick.odometry
        reasons = [
            *clock,
            *self._scan_watch.check(None if scan is None else scan.stamp, tick.scan_received, tick),
            *self._odometry_watch.check(None if odometry is None else odometry.stamp, tick.odometry_received, tick),
        ]
        if odometry is not None:
            reasons += self._take_odometry(odometry, tick)
        if scan is not None:
            reasons += self._take_scan(scan, tick)
        reasons += check_numbers(self._scan_invalid, self._lidar, tick, dogs)
        if proposed is not None and not all(math.isfinite(value) for value in proposed):
            reasons.append(Reason("command_invalid", f"the proposed command is not finite: {tuple(proposed)}"))
        return tuple(reasons)

    def _take_odometry(self, odometry: Odometry, tick: Tick) -> list[Reason]:
        if odometry is not self._odometry:
            self._odometry = odometry
            try:
                self._measured = self._odometry_check.check(odometry)
            except BadArgument as error:
                return [Reason("odometry_invalid", str(error))]
            self._remember(odometry.stamp, self._measured.odom_from_base)
        reasons = [*self._frozen_odometry.check(odometry, tick.odometry_received, self._limits.reached)]
        if self._measured is not None and self._measured.fault is not None:
            reasons.append(Reason("odometry_invalid", self._measured.fault))
        return reasons

    def _remember(self, stamp: float, odom_from_base: Pose2) -> None:
        """Note where the body was; after a jump of the stamps back, from there on."""
        poses = self._poses
        if not math.isfinite(stamp):
            return
        if poses and stamp < poses[-1][0]:
            poses.clear()
        poses.append((stamp, odom_from_base))
        while poses[0][0] < stamp - _REMEMBERED:
            poses.popleft()

    def _take_scan(self, scan: Scan, tick: Tick) -> list[Reason]:
        if scan is not self._scan:
            try:
                raw = as_numbers(scan.ranges, "the scan's ranges")
                checked = self._scan_check.check(Scan(scan.stamp, raw))
            except BadArgument as error:
                self._scan = None
                return [Reason("scan_size", str(error))]
            self._scan, self._raw, self._scan_invalid = scan, raw, checked.invalid
            self.monitor.observe(checked.scan.ranges)
        twist = _STILL if self._measured is None else self._measured.twist
        return [*self._frozen_scan.check(scan.stamp, self._raw, tick.scan_received, twist)]

    def _wait(self, tick: Tick, reasons: tuple[Reason, ...]) -> float:
        """Time until the body may move, 0 or less if it may [s]."""
        if reasons or self._emergency is not None:
            self._healthy_since = None
            self._last_fault = reasons[0].text if reasons else "emergency stop"
            return self.config.healthy
        if self._healthy_since is None:
            self._healthy_since = tick.now
        waits = self._healthy_since + self.config.healthy - tick.now
        if waits <= 1e-9:
            self._last_fault = ""
            return 0.0
        return waits

    def _stands(self, level: Level, action: Action, message: str, reasons: tuple[Reason, ...] = ()) -> SafetyState:
        return SafetyState(level, action, message, reasons)

    def _motion(self, tick: Tick) -> Motion:
        """The body's motion at a tick, in base_link of when the scan was taken."""
        assert self._measured is not None
        assert self._odometry is not None
        assert self._scan is not None
        measured, begins = self._measured, self._odometry.stamp
        scan_from_base = between(self._pose_at(self._scan.stamp), measured.odom_from_base)
        return Motion(scan_from_base, measured.twist, begins, tick.clock, self._limits.unanswered(begins))

    def _pose_at(self, stamp: float) -> Pose2:
        """Where the body was at a time, in odom: between two readings, or carried on from the last [s]."""
        assert self._measured is not None
        poses = self._poses
        if not poses:
            return self._measured.odom_from_base
        last_stamp, last = poses[-1]
        if stamp >= last_stamp:
            ahead, twist = min(stamp - last_stamp, _LONGEST_AHEAD), self._measured.twist
            return compose(last, Pose2(twist.v_x * ahead, twist.v_y * ahead, twist.w_z * ahead))
        before_stamp, before = poses[0]
        for after_stamp, after in poses:
            if after_stamp >= stamp:
                if after_stamp <= before_stamp:
                    return after
                share = (stamp - before_stamp) / (after_stamp - before_stamp)
                motion = between(before, after)
                return compose(before, Pose2(share * motion.x, share * motion.y, share * motion.yaw))
            before_stamp, before = after_stamp, after
        return last
