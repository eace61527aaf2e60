"""The network and the recipe of the baseline drl: its sizes, its file, and the same numbers with torch and without."""

import dataclasses

import numpy as np
import pytest
import torch

from tests.train.navigation.open_ground import OpenGround
from train.arena.config import KINDS
from train.navigation.config import RunConfig
from train.navigation.learner import make_local_learner
from train.navigation.networks import ConvolutionalActor, ConvolutionalTrunk, NetworkConfig, make_actor, make_critic_of
from train.navigation.stages import STAGES, find_stage
from train.navigation.training import check_run
from train.navigation.weights import actor_of, export, find_sources, start_from
from train.ppo.team import Alone
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.policy.drl_network import convolved_size
from vuca_nav.policy.network import ConvolutionalNetwork, Gate, make_network
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import load_weights

FRAMES = ObservationConfig(kind="frames", sectors=90, history=2)
CONV = NetworkConfig(architecture="convolutional", initial_std=0.5)


def networks(observation=FRAMES, seed=0):
    generator = torch.Generator().manual_seed(seed)
    actor, critic = (make(observation, CONV, generator) for make in (make_actor, make_critic_of))
    assert isinstance(actor, ConvolutionalActor)
    for trunk in (actor.trunk, critic):  # biases that matter, and outputs of some size
        for parameter in trunk.parameters():
            parameter.data += 0.05 * torch.randn(parameter.shape, generator=generator)
    return actor, critic


@pytest.fixture
def file(tmp_path):
    actor, critic = networks()
    path = tmp_path / "drl.safetensors"
    export(path, "drl", actor, critic, CONV, FRAMES, 10.0, {})
    return path


@pytest.mark.parametrize(("sectors", "flat"), [(512, 4096), (180, 1440), (90, 704)])
def test_the_network_has_the_shapes_of_the_reproduction(sectors, flat):
    """4096 inputs of the first layer for 512 beams, as there."""
    actor, critic = networks(dataclasses.replace(FRAMES, sectors=sectors))
    assert convolved_size(sectors) == flat
    for trunk, outputs in ((actor.trunk, 2), (critic, 1)):
        assert isinstance(trunk, ConvolutionalTrunk)
        shapes = [tuple(layer.weight.shape) for layer in (*trunk.convolution_layers, *trunk.layers)]
        assert shapes == [(32, 3, 5), (32, 32, 3), (256, flat), (128, 260), (outputs, 128)]
        assert [(c.stride, c.padding) for c in trunk.convolution_layers] == [((2,), (1,))] * 2
    assert not {id(p) for p in actor.parameters()} & {id(p) for p in critic.parameters()}


def test_actions_are_forward_and_within_the_limits():
    actor, _ = networks()
    mean = actor.act(torch.randn(200, FRAMES.size) * 5.0)
    assert mean.shape == (200, 2)
    assert ((mean[:, 0] >= 0.0) & (mean[:, 0] <= 1.0) & (mean[:, 1].abs() <= 1.0)).all()
    shares = actor.shares(torch.tensor([[-0.4, 1.7], [0.3, -0.2], [1.4, -3.0]]))
    assert shares.numpy() == pytest.approx(np.array([[0.0, 0.0, 1.0], [0.3, 0.0, -0.2], [1.0, 0.0, -1.0]]))


@pytest.mark.parametrize("sectors", [90, 512])
def test_the_same_actions_with_torch_and_without(tmp_path, sectors):
    observation = dataclasses.replace(FRAMES, sectors=sectors)
    actor, critic = networks(observation, 1)
    path = tmp_path / "a.safetensors"
    export(path, "a", actor, critic, CONV, observation, 10.0, {})
    network = make_network(load_weights(path))
    assert isinstance(network, ConvolutionalNetwork)
    rng, action = np.random.default_rng(0), np.zeros(3)
    seen = rng.uniform(-0.5, 0.5, (50, observation.size)).astype(np.float32)
    seen[:, observation.goal_slice] = rng.uniform(-10.0, 10.0, (50, 2))
    with torch.no_grad():
        expected = actor.shares(actor.act(torch.from_numpy(seen))).numpy()
    for row, wanted in zip(seen, expected):
        assert network.act(row, action)
        assert np.abs(action - wanted).max() < 1e-5
    assert expected.std(0)[[0, 2]].min() > 0.02


def test_what_is_not_finite_gives_no_action(file):
    network, action = make_network(load_weights(file)), np.full(3, 0.25)
    seen = np.zeros(FRAMES.size, np.float32)
    seen[100] = np.nan
    assert not network.act(seen, action)
    assert action.tolist() == [0.25] * 3


