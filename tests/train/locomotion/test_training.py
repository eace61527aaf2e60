import dataclasses
import json

import numpy as np
import pytest
import torch

from robots.bodies.go2 import GO2
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.network import load_policy
from train.locomotion.environment import EnvironmentConfig
from train.locomotion.learner import PpoConfig, advantages
from train.locomotion.training import Stage, Training, TrainingConfig
from vuca_nav.errors import BadArgument

ENVIRONMENT = EnvironmentConfig(num_robots=8)
STAGES = (Stage(0.0, 120, 0, 0.0), Stage(0.5, 120, 2, 1.0))


def tiny(iterations, **changes):
    ppo = PpoConfig(horizon=4, epochs=1, minibatches=2)
    config = TrainingConfig(seed=1, steps=32 * iterations, environment=ENVIRONMENT, ppo=ppo, stages=STAGES)
    return dataclasses.replace(config, **changes)


def interrupt_at(training, monkeypatch, iteration):
    """As if somebody pressed control-C in the middle of that iteration, or the machine went down."""
    learn = training.learner._learn

    def interrupted(progress):
        if training.learner.iteration == iteration:
            raise KeyboardInterrupt
        return learn(progress)

    monkeypatch.setattr(training.learner, "_learn", interrupted)
    with pytest.raises(KeyboardInterrupt):
        training.run()


