"""A stack under the safety layer of a deployed robot (``--monitor``), with times from the simulated clock."""

from collections import Counter

from vuca_nav.deploy.safety.config import SafetyConfig
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.status import Tick
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.stack import Stack
from vuca_nav.types import BodySpec, LidarSpec, Odometry, Pose2, Scan, VelocityCommand


class Monitored(Stack):
    """Another stack, whose commands the safety layer passes, scales or stops.

    Args:
        stack: The stack that drives.
        body: The body that is driven.
        lidar: The body's lidar.
        rate: Rate of the ticks [Hz].

    Attributes:
        actions: Number of ticks by what the layer did: an ``Action``, or the names of the faults.
    """

    def __init__(self, stack: Stack, body: BodySpec, lidar: LidarSpec, rate: float):
        self.stack = stack
        self.layer = SafetyLayer(body, lidar, SafetyConfig(rate=rate, odometry_rate=rate))
        self.actions: Counter[str] = Counter()

    @property
    def grid(self) -> OccupancyGrid | None:
        """The map of the stack that drives."""
        return self.stack.grid

    def reset(self, start: Pose2, goal: tuple[float, float], prior_map: OccupancyGrid | None = None) -> None:
        """Begin a mission: the first healthy second has to pass before the body moves."""
        self.stack.tolerance, self.finding = self.tolerance, None
        self.stack.reset(start, goal, prior_map)
        self.layer.reset()
        self.actions.clear()
        self.map_from_base = self.stack.map_from_base

    def step(self, scan: Scan, odometry: Odometry) -> VelocityCommand:
        """The stack's command, as far as the layer lets it through."""
        proposed = self.stack.step(scan, odometry)
        self.map_from_base, self.finding = self.stack.map_from_base, self.stack.finding
        now = odometry.stamp
        allowed = self.layer.step(Tick(now, now, scan, scan.stamp, odometry, now, has_goal=True), proposed)
        state = allowed.state
        self.actions.update([reason.name for reason in state.reasons] or [state.action])
        return allowed.command
