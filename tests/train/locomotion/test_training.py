import dataclasses
import json

import numpy as np
import pytest
import torch

from robots.bodies.go2 import GO2
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.network import load_policy
from train.locomotion.config import GAIT_PPO, Stage, TrainingConfig
from train.locomotion.environment import EnvironmentConfig
from train.locomotion.rollouts import following_values
from train.locomotion.training import GaitTraining, make_learner
from train.ppo.estimates import advantages
from train.ppo.learner import PpoLearner
from train.ppo.rollout import Rollout
from vuca_nav.errors import BadArgument

ENVIRONMENT = EnvironmentConfig(num_robots=8)
STAGES = (Stage(0.0, 120, 0, 0.0), Stage(0.5, 120, 2, 1.0))


def tiny(iterations, **changes):
    ppo = dataclasses.replace(GAIT_PPO, horizon=4, epochs=1, minibatch=16)
    config = TrainingConfig(seed=1, steps=32 * iterations, environment=ENVIRONMENT, ppo=ppo, stages=STAGES)
    return dataclasses.replace(config, **changes)


def interrupt_at(training, monkeypatch, iteration):
    """As if somebody pressed control-C in the middle of that iteration."""
    learn = PpoLearner.learn

    def interrupted(self, *arguments):
        if self.iteration == iteration:
            raise KeyboardInterrupt
        return learn(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(PpoLearner, "learn", interrupted)
        with pytest.raises(KeyboardInterrupt):
            training.run()


def rows_of(out):
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def test_training_writes_weights_that_a_mission_loads(tmp_path):
    training = GaitTraining(GO2, tiny(6), tmp_path)
    training.run()
    policy = load_policy(GO2, tmp_path / GO2.weights)
    observation = np.random.default_rng(0).normal(size=OBSERVATION_SIZE)
    action = np.empty(ACTION_SIZE)
    policy(observation, action)
    learner = make_learner(GO2, tiny(6))
    learner.load(training.directory.load()["learner"])
    with torch.no_grad():
        seen = learner.rollouts.see(torch.tensor(observation, dtype=torch.float32))  # type: ignore[attr-defined]
        expected = learner.averaged.layers(seen)  # type: ignore[operator]
    assert action == pytest.approx(expected.numpy(), abs=1e-4)
    rows = rows_of(tmp_path)
    assert [row["steps"] for row in rows] == [32, 64, 96, 128, 160, 192]
    assert [row["roughness"] for row in rows] == pytest.approx([0.0, 0.0, 0.0, 0.0, 2 / 3, 1.0])
    assert [row["difficulty"] for row in rows] == [0.4, 1.0, 1.0, 1.0, 1.0, 1.0]
    assert (tmp_path / "curves.png").stat().st_size > 1000

    with pytest.raises(BadArgument, match="--resume"):
        GaitTraining(GO2, tiny(6), tmp_path)


def test_same_seed_same_bits_whatever_the_threads(tmp_path):
    GaitTraining(GO2, tiny(6), tmp_path / "one").run()
    GaitTraining(GO2, tiny(6), tmp_path / "two", threads=2).run()
    GaitTraining(GO2, tiny(6, seed=2), tmp_path / "other").run()
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
    whole = GaitTraining(GO2, tiny(8), tmp_path / "whole")
    whole.run()
    interrupt_at(GaitTraining(GO2, tiny(8), tmp_path / "parts"), monkeypatch, interrupted)
    resumed = GaitTraining(GO2, tiny(8), tmp_path / "parts", resume=True)
    assert resumed.directory.progress()[0] == interrupted
    resumed.run()
    expected, got = (training.directory.load()["learner"] for training in (whole, resumed))
    for part in ("actor", "average", "critic"):
        for key, tensor in expected[part].items():
            assert torch.equal(tensor, got[part][key]), (part, key)
    for part in ("see", "see_all", "environment"):
        for key, tensor in expected["rollouts"][part].items():
            assert torch.equal(tensor, got["rollouts"][part][key]), (part, key)
    times = ("seconds", "speed/collect", "speed/total")
    here, there = rows_of(tmp_path / "whole"), rows_of(tmp_path / "parts")
    assert [{k: v for k, v in row.items() if k not in times} for row in here] == [
        {k: v for k, v in row.items() if k not in times} for row in there
    ]


def test_a_run_of_another_kind_is_not_gone_on_with(tmp_path):
    GaitTraining(GO2, tiny(2), tmp_path).run()
    named = dataclasses.replace(GO2, spec=dataclasses.replace(GO2.spec, name="other"))
    stiffer = dataclasses.replace(GO2, kp=50.0)
    for robot, config, place in (
        (named, tiny(2), "robot"),
        (stiffer, tiny(2), "gait"),
        (GO2, tiny(2, seed=2), "training.seed"),
        (GO2, tiny(3), "training.steps"),
        (GO2, tiny(2, hidden=64), "training.hidden"),
        (GO2, tiny(2, opened=0.5), "training.opened"),
    ):
        with pytest.raises(BadArgument, match=f"holds a run that differs in {place}"):
            GaitTraining(robot, config, tmp_path, resume=True)


def test_a_log_that_goes_beyond_the_checkpoint_is_cut(tmp_path, monkeypatch):
    interrupt_at(GaitTraining(GO2, tiny(3), tmp_path), monkeypatch, 2)
    with (tmp_path / "log.jsonl").open("a") as log:
        log.write(json.dumps({"iteration": 3, "seconds": 9.0}) + '\n{"iter')
    GaitTraining(GO2, tiny(3), tmp_path, resume=True).run()
    assert [row["steps"] for row in rows_of(tmp_path)] == [32, 64, 96]
    (tmp_path / "log.jsonl").write_text("garbage\n" * 2)
    with pytest.raises(BadArgument, match=r"log\.jsonl:1 is not a row"):
        GaitTraining(GO2, tiny(3), tmp_path, resume=True).run()


def test_a_broken_checkpoint_is_refused(tmp_path, monkeypatch):
    interrupt_at(GaitTraining(GO2, tiny(3), tmp_path), monkeypatch, 2)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    rollouts = state["learner"]["rollouts"]
    unseen = {key: value for key, value in rollouts.items() if key != "observation"}
    aged = {**rollouts, "environment": {**rollouts["environment"], "age": torch.zeros(3)}}
    for broken in (unseen, aged):
        torch.save({**state, "learner": {**state["learner"], "rollouts": broken}}, tmp_path / "checkpoint.pt")
        with pytest.raises(BadArgument, match="does not fit"):
            GaitTraining(GO2, tiny(3), tmp_path, resume=True).run()
    (tmp_path / "checkpoint.pt").write_bytes(b"broken")
    with pytest.raises(BadArgument, match="can be read"):
        GaitTraining(GO2, tiny(3), tmp_path, resume=True).run()


def test_advantages_worked_by_hand():
    """gamma 0.9, lambda 0.5; three robots: one goes on, one falls in the second step, one's time is up then.

    On: deltas 1 + .9 * 2 - 1 = 1.8, 2 + .9 * 3 - 2 = 2.7, 3 + .9 * 4 - 3 = 3.6;
    3.6, then 2.7 + .45 * 3.6 = 4.32, then 1.8 + .45 * 4.32 = 3.744.
    Fallen: the second delta is 2 - 2 = 0, and the third step's is not carried over; 1.8 + .45 * 0 = 1.8.
    Time up: the second delta is 2 + .9 * 2 - 2 = 1.8, not carried over either; 1.8 + .45 * 1.8 = 2.61.
    """
    values = torch.tensor([1.0, 2.0, 3.0]).reshape(3, 1, 1).expand(3, 3, 1).contiguous()
    rewards = torch.tensor([1.0, 2.0, 3.0]).reshape(3, 1, 1).expand(3, 3, 1).contiguous()
    terminated, truncated = torch.zeros(2, 3, 3, 1, dtype=torch.bool)
    terminated[1, 1], truncated[1, 2] = True, True
    rollout = Rollout.zeros(3, 3, {"observation": 1}, 1)._replace(
        value=values, reward=rewards, done=terminated | truncated, terminated=terminated,
        following=following_values(values, torch.full((3, 1), 4.0), truncated),
    )  # fmt: skip
    advantage, target = advantages(rollout, 0.9, 0.5)
    expected = torch.tensor([[3.744, 1.8, 2.61], [4.32, 0.0, 1.8], [3.6, 3.6, 3.6]])
    assert torch.allclose(advantage[..., 0], expected, atol=1e-5)
    assert torch.allclose(target, advantage + values, atol=1e-5)
