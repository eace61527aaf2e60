import json

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from robots.bodies.go2 import GO2
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.network import (
    FORMAT,
    WEIGHTS_FOLDER,
    BadObservation,
    BadWeights,
    PolicyNetwork,
    gait_contract,
    load_policy,
)

METADATA = {"format": FORMAT, "robot": "go2", "gait": gait_contract(GO2)}


def tensors():
    return load_file(WEIGHTS_FOLDER / GO2.weights)


def refused(path, content, metadata):
    save_file(content, path, metadata)
    with pytest.raises(BadWeights) as caught:
        load_policy(GO2, path)
    return str(caught.value)


def test_network_is_what_numpy_computes():
    t, policy = tensors(), load_policy(GO2)
    observation = np.random.default_rng(0).normal(size=OBSERVATION_SIZE)
    x = np.clip((observation - t["mean"]) * t["scale"], -10.0, 10.0)
    for k in range(3):
        x = t[f"weight_{k}"] @ x + t[f"bias_{k}"]
        if k < 2:
            x = np.where(x < 0.0, np.expm1(x), x)
    action = np.empty(ACTION_SIZE)
    policy(observation, action)
    assert action == pytest.approx(x, abs=1e-4)


def test_weights_of_another_robot_are_refused(tmp_path):
    message = refused(tmp_path / "w.safetensors", tensors(), METADATA | {"robot": "a1"})
    assert "robot is 'a1', expected 'go2'" in message


def test_weights_of_another_nominal_gait_are_refused(tmp_path):
    assert "gait is" in refused(tmp_path / "w.safetensors", tensors(), METADATA | {"gait": "{}"})


@pytest.mark.parametrize("name", ["mean", "weight_1", "bias_0", "bias_2"])
def test_a_missing_tensor_is_named(tmp_path, name):
    content = tensors()
    del content[name]
    assert f"no tensor {name!r}" in refused(tmp_path / "w.safetensors", content, METADATA)


def test_a_tensor_of_another_shape_is_named(tmp_path):
    content = tensors() | {"weight_0": np.zeros((128, 10), np.float32)}
    assert "'weight_0' has shape (128, 10)" in refused(tmp_path / "w.safetensors", content, METADATA)


def test_weights_that_are_not_finite_are_refused(tmp_path):
    content = tensors()
    content["bias_1"][3] = np.nan
    assert "'bias_1'" in refused(tmp_path / "w.safetensors", content, METADATA)


def test_what_is_no_weights_file_is_refused(tmp_path):
    (tmp_path / "w.safetensors").write_bytes(b"no weights")
    with pytest.raises(BadWeights, match="not a safetensors file"):
        load_policy(GO2, tmp_path / "w.safetensors")
    with pytest.raises(BadWeights, match="vuca train locomotion --robot go2"):
        load_policy(GO2, tmp_path / "nowhere.safetensors")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_observation_that_is_not_finite_raises_and_says_which(bad):
    observation = np.zeros(OBSERVATION_SIZE)
    observation[17] = bad
    with pytest.raises(BadObservation, match="observation 17 of 49"):
        load_policy(GO2)(observation, np.zeros(ACTION_SIZE))


def test_weights_too_large_for_single_precision_are_refused(tmp_path):
    content = tensors()
    content["bias_1"] = content["bias_1"].astype(np.float64)
    content["bias_1"][3] = 1e300
    assert "'bias_1'" in refused(tmp_path / "w.safetensors", content, METADATA)


def test_an_empty_layer_and_a_scale_of_zero_are_refused(tmp_path):
    empty = {"weight_0": np.zeros((0, OBSERVATION_SIZE), np.float32), "bias_0": np.zeros(0, np.float32)}
    empty["weight_1"] = np.zeros((128, 0), np.float32)
    assert "'bias_0' is empty" in refused(tmp_path / "w.safetensors", tensors() | empty, METADATA)
    content = tensors()
    content["scale"][5] = 0.0
    assert "'scale'" in refused(tmp_path / "w.safetensors", content, METADATA)


def test_weights_in_bfloat16_are_refused(tmp_path):
    header = {"__metadata__": METADATA, "mean": {"dtype": "BF16", "shape": [2], "data_offsets": [0, 4]}}
    text = json.dumps(header).encode()
    (tmp_path / "w.safetensors").write_bytes(len(text).to_bytes(8, "little") + text + bytes(4))
    with pytest.raises(BadWeights, match="'mean' is of type BF16"):
        load_policy(GO2, tmp_path / "w.safetensors")


def test_an_action_that_is_not_finite_raises_and_is_not_given():
    huge = tensors()
    huge["weight_2"][:] = 3e38
    action = np.zeros(ACTION_SIZE)
    with pytest.raises(BadObservation, match="gait action 0 of 12"):
        PolicyNetwork(huge)(np.ones(OBSERVATION_SIZE), action)
    assert not action.any()
