"""The collision monitor against closed forms, and a body that never touches what stands still."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.deploy.safety.scenes import TICK, Base, box_body, cast, gap
from vuca_nav.deploy.safety.config import MonitorConfig, SafetyConfig
from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.limits import Given
from vuca_nav.deploy.safety.monitor import CollisionMonitor, Motion
from vuca_nav.deploy.safety.status import Tick
from vuca_nav.types import STANDING, STOP, LidarSpec, Pose2, Twist2, VelocityCommand

LIDAR = LidarSpec(num_beams=720, max_range=10.0)
PLAIN = MonitorConfig(slow_ratio=1.0)
NO_DISCS = np.empty((0, 3))
AHEAD = np.array([1.0, 0.0])


def wall(angle: float, distance: float) -> list[float]:
    """A wall at a distance from the origin, whose foot lies in a direction."""
    return [math.cos(angle), math.sin(angle), distance]


def monitor_at(body, walls, config=PLAIN, lidar=LIDAR):
    monitor = CollisionMonitor(body, lidar, config)
    monitor.observe(cast(lidar, STANDING, NO_DISCS, np.array(walls)))
    return monitor


def steady(v_x=0.0, v_y=0.0, w_z=0.0):
    """A motion that has gone on at this velocity, as it was commanded, for long."""
    return Motion(STANDING, Twist2(v_x, v_y, w_z), 0.0, 0.0, [Given(-9.0, VelocityCommand(v_x, v_y, w_z))])


@pytest.mark.parametrize("delay", [0.0, 0.11])
@pytest.mark.parametrize("distance", [0.1, 0.3, 0.6])
@pytest.mark.parametrize("deceleration", [1.0, 0.6])
def test_the_speed_before_a_wall_is_that_from_which_the_body_can_stop(distance, delay, deceleration):
    body = box_body(delay=delay)
    config = replace(PLAIN, deceleration=deceleration)
    monitor = monitor_at(body, [wall(0.0, 0.3 + config.margin + distance)], config)
    # v (delay + hold) + v^2 / 2a = distance
    a, reaction = deceleration * body.max_a_x, delay + config.hold
    v = -a * reaction + math.sqrt((a * reaction) ** 2 + 2.0 * a * distance)
    assert monitor.allow(VelocityCommand(v - 0.01, 0.0, 0.0), steady(v - 0.01)).action == "passed"
    decision = monitor.allow(VelocityCommand(v + 0.01, 0.0, 0.0), steady(v + 0.01))
    assert decision.action in ("approach", "stopped")
    assert decision.command.v_x < v
    assert monitor.allow(VelocityCommand(-0.3, 0.0, 0.0), steady()).action == "passed"


def test_a_body_that_presses_on_comes_to_rest_at_the_margin():
    body, walls = box_body(delay=0.1), np.array([wall(0.0, 3.0)])
    layer = SafetyLayer(body, LIDAR, SafetyConfig(monitor=PLAIN, healthy=0.0))
    base = Base(body)
    for _ in range(240):
        tick = Tick(
            base.time, base.time, base.scan(LIDAR, NO_DISCS, walls), base.time, base.odometry(), base.time, True
        )
        base.step(layer.step(tick, VelocityCommand(1.0, 0.0, 0.0)).command)
        assert gap(body.footprint, base.pose, NO_DISCS, walls) > PLAIN.margin - 2e-3
    assert gap(body.footprint, base.pose, NO_DISCS, walls) < PLAIN.margin + 0.01
    assert abs(base.velocity[0]) < 0.05


def test_a_corridor_is_driven_along_at_full_speed_and_its_walls_are_not_turned_into():
    body = box_body(width=0.4)
    for clear in (0.06, 0.03):  # beyond the margin, and within it already
        monitor = monitor_at(body, [wall(0.5 * math.pi, 0.2 + clear), wall(-0.5 * math.pi, 0.2 + clear)])
        assert monitor.allow(VelocityCommand(1.0, 0.0, 0.0), steady(1.0)).action == "passed"
        turning = monitor.allow(VelocityCommand(1.0, 0.0, 1.0), steady(1.0))
        assert turning.action in ("approach", "stopped")
        assert turning.command.w_z < 0.3


def test_turning_on_the_spot_is_safe_for_what_is_round_and_not_for_what_is_long():
    angles = np.arange(24) * 2.0 * math.pi / 24
    disc = replace(box_body(), footprint=0.3 * np.column_stack([np.cos(angles), np.sin(angles)]))
    near = [wall(0.5 * math.pi, 0.32)]
    turn = VelocityCommand(0.0, 0.0, 1.0)
    assert monitor_at(disc, near).allow(turn, steady()).action == "passed"
    long = box_body(length=0.8, width=0.5)
    assert monitor_at(long, near).allow(turn, steady()).command.w_z < 0.3
    away = monitor_at(long, [wall(0.5 * math.pi, 0.6)])  # its corner comes to 0.47 m
    assert away.allow(turn, steady()).action == "passed"


def test_what_is_within_the_margin_may_be_left_and_not_approached():
    monitor = monitor_at(box_body(), [wall(0.0, 0.32)])
    assert monitor.allow(VelocityCommand(-0.5, 0.0, 0.0), steady()).action == "passed"
    assert monitor.allow(VelocityCommand(0.1, 0.0, 0.0), steady()).command == STOP


def test_a_command_that_leads_round_passes_where_braking_comes_too_late():
    body = box_body(max_v_y=0.5, max_a_y=4.0, max_a_x=0.5)
    monitor = CollisionMonitor(body, LIDAR, PLAIN)
    monitor.observe(cast(LIDAR, STANDING, np.array([[0.85, -0.25, 0.1]]), np.empty((0, 3))))
    assert monitor.allow(VelocityCommand(1.0, 0.0, 0.0), steady(1.0)).action == "stopped"
    assert monitor.allow(VelocityCommand(0.8, 0.5, 0.0), steady(1.0)).action == "passed"


def test_the_lidar_s_mount_counts():
    lidar = LidarSpec(num_beams=720, max_range=10.0, mount=Pose2(0.2, 0.1, 0.5))
    body, walls = box_body(), [wall(0.0, 0.3 + 0.05 + 0.3)]
    v = -0.2 + math.sqrt(0.04 + 0.6)
    monitor = monitor_at(body, walls, lidar=lidar)
    assert monitor.allow(VelocityCommand(v - 0.01, 0.0, 0.0), steady(v - 0.01)).action == "passed"
    assert monitor.allow(VelocityCommand(v + 0.01, 0.0, 0.0), steady(v + 0.01)).action != "passed"


def test_the_way_since_the_scan_counts():
    body = box_body()
    monitor = monitor_at(body, [wall(0.0, 0.3 + 0.05 + 0.5)])
    v = -0.2 + math.sqrt(0.04 + 0.6)  # for 0.3 m
    for far, passes in ((0.2, True), (0.23, False)):
        motion = steady(v - 0.01)._replace(scan_from_base=Pose2(far, 0.0, 0.0))
        assert (monitor.allow(VelocityCommand(v - 0.01, 0.0, 0.0), motion).action == "passed") == passes


def test_it_goes_slowly_where_it_passes_something_near():
    body = box_body()
    config = MonitorConfig()
    beside = [wall(0.5 * math.pi, 0.2 + 0.08)]
    decision = monitor_at(body, beside, config).allow(VelocityCommand(1.0, 0.0, 0.0), steady(0.5))
    assert decision.command == VelocityCommand(0.5, 0.0, 0.0)
    assert decision.action == "slowed"
    wider = [wall(0.5 * math.pi, 0.2 + 0.12)]
    assert monitor_at(body, wider, config).allow(VelocityCommand(1.0, 0.0, 0.0), steady(0.5)).action == "passed"


def test_it_creeps_to_where_the_lidar_does_not_look():
    lidar = LidarSpec(num_beams=541, max_range=10.0, angle_min=-0.75 * math.pi, angle_increment=1.5 * math.pi / 540)
    body = box_body()
    monitor = monitor_at(body, [wall(0.0, 5.0)], lidar=lidar)
    back = monitor.allow(VelocityCommand(-0.5, 0.0, 0.0), steady())
    assert back.command == VelocityCommand(-PLAIN.blind_speed, 0.0, 0.0)
    assert back.action == "slowed"
    assert monitor.allow(VelocityCommand(1.0, 0.0, 0.0), steady(1.0)).action == "passed"
    none = monitor_at(body, [wall(0.0, 5.0)], replace(PLAIN, blind_speed=0.0), lidar)
    assert none.allow(VelocityCommand(-0.5, 0.0, 0.0), steady()).command[:2] == (0.0, 0.0)
    ranges = cast(LIDAR, STANDING, NO_DISCS, np.array([wall(0.0, 5.0)]))
    ranges[300:420] = np.nan  # a front that fails
    front = CollisionMonitor(body, LIDAR, PLAIN)
    front.observe(ranges)
    assert front.allow(VelocityCommand(1.0, 0.0, 0.0), steady(1.0)).command.v_x == pytest.approx(PLAIN.blind_speed)


BODIES = {
    "differential": box_body(),
    "walking": box_body(0.75, 0.38, max_v_x=1.2, max_v_y=0.4, max_a_x=2.0, max_a_y=2.0, max_a_w=5.0, delay=0.11),
    "slow to brake": box_body(max_a_x=0.4, max_a_w=1.0, delay=0.05),
}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", BODIES)
def test_it_never_touches_what_stands_still(name, seed):
    body, rng = BODIES[name], np.random.default_rng([seed, *name.encode()])
    lidar = LidarSpec(num_beams=360, max_range=10.0, mount=Pose2(0.1, 0.0, 0.3))
    discs = np.column_stack([rng.uniform(-2.5, 2.5, (14, 2)), rng.uniform(0.1, 0.3, 14)])
    discs = discs[np.hypot(discs[:, 0], discs[:, 1]) > 1.0]
    walls = np.array([wall(angle, rng.uniform(2.0, 3.0)) for angle in rng.uniform(-math.pi, math.pi, 3)])
    layer = SafetyLayer(body, lidar, SafetyConfig(healthy=0.0))
    base, wanted, least, way, actions = Base(body), STOP, math.inf, 0.0, set()
    for k in range(round(20.0 / TICK)):
        if k % 20 == 0:  # bold: mostly at the limits
            share = np.sign(rng.uniform(-0.6, 1.0, 3)) * rng.uniform(0.5, 1.0, 3)
            wanted = VelocityCommand(
                body.max_v_x * share[0] if share[0] > 0.0 else -body.min_v_x * share[0],
                body.max_v_y * share[1] * rng.choice([-1.0, 1.0]),
                body.max_w_z * share[2] * rng.choice([-1.0, 0.0, 1.0]),
            )
        tick = Tick(base.time, base.time, base.scan(lidar, discs, walls), base.time, base.odometry(), base.time, True)
        allowed = layer.step(tick, wanted)
        actions.add(allowed.state.action)
        before = base.pose
        for pose in base.step(allowed.command):
            least = min(least, gap(body.footprint, pose, discs, walls))
        way += math.hypot(base.pose.x - before.x, base.pose.y - before.y)
    assert least > 0.0
    assert way > 1.0
    assert "approach" in actions
