import copy
import math
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from robots.gym_env import NavigationEnv
from vuca_nav.errors import BadArgument, UnknownName

NAME = "robots.gym_env:vuca/Navigation-v0"


def make(**options) -> NavigationEnv:
    env = gymnasium.make(NAME, **options).unwrapped
    assert isinstance(env, NavigationEnv)
    return env


def assert_same_steps(one, other):
    """Two results of ``step`` are the same bits."""
    assert one[1:] == other[1:]
    for key, value in one[0].items():
        np.testing.assert_array_equal(value, other[0][key])


@pytest.mark.parametrize("robot", ["tiago", "go2"])
def test_gymnasium_finds_nothing_wrong(robot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(world="dynamic", movers=4, robot=robot), skip_render_check=True)


def test_an_action_has_the_dimensions_that_the_body_has():
    wheeled, legged = make(robot="tiago"), make(robot="go2")
    assert wheeled.axes == ("v_x", "w_z")
    assert legged.axes == ("v_x", "v_y", "w_z")
    for env in (wheeled, legged):
        assert env.action_space == gymnasium.spaces.Box(-1.0, 1.0, (len(env.axes),), np.float32)


@pytest.mark.parametrize(("share", "speed"), [(1.0, 1.0), (0.5, 0.5), (-1.0, -0.2), (7.0, 1.0)])
def test_an_action_is_a_share_of_the_bodys_limits(share, speed):
    env = make(world="square", movers=0, robot="tiago")
    env.reset(seed=0)
    for _ in range(12):
        observation, *_ = env.step(np.array([share, 0.0], np.float32))
    assert observation["twist"][0] == pytest.approx(speed, abs=0.05)


def test_scaling_wrappers_have_no_degenerate_dimension():
    env = gymnasium.wrappers.RescaleAction(
        gymnasium.make(NAME, world="dynamic", movers=0), np.float32(-2.0), np.float32(2.0)
    )
    plain = make(world="dynamic", movers=0)
    env.reset(seed=0)
    plain.reset(seed=0)
    assert_same_steps(env.step(np.array([2.0, 0.5])), plain.step(np.array([1.0, 0.25])))


def test_gymnasiums_wrappers_and_vectors_take_it():
    env = gymnasium.make(NAME, world="dynamic", movers=0, render_mode=None, max_episode_steps=3)
    env = gymnasium.wrappers.RecordEpisodeStatistics(env)
    env.reset(seed=0)
    total, truncated, info = 0.0, False, {}
    for _ in range(3):
        _, reward, _, truncated, info = env.step(np.array([1.0, 0.0], np.float32))
        total += float(reward)
    assert truncated
    assert info["episode"]["l"] == 3
    assert info["episode"]["r"] == pytest.approx(total)

    envs = gymnasium.make_vec(NAME, 2, vectorization_mode="sync", world="dynamic", movers=0)
    observations, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observations)
    *_, infos = envs.step(np.zeros((2, 2), np.float32))
    np.testing.assert_array_equal(infos["success"], [False, False])
    envs.close()


@pytest.mark.parametrize("robot", ["tiago", "go2"])
def test_a_copy_goes_on_to_the_same_bits(robot):
    env = gymnasium.make(NAME, world="dynamic", movers=4, robot=robot)
    env.reset(seed=1)
    env.action_space.seed(0)
    for _ in range(5):
        env.step(env.action_space.sample())
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    places = set()
    for _ in range(5):
        action = env.action_space.sample()
        expected = env.step(action)
        places.add(tuple(expected[0]["goal"]))
        for other in copies:
            np.testing.assert_array_equal(other.action_space.sample(), action)
            assert_same_steps(other.step(action), expected)
    assert len(places) == 5  # the robot drives
    _, info = env.reset()
    for other in copies:
        assert other.reset()[1] == info


def test_a_copy_before_the_first_reset_begins_like_the_original():
    env = make(world="dynamic", movers=0)
    other = copy.deepcopy(env)
    with pytest.raises(ResetNeeded):
        other.step(np.zeros(2, np.float32))
    np.testing.assert_array_equal(env.reset(seed=2)[0]["scan"], other.reset(seed=2)[0]["scan"])


