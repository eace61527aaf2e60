"""The ONNX graphs compute what the stack's networks compute, of any batch, by any gate."""

import json
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest

from eval.export.graphs import OPSET, critic_graph, policy_graph
from tests.vuca_nav.deploy.bundles import body
from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.random_safety import random_safety
from vuca_nav.deploy.contract import critic_contract, policy_contract
from vuca_nav.deploy.robot_file import robot_file_of
from vuca_nav.exploration.critic import CriticNetwork, load_critic, value_network
from vuca_nav.policy.network import Gate, make_network
from vuca_nav.policy.observation import ObservationConfig, command_from_action, limits_of
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.types import LidarSpec

ROBOT = robot_file_of(body(), LidarSpec())
TRACKED = ObservationConfig(kind="tracked")


def run(content, observations) -> Any:
    return onnxruntime.InferenceSession(content).run(None, {"observation": observations})


def observations_of(config, count=50):
    return np.random.default_rng(1).uniform(-1.0, 1.0, (count, config.size)).astype(np.float32)


@pytest.mark.parametrize(
    ("gate", "sizes"),
    [
        (Gate(), {}),
        (Gate(), {"activation": "elu", "gate": (16, 8)}),
        (Gate(uniform=True), {}),
        (Gate(without=3), {}),
        (Gate(uniform=True, without=1), {}),
        (Gate(), {"experts": 1}),
        (Gate(), {"observation": TRACKED}),
    ],
)
def test_the_policys_graph_is_the_policy(tmp_path, gate, sizes):
    weights = load_weights(random_policy(tmp_path / "w.safetensors", **sizes))
    observations = observations_of(weights.observation)
    content = policy_graph(weights, gate, body(), policy_contract(ROBOT, weights))
    actions, commands, shares = run(content, observations)
    network, action = make_network(weights, gate), np.zeros(3)
    for k, observation in enumerate(observations):
        assert network.act(observation, action)
        np.testing.assert_allclose(actions[k], action, atol=1e-5)
        np.testing.assert_allclose(commands[k], command_from_action(action, limits_of(body())), atol=1e-5)
        np.testing.assert_allclose(shares[k], network.shares, atol=1e-5)
    one = run(content, observations[7:8])
    np.testing.assert_allclose(one[0], actions[7:8], atol=1e-6)


def test_commands_go_backwards_by_their_own_limit(tmp_path):
    weights = load_weights(random_policy(tmp_path / "w.safetensors"))
    content = policy_graph(weights, Gate(), body(), {})
    actions, commands, _ = run(content, observations_of(weights.observation, 200))
    back = actions[:, 0] < 0.0
    assert back.any()
    np.testing.assert_allclose(commands[back, 0], 0.2 * actions[back, 0], rtol=1e-6)
    np.testing.assert_allclose(commands[~back, 0], actions[~back, 0], rtol=1e-6)


def test_the_network_of_long_et_al_is_the_same():
    weights = load_weights(WEIGHTS_FOLDER / "drl.safetensors")
    observations = observations_of(weights.observation)
    actions, _, shares = run(policy_graph(weights, Gate(), body(), policy_contract(ROBOT, weights)), observations)
    network, action = make_network(weights), np.zeros(3)
    for k, observation in enumerate(observations):
        network.act(observation, action)
        np.testing.assert_allclose(actions[k], action, atol=1e-5)
    np.testing.assert_array_equal(shares, np.ones((len(observations), 1)))


@pytest.mark.parametrize("own", [True, False])
def test_the_critics_graph_is_the_critic(tmp_path, own):
    if own:
        critic = value_network(load_weights(random_policy(tmp_path / "w.safetensors", activation="elu")))
    else:
        critic = load_critic(random_safety(tmp_path / "c.safetensors"))
    observations, network = observations_of(critic.observation), CriticNetwork(critic)
    (values,) = run(critic_graph(critic, critic_contract(ROBOT, critic)), observations)
    goals = critic.observation.goal_slice
    expected = [network.rate(row, row[None, goals])[0] for row in observations]
    np.testing.assert_allclose(values[:, 0], expected, atol=1e-5)


@pytest.mark.parametrize(
    "config", [ObservationConfig(), TRACKED, ObservationConfig(kind="frames", sectors=90, history=2)]
)
def test_the_contract_covers_every_number_of_the_observation(tmp_path, config):
    if config.kind == "frames":
        weights = load_weights(WEIGHTS_FOLDER / "drl.safetensors")
    else:
        weights = load_weights(random_policy(tmp_path / "w.safetensors", observation=config))
    contract = policy_contract(ROBOT, weights)["inputs"]["observation"]
    parts = contract["parts"]
    assert [part["start"] for part in parts] == [0, *(part["stop"] for part in parts[:-1])]
    assert parts[-1]["stop"] == config.size == contract["shape"][1]
    goal = next(part for part in parts if part["name"] in ("O_g", "goal"))
    assert slice(goal["start"], goal["stop"]) == config.goal_slice


def test_the_graph_carries_its_contract_and_its_opset(tmp_path):
    weights = load_weights(random_policy(tmp_path / "w.safetensors"))
    contract = policy_contract(ROBOT, weights)
    model = onnx.load_from_string(policy_graph(weights, Gate(), body(), contract))
    (entry,) = model.metadata_props
    assert (entry.key, json.loads(entry.value)) == ("vuca.contract", contract)
    assert [opset.version for opset in model.opset_import] == [OPSET]
    assert model.graph.input[0].type.tensor_type.shape.dim[0].dim_param == "N"
