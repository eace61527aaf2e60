"""Warm-up: kernels are compiled, and caches filled, before the robot can be told to move."""

import itertools

from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.manifest import STEPS
from vuca_nav.deploy.safety.config import SafetyConfig
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.status import Tick
from vuca_nav.deploy.steps import read_steps

TICKS = 150
"""Number of recorded ticks that are driven: five seconds hold all that ticks do, and the first healthy second."""


def warm_up(bundle: Bundle) -> None:
    """Drive the first recorded ticks of a bundle, under a safety layer, and forget them."""
    steps = read_steps(bundle.directory / STEPS)
    navigator = bundle.navigator()
    rate = bundle.config.navigator.rate
    safety = SafetyLayer(bundle.body, bundle.lidar, SafetyConfig(rate=rate, odometry_rate=rate))
    start, goal, ticks = next(steps.missions())
    navigator.reset(start, goal)
    for tick in itertools.islice(ticks, TICKS):
        scan, odometry = steps.sensed(tick)
        now = odometry.stamp
        safety.step(Tick(now, now, scan, scan.stamp, odometry, now, has_goal=True), navigator.step(scan, odometry))
