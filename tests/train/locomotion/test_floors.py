# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import math

import mujoco
import numpy as np
import pytest

from robots.bodies.go2 import GO2
from robots.locomotion.model import QuadrupedModel
from tests.robots.gaits import untaught
from train.locomotion.evaluate import SILL, SLOPE, Track, rough_floor
from train.locomotion.floors import SILL_HALF_HEIGHT, SILL_SPACING, Floor, compile_model
from vuca_nav.types import STOP


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    return untaught(tmp_path_factory.mktemp("gait"))


@pytest.mark.parametrize("uphill", [0.0, math.pi / 2.0, -2.0])
def test_a_slope_rises_uphill(uphill):
    model = compile_model(QuadrupedModel(GO2), 300, Floor(0.1, uphill))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    normal = data.geom("floor").xmat[2::3]
    # On a plane through the origin z = -(n_x x + n_y y) / n_z.
    rise = -(normal[0] * math.cos(uphill) + normal[1] * math.sin(uphill)) / normal[2]
    across = -normal[0] * math.sin(uphill) + normal[1] * math.cos(uphill)
    assert rise == pytest.approx(0.1)
    assert across == pytest.approx(0.0, abs=1e-12)
    assert model.opt.gravity.tolist() == [0.0, 0.0, -9.81]


def test_bars_stand_out_of_the_tilted_plane_by_their_tops():
    floor = Floor(0.1, 0.7, (0.02, 0.04), (0.1, 0.3))
    model = compile_model(QuadrupedModel(GO2), 300, floor)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    normal = data.geom("floor").xmat[2::3]
    for k, (top, depth) in enumerate(zip(floor.tops, floor.depths)):
        assert normal @ data.geom(f"sill_{k}").xpos + SILL_HALF_HEIGHT == pytest.approx(top)
        assert 2.0 * model.geom(f"sill_{k}").size[0] == pytest.approx(depth)
    apart = data.geom("sill_1").xpos - data.geom("sill_0").xpos
    assert np.linalg.norm(apart) == pytest.approx(math.hypot(SILL_SPACING, 0.02))


@pytest.mark.parametrize("uphill", [0.0, 2.0])
def test_the_imu_of_a_robot_that_stands_on_a_slope_shows_it(tmp_path, uphill):
    """The vertical leans towards uphill, seen from a body that stands along the slope on legs that do not give."""
    stiff = untaught(tmp_path, kp=400.0, kd=10.0)

    def stand(floor):
        track = Track(stiff, 0, vary=False, floor=floor)
        ups = []
        for _ in range(30):
            track.step(STOP)
            ups.append(track._bound._sensors.up.copy())
        assert not track.fallen
        w, x, y, z = track.data.qpos[3:7]
        return np.mean(ups, axis=0), math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    level, _ = stand(Floor())
    up, yaw = stand(Floor(0.1, uphill))
    lean = 0.1 / math.hypot(1.0, 0.1)
    assert up[0] - level[0] == pytest.approx(lean * math.cos(uphill - yaw), abs=0.025)
    assert up[1] - level[1] == pytest.approx(lean * math.sin(uphill - yaw), abs=0.025)


def test_the_floor_never_ends(body):
    """A robot that walked off is put where the floor is the same: along it, and as high over it."""
    floor = Floor(0.1, 0.5, (0.0,) * 4, (0.3,) * 4)
    track = Track(body, 0, vary=False, floor=floor)
    world_from_floor = np.empty(9)
    mujoco.mju_quat2Mat(world_from_floor, floor.quaternion())
    floor_from_world = world_from_floor.reshape(3, 3).T
    before = floor_from_world @ track.data.qpos[:3]
    for away, expected in (((2.0, 0.0, 0.0), (2.0, 0.0, 0.0)), ((3.0, 2.5, 0.0), (3.0 - floor.length, -1.5, 0.0))):
        track.data.qpos[:3] = floor_from_world.T @ (before * (0, 0, 1) + away)
        mujoco.mj_forward(track.model, track.data)
        track.step(STOP)
        now = floor_from_world @ track.data.qpos[:3]
        assert now == pytest.approx(np.array(expected) + before * (0, 0, 1), abs=0.03)
        assert not track.fallen


def test_a_robot_high_up_a_slope_lies_where_it_lies(body):
    """Whether it has fallen is asked of its height over the slope, not over sea level."""
    track = Track(body, 0, vary=False, floor=Floor(0.1, 0.0))
    uphill = track._world_from_floor[0::3]
    for far in (-3.0, 3.0):
        track.data.qpos[:3] = 0.28 * track._world_from_floor[2::3] + far * uphill
        assert not track.fallen
        track.data.qpos[:3] = 0.10 * track._world_from_floor[2::3] + far * uphill
        assert track.fallen


def test_every_minute_on_rough_floor_has_full_sills_and_every_third_the_full_slope():
    floors = [rough_floor(minute, np.random.default_rng((0, minute))) for minute in range(30)]
    for minute, floor in enumerate(floors):
        tops = np.array(floor.tops)
        assert np.mean(tops == SILL) >= 0.5
        assert tops.min() >= 0.02
        assert tops.max() == SILL
        assert 0.0 <= floor.slope <= SLOPE
        if minute % 3 == 0:
            assert floor.slope == SLOPE
    assert len({floor.uphill for floor in floors}) == 30
