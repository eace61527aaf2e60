"""Warm-up: kernels are compiled, and caches filled, before the robot can be told to move."""

import itertools

import numpy as np

from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.manifest import STEPS
from vuca_nav.deploy.safety.config import SafetyConfig
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.status import Tick
from vuca_nav.deploy.steps import read_steps
from vuca_nav.footprint import outline_ranges
from vuca_nav.types import STOP, Odometry, Pose2, Scan, Twist2, VelocityCommand

TICKS = 150
"""Number of recorded ticks that are driven: five seconds hold all that ticks do, and the first healthy second."""
CLOSING_TICKS = 120
"""Number of ticks in which obstacles all round come closer, after a healthy second: the body slows down, and stops."""


def warm_up(bundle: Bundle) -> None:
    """Drive the first recorded ticks of a bundle under a safety layer, then towards obstacles; and forget it all."""
    steps = read_steps(bundle.directory / STEPS)
    navigator, body = bundle.navigator(), bundle.body
    rate = bundle.config.navigator.rate
    safety = SafetyLayer(body, bundle.lidar, SafetyConfig(rate=rate, odometry_rate=rate))
    start, goal, ticks = next(steps.missions())
    navigator.reset(start, goal)
    now = 0.0
    for tick in itertools.islice(ticks, TICKS):
        scan, odometry = steps.sensed(tick)
        now = odometry.stamp
        safety.step(Tick(now, now, scan, scan.stamp, odometry, now, has_goal=True), navigator.step(scan, odometry))
    ahead, back, command = VelocityCommand(body.max_v_x, 0.0, 0.2), VelocityCommand(body.min_v_x, 0.0, 0.0), STOP
    outline, phase = outline_ranges(body.footprint, bundle.lidar.num_beams), np.arange(bundle.lidar.num_beams)
    for k, near in enumerate(np.linspace(2.0, 0.02, CLOSING_TICKS).tolist()):
        now += 1.0 / rate
        ranges = np.maximum(outline + near + 1e-3 * np.cos(k + phase), 1.01 * bundle.lidar.min_range)
        odometry = Odometry(now, Pose2(0.0, 0.0, 1e-6 * k), Twist2(*command))
        proposal = ahead if k % 40 < 30 else back
        tick = Tick(now, now, Scan(now, ranges), now, odometry, now, has_goal=True)
        command = safety.step(tick, proposal).command