def test_the_second_stage_starts_as_the_first_ended(file):
    taught, critic = networks()
    actor, other = networks(seed=5)
    start_from(actor, other, find_sources([file], CONV, FRAMES), 0.05, torch.Generator())
    x = torch.randn(16, FRAMES.size)
    assert torch.equal(actor.act(x), taught.act(x))
    assert torch.equal(other(x), critic(x))
    assert actor.std().tolist() == pytest.approx([0.5, 0.5])


def test_a_file_that_is_not_such_a_network_is_refused(file, tmp_path):
    from safetensors.numpy import load_file, save_file

    tensors, metadata = load_file(file), load_weights(file).metadata
    assert load_weights(file).experts == 1
    wrong = tmp_path / "wrong.safetensors"
    save_file(tensors | {"conv_weight_1": tensors["conv_weight_1"][:, :, :2]}, wrong, metadata)
    with pytest.raises(BadWeights, match=r"conv_weight_1.*\(32, 32, 3\)"):
        load_weights(wrong)
    save_file({name: t for name, t in tensors.items() if name != "critic_conv_bias_0"}, wrong, metadata)
    with pytest.raises(BadWeights, match="critic_conv_bias_0"):
        load_weights(wrong)
    save_file(tensors, wrong, metadata | {"activation": "elu"})
    with pytest.raises(BadWeights, match="relu"):
        load_weights(wrong)
    with pytest.raises(BadArgument, match="has 1, which it needs"):
        make_network(load_weights(file), Gate(without=1))
    with pytest.raises(BadArgument, match="network of convolutions"):
        actor_of(load_weights(file))
    with pytest.raises(BadArgument, match="looks at"):
        find_sources([file], CONV, dataclasses.replace(FRAMES, sectors=180))


def test_it_learns_to_walk_to_its_goal():
    stage = find_stage("drl-circle")
    ppo = dataclasses.replace(stage.ppo, worlds=64, horizon=16, first_rate=1e-3, last_rate=1e-3)
    stage = dataclasses.replace(stage, ppo=ppo, observation=ObservationConfig(kind="frames", sectors=8, history=2))

    class Forward(OpenGround):
        """Goals ahead of the robot, which may wait or drive."""

        def step(self, action):
            assert (action[:, 1] == 0.0).all()
            assert ((action[:, 0] >= 0.0) & (action[:, 0] <= 1.0)).all()
            self.goals = np.abs(self.goals) * [1.0, 0.0]
            return super().step(action)

    mind = make_local_learner(stage, 0, Alone(), Forward(stage, 64))
    mind.restart()
    reports = [mind.iterate(k / 12) for k in range(12)]
    assert reports[-1]["reward/R_g"] > 1.1 * reports[0]["reward/R_g"]
    assert "gate/entropy" not in reports[0]
    assert set(reports[0]) >= {"std/v_x", "std/w_z"}


def test_the_recipe_is_that_of_the_reproduction_where_it_prints_one():
    first, second = find_stage("drl-circle"), find_stage("drl")
    assert (first.arena.robots, second.arena.robots) == (24, 44)
    assert first.arena.circle == second.arena.hall == 1.0
    assert second.sources == ("drl-circle",)
    for stage in (first, second):
        ppo = stage.ppo
        assert (ppo.horizon, ppo.gamma, ppo.lambda_, ppo.clip, ppo.entropy) == (128, 0.99, 0.95, 0.1, 5e-4)
        assert (stage.observation.kind, stage.observation.max_range, stage.observation.history) == ("frames", 6.0, 2)
        assert ppo.worlds % stage.arena.robots == 0
        assert stage.rewards == "drl"
        assert all(getattr(stage.arena, kind) == 0.0 for kind in KINDS)


def test_what_does_not_go_together_is_refused(monkeypatch):
    stage = STAGES["drl"]
    with pytest.raises(BadArgument, match="'convolutional' goes with 'frames'"):
        dataclasses.replace(stage, observation=ObservationConfig())
    with pytest.raises(BadArgument, match="do not make whole worlds of 44 robots"):
        check_run(dataclasses.replace(stage, ppo=dataclasses.replace(stage.ppo, worlds=48)), RunConfig(0, 1, ()))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: True)
    with pytest.raises(BadArgument, match="--collector ray trains fused networks"):
        check_run(stage, RunConfig(0, 1, (), collector="ray"))
