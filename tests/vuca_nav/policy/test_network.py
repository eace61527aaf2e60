import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from tests.vuca_nav.random_policy import metadata, random_policy, random_tensors
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.policy.network import UNIFORM_GATE, Gate, PolicyNetwork
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import load_weights


def activate(x: np.ndarray, kind: str) -> np.ndarray:
    return np.maximum(x, 0.0) if kind == "relu" else np.where(x < 0.0, np.expm1(x), x)


def by_definition(tensors, observation, activation, shares=None):
    """Action and shares: the weights fused first, W = sum_n a_n W_n, in double precision."""
    t = {name: tensor.astype(np.float64) for name, tensor in tensors.items()}
    x = (observation - t["mean"]) * t["scale"]
    if shares is None:
        depth = sum(name.startswith("gate_weight") for name in t)
        y = x
        for k in range(depth):
            y = t[f"gate_weight_{k}"] @ y + t[f"gate_bias_{k}"]
            y = np.maximum(y, 0.0) if k < depth - 1 else y
        shares = np.exp(y) / np.exp(y).sum()
    for k in range(3):
        weight = np.einsum("n,noi->oi", shares, t[f"weight_{k}"])
        x = weight @ x + shares @ t[f"bias_{k}"]
        x = activate(x, activation) if k < 2 else np.tanh(x)
    return x, shares


@pytest.mark.parametrize("activation", ["relu", "elu"])
@pytest.mark.parametrize("gate", [(16,), (16, 8)])
@pytest.mark.parametrize("kind", ["paper", "tracked"])
def test_what_it_computes_is_the_fused_network_of_the_definition(tmp_path, activation, gate, kind):
    config = ObservationConfig(kind=kind)
    path = random_policy(tmp_path / "p.safetensors", config, activation, gate=gate)
    network = PolicyNetwork(load_weights(path))
    rng = np.random.default_rng(1)
    for _ in range(5):
        observation = rng.uniform(-1.0, 1.0, config.size).astype(np.float32)
        action = np.empty(3)
        assert network.act(observation, action)
        right, shares = by_definition(random_tensors(config, gate=gate), observation, activation)
        assert action == pytest.approx(right, abs=2e-6)
        assert network.shares == pytest.approx(shares, abs=1e-6)
        assert shares.max() > 0.3  # no uniform gate by chance


def test_the_gate_can_be_overruled(tmp_path):
    weights = load_weights(random_policy(tmp_path / "p.safetensors"))
    observation = np.random.default_rng(2).uniform(-1.0, 1.0, weights.observation.size).astype(np.float32)
    _, learned = by_definition(random_tensors(), observation, "relu")
    without = np.where(np.arange(4) == 2, 0.0, learned)
    for gate, shares in ((UNIFORM_GATE, np.full(4, 0.25)), (Gate(without=3), without / without.sum())):
        network, action = PolicyNetwork(weights, gate), np.empty(3)
        assert network.act(observation, action)
        assert network.shares == pytest.approx(shares, abs=1e-6)
        assert action == pytest.approx(by_definition(random_tensors(), observation, "relu", shares)[0], abs=2e-6)
    both, action = PolicyNetwork(weights, Gate(uniform=True, without=1)), np.empty(3)
    assert both.act(observation, action)
    assert both.shares == pytest.approx([0.0, 1 / 3, 1 / 3, 1 / 3])


def test_there_must_be_an_expert_to_leave_out(tmp_path):
    for number in (0, 5):
        with pytest.raises(BadArgument, match=f"cannot leave out expert {number}: .* has 4, numbered 1 to 4"):
            PolicyNetwork(load_weights(random_policy(tmp_path / "p.safetensors")), Gate(without=number))
    with pytest.raises(BadArgument, match="which it needs"):
        PolicyNetwork(load_weights(random_policy(tmp_path / "p.safetensors", experts=1)), Gate(without=1))


def test_a_single_network_needs_no_gate(tmp_path):
    weights = load_weights(random_policy(tmp_path / "p.safetensors", experts=1, activation="elu"))
    observation, action = np.linspace(-1.0, 1.0, weights.observation.size, dtype=np.float32), np.empty(3)
    assert PolicyNetwork(weights).act(observation, action)
    right, _ = by_definition(random_tensors(experts=1), observation, "elu", np.ones(1))
    assert action == pytest.approx(right, abs=2e-6)


