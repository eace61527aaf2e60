import dataclasses

import numpy as np
import pytest
import torch

from train.navigation.gate_losses import entropy
from train.navigation.mirror import ACTION_SIGNS, observation_mirror
from train.navigation.networks import Activation, FusedActor, NetworkConfig, make_critic
from train.navigation.skills import SKILLS, skill_labels
from train.navigation.weights import actor_of, export, find_sources, start_from
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.policy.network import PolicyNetwork
from vuca_nav.policy.observation import ObservationConfig, Observer
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.types import BodySpec

SMALL = ObservationConfig(sectors=6)


def random_actor(experts, activation: Activation = "relu", inputs=SMALL.size, hidden=16):
    generator = torch.Generator().manual_seed(3)
    network = NetworkConfig(experts=experts, hidden=hidden, gate=8, critic=16, activation=activation)
    actor = FusedActor(inputs, network, generator)
    for parameter in actor.parameters():  # small first outputs and zero biases would hide mistakes
        parameter.data = torch.randn(parameter.shape, generator=generator) / parameter.shape[-1] ** 0.5
    critic = make_critic(inputs, network, generator)
    return network, actor, critic


@pytest.mark.parametrize("activation", ["relu", "elu"])
@pytest.mark.parametrize("experts", [1, 4])
def test_the_batch_equals_a_network_with_the_fused_weights_of_each_row(experts, activation):
    _, actor, _ = random_actor(experts, activation)
    x = torch.randn(32, SMALL.size, generator=torch.Generator().manual_seed(4))
    shares = actor.gate(x)
    assert shares.sum(-1).tolist() == pytest.approx([1.0] * 32, abs=1e-6)
    mean = actor.mean(x, shares)
    squash = torch.relu if activation == "relu" else torch.nn.functional.elu
    for row in range(32):
        h = x[row]
        for k, layer in enumerate(actor.layers):
            weight = (shares[row, :, None, None] * layer.weight).sum(0)
            bias = (shares[row, :, None] * layer.bias).sum(0)
            h = weight @ h + bias
            h = squash(h) if k < 2 else torch.tanh(h)
        assert torch.allclose(h, mean[row], atol=1e-5)


def test_a_sure_gate_leaves_one_expert():
    _, actor, _ = random_actor(4)
    x = torch.randn(8, SMALL.size, generator=torch.Generator().manual_seed(5))
    alone = FusedActor(SMALL.size, NetworkConfig(hidden=16), torch.Generator())
    for mine, all_ in zip(alone.layers, actor.layers):
        mine.weight.data, mine.bias.data = all_.weight.data[2:3], all_.bias.data[2:3]
    one_hot = torch.eye(4)[2].expand(8, 4)
    assert torch.allclose(actor.mean(x, one_hot), alone.mean(x, alone.gate(x)), atol=1e-6)


def test_the_entropy_of_a_gate():
    shares = torch.tensor([[0.25, 0.25, 0.25, 0.25], [1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0]])
    assert entropy(shares).tolist() == pytest.approx([np.log(4.0), 0.0, np.log(2.0)], abs=1e-6)


@pytest.mark.parametrize("kind", ["paper", "tracked", "frames"])
def test_what_a_mirrored_robot_sees_is_the_mirror_image(kind):
    config = ObservationConfig(sectors=9 if kind == "frames" else 12, kind=kind)
    outline = np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]])
    body = BodySpec("box", outline, 1.0, -0.5, 0.4, 1.2, 1.0, 1.0, 2.0)
    rng = np.random.default_rng(0)
    left, right = (Observer(config, [body], 36, 10.0) for _ in range(2))
    here, there = np.zeros((1, config.size), np.float32), np.zeros((1, config.size), np.float32)
    for _ in range(6):
        ranges = rng.uniform(0.5, 7.0, (1, 36))
        goal, twist, motion = rng.normal(size=(1, 2)), rng.normal(size=(1, 3)), 0.1 * rng.normal(size=(1, 3))
        left.observe(ranges, goal, twist, motion, here)
        mirrored = ranges[:, (-np.arange(36)) % 36]
        sign = np.array([1.0, -1.0, -1.0])
        right.observe(mirrored, goal * sign[:2], twist * sign, motion * sign, there)
    order, signs = (tensor.numpy() for tensor in observation_mirror(config))
    image = here[:, order] * signs
    assert image == pytest.approx(there, abs=1e-5)
    assert not np.allclose(image, here)
    twice = image[:, order] * signs
    assert twice == pytest.approx(here)
    assert ACTION_SIGNS == (1.0, -1.0, -1.0)


