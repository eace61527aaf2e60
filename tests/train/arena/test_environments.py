import copy
import pickle

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from torchrl.envs import check_env_specs

from train.arena.arena import Arena
from train.arena.config import ArenaConfig
from train.arena.gym_env import ArenaVectorEnv
from train.arena.torchrl_env import ArenaEnv
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.policy.observation import ObservationConfig

CONFIG = ArenaConfig(layouts=2, pairs=16, num_bodies=4).of("mixed")


def arena(n=24, seed=0):
    return Arena(CONFIG, ObservationConfig(), n, seed)


def test_torchrl_finds_the_specs_true():
    check_env_specs(ArenaEnv(arena(8)), break_when_any_done="both")


def test_torchrl_rollouts_are_the_arenas():
    env, plain = ArenaEnv(arena(seed=3)), arena(seed=3)
    torch.manual_seed(0)
    rollout = env.rollout(80, break_when_any_done=False)
    done = rollout["next", "done"][:, :, 0].numpy()
    assert 5 < done.sum() < 300
    observation = plain.reset()
    for t in range(80):
        np.testing.assert_array_equal(rollout["observation"][:, t].numpy(), observation)
        step = plain.step(rollout["action"][:, t].numpy())
        over = step.collided | step.reached | step.timed_out
        np.testing.assert_array_equal(done[:, t], over)
        following = rollout["next", "observation"][:, t].numpy()
        np.testing.assert_array_equal(following[~over], step.observation[~over])
        np.testing.assert_array_equal(following[over], step.final_observation[over])
        expected = 4.0 * step.progress - 15.0 * step.collided + 20.0 * step.reached
        np.testing.assert_allclose(rollout["next", "reward"][:, t, 0].numpy(), expected, atol=1e-5)
        observation = step.observation


def test_rows_called_back_on_the_way_begin_anew():
    env = ArenaEnv(arena(6))
    first = env.rollout(5, break_when_any_done=False)[:, -1]["next"]
    mask = torch.tensor([[True], [False], [False], [True], [False], [False]])
    again = env.reset(first.select("observation").set("_reset", mask))
    same = torch.isclose(again["observation"], first["observation"]).all(dim=-1)
    assert not same[mask[:, 0]].any()
    assert env._arena.gather("ticks")[mask[:, 0].numpy()].max() == 0


def test_gymnasium_vector_environment():
    env = ArenaVectorEnv(arena(seed=1))
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    one, _ = env.reset(seed=5)
    two, _ = env.reset(seed=5)
    np.testing.assert_array_equal(one, two)
    assert env.observation_space.contains(one)
    env.action_space.seed(0)
    finals = 0
    for _ in range(60):
        observation, reward, terminated, truncated, infos = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
        assert reward.shape == terminated.shape == truncated.shape == (24,)
        if "final_obs" in infos:
            ended = infos["_final_obs"]
            np.testing.assert_array_equal(ended, terminated | truncated)
            assert not np.isclose(infos["final_obs"][ended], observation[ended]).all(axis=1).any()
            finals += ended.sum()
    assert finals > 5
    env.close()


def test_there_is_no_step_before_a_reset_nor_after_a_close():
    env = ArenaVectorEnv(arena(4))
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(np.zeros((4, 3), np.float32))
    with pytest.raises(BadArgument, match="reset"):
        arena(4).step(np.zeros((4, 3), np.float32))
    env.reset(seed=0)
    env.close()
    env.close()
    with pytest.raises(ClosedEnvironmentError):
        env.step(np.zeros((4, 3), np.float32))


def test_bad_actions_and_seeds_are_refused():
    env = ArenaVectorEnv(arena(4))
    with pytest.raises(BadArgument, match=r"seed \[0, 1, 2, 3\]"):
        env.reset(seed=[0, 1, 2, 3])  # type: ignore[arg-type]
    env.reset(seed=0)
    with pytest.raises(BadArgument, match="row 2"):
        env.step(np.array([[0, 0, 0], [0, 0, 0], [0, np.nan, 0], [0, 0, 0]], np.float32))
    with pytest.raises(BadArgument, match="shape"):
        env.step(np.zeros((4, 2), np.float32))


def test_without_a_seed_the_first_episodes_differ():
    one, two = ArenaVectorEnv(arena(4)), ArenaVectorEnv(arena(4))
    assert (one.reset()[0] != two.reset()[0]).any()
    one.reset(seed=7)
    two.reset(seed=7)
    np.testing.assert_array_equal(one.reset()[0], two.reset()[0])


@pytest.mark.parametrize("make", [arena, lambda n: ArenaVectorEnv(arena(n)), lambda n: ArenaEnv(arena(n))])
@pytest.mark.parametrize("duplicate", [copy.deepcopy, pickle.dumps])
def test_an_arena_is_not_copied(make, duplicate):
    made = make(2)
    with pytest.raises(TypeError, match="Arena can be neither copied nor pickled"):
        duplicate(made)


def test_unknown_rewards_are_refused():
    with pytest.raises(Exception, match="reward column 'fuson'; did you mean 'fusion'"):
        ArenaEnv(arena(2), "fuson")


def test_gymnasium_makes_it_by_its_name():
    options = {"vectorization_mode": "vector_entry_point", "kind": "mixed", "config": CONFIG, "rewards": "careful"}
    env = gymnasium.make_vec("vuca/Arena-v0", num_envs=24, render_mode=None, **options)
    assert isinstance(env.unwrapped, ArenaVectorEnv)
    assert env.num_envs == 24
    plain = ArenaVectorEnv(arena(), "careful")
    np.testing.assert_array_equal(env.reset(seed=2)[0], plain.reset(seed=2)[0])
    action = np.full((24, 3), 0.5, np.float32)
    for one, two in zip(env.step(action)[:4], plain.step(action)[:4]):
        np.testing.assert_array_equal(one, two)
    env.close()


def test_gymnasiums_maker_takes_kind_body_and_observation():
    small = ArenaConfig(layouts=1, pairs=4, num_bodies=2)
    seen = ObservationConfig(kind="tracked")
    env = gymnasium.make_vec(
        "train.arena.gym_env:vuca/Arena-v0", 3, kind="dynamic", body="go2", config=small, observation=seen, threads=2
    ).unwrapped
    assert isinstance(env, ArenaVectorEnv)
    assert env.single_observation_space.shape == (seen.size,)
    assert env._arena.config == small.of("dynamic").driven_by("go2")
    assert len(env._arena.shards) == 2
    env.close()


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"kind": "mixd"}, BadArgument, "no kind of world 'mixd'; there are static"),
        ({"body": "gp2"}, BadArgument, "no body 'gp2'; there are tiago"),
        ({"rewards": "fuson"}, UnknownName, "did you mean 'fusion'"),
        ({"render_mode": "rgb_array"}, BadArgument, "the arena draws no pictures"),
    ],
)
def test_gymnasiums_maker_says_what_is_wrong(options, error, match):
    with pytest.raises(error, match=match):
        gymnasium.make_vec("vuca/Arena-v0", **options)