def test_what_is_not_finite_gives_no_action(tmp_path):
    network = PolicyNetwork(load_weights(random_policy(tmp_path / "p.safetensors")))
    observation, action = np.zeros(126, np.float32), np.full(3, 7.0)
    observation[5] = np.nan
    assert not network.act(observation, action)
    assert (action == 7.0).all()


def replaced(**changes):
    """Metadata with some entries replaced; None leaves one out."""
    return {name: text for name, text in {**metadata(), **changes}.items() if text is not None}


def observation_text(**changes) -> str:
    return json.dumps({**asdict(ObservationConfig()), **changes})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (replaced(format=None), "format is None, expected 'vuca-policy-1'"),
        (replaced(format="vuca-gait-1"), "format is 'vuca-gait-1'"),
        (replaced(activation="gelu"), "activation is 'gelu', expected one of relu, elu"),
        (replaced(observation=None), "its observation is not one"),
        (replaced(observation="[1]"), r"observation is \[1\], expected the fields"),
        (replaced(observation='{"sectors": 60}'), "expected the fields"),
        (replaced(observation=observation_text(sectors="sixty")), "its observation is not one"),
        (replaced(observation=observation_text(kind="other")), "of kind paper or tracked"),
        (replaced(observation=observation_text(sectors=30)), r"'mean' has shape \(126,\), expected \(66,\)"),
    ],
)
def test_bad_metadata_is_named(tmp_path: Path, content, message):
    save_file(random_tensors(), tmp_path / "p.safetensors", content)
    with pytest.raises(BadWeights, match=message) as caught:
        load_weights(tmp_path / "p.safetensors")
    assert "p.safetensors" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight_1": None}, "no tensor 'weight_1'"),
        ({"weight_0": None}, "no tensor 'weight_0'"),
        ({"bias_0": None}, "no tensor 'bias_0'"),
        ({"gate_weight_1": None}, "no tensor 'gate_weight_1'"),
        ({"critic_bias_2": None}, "no tensor 'critic_bias_2'"),
        ({"mean": None}, "no tensor 'mean'"),
        ({"weight_0": np.zeros((32, 126), np.float32)}, r"'weight_0' has shape \(32, 126\)"),
        ({"weight_0": np.zeros((0, 32, 126), np.float32)}, r"'weight_0' has shape \(0, 32, 126\)"),
        ({"weight_0": np.zeros((3, 32, 126), np.float32)}, r"'bias_0' has shape \(4, 32\), expected \(3, 32\)"),
        ({"weight_2": np.zeros((4, 2, 32), np.float32)}, r"'weight_2' has shape \(4, 2, 32\), expected \(4, 3, 32\)"),
        ({"bias_1": np.zeros((4, 0), np.float32)}, "'bias_1' is empty"),
        ({"bias_1": np.zeros((), np.float32)}, "'bias_1' is empty"),
        ({"gate_bias_1": np.zeros(5, np.float32)}, r"'gate_bias_1' has shape \(5,\), expected \(4,\)"),
        ({"critic_weight_0": np.full((24, 126), np.nan, np.float32)}, "'critic_weight_0' holds numbers that are not"),
        ({"bias_2": np.full((4, 3), 1e300)}, "'bias_2' holds numbers that are not finite in single"),
        ({"scale": np.zeros(126, np.float32)}, "'scale' holds numbers that are not positive"),
        ({"mean": np.zeros(126, np.int32)}, "'mean' is of type I32"),
        ({"log_std": np.zeros(3, np.float32)}, "'log_std' does not belong there"),
    ],
)
def test_bad_tensors_are_named(tmp_path: Path, change, message):
    tensors = {name: tensor for name, tensor in {**random_tensors(), **change}.items() if tensor is not None}
    save_file(tensors, tmp_path / "p.safetensors", metadata())
    with pytest.raises(BadWeights, match=message) as caught:
        load_weights(tmp_path / "p.safetensors")
    assert "p.safetensors" in str(caught.value)


def test_a_missing_or_foreign_file_is_named(tmp_path: Path):
    with pytest.raises(BadWeights, match="vuca train all"):
        load_weights(tmp_path / "none.safetensors")
    (tmp_path / "p.safetensors").write_bytes(b"not this")
    with pytest.raises(BadWeights, match="not a safetensors file"):
        load_weights(tmp_path / "p.safetensors")
