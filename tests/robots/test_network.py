import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from robots.go2 import GO2
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.network import FORMAT, WEIGHTS_FOLDER, BadObservation, BadWeights, gait_contract, load_policy

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
