"""A collision monitor on the raw scan, after Nav2's (stop, slow down, approach), by the body's own braking distance.

A command passes if the body can obey it for ``hold`` seconds, from the velocity that it has and after the commands that
are on their way, and then brake, without coming nearer to any return than the margin. Otherwise it is scaled along its
arc to the greatest speed for which that is true, and then turns as fast as is safe. A body that has less clearance than
the margin already may leave, turn, and go along, but get no nearer. Returns are taken to stand: what moves is the
business of others.

What the lidar does not look at is taken to begin at the footprint: towards it the body only creeps.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.deploy.safety.config import DEFAULTS, MonitorConfig
from vuca_nav.deploy.safety.limits import Given
from vuca_nav.deploy.safety.status import Action
from vuca_nav.deploy.safety.sweep import (
    ROUNDING,
    Beams,
    Course,
    Keep,
    approaches,
    distance_to,
    empty_poses,
    farthest,
    gather,
    greatest_share,
    intrudes,
    outline_of,
    smooth,
)
from vuca_nav.types import STOP, BodySpec, FloatArray, LidarSpec, Pose2, Twist2, VelocityCommand

_HALVINGS = 5
"""Bisections of the share of a command that is safe: to 3%, on the safe side."""
_LEAST_SHARE = 0.01
"""Share of a command below which the body had better stand."""
_BLIND_STEP = 0.05
"""Angle between two points that stand for what the lidar does not look at [rad]."""
_BLIND_AT = 0.02
"""Their distance from the footprint [m]."""
_FLOOR = 0.01
"""Clearance that is kept wherever the body stands within the margin already [m]."""
_TURN = 0.005
"""Approach that is none while turning on the spot within the margin [m]: the outline of a round body has corners."""
_NO_POINTS = np.empty((0, 2))


class Motion(NamedTuple):
    """The body's motion at a tick."""

    scan_from_base: Pose2
    """Its pose, in base_link of when the scan was taken."""
    velocity: Twist2
    """Its velocity."""
    begins: float
    """The time of both [s]."""
    now: float
    """The time at which the command is given [s]."""
    given: list[Given]
    """Commands that went to the body and may not be answered yet, oldest first."""


class Decision(NamedTuple):
    """What the monitor makes of a command."""

    command: VelocityCommand
    action: Action
    message: str


