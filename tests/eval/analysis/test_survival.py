"""The search for a way to survive: rooms in which it is known whether there is one."""

import math

import numpy as np
import pytest

from eval.analysis.survival import SEGMENT, TICK_RATE, body_model, commands_of, scene_about, start_of, survive
from robots.registry import make_body
from vuca_nav.types import BodySpec, Pose2
from worlds.arrays import pack_shapes
from worlds.world import Box, Cylinder

SQUARE = np.array([[0.25, -0.25], [0.25, 0.25], [-0.25, 0.25], [-0.25, -0.25]])
BODY = BodySpec("square", SQUARE, 1.0, -0.5, 0.0, 1.0, 1.0, 0.0, 2.0)
SIDEWAYS = BodySpec("sideways", SQUARE, 1.0, -0.5, 0.8, 1.0, 2.0, 2.0, 2.0)
CORRIDOR = tuple(Box(0.0, y, 20.0, 0.2, 0.0, 2.0) for y in (-0.6, 0.6))


def search(mover_path, *, speed=0.0, obstacles=(), body=BODY, ticks=120, margin=0.02):
    """A disc of 0.3 m whose centre is at ``mover_path(t)``; the body is at the origin, ahead is +x."""
    start, model = Pose2(0.0, 0.0, 0.0), body_model(body)
    poses = np.array([[(*mover_path((k + 1) / TICK_RATE), 0.0)] for k in range(ticks)], float)
    shapes = pack_shapes(list(obstacles)), pack_shapes([Cylinder(0.0, 0.0, 0.3, 1.0)])
    scene = scene_about(start, body, 1.0, shapes, poses, margin)
    moving = start_of(model, start, np.tile((speed, 0.0, 0.0), (90, 1)))
    return survive(moving, scene, model, commands_of(body)), poses


def clearances(found, poses):
    """Distances of the square to the disc, tick by tick."""
    gaps = []
    for (x, y, yaw), ((mx, my, _),) in zip(found.poses, poses, strict=True):
        c, s = math.cos(yaw), math.sin(yaw)
        u, v = c * (mx - x) + s * (my - y), c * (my - y) - s * (mx - x)
        gaps.append(math.hypot(max(abs(u) - 0.25, 0.0), max(abs(v) - 0.25, 0.0)) - 0.3)
    return np.array(gaps)


def oncoming(distance, speed):
    return lambda t: (distance - speed * t, 0.0)


def test_a_way_past_what_comes_is_found_and_keeps_its_distance():
    found, poses = search(oncoming(5.0, 1.0), speed=0.5)
    assert len(found.commands) == len(poses) == len(found.poses)
    assert clearances(found, poses).min() > 0.02 - 1e-9
    assert np.hypot(*np.diff(found.poses[:, :2], axis=0).T).max() <= 1.0 / TICK_RATE + 1e-9


def test_none_is_found_where_there_is_too_little_time():
    """0.25 s at 2 m/s ahead: the body brakes by 1 m/s^2 and cannot be gone from its place."""
    found, _ = search(oncoming(0.25 + 0.3 + 0.5, 2.0), speed=0.5)
    assert (found.commands, found.is_exhausted) == ((), True)


def test_in_a_corridor_it_backs_away_from_what_is_slower():
    found, poses = search(oncoming(1.5, 0.4), obstacles=CORRIDOR)
    assert clearances(found, poses).min() > 0.0
    assert found.poses[-1, 0] < -0.2


def test_in_a_corridor_what_is_faster_cannot_be_survived():
    found, _ = search(oncoming(2.0, 1.5), obstacles=CORRIDOR)
    assert (found.commands, found.is_exhausted) == ((), True)


def test_a_niche_beside_the_corridor_is_found():
    niche = (
        Box(-5.5, 0.6, 9.0, 0.2, 0.0, 2.0), Box(5.5, 0.6, 9.0, 0.2, 0.0, 2.0), Box(0.0, 2.0, 4.0, 0.2, 0.0, 2.0),
        CORRIDOR[0],
    )  # fmt: skip
    found, poses = search(oncoming(3.5, 1.5), obstacles=niche, body=SIDEWAYS, ticks=210)
    assert clearances(found, poses).min() > 0.0
    assert found.poses[:, 1].max() > 0.6
    closed, _ = search(oncoming(3.5, 1.5), obstacles=CORRIDOR, body=SIDEWAYS, ticks=210)
    assert closed.commands == ()


def test_where_nothing_comes_all_goes():
    found, _ = search(lambda t: (5.0, 5.0))
    assert len(found.commands) == 120


@pytest.mark.parametrize("robot", ["tiago", "go2"])
def test_models_of_the_bodies_reach_their_commands(robot):
    model = body_model(make_body(robot).spec)
    assert (model.delay <= SEGMENT).all()
    start = start_of(model, Pose2(0.0, 0.0, 0.0), np.tile((0.5, 0.0, 0.2), (90, 1)))
    np.testing.assert_allclose(start.velocity, model.gain * (0.5, 0.0, 0.2), atol=1e-3)


def test_tiagos_wheels_limit_speed_and_turn_together():
    model = body_model(make_body("tiago").spec)
    start = start_of(model, Pose2(0.0, 0.0, 0.0), np.tile((1.0, 0.0, 1.0), (120, 1)))
    v_x, _, w_z = start.velocity
    assert v_x + w_z * 0.2022 == pytest.approx(1.0, abs=0.02)  # speed of the wheel's rim [m/s]
    assert v_x == pytest.approx(w_z, abs=0.02)