def test_experts_start_as_trained_networks(tmp_path):
    network, teacher, critic = random_actor(1)
    path = tmp_path / "a.safetensors"
    export(path, "a", teacher, critic, network, SMALL, 10.0, {})
    four, fused, fused_critic = random_actor(4)
    generator = torch.Generator().manual_seed(6)
    start_from(fused, fused_critic, find_sources([path] * 4, four, SMALL), 0.05, generator)
    x = torch.randn(64, SMALL.size, generator=generator)
    taught = teacher.mean(x, teacher.gate(x))
    first = fused.mean(x, torch.eye(4)[0].expand(64, 4))
    second = fused.mean(x, torch.eye(4)[1].expand(64, 4))
    assert torch.allclose(first, taught, atol=1e-6)
    assert not torch.allclose(second, taught, atol=1e-3)
    assert (second - taught).abs().mean() < 0.1
    assert torch.allclose(fused_critic(x), critic(x), atol=1e-6)


def test_what_cannot_be_started_from(tmp_path):
    network, teacher, critic = random_actor(1)
    path = tmp_path / "a.safetensors"
    with pytest.raises(BadWeights, match=r"a\.safetensors"):
        find_sources([path], network, SMALL)
    path.write_bytes(b"no")
    with pytest.raises(BadWeights, match=r"a\.safetensors"):
        find_sources([path], network, SMALL)
    export(path, "a", teacher, critic, network, SMALL, 10.0, {})
    with pytest.raises(BadArgument, match="looks at"):
        find_sources([path], network, ObservationConfig(sectors=6, history=2))
    with pytest.raises(BadArgument, match=r"expected 1 x \(24, 24\)"):
        find_sources([path], dataclasses.replace(network, hidden=24), SMALL)
    with pytest.raises(BadArgument, match="2 policies"):
        find_sources([path] * 2, network, SMALL)


@pytest.mark.parametrize("activation", ["relu", "elu"])
@pytest.mark.parametrize("experts", [1, 4])
def test_a_file_acts_without_torch_as_it_did_with_it(tmp_path, experts, activation):
    network, actor, critic = random_actor(experts, activation)
    path = tmp_path / "a.safetensors"
    export(path, "a", actor, critic, network, SMALL, 10.0, {"seed": "0"})
    weights = load_weights(path)
    assert weights.metadata["decision_rate"] == "10.0"
    assert weights.metadata["seed"] == "0"
    shipped, again = PolicyNetwork(weights), actor_of(weights)
    x = torch.randn(16, SMALL.size, generator=torch.Generator().manual_seed(7))
    with torch.no_grad():
        shares, mean = actor.gate(x), actor.mean(x, actor.gate(x))
        assert torch.equal(again.mean(x, again.gate(x)), mean)
    action = np.zeros(3)
    for row in range(16):
        assert shipped.act(x[row].numpy(), action)
        assert action == pytest.approx(mean[row].numpy(), abs=1e-5)
        assert shipped.shares == pytest.approx(shares[row].numpy(), abs=1e-5)


def test_the_same_policy_is_the_same_bytes(tmp_path):
    network, actor, critic = random_actor(4)
    notes = {f"note {k}": str(k) for k in range(20)}
    for name in "ab":
        export(tmp_path / name, "x", actor, critic, network, SMALL, 10.0, notes)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize(
    ("ahead", "behind", "bearing", "skill"),
    [
        (3.0, 3.0, 0.0, "forward"), (3.0, 0.1, 0.5, "forward"), (3.0, 3.0, 0.7, "turn"), (3.0, 3.0, -3.0, "turn"),
        (0.5, 3.0, 0.0, "emergency stop"), (0.5, 3.0, 2.0, "emergency stop"), (0.2, 3.0, 0.0, "backward"),
    ],
)  # fmt: skip
def test_the_skill_that_is_called_for(ahead, behind, bearing, skill):
    config = ObservationConfig(sectors=12)
    observation = torch.zeros(2, config.size)
    clearances = np.where(np.abs(np.arange(12) - 5.5) < 1.0, ahead, behind)  # the two sectors beside straight ahead
    observation[:, :12] = torch.tensor(2.0 * clearances / config.max_range - 1.0)
    goal = config.goal_slice.start
    observation[:, goal + 1], observation[:, goal + 2] = np.cos(bearing), np.sin(bearing)
    assert [SKILLS[label] for label in skill_labels(observation, config)] == [skill, skill]