def rows_of(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def test_training_writes_weights_that_a_mission_loads(tmp_path):
    training = Training(GO2, tiny(6), tmp_path)
    training.run()
    policy = load_policy(GO2, tmp_path / GO2.weights)
    observation = np.random.default_rng(0).normal(size=OBSERVATION_SIZE)
    action = np.empty(ACTION_SIZE)
    policy(observation, action)
    learner = training.learner
    with torch.no_grad():
        expected = learner.averaged.layers(learner.see(torch.tensor(observation, dtype=torch.float32)))
    assert action == pytest.approx(expected.numpy(), abs=1e-4)
    rows = rows_of(tmp_path)
    assert [row["steps"] for row in rows] == [32, 64, 96, 128, 160, 192]
    assert [row["roughness"] for row in rows] == pytest.approx([0.0, 0.0, 0.0, 0.0, 2 / 3, 1.0])
    assert [row["difficulty"] for row in rows] == [0.4, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert (tmp_path / "curves.png").stat().st_size > 1000

    with pytest.raises(BadArgument, match="--resume"):
        Training(GO2, tiny(6), tmp_path)


def test_same_seed_same_bits_whatever_the_threads(tmp_path):
    Training(GO2, tiny(6), tmp_path / "one").run()
    Training(GO2, tiny(6), tmp_path / "two", threads=2).run()
    Training(GO2, tiny(6, seed=2), tmp_path / "other").run()
    one, two, other = (load_policy(GO2, tmp_path / name / GO2.weights) for name in ("one", "two", "other"))
    observation = np.random.default_rng(0).normal(size=OBSERVATION_SIZE)
    actions = np.empty((3, ACTION_SIZE))
    for policy, action in zip((one, two, other), actions):
        policy(observation, action)
    assert actions[0].tobytes() == actions[1].tobytes()
    assert (actions[0] != actions[2]).any()


@pytest.mark.parametrize("interrupted", [2, 5])
def test_an_interrupted_run_ends_with_the_weights_it_would_have_had(tmp_path, monkeypatch, interrupted):
    """In the first stage and in the second: networks, optimisers, robots, floors and random numbers go on."""
    whole = Training(GO2, tiny(8), tmp_path / "whole")
    whole.run()
    interrupt_at(Training(GO2, tiny(8), tmp_path / "parts"), monkeypatch, interrupted)
    resumed = Training(GO2, tiny(8), tmp_path / "parts", resume=True)
    assert resumed.learner.iteration == interrupted
    resumed.run()
    expected, got = whole.learner.state(), resumed.learner.state()
    for network in ("actor", "average", "critic", "see", "see_all"):
        for key, tensor in expected[network].items():
            assert torch.equal(tensor, got[network][key]), (network, key)
    for key, array in whole.learner.environment.state().items():
        assert (array == resumed.learner.environment.state()[key]).all(), key
    times = ("seconds", "speed/collect", "speed/total")
    here, there = rows_of(tmp_path / "whole"), rows_of(tmp_path / "parts")
    assert [{k: v for k, v in row.items() if k not in times} for row in here] == [
        {k: v for k, v in row.items() if k not in times} for row in there
    ]


def test_a_run_of_another_kind_is_not_gone_on_with(tmp_path):
    Training(GO2, tiny(2), tmp_path).run()
    named = dataclasses.replace(GO2, spec=dataclasses.replace(GO2.spec, name="other"))
    stiffer = dataclasses.replace(GO2, kp=50.0)
    for robot, config, key in (
        (named, tiny(2), "robot 'go2', not of 'other'"),
        (stiffer, tiny(2), "gait "),
        (GO2, tiny(2, seed=2), "seed 1, not of 2"),
        (GO2, tiny(3), "steps 64, not of 96"),
        (GO2, tiny(2, ppo=PpoConfig(hidden=64)), "ppo "),
        (GO2, tiny(2, opened=0.5), "environment and stages "),
    ):
        with pytest.raises(BadArgument, match=f"is a run of {key}"):
            Training(robot, config, tmp_path, resume=True)
    with pytest.raises(BadArgument, match=r"there is no .*checkpoint.pt"):
        Training(GO2, tiny(2), tmp_path / "empty", resume=True)


def test_a_log_that_goes_beyond_the_checkpoint_is_cut(tmp_path):
    Training(GO2, tiny(2), tmp_path).run()
    with (tmp_path / "log.jsonl").open("a") as log:
        log.write(json.dumps({"iteration": 3, "seconds": 9.0}) + '\n{"iter')
    Training(GO2, tiny(2), tmp_path, resume=True)
    assert [row["iteration"] for row in rows_of(tmp_path)] == [1, 2]
    (tmp_path / "log.jsonl").write_text("garbage\n" * 2)
    with pytest.raises(BadArgument, match=r"log\.jsonl:1 is not a row"):
        Training(GO2, tiny(2), tmp_path, resume=True)


def test_a_broken_checkpoint_is_refused(tmp_path):
    Training(GO2, tiny(2), tmp_path).run()
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    for part, key, wrong in (("learner", "observation", None), ("environment", "age", torch.zeros(3))):
        broken = {**state, part: {**state[part], key: wrong}}
        if wrong is None:
            del broken[part][key]
        torch.save(broken, tmp_path / "checkpoint.pt")
        with pytest.raises(BadArgument, match="does not fit"):
            Training(GO2, tiny(2), tmp_path, resume=True)
    (tmp_path / "checkpoint.pt").write_bytes(b"broken")
    with pytest.raises(BadArgument, match="can be read"):
        Training(GO2, tiny(2), tmp_path, resume=True)


def test_advantages_worked_by_hand():
    """gamma 0.9, lambda 0.5; three robots: one goes on, one falls in the second step, one's time is up then.

    On: deltas 1 + .9 * 2 - 1 = 1.8, 2 + .9 * 3 - 2 = 2.7, 3 + .9 * 4 - 3 = 3.6;
    3.6, then 2.7 + .45 * 3.6 = 4.32, then 1.8 + .45 * 4.32 = 3.744.
    Fallen: the second delta is 2 - 2 = 0, and the third step's is not carried over; 1.8 + .45 * 0 = 1.8.
    Time up: the second delta is 2 + .9 * 2 - 2 = 1.8, not carried over either; 1.8 + .45 * 1.8 = 2.61.
    """
    config = PpoConfig(gamma=0.9, lambda_=0.5)
    values = torch.tensor([1.0, 2.0, 3.0, 4.0]).reshape(4, 1, 1).expand(4, 3, 1).contiguous()
    rewards = torch.tensor([1.0, 2.0, 3.0]).reshape(3, 1, 1).expand(3, 3, 1).contiguous()
    terminated, truncated = torch.zeros(2, 3, 3, 1, dtype=torch.bool)
    terminated[1, 1], truncated[1, 2] = True, True
    advantage, target = advantages(config, values, rewards, terminated, truncated)
    expected = torch.tensor([[3.744, 1.8, 2.61], [4.32, 0.0, 1.8], [3.6, 3.6, 3.6]])
    assert torch.allclose(advantage[..., 0], expected, atol=1e-5)
    assert torch.allclose(target, advantage + values[:-1], atol=1e-5)
