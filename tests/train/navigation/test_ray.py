import dataclasses

import pytest
import torch

from train.arena.config import ArenaConfig
from train.navigation import training as run_module
from train.navigation.config import NavigationPpoConfig, RunConfig
from train.navigation.environment import ArenaEnvironment
from train.navigation.networks import FusedActor, NetworkConfig
from train.navigation.stages import StageConfig
from train.navigation.training import NavigationTraining
from train.ppo.estimates import log_prob
from train.ppo.learner import PpoLearner
from train.ppo.run_directory import read_log
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import load_weights

PPO = NavigationPpoConfig(worlds=8, horizon=16, minibatch=64, epochs=2)
NETWORK = NetworkConfig(experts=2, hidden=16, gate=8, critic=16)
ARENA = ArenaConfig(layouts=2, pairs=8, num_bodies=4).of("mixed")
NEEDS_RAY = "needs Ray, which has an environment of its own: make test-ray"
STAGE = StageConfig("tiny", "For tests.", "fusion", ARENA, ObservationConfig(sectors=6), NETWORK, PPO, 4 * 8 * 16)


def run(out, **options):
    training = NavigationTraining(STAGE, RunConfig(1, 2, (), collector="ray"), out, ArenaEnvironment, **options)
    training.run()
    return training.weights


@pytest.mark.slow
def test_two_workers_on_a_local_ray_feed_the_learner(tmp_path, monkeypatch):
    pytest.importorskip("ray", reason=NEEDS_RAY)
    monkeypatch.setattr(NavigationTraining, "save_every", 2)
    weights = run(tmp_path / "whole")
    assert load_weights(weights).experts == 2
    rows = read_log(tmp_path / "whole" / "log.jsonl")
    assert [row["iteration"] for row in rows] == [1, 2, 3, 4]
    assert any(row["episodes/ended"] > 0 for row in rows)
    # Interrupted after a checkpoint it ends with the same weights.
    real = PpoLearner.iterate

    def torn(self, progress):
        if self.iteration == 3:
            raise KeyboardInterrupt
        return real(self, progress)

    with monkeypatch.context() as patch:
        patch.setattr(PpoLearner, "iterate", torn)
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path / "torn")
    assert run(tmp_path / "torn", resume=True).read_bytes() == weights.read_bytes()
    with pytest.raises(BadArgument, match="collector"):
        NavigationTraining(STAGE, RunConfig(1, 2, ()), tmp_path / "torn", ArenaEnvironment, resume=True)


@pytest.mark.slow
def test_a_batch_from_ray_is_what_the_present_policy_did():
    pytest.importorskip("ray", reason=NEEDS_RAY)
    from train.navigation.ray_cluster import ray_learner

    with ray_learner(STAGE, 0, 2) as learner, torch.no_grad():
        learner.restart()
        actor = learner.actor
        assert isinstance(actor, FusedActor)
        last = None
        for _ in range(3):
            for parameter in actor.parameters():  # as an update would
                parameter += 0.1 * torch.randn(parameter.shape, generator=torch.Generator().manual_seed(0))
            rollout, report = learner.rollouts.collect(0.0, torch.Generator())
            observations = rollout.seen["observation"]
            flat = observations.flatten(0, 1)
            mean = actor.mean(flat, actor.gate(flat))
            expected = log_prob(rollout.action.flatten(0, 1), mean, actor.std())
            assert torch.allclose(rollout.log_prob.flatten(), expected, atol=1e-4)
            assert torch.allclose(rollout.value, learner.critic(observations))
            assert report["episodes/ended"] == int(rollout.done.sum())
            assert last is None or not torch.equal(observations[0], last)
            last = observations[-1].clone()
            # No two rows, and so no two workers, are in the same episode.
            assert len({tuple(row) for row in observations[0].tolist()}) == PPO.worlds
            assert report["episodes/timed_out"] == 0.0  # too early for that
            paid = float(rollout.reward.sum()) / PPO.worlds / PPO.horizon / PPO.reward_scale
            assert paid == pytest.approx(report["reward/total"], abs=1e-5)
            ended = report["episodes/ended"] / PPO.worlds / PPO.horizon
            assert report["reward/R_c"] == pytest.approx(-15.0 * ended * report["episodes/collided"], abs=1e-5)
            assert report["reward/R_r"] == pytest.approx(20.0 * ended * report["episodes/reached"], abs=1e-5)
    with (
        pytest.raises(BadArgument, match="need a core each"),
        ray_learner(dataclasses.replace(STAGE, ppo=dataclasses.replace(PPO, worlds=1 << 14)), 0, 1 << 14),
    ):
        pass


def test_without_ray_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(run_module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(BadArgument, match="distributed"):
        NavigationTraining(STAGE, RunConfig(0, 2, (), collector="ray"), tmp_path, ArenaEnvironment)


def test_a_cluster_may_have_more_cores_than_this_computer(tmp_path, monkeypatch):
    monkeypatch.setattr(run_module.importlib.util, "find_spec", lambda name: name == "ray")  # nothing is collected here
    ppo = dataclasses.replace(PPO, worlds=4096, minibatch=4096)
    stage = dataclasses.replace(STAGE, ppo=ppo)
    NavigationTraining(stage, RunConfig(0, 1024, (), collector="ray"), tmp_path, ArenaEnvironment)
