"""Weights files that were made to do harm are refused in one line, without much memory."""

import json
import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save

from tests.vuca_nav.random_policy import metadata, random_tensors
from vuca_nav.errors import BadWeights
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.safetensors_file import MOST_HEADER


def written(tmp_path: Path, header: bytes, data: bytes = b"", size: int | None = None) -> Path:
    path = tmp_path / "w.safetensors"
    path.write_bytes((len(header) if size is None else size).to_bytes(8, "little") + header + data)
    return path


def entry(dtype="F32", shape=(2,), offsets=(0, 8)) -> dict:
    return {"dtype": dtype, "shape": list(shape), "data_offsets": list(offsets)}


def refusal(path: Path) -> str:
    tracemalloc.start()
    try:
        with pytest.raises(BadWeights) as caught:
            load_weights(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 40e6
    text = str(caught.value)
    assert "w.safetensors" in text
    assert "\n" not in text
    assert len(text) < 600 + len(str(path))
    return text


@pytest.mark.parametrize("size", [0, 1, 10**6, 2**31, 2**63, 2**64 - 1])
def test_a_header_of_another_length(tmp_path, size):
    assert f"its header has {size} bytes" in refusal(written(tmp_path, b"{}", b"", size))


def test_a_header_that_is_large(tmp_path):
    header = json.dumps({"__metadata__": {"a": "x" * MOST_HEADER}}).encode()
    assert f"at most {MOST_HEADER} are read" in refusal(written(tmp_path, header))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"[" * 100_000, "nested too deeply"),
        (b"[1, 2]", "not a JSON object"),
        (b"nul", "not JSON"),
        (b"\xff\xff", "not a text in UTF-8"),
        (b'{"mean": 1}', "is of type None"),
        (b'{"mean": {"dtype": ["F32"]}}', "is of type ['F32']"),
        (json.dumps({"__metadata__": [1]}).encode(), "metadata that are not texts by name"),
        (json.dumps({"__metadata__": {"format": 1}}).encode(), "metadata that are not texts by name"),
        (json.dumps({"mean": entry("BF16")}).encode(), "of type BF16"),
        (json.dumps({"mean": entry("U64")}).encode(), "of type U64"),
        (b'{"a": {"dtype": "F32"}, "a": {"dtype": "F32"}}', "the key 'a' a second time"),
        (json.dumps({"\x1b[2J" * 1000: entry("I8")}).encode(), "tensor '"),
    ],
)
def test_a_header_that_is_none(tmp_path, header, message):
    text = refusal(written(tmp_path, header, bytes(8)))
    assert message in text
    assert "\x1b" not in text


@pytest.mark.parametrize(
    "tensors",
    [
        {"a": entry(), "b": entry(offsets=(4, 12))},  # they overlap
        {"a": entry(), "b": entry()},
        {"a": entry(offsets=(0, 16))},  # more than the shape says
        {"a": entry(offsets=(8, 0))},
        {"a": entry(offsets=(-8, 0))},
        {"a": entry(offsets=(0, 2**70))},
        {"a": entry(offsets=(4, 12))},  # a hole
        {"a": entry(shape=(2**40, 2**40))},
        {"a": entry(shape=(2**63, 2))},
        {"a": entry(shape=(2**64, 0), offsets=(0, 0))},
        {"a": entry(shape=(2**63, 0), offsets=(0, 0))},
        {"a": entry(shape=(0, 2**62, 2**62), offsets=(0, 0))},
        {"a": entry(shape=(-2,))},
        {"a": entry(shape=("x",))},
        {"a": entry(shape=(1,) * 200)},
        {"a": entry(shape=(10**9, 10**9))},
    ],
)
def test_tensors_that_do_not_fit_the_data(tmp_path, tensors):
    header = json.dumps({"__metadata__": metadata(), **tensors}).encode()
    refusal(written(tmp_path, header, bytes(16)))


def test_a_file_that_was_cut_off(tmp_path):
    whole = save(random_tensors(), metadata())
    for length in (0, 3, 8, 100, len(whole) // 2, len(whole) - 1):
        (tmp_path / "w.safetensors").write_bytes(whole[:length])
        refusal(tmp_path / "w.safetensors")


def test_what_is_no_regular_file(tmp_path):
    (tmp_path / "folder.w.safetensors").mkdir()
    assert "Is a directory" in refusal(tmp_path / "folder.w.safetensors")
    os.mkfifo(tmp_path / "w.safetensors")
    assert "a pipe" in refusal(tmp_path / "w.safetensors")
    with pytest.raises(BadWeights, match="no policy weights at"):
        load_weights(Path("a" * 5000))


@pytest.mark.parametrize(
    ("value", "message"), [(np.nan, "not finite"), (-np.inf, "not finite"), (3e38, "beyond 1e+06")]
)
@pytest.mark.parametrize("name", ["weight_1", "gate_bias_0", "critic_weight_2", "mean", "scale"])
def test_numbers_that_no_network_can_be_trusted_with(tmp_path, name, value, message):
    tensors = random_tensors()
    tensors[name].flat[1] = value
    (tmp_path / "w.safetensors").write_bytes(save(tensors, metadata()))
    text = refusal(tmp_path / "w.safetensors")
    assert f"tensor {name!r}" in text
    assert message in text


@pytest.mark.parametrize(
    "observation",
    [
        "[" * 50_000,
        '{"sectors": 1e400}',
        json.dumps({"sectors": 10**9, "max_range": 6.0, "history": 3, "spacing": 0.1, "kind": "paper"}),
        json.dumps({"sectors": True, "max_range": 6.0, "history": 3, "spacing": 0.1, "kind": "paper"}),
        json.dumps({"sectors": 60, "max_range": "6", "history": 3, "spacing": 0.1, "kind": "paper"}),
        json.dumps({"sectors": 60, "max_range": 10**400, "history": 3, "spacing": 0.1, "kind": "paper"}),
        json.dumps({"sectors": 60, "max_range": 6.0, "history": 3, "spacing": None, "kind": "paper"}),
        json.dumps({"sectors": 60, "max_range": 6.0, "history": 3, "spacing": 0.1, "kind": ["paper"]}),
        "NaN",
        "9" * 5000,
    ],
)
def test_an_observation_that_is_none(tmp_path, observation):
    (tmp_path / "w.safetensors").write_bytes(save(random_tensors(), {**metadata(), "observation": observation}))
    assert "observation is" in refusal(tmp_path / "w.safetensors")


def test_more_experts_than_are_read(tmp_path):
    (tmp_path / "w.safetensors").write_bytes(save(random_tensors(experts=65), metadata()))
    assert "'weight_0' has 65 experts, at most 64 are read" in refusal(tmp_path / "w.safetensors")
