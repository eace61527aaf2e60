# pyright: reportMissingImports=false, reportOptionalMemberAccess=false
# (stable-baselines3 has an environment of its own.)

import time

import gymnasium
import numpy as np
import pytest
import torch

from tests.docs.pages import DOCS, blocks_of
from train.arena.config import ArenaConfig
from train.arena.gym_env import ArenaVectorEnv, make_arena_env
from vuca_nav.errors import BadArgument

try:
    import stable_baselines3 as sb3
except ModuleNotFoundError:
    sb3 = None
needs_sb3 = pytest.mark.skipif(sb3 is None, reason="stable-baselines3 has an environment of its own: make test-sb3")

SMALL = ArenaConfig(layouts=2, pairs=16, num_bodies=2)
NAVIGATION = "robots.gym_env:vuca/Navigation-v0"


def arena(n: int = 24, kind: str = "mixed") -> ArenaVectorEnv:
    return make_arena_env(n, kind, "tiago", config=SMALL)


def adapted(envs: gymnasium.vector.VectorEnv):
    from train.arena.sb3_env import ArenaVecEnv

    return ArenaVecEnv(envs)


@pytest.mark.skipif(sb3 is not None, reason="stable-baselines3 is installed")
def test_a_missing_stable_baselines_is_named():
    with pytest.raises(ModuleNotFoundError, match=r"stable_baselines3; run pip install -e '.\[sb3\]'"):
        import train.arena.sb3_env  # noqa: F401


@needs_sb3
def test_the_adapter_gives_the_arenas_episodes():
    env, plain = adapted(arena()), arena()
    env.seed(3)
    np.testing.assert_array_equal(env.reset(), plain.reset(seed=3)[0])
    env.action_space.seed(0)
    ends = []
    for _ in range(400):
        action = np.stack([env.action_space.sample() for _ in range(24)])
        observation, reward, done, infos = env.step(action)
        expected, expected_reward, terminated, truncated, info = plain.step(action)
        np.testing.assert_array_equal(observation, expected)
        np.testing.assert_array_equal(reward, expected_reward)
        np.testing.assert_array_equal(done, terminated | truncated)
        for row, of_row in enumerate(infos):
            assert bool(of_row) == done[row]
            if done[row]:
                np.testing.assert_array_equal(of_row["terminal_observation"], info["final_obs"][row])
                assert of_row["TimeLimit.truncated"] == truncated[row]
                assert of_row["is_success"] == info["reached"][row]
                ends.append(of_row["TimeLimit.truncated"])
    assert 0 < sum(ends) < len(ends)
    env.close()
    env.close()


@needs_sb3
def test_the_adapter_refuses_what_rows_do_not_have():
    env = adapted(arena(3))
    assert env.get_attr("num_envs", [0, 2]) == [3, 3]
    assert env.get_attr("render_mode") == [None, None, None]
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False, False, False]
    with pytest.raises(AttributeError):
        env.get_attr("nothing")
    with pytest.raises(BadArgument, match="'pause' of some rows"):
        env.set_attr("pause", True, [0])
    with pytest.raises(BadArgument, match="'jump' of a row"):
        env.env_method("jump")
    with pytest.raises(BadArgument, match="begin anew in the same step"):
        adapted(gymnasium.make_vec("CartPole-v1", 2, vectorization_mode="sync"))


@needs_sb3
@pytest.mark.slow
def test_ppo_learns_in_the_arena():
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import VecMonitor

    env = VecMonitor(adapted(arena(64, "static")))
    model = sb3.PPO("MlpPolicy", env, n_steps=64, batch_size=512, n_epochs=4, seed=0)
    before, _ = evaluate_policy(model, env, 50)
    model.learn(100_000)
    after, _ = evaluate_policy(model, env, 50)
    assert after > before + 5.0  # of a goal's 20
    env.close()


@needs_sb3
def test_stable_baselines_finds_nothing_wrong(recwarn):
    from stable_baselines3.common.env_checker import check_env

    check_env(gymnasium.make(NAVIGATION, world="dynamic", movers=2, robot="tiago", render_mode=None))
    assert [str(warning.message) for warning in recwarn] == []


@needs_sb3
@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "robot", "options"),
    [("PPO", "tiago", {"n_steps": 256}), ("SAC", "tiago", {"learning_starts": 100}),
     ("SAC", "go2", {"learning_starts": 100})],
)  # fmt: skip
def test_a_minute_of_training_in_navigation_gives_finite_weights(algorithm, robot, options):
    from stable_baselines3.common.callbacks import BaseCallback

    class Stop(BaseCallback):
        def _on_step(self) -> bool:
            return time.monotonic() < end

    env = gymnasium.make(NAVIGATION, world="static", robot=robot, render_mode=None)
    if algorithm == "SAC":
        options = {"buffer_size": 20_000, **options}
    model = getattr(sb3, algorithm)("MultiInputPolicy", env, seed=0, **options)
    before = torch.nn.utils.parameters_to_vector(model.policy.parameters()).clone()
    end = time.monotonic() + 60.0
    model.learn(10**9, callback=Stop())
    after = torch.nn.utils.parameters_to_vector(model.policy.parameters())
    assert torch.isfinite(after).all()
    assert (after != before).any()
    env.close()


@needs_sb3
def test_the_pages_example_runs():
    (example,) = [block for block in blocks_of(DOCS / "training.md") if "stable_baselines3" in block.text]
    exec(compile(example.text, "docs/training.md", "exec"), {})
