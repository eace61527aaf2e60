"""Damaged weights files: each is refused in one line, or gives a network that acts."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import save

from tests.fuzz import FAST, SLOW
from tests.vuca_nav.random_policy import metadata, random_tensors
from vuca_nav.errors import BadWeights
from vuca_nav.policy.network import PolicyNetwork
from vuca_nav.policy.weights_file import load_weights

WHOLE = save(random_tensors(hidden=8, gate=(8,), critic=8), metadata())
HEADER_END = 8 + int.from_bytes(WHOLE[:8], "little")
HEADER = json.loads(WHOLE[8:HEADER_END])


def refused_or_usable(path: Path) -> bool:
    """Whether a file is accepted; its network then acts, and the file is otherwise refused in one line."""
    try:
        weights = load_weights(path)
    except BadWeights as error:
        text = str(error)
        assert str(path) in text
        assert text.isprintable()
        assert len(text) < 1000 + len(str(path))
        return False
    action = np.full(3, math.nan)
    network = PolicyNetwork(weights)
    observation = np.linspace(-1.0, 1.0, weights.observation.size, dtype=np.float32)
    assert network.act(observation, action)
    assert (np.abs(action) <= 1.0).all()
    assert network.shares.sum() == pytest.approx(1.0)
    return True


def check_bytes(tmp_path, edits):
    path, content = tmp_path / "w.safetensors", bytearray(WHOLE)
    for at, removed, added in edits:
        content[at : at + removed] = added
    path.write_bytes(bytes(content))
    refused_or_usable(path)


edits = st.lists(
    st.tuples(
        st.one_of(st.integers(0, 8), st.integers(8, HEADER_END), st.integers(0, len(WHOLE))),
        st.sampled_from([0, 1, 4, 8, 1000]),
        st.one_of(st.binary(max_size=8), st.sampled_from([b"9" * 8, b'"', b"[", b"{", b"-", b"\x00\x00\xc0\x7f"])),
    ),
    min_size=1,
    max_size=4,
)
junk = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.lists(st.integers(), max_size=4)
)


@st.composite
def headers(draw):
    """The header with some of its entries replaced or left out."""
    header = json.loads(json.dumps(HEADER))
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(HEADER)))
        if name not in header:
            continue
        how = draw(st.sampled_from(["drop", "junk", "field", "field", "field", "rename"]))
        if how == "drop":
            del header[name]
        elif how == "rename":
            header[draw(st.text(max_size=8))] = header.pop(name)
        elif how == "field" and isinstance(header[name], dict) and header[name]:
            key = draw(st.sampled_from(sorted(header[name])))
            shape = st.lists(st.integers(-1, 200), max_size=4)
            other = {"shape": shape, "data_offsets": st.lists(st.integers(0, len(WHOLE)), min_size=2, max_size=2)}
            header[name][key] = draw(st.one_of(other.get(key, junk), junk, st.text(max_size=20)))
        else:
            header[name] = draw(junk)
    return header


def check_header(tmp_path, header):
    text = json.dumps(header).encode()
    path = tmp_path / "w.safetensors"
    path.write_bytes(len(text).to_bytes(8, "little") + text + WHOLE[HEADER_END:])
    refused_or_usable(path)


def test_the_undamaged_file_is_usable(tmp_path):
    (tmp_path / "w.safetensors").write_bytes(WHOLE)
    assert refused_or_usable(tmp_path / "w.safetensors")


@FAST
@given(edits=edits)
def test_damaged_bytes(tmp_path, edits):
    check_bytes(tmp_path, edits)


@FAST
@given(header=headers())
def test_damaged_headers(tmp_path, header):
    check_header(tmp_path, header)


@pytest.mark.slow
@SLOW
@given(edits=edits)
def test_many_damaged_bytes(tmp_path, edits):
    check_bytes(tmp_path, edits)


@pytest.mark.slow
@SLOW
@given(header=headers())
def test_many_damaged_headers(tmp_path, header):
    check_header(tmp_path, header)
