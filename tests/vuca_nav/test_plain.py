"""Configurations as plain data and back: nothing is lost, and what does not belong is named."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pytest

from vuca_nav.build import StackConfig
from vuca_nav.errors import BadArgument, VucaError
from vuca_nav.plain import from_plain, to_plain
from vuca_nav.policy.dynamic_window import DynamicWindowConfig
from vuca_nav.policy.network import Gate
from vuca_nav.shield.shield import ShieldConfig
from vuca_nav.types import FloatArray, LidarSpec, Pose2


class Pair(NamedTuple):
    a: float
    b: int


@dataclass(frozen=True)
class Inner:
    kind: Literal["x", "y"]
    numbers: tuple[float, ...]

    def __post_init__(self):
        if len(self.numbers) > 2:
            raise BadArgument("numbers must be two at most")


@dataclass(frozen=True)
class Outer:
    inner: Inner
    pair: Pair
    points: FloatArray
    file: Path | Literal["own"] | None


GOOD = {"inner": {"kind": "x", "numbers": [1, 2.5]}, "pair": {"a": 1, "b": 2}, "points": [[0, 1.5]], "file": "own"}


def changed(**changes):
    return {**GOOD, **changes}


def test_every_kind_of_field_is_read():
    read = from_plain(Outer, GOOD, "f", VucaError)
    assert read.inner == Inner("x", (1.0, 2.5))
    assert read.pair == Pair(1.0, 2)
    assert isinstance(read.pair.a, float)
    np.testing.assert_array_equal(read.points, [[0.0, 1.5]])
    assert read.file == "own"
    assert from_plain(Outer, changed(file="w.bin"), "f", VucaError).file == Path("w.bin")
    assert from_plain(Outer, changed(file=None), "f", VucaError).file is None


@pytest.mark.parametrize(
    "config",
    [
        StackConfig(weights=Path("w"), shield=ShieldConfig(margin=1e-7), gate=Gate(without=2), critic=Path("c")),
        StackConfig(weights=Path("w"), critic="own-value", tracks="map"),
        StackConfig(window=DynamicWindowConfig(horizon=0.1 + 0.2)),
    ],
)
def test_a_stack_comes_back_to_the_bit(config):
    assert from_plain(StackConfig, to_plain(config), "f", VucaError) == config


def test_a_lidar_comes_back_with_its_mount():
    lidar = LidarSpec(num_beams=11, angle_min=-1.0, angle_increment=0.2, mount=Pose2(0.1, 0.2, 0.3))
    assert from_plain(LidarSpec, to_plain(lidar), "f", VucaError) == lidar


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (changed(inner={"kind": "z", "numbers": []}), "f: inner.kind is 'z', expected 'x' or 'y'"),
        (changed(inner={"kind": "x"}), "f: inner.numbers is missing"),
        (changed(inner={"kind": "x", "numbers": [1.0] * 3}), "f: inner: numbers must be two at most"),
        (changed(inner={"kind": "x", "numbers": ["1"]}), "f: inner.numbers[0] is '1', expected a number"),
        (changed(pair={"a": True, "b": 2}), "f: pair.a is True, expected a number"),
        (changed(pair={"a": float("nan"), "b": 2}), "f: pair.a is nan, expected a number"),
        (changed(pair={"a": 10**400, "b": 2}), "expected a number of double precision"),
        (changed(pair={"a": 1, "b": 2.0}), "f: pair.b is 2.0, expected a whole number"),
        (changed(points=[[1, 2], [3]]), "f: points[1] is [3], expected a point of 2 numbers"),
        (changed(points=[]), "f: points is [], expected a list of numbers or points"),
        (changed(file=3), "f: file is 3, expected a text"),
        (changed(more=1), "f: more: there is no such field (inner, pair, points, file)"),
        ([], "f: the whole is [], expected the fields inner, pair, points, file"),
    ],
)
def test_what_does_not_belong_is_named(value, message):
    with pytest.raises(VucaError) as caught:
        from_plain(Outer, value, "f", VucaError)
    assert message in str(caught.value)
