"""The safety layer as a whole: when a command passes, and how soon a fault makes it zero."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vuca_nav.deploy.safety.layer import SafetyLayer
from vuca_nav.deploy.safety.status import Level, Tick
from vuca_nav.types import STOP, BodySpec, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand

BODY = BodySpec(
    name="box",
    footprint=np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]),
    max_v_x=1.0, min_v_x=-0.3, max_v_y=0.0, max_w_z=1.0, max_a_x=1.0, max_a_y=0.0, max_a_w=2.0,
)  # fmt: skip
LIDAR = LidarSpec(num_beams=180, max_range=10.0)
FORWARD = VelocityCommand(0.5, 0.0, 0.0)


def ticks(layer, first, count, **changes):
    """Results of some ticks of a body that stands in a round hall."""
    return [layer.step(healthy(k / 30.0)._replace(**changes), FORWARD) for k in range(first, first + count)]


def healthy(time):
    rng = np.random.default_rng(round(time * 1000))
    ranges = 5.0 + 0.01 * rng.standard_normal(LIDAR.num_beams)
    odometry = Odometry(time, Pose2(1e-4 * rng.standard_normal(), 0.0, 0.0), Twist2(0.0, 0.0, 0.0))
    return Tick(time, time, Scan(time, ranges), time, odometry, time, has_goal=True)


def test_nothing_moves_before_a_healthy_second_and_a_goal():
    layer = SafetyLayer(BODY, LIDAR)
    results = ticks(layer, 0, 40)
    first = next(k for k, result in enumerate(results) if result.command != STOP)
    assert first == 30
    assert {r.state.action for r in results[:30]} == {"waiting"}
    without = ticks(layer, 40, 5, has_goal=False)
    assert all(r.command == STOP and r.state == (Level.OK, "standing", "no goal", ()) for r in without)
    assert layer.step(healthy(45 / 30.0), None).command == STOP


def test_it_accelerates_as_the_body_can_and_brakes_at_once():
    layer = SafetyLayer(BODY, LIDAR)
    moving = [r.command.v_x for r in ticks(layer, 0, 60)[30:]]
    np.testing.assert_allclose(moving[:15], np.arange(1, 16) / 30.0, atol=1e-9)
    assert moving[-1] == 0.5
    assert layer.step(healthy(2.0), VelocityCommand(0.0, 0.0, 0.0)).command == STOP
    assert layer.step(healthy(2.0 + 1 / 30.0), FORWARD).command.v_x == pytest.approx(0.5)  # it has hardly braked


def test_an_emergency_stop_holds_until_it_is_released():
    layer = SafetyLayer(BODY, LIDAR)
    ticks(layer, 0, 60)
    layer.stop("button")
    held = ticks(layer, 60, 90)
    assert all(r.command == STOP and r.state.action == "emergency" and "button" in r.state.message for r in held)
    layer.release()
    assert [r.command != STOP for r in ticks(layer, 150, 35)].index(True) == 30


@pytest.mark.parametrize("command", [VelocityCommand(math.nan, 0.0, 0.0), VelocityCommand(0.0, 0.0, math.inf)])
def test_a_command_that_is_not_finite_stops_the_body(command):
    layer = SafetyLayer(BODY, LIDAR)
    ticks(layer, 0, 60)
    result = layer.step(healthy(2.0), command)
    assert result.command == STOP
    assert [reason.name for reason in result.state.reasons] == ["command_invalid"]


def test_a_turn_back_begins_at_rest_at_the_earliest():
    layer = SafetyLayer(BODY, LIDAR)
    ticks(layer, 0, 60)
    backwards = VelocityCommand(-0.3, 0.0, 0.0)
    given = [layer.step(healthy(2.0 + k / 30.0), backwards).command.v_x for k in range(30)]
    reached = 0.5
    for v_x in given:
        assert v_x >= min(reached - 1 / 30.0, 0.0) - 1e-9
        reached += min(max(v_x - reached, -1 / 30.0), 1 / 30.0)
    assert given[0] == 0.0
    assert given[-1] == pytest.approx(-0.3)


def test_stamps_that_are_not_finite_stop_the_body_until_they_are():
    layer = SafetyLayer(BODY, LIDAR)
    ticks(layer, 0, 60)
    for field in ("scan", "odometry"):
        for k in range(5):
            tick = healthy(2.0 + k / 30.0)
            broken = tick._replace(**{field: replace(getattr(tick, field), stamp=math.nan)})
            result = layer.step(broken, FORWARD)
            assert result.command == STOP
            assert f"{field}_time" in {reason.name for reason in result.state.reasons}
            assert dict(layer.values())["action"] == "fault"
        layer.reset()
        assert ticks(layer, 90, 60)[-1].command == FORWARD


def test_the_diagnostics_say_how_near_the_body_is():
    layer = SafetyLayer(BODY, LIDAR)
    ticks(layer, 0, 40)
    values = dict(layer.values())
    assert float(values["clearance [m]"]) == pytest.approx(5.0 - math.hypot(0.3, 0.2), abs=0.03)
    assert values["publishers"] == "1"
