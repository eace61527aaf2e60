import math

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from vuca_nav.errors import BadArgument, UnknownName

NAME = "robots.gym_env:vuca/Navigation-v0"


def make(**options):
    return gymnasium.make(NAME, **options).unwrapped


@pytest.mark.parametrize("robot", ["tiago", "go2"])
def test_gymnasium_finds_nothing_wrong(robot):
    check_env(make(world="dynamic", movers=4, robot=robot), skip_render_check=True)


def test_one_seed_is_one_episode():
    env = make(world="dynamic", movers=4)
    ends = []
    for _ in range(2):
        env.reset(seed=3)
        for _ in range(5):
            observation, *_ = env.step(np.array([0.5, 0.0, 0.2], np.float32))
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
        action = np.array([forward, 0.0, np.clip(2.0 * bearing, -1.0, 1.0)], np.float32)
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
        away_from_goal = [0.0, 0.0, 1.0] if step < 20 else [1.0, 0.0, 0.0]
        _, reward, terminated, _, info = env.step(np.array(away_from_goal, np.float32))
        if terminated:
            break
    assert terminated
    assert info["contact"] == "wall"
    assert float(reward) < -10.0


def test_bad_arguments_are_refused():
    with pytest.raises(UnknownName):
        make(world="nowhere")
    with pytest.raises(UnknownName):
        make(robot="gp2")
    with pytest.raises(BadArgument, match="rate 7"):
        make(rate=7)
    env = make(world="dynamic", movers=0)
    env.reset(seed=0)
    with pytest.raises(BadArgument, match="finite"):
        env.step(np.array([math.nan, 0.0, 0.0], np.float32))
