# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import copy
import math

import mujoco
import numpy as np
import pytest

from robots.bodies.go2 import GO2
from robots.locomotion.model import GRAVITY, SERVO_KD, SERVO_KP, SERVO_SUPPLY, QuadrupedModel
from train.locomotion.floors import SILL_DEPTH, SILL_HALF_HEIGHT, Floor, compile_model
from train.locomotion.randomise import Randomisation, randomise, randomise_robot

RANGES = Randomisation()
CHANGED = {
    "geom_friction", "body_mass", "body_inertia", "body_ipos", "actuator_gainprm", "actuator_forcerange",
    "dof_damping", "dof_armature", "dof_frictionloss",
    # what follows from them
    "body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "actuator_acc0", "dof_length", "bvh_aabb",
}  # fmt: skip
FLOOR_CHANGED = {"geom_size", "geom_pos", "geom_aabb", "geom_rbound"}


@pytest.fixture(scope="module")
def base() -> mujoco.MjModel:
    return compile_model(QuadrupedModel(GO2), 120, Floor.for_training(4), touch=True, delayed=False)


def variants(base, num, roughness):
    data = mujoco.MjData(base)
    for seed in range(num):
        model = copy.copy(base)
        randomise(model, base, data, RANGES, np.random.default_rng(seed), roughness)
        yield model


def arrays(model) -> dict[str, np.ndarray]:
    named = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: value for name, value in named.items() if isinstance(value, np.ndarray)}


def ratio(now, before):
    """The one factor between two arrays."""
    at = before != 0.0
    factors = now[at] / before[at]
    assert factors == pytest.approx(factors[0])
    assert (now[~at] == 0.0).all()
    return factors[0]


def test_everything_is_drawn_within_its_range(base):
    trunk, feet = base.body("go2/base_link").id, base.geom_priority > 0
    drawn = []
    for model in variants(base, 60, 1.0):
        drawn.append(
            (
                model.geom_friction[feet, 0][0],
                ratio(model.geom_friction[feet, 1:], base.geom_friction[feet, 1:]),
                model.body_mass[trunk] - base.body_mass[trunk],
                *(model.body_ipos[trunk] - base.body_ipos[trunk]),
                ratio(model.actuator_gainprm[:, SERVO_KP], base.actuator_gainprm[:, SERVO_KP]),
                ratio(model.actuator_gainprm[:, SERVO_KD], base.actuator_gainprm[:, SERVO_KD]),
                ratio(model.actuator_forcerange, base.actuator_forcerange),
                ratio(model.dof_damping, base.dof_damping),
                ratio(model.dof_armature, base.dof_armature),
                ratio(model.dof_frictionloss, base.dof_frictionloss),
            )
        )
        supply = model.actuator_gainprm[:, SERVO_SUPPLY], base.actuator_gainprm[:, SERVO_SUPPLY]
        assert ratio(*supply) == pytest.approx(drawn[-1][8])
        assert ratio(model.body_inertia[trunk], base.body_inertia[trunk]) == pytest.approx(
            model.body_mass[trunk] / base.body_mass[trunk]
        )
    shift = (-RANGES.centre_of_mass, RANGES.centre_of_mass)
    limits = np.array([
        RANGES.friction, RANGES.spin_friction, RANGES.payload, shift, shift, shift, RANGES.gains, RANGES.gains,
        RANGES.strength, RANGES.damping, RANGES.armature, RANGES.joint_friction,
    ])  # fmt: skip
    low, high = np.min(drawn, axis=0), np.max(drawn, axis=0)
    width = limits[:, 1] - limits[:, 0]
    assert (low >= limits[:, 0]).all()
    assert (high <= limits[:, 1]).all()
    assert (high - low > 0.8 * width).all()  # and all of it is used