class CollisionMonitor:
    """Lets a command through as far as the body can stop before what stands in its way.

    Args:
        body: The body; its limits and its delay are taken as they are.
        lidar: The body's lidar.
        config: Settings.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, config: MonitorConfig = DEFAULTS.monitor):
        self._config, self._body, self._lidar = config, body, lidar
        self._outline = outline_of(body.footprint)
        self._accelerations = np.array([body.max_a_x, body.max_a_y, body.max_a_w])
        self._decelerations = config.deceleration * self._accelerations
        angles = lidar.angles_in_base()
        origin = np.array([lidar.mount.x, lidar.mount.y])
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        self._beams = Beams(np.full(lidar.num_beams, np.inf), origin, directions)
        self._poses = empty_poses()
        self._keep = Keep(config.margin, _TURN, _FLOOR)
        self._points = np.empty((lidar.num_beams, 3))
        self._unseen = np.zeros(lidar.num_beams, np.bool_)
        self._set_blind(self._unseen)

    def observe(self, ranges: FloatArray) -> None:
        """Take in a scan.

        Args:
            ranges: (num_beams,) as ``vuca_nav.perception.readings.ScanCheck`` gives them: above 0, ``inf`` for no
                return, NaN for what is not known [m].
        """
        c = self._config
        smooth(ranges, c.smoothing, c.surface, self._beams.ranges)
        unseen = np.isnan(ranges)
        if not np.array_equal(unseen, self._unseen):
            self._set_blind(unseen)

    def clearance(self, motion: Motion) -> float:
        """Distance of the footprint to the nearest return, now; negative for one inside, ``inf`` without any [m]."""
        points = self._near(self._beams, motion.scan_from_base, np.inf, np.inf)
        return float(points[:, 2].min(initial=np.inf))

    def allow(self, wanted: VelocityCommand, motion: Motion) -> Decision:
        """The wanted command, or what of it is safe.

        Args:
            wanted: A command within the body's limits.
            motion: The body's motion.
        """
        c, course = self._config, self._course(wanted, motion)
        action: Action = "passed"
        command, message = wanted, ""
        reach = farthest(course, self._outline.radius)
        pose, slow = motion.scan_from_base, max(c.slow_distance if c.slow_ratio < 1.0 else 0.0, c.margin)
        if len(self._blind_beams.ranges):
            blind = self._near(self._blind_beams, pose, reach + c.margin, c.margin)
            if self._approach(blind, course, command)[0] > ROUNDING:
                command = self._creeping(command)
                action, message = "slowed", "the lidar does not look where the body goes"
        points = self._near(self._beams, pose, reach + slow, slow)
        if self._intrusion(points, course, command, slow)[0] <= ROUNDING:
            return Decision(command, action, message)
        points = points[points[:, 2].argsort(kind="stable")]  # the nearest first: they end a search
        if slow > c.margin:
            slowly = self._slowly(command)
            if slowly != command:
                command, action, message = slowly, "slowed", f"something within {c.slow_distance:g} m of its way"
        lack, which = self._approach(points, course, command)
        if lack <= ROUNDING:
            return Decision(command, action, message)
        return self._scaled(command, points, course, which)

    def _scaled(self, wanted: VelocityCommand, points: FloatArray, course: Course, which: int) -> Decision:
        """The greatest share of a command that is not safe as it is."""
        x, y = points[which, :2]
        place = f"a return {math.hypot(x, y):.2f} m off at {math.degrees(math.atan2(y, x)):.0f} degrees"
        lack = self._approach(points, course, STOP, math.inf)[0]
        if lack > ROUNDING:  # braking comes too near as well
            if self._escapes(wanted, points, course, lack):
                return Decision(wanted, "passed", "")
            return Decision(STOP, "stopped", f"too late to keep {self._config.margin:g} m from {place}")

        share = self._share_of(wanted, points, course)
        turns = wanted.w_z != 0.0 and wanted[:2] != (0.0, 0.0)
        turn = self._share_of(wanted, points, course, share) if turns else share
        if max(share, turn) < _LEAST_SHARE:
            return Decision(STOP, "stopped", f"it would come too near to {place}")
        return Decision(_share(wanted, share, turn), "approach", f"slowed before {place}")

    def _escapes(self, wanted: VelocityCommand, points: FloatArray, course: Course, lack: float) -> bool:
        """Whether a command keeps as far off as braking at once, which comes too near, and touches nothing."""
        if self._approach(points, course, wanted, lack)[0] > lack:
            return False
        return self._intrusion(points, course, wanted, 0.0)[0] <= ROUNDING

    def _share_of(self, wanted: VelocityCommand, points: FloatArray, course: Course, safe: float = -1.0) -> float:
        """The greatest safe share of a command, or of its turn beside a safe share of its speed."""
        command = np.array(wanted, np.float64)
        return greatest_share(points, course, command, self._outline, self._keep, safe, _HALVINGS, self._poses)

    def _approach(
        self, points: FloatArray, course: Course, command: VelocityCommand, enough: float = ROUNDING
    ) -> tuple[float, int]:
        """How much nearer than the margin, or than it is already, the body comes under a command; to which point."""
        wanted = np.array(command, np.float64)
        return approaches(points, course, wanted, self._outline, self._keep, enough, self._poses)

    def _intrusion(
        self, points: FloatArray, course: Course, command: VelocityCommand, margin: float, enough: float = ROUNDING
    ) -> tuple[float, int]:
        """How much nearer than a margin the body comes under a command, and to which point."""
        wanted = np.array(command, np.float64)
        return intrudes(points, course, wanted, self._outline, margin, enough, self._poses)

    def _course(self, wanted: VelocityCommand, motion: Motion) -> Course:
        """The commands that the body is going to obey, the wanted one last."""
        body, ends = self._body, motion.now + self._body.delay
        times, commands = [], []
        given = [item for item in motion.given if item.time + body.delay < ends]
        for n, item in enumerate(given):
            begins = motion.begins if n == 0 else max(item.time + body.delay, motion.begins)
            until = given[n + 1].time + body.delay if n + 1 < len(given) else ends
            if until > begins:
                times.append(until - begins)
                commands.append(item.command)
        times.append(self._config.hold)
        commands.append(wanted)
        v_x, v_y, w_z = motion.velocity
        start = np.array([*motion.scan_from_base, v_x, v_y if body.max_v_y > 0.0 else 0.0, w_z])
        return Course(start, np.array(times), np.array(commands), self._accelerations, self._decelerations)

    def _near(self, beams: Beams, pose: Pose2, reach: float, exact: float) -> FloatArray:
        """The points (n, 3) that are within a distance of the footprint [m], with their distances as ``gather`` has."""
        return self._points[: gather(beams, pose, reach, exact, self._outline, self._points)]

    def _slowly(self, command: VelocityCommand) -> VelocityCommand:
        """The command, along its arc at no more than the share of the greatest speed that is slow."""
        body, ratio = self._body, self._config.slow_ratio
        fastest = math.hypot(command.v_x, command.v_y) / (ratio * max(body.max_v_x, -body.min_v_x))
        return _share(command, *(2 * [1.0 / max(1.0, fastest)]))

    def _creeping(self, command: VelocityCommand) -> VelocityCommand:
        """The command, along its arc at no more than the speed at which the body goes where it does not look."""
        fastest = math.hypot(command.v_x, command.v_y) + self._outline.radius * abs(command.w_z)
        share = min(1.0, self._config.blind_speed / fastest) if fastest > 0.0 else 1.0
        return _share(command, share, share)

    def _set_blind(self, unseen: np.ndarray) -> None:
        """Make the points about the footprint that stand for what the lidar does not look at.

        Args:
            unseen: (num_beams,) the beams of which nothing is known.
        """
        self._unseen = unseen
        lidar, outline = self._lidar, self._outline
        angles = lidar.angles_in_base()[~unseen]
        if not len(angles):
            angles = np.array([0.0])
        seen = np.sort(angles % (2.0 * math.pi))
        gaps = np.diff(np.append(seen, seen[0] + 2.0 * math.pi))
        points = []
        for first, gap in zip(seen, gaps, strict=True):
            if gap <= max(self._config.blind_gap, 2.5 * abs(lidar.pitch)):
                continue
            inner = np.linspace(first, first + gap, max(math.ceil(gap / _BLIND_STEP), 2) + 1)[1:-1]
            for angle in inner:
                ray = np.array([math.cos(angle), math.sin(angle)])
                ahead = outline.normals[:, 0] * ray[0] + outline.normals[:, 1] * ray[1]
                left = outline.offsets - (outline.normals * self._beams.origin).sum(axis=1)
                leaves = float((left[ahead > 1e-9] / ahead[ahead > 1e-9]).min())
                point = self._beams.origin + (max(leaves, 0.0) + _BLIND_AT) * ray
                if distance_to(outline, point[0], point[1]) > 0.0:
                    points.append(point)
        self._blind_beams = Beams(np.ones(len(points)), np.zeros(2), np.array(points) if points else _NO_POINTS)


def _share(command: VelocityCommand, linear: float, angular: float) -> VelocityCommand:
    return VelocityCommand(linear * command.v_x, linear * command.v_y, angular * command.w_z)