def test_before_a_reset_there_is_nothing_to_step_or_draw():
    env = make(world="dynamic", movers=0)
    with pytest.raises(ResetNeeded, match="step"):
        env.step(np.zeros(2, np.float32))
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(ResetNeeded, match="step"):
        env.step(np.zeros(2, np.float32))
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))


def test_a_seed_determines_the_episodes_after_it_too():
    env = make(world="dynamic", movers=0)
    first, second = [[env.reset(seed=5)[1], env.reset()[1], env.reset()[1]] for _ in range(2)]
    assert first == second
    assert len({info["seed"] for info in first}) == 3
    assert make(world="dynamic", movers=0).reset()[1] != make(world="dynamic", movers=0).reset()[1]


def test_one_seed_is_one_episode():
    env = make(world="dynamic", movers=4)
    ends = []
    for _ in range(2):
        env.reset(seed=3)
        for _ in range(5):
            observation, *_ = env.step(np.array([0.5, 0.2], np.float32))
        ends.append(observation)
    for key, value in ends[0].items():
        np.testing.assert_array_equal(value, ends[1][key])


def test_driving_to_the_goal_is_rewarded():
    env = make(world="dynamic", movers=0, robot="tiago")
    observation, info = env.reset(seed=0)
    total, over = 0.0, False
    start = float(np.hypot(*observation["goal"]))
    while not over:
        bearing = math.atan2(observation["goal"][1], observation["goal"][0])
        forward = 1.0 if abs(bearing) < 0.3 else 0.0
        action = np.array([forward, np.clip(2.0 * bearing, -1.0, 1.0)], np.float32)
        observation, reward, over, truncated, info = env.step(action)
        total += float(reward)
        assert not truncated
    assert info["success"]
    assert np.hypot(*observation["goal"]) < 0.3
    assert total == pytest.approx(4.0 * (start - np.hypot(*observation["goal"])) + 20.0, abs=1e-3)


def test_driving_into_a_wall_terminates():
    env = make(world="dynamic", movers=0, robot="tiago")
    env.reset(seed=0)
    reward, terminated, info = 0.0, False, {}
    for step in range(300):
        away_from_goal = [0.0, 1.0] if step < 20 else [1.0, 0.0]
        observation, reward, terminated, _, info = env.step(np.array(away_from_goal, np.float32))
        assert env.observation_space.contains(observation)
        if terminated:
            break
    assert terminated
    assert info["contact"] == "wall"
    assert float(reward) < -10.0
    with pytest.warns(UserWarning, match="terminated"):
        env.step(np.zeros(2, np.float32))


def test_bad_arguments_are_refused():
    with pytest.raises(UnknownName):
        make(world="nowhere")
    with pytest.raises(UnknownName):
        make(robot="gp2")
    with pytest.raises(BadArgument, match="rate 7"):
        make(rate=7)
    for options in ({"rate": 7.5}, {"rate": "10"}, {"tolerance": math.nan}, {"tolerance": -1.0}, {"tolerance": "a"}):
        with pytest.raises(BadArgument, match="would be right"):
            NavigationEnv(**options)  # type: ignore[arg-type]
    with pytest.raises(BadArgument, match="render_mode 'human'"):
        NavigationEnv(render_mode="human")
    env = make(world="dynamic", movers=0)
    env.reset(seed=0)
    for action in ([math.nan, 0.0], [0.0, math.inf], [0.0, 0.0, 0.0], 0.0):
        with pytest.raises(BadArgument, match=r"2 finite numbers in .* v_x, w_z"):
            env.step(np.array(action, np.float32))


def test_actions_that_are_no_numbers_are_refused():
    env = make()
    env.reset(seed=0)
    for action in (["a", "b"], [None, 0.0], [1.0, 1j], [10**400, 0]):
        with pytest.raises(BadArgument, match="the action must be numbers"):
            env.step(action)  # type: ignore[arg-type]
