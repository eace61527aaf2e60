import copy
import pickle
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from robots.gym_env import NavigationEnv
from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.scene_camera import NoOpenGL
from robots.simulation import Simulation
from worlds.registry import make_world

NAME = "robots.gym_env:vuca/Navigation-v0"
OPTIONS = {"world": "dynamic", "movers": 0, "render_mode": "rgb_array"}
FORWARD = np.array([1.0, 0.0], np.float32)


@pytest.fixture
def env():
    try:
        made = gymnasium.make(NAME, **OPTIONS)
    except NoOpenGL as error:
        pytest.skip(str(error))
    yield made
    made.close()


def test_a_picture_shows_the_robot_on_the_floor_in_its_middle(env):
    with pytest.raises(ResetNeeded, match="render"):
        env.unwrapped.render()
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (480, 640, 3)
    assert picture.dtype == np.uint8
    middle = picture[220:260, 300:340].reshape(-1, 3).astype(float)
    assert middle.std() > 10.0  # not the floor alone
    np.testing.assert_array_equal(env.render(), picture)
    for _ in range(10):
        env.step(FORWARD)
    assert (env.render() != picture).any()
    env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), picture)


def test_pictures_change_nothing_in_the_episode(env):
    plain = NavigationEnv(world="dynamic", movers=0)
    env.reset(seed=1)
    plain.reset(seed=1)
    for _ in range(10):
        env.render()
        one, other = env.step(FORWARD), plain.step(FORWARD)
        assert one[1:] == other[1:]
        np.testing.assert_array_equal(one[0]["scan"], other[0]["scan"])


def test_a_copy_draws_the_same_picture(env):
    env.reset(seed=2)
    env.step(FORWARD)
    other = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(other.render(), env.render())
    env.close()
    other.render()
    other.close()


def test_videos_are_recorded(env, tmp_path):
    pytest.importorskip("moviepy", reason="needs moviepy, which has an environment of its own: make test-sb3")
    video = gymnasium.wrappers.RecordVideo(env, str(tmp_path), video_length=5)
    video.reset(seed=0)
    for _ in range(6):
        video.step(FORWARD)
    video.close()
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]
    assert env.metadata["render_fps"] == 10


def test_where_nothing_can_be_drawn_make_says_so(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(NoOpenGL, match=r"MUJOCO_GL=off .* egl"):
        gymnasium.make(NAME, **OPTIONS)
    monkeypatch.setenv("MUJOCO_GL", "cgl" if sys.platform == "linux" else "osmesa")  # of another system
    with pytest.raises(NoOpenGL, match="no OpenGL to draw with"):
        gymnasium.make(NAME, **OPTIONS)
    gymnasium.make(NAME, world="dynamic", render_mode=None)


def test_a_simulation_is_not_copied():
    simulation = Simulation(make_world("square", 0), make_body("tiago"), 0, noise=NoiseConfig())
    for duplicate in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="Simulation can be neither copied nor pickled"):
            duplicate(simulation)
