# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math

import mujoco
import numpy as np
import pytest

from vuca_nav.types import Pose2
from worlds.mjcf import FLOOR, TOUCHES_FLOOR, TOUCHES_SCENE, build_arena, obstacle_name, part_name
from worlds.motion.movers import MoverField
from worlds.registry import make_world
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, RandomWalk, World

WORLD = World(
    "two",
    0,
    (0.0, 0.0, 10.0, 8.0),
    (
        Obstacle("wall", Box(5.0, 8.1, 10.0, 0.2, 0.1, 2.5)),
        Obstacle("pillar", Cylinder(2.0, 3.0, 0.25, 2.0, base=0.5)),
    ),
    (
        Mover(
            "cart",
            (MoverPart(Box(0.5, 0.0, 1.0, 0.6, 0.0, 0.8, base=0.1)), MoverPart(Cylinder(0.0, 1.0, 0.1, 1.0))),
            1.2,
            Pose2(4.0, 4.0, math.pi / 2.0),
            RandomWalk(0.5, 7),
        ),
    ),
    Pose2(1.0, 1.0, 0.0),
    (9.0, 7.0),
)


@pytest.fixture(scope="module")
def compiled():
    model = mujoco.MjModel.from_xml_string(build_arena(WORLD).to_xml_string())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_obstacles_are_where_and_as_large_as_the_world_says(compiled):
    model, data = compiled
    wall, pillar = model.geom(obstacle_name(0, "wall")), data.geom(obstacle_name(1, "pillar"))
    np.testing.assert_allclose(wall.size, (5.0, 0.1, 1.25))
    np.testing.assert_allclose(data.geom(wall.id).xpos, (5.0, 8.1, 1.25))
    assert math.atan2(data.geom(wall.id).xmat[3], data.geom(wall.id).xmat[0]) == pytest.approx(0.1)
    np.testing.assert_allclose(pillar.xpos, (2.0, 3.0, 1.5))
    np.testing.assert_allclose(model.geom(pillar.id).size[:2], (0.25, 1.0))


def test_a_movers_parts_are_mocap_bodies_in_order(compiled):
    model, data = compiled
    assert model.nmocap == 2
    np.testing.assert_allclose(data.mocap_pos, [(4.0, 4.5, 0.5), (3.0, 4.0, 0.5)], atol=1e-12)
    assert [model.body(part_name(0, p, "cart")).mocapid[0] for p in range(2)] == [0, 1]


def test_mocap_order_is_that_of_the_mover_field():
    world = make_world("factory", 3, region=1)
    model = mujoco.MjModel.from_xml_string(build_arena(world).to_xml_string())
    data, field = mujoco.MjData(model), MoverField(world)
    np.testing.assert_allclose(data.mocap_pos[:, :2], field.part_poses[:, :2], atol=1e-9)
    yaw = 2.0 * np.arctan2(data.mocap_quat[:, 3], data.mocap_quat[:, 0])
    np.testing.assert_allclose(np.cos(yaw - field.part_poses[:, 2]), 1.0, atol=1e-9)


def test_nothing_of_the_world_collides_with_the_world(compiled):
    model, data = compiled
    data.mocap_pos[:] = (2.0, 3.0, 0.2)  # both parts in the pillar, in each other and in the floor
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    assert (model.geom_contype == 0).all()


@pytest.mark.parametrize(("bits", "touched"), [(TOUCHES_FLOOR, {FLOOR}), (TOUCHES_SCENE, {"pillar_1"})])
def test_a_robots_geom_touches_what_its_bits_say(bits, touched):
    arena = build_arena(WORLD)
    ball = arena.worldbody.add("body", name="ball", pos=(2.3, 3.0, 0.55))
    ball.add("freejoint")
    ball.add("geom", name="ball", type="sphere", size=(0.6,), contype=bits, conaffinity=0)
    model = mujoco.MjModel.from_xml_string(arena.to_xml_string())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = {model.geom(geom).name for pair in data.contact.geom for geom in pair} - {"ball"}
    assert names == touched