def test_floors_are_drawn_within_theirs(base):
    sills = base.geom_bodyid == base.body("sills").id
    slopes, tops, depths = [], [], []
    for model in variants(base, 100, 1.0):
        g = model.opt.gravity
        assert np.linalg.norm(g) == pytest.approx(GRAVITY)
        slopes.append(math.hypot(g[0], g[1]) / -g[2])
        tops.append(model.geom_pos[sills, 2] + SILL_HALF_HEIGHT)
        depths.append(2.0 * model.geom_size[sills, 0])
    sloped, rough = np.array(slopes) > 0.0, np.max(tops, axis=1) > 0.0
    assert np.mean(sloped) == pytest.approx(RANGES.slopes, abs=0.15)
    assert np.mean(rough) == pytest.approx(RANGES.sills, abs=0.15)
    assert 0.9 * RANGES.slope < max(slopes) <= RANGES.slope
    high = np.array(tops)[rough]
    assert 0.0 <= high.min() < high.max() <= RANGES.sill_height[1]
    assert (np.array(tops)[~rough] < 0.0).all()
    assert 0.1 * SILL_DEPTH <= np.min(depths) < np.max(depths) <= SILL_DEPTH


def test_a_smooth_floor_is_flat(base):
    sills = base.geom_bodyid == base.body("sills").id
    for model in variants(base, 10, 0.0):
        assert model.opt.gravity == pytest.approx([0.0, 0.0, -GRAVITY])
        assert (model.geom_pos[sills, 2] + SILL_HALF_HEIGHT < 0.0).all()


def test_nothing_else_changes(base):
    before = arrays(copy.copy(base))
    robot = copy.copy(base)
    randomise_robot(robot, base, mujoco.MjData(base), RANGES, np.random.default_rng(0))
    (whole,) = variants(base, 1, 1.0)
    for model, allowed in ((robot, CHANGED), (whole, CHANGED | FLOOR_CHANGED)):
        changed = {name for name, value in arrays(model).items() if not np.array_equal(value, before[name])}
        assert changed <= allowed
    assert robot.opt.gravity.tolist() == base.opt.gravity.tolist()
    untouched = base.geom_priority == 0
    assert (robot.geom_friction[untouched] == base.geom_friction[untouched]).all()


def test_what_follows_from_the_masses_follows(base):
    for model in variants(base, 3, 0.0):
        trunk = base.body("go2/base_link").id
        assert model.body_subtreemass[0] == pytest.approx(model.body_mass.sum())
        assert model.body_invweight0[trunk, 0] != base.body_invweight0[trunk, 0]


def test_the_collision_tree_holds_the_bars_that_were_drawn(base):
    """Bars that are drawn anew must not keep the boxes of their predecessors."""
    model, data, sills = copy.copy(base), mujoco.MjData(base), base.body("sills").id
    for seed in range(5):
        randomise(model, base, data, RANGES, np.random.default_rng(seed), 1.0)
        mujoco.mj_forward(model, data)
        rotation, origin = data.ximat[sills].reshape(3, 3), data.xipos[sills]
        first = model.body_bvhadr[sills]
        for node in range(first, first + model.body_bvhnum[sills]):
            geom = model.bvh_nodeid[node]
            if geom < 0:
                continue
            half = np.abs(rotation.T @ data.geom_xmat[geom].reshape(3, 3)) @ model.geom_size[geom]
            middle = rotation.T @ (data.geom_xpos[geom] - origin)
            assert model.bvh_aabb[node] == pytest.approx([*middle, *half], abs=1e-9)


def test_a_variant_does_not_depend_on_the_one_before(base):
    data, fresh, used = mujoco.MjData(base), copy.copy(base), copy.copy(base)
    randomise(used, base, data, RANGES, np.random.default_rng(5), 1.0)
    for model in (fresh, used):
        randomise(model, base, data, RANGES, np.random.default_rng(6), 1.0)
    for name, value in arrays(fresh).items():
        assert np.array_equal(value, getattr(used, name)), name
