"""The shipped policy: a small multilayer perceptron in a safetensors file, evaluated without torch."""

import json
import math
import os
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.locomotion.config import QuadrupedConfig
from robots.locomotion.kernels import (
    ACTION_SIZE,
    GYRO_SCALE,
    OBSERVATION_SIZE,
    RATE_SCALE,
    TRIM_LIMIT,
    TRIM_RATE,
    TURN_TRIM_LIMIT,
)
from robots.locomotion.odometry import VELOCITY_GAIN
from vuca_nav.data_files import shown
from vuca_nav.errors import BadWeights, VucaError
from vuca_nav.kernel_cache import njit
from vuca_nav.safetensors_file import checked_all, present, read_weights

FORMAT = "vuca-gait-1"
WEIGHTS_FOLDER = Path(__file__).parent / "weights"
LAYERS = 3
CLIP = 10.0
"""Bound of the normalised observation, as in its training (train/locomotion)."""


class BadObservation(VucaError):
    """An observation that is not finite, so that no action can be trusted."""


def gait_contract(config: QuadrupedConfig) -> str:
    """Constants that a policy was trained with and must run with, as text for the weights' metadata."""
    spec = config.spec
    gait = {
        "kp": config.kp, "kd": config.kd, "action_scale": config.action_scale, "control_rate": config.control_rate,
        "slew": (spec.max_a_x, spec.max_a_y, spec.max_a_w), "side_slip": config.side_slip,
        "yaw_lever": config.yaw_lever, "velocity_gain": VELOCITY_GAIN, "trim_rate": TRIM_RATE,
        "trim_limits": (TRIM_LIMIT, TRIM_LIMIT, TURN_TRIM_LIMIT), "rate_scale": RATE_SCALE, "gyro_scale": GYRO_SCALE,
        **asdict(config.trot),
    }  # fmt: skip
    return json.dumps(gait, sort_keys=True)


class Layers(NamedTuple):
    """A policy's tensors with the memory for one evaluation, all of float32, as the kernels take them."""

    mean: NDArray[np.float32]
    """Mean, which is subtracted from the observation (OBSERVATION_SIZE,)."""
    scale: NDArray[np.float32]
    """Factor on the difference (OBSERVATION_SIZE,)."""
    weights_0: NDArray[np.float32]
    """First hidden layer (inputs, outputs)."""
    weights_1: NDArray[np.float32]
    """Second hidden layer (inputs, outputs)."""
    weights_2: NDArray[np.float32]
    """Output layer (inputs, outputs)."""
    bias_0: NDArray[np.float32]
    bias_1: NDArray[np.float32]
    bias_2: NDArray[np.float32]
    inputs: NDArray[np.float32]
    """Scratch: the normalised observation (OBSERVATION_SIZE,)."""
    hidden_0: NDArray[np.float32]
    """Scratch: the first hidden layer."""
    hidden_1: NDArray[np.float32]
    """Scratch: the second hidden layer."""
    outputs: NDArray[np.float32]
    """Scratch: the outputs (ACTION_SIZE,)."""


class PolicyNetwork:
    """Two hidden ELU layers on a normalised observation.

    Args:
        tensors: ``mean``, ``scale`` (inputs,), then ``weight_k`` (outputs, inputs) and ``bias_k`` for k = 0, 1, 2.

    Attributes:
        layers: The same tensors, for :func:`forward`.
    """

    def __init__(self, tensors: dict[str, NDArray[np.float32]]):
        # Transposed: the kernel adds up columns, which vectorises without reordering a sum.
        weights = [np.ascontiguousarray(tensors[f"weight_{k}"].T) for k in range(LAYERS)]
        biases = [tensors[f"bias_{k}"] for k in range(LAYERS)]
        scratch = [np.empty(size, np.float32) for size in (OBSERVATION_SIZE, *map(len, biases))]
        self.layers = Layers(tensors["mean"], tensors["scale"], *weights, *biases, *scratch)

    def __call__(self, observation: NDArray[np.float64], action: NDArray[np.float64]) -> None:
        """Compute the policy's mean action for an observation (OBSERVATION_SIZE,), into ``action`` (ACTION_SIZE,).

        Raises:
            BadObservation: If a number is not finite, or the result is not; says which. The action is left alone.
        """
        refuse_bad(forward(observation, action, self.layers), observation)


def refuse_bad(index: int, observation: NDArray[np.float64]) -> None:
    """Raise BadObservation for an index that :func:`forward` returned; -1 is none."""
    if index >= OBSERVATION_SIZE:
        raise BadObservation(f"gait action {index - OBSERVATION_SIZE} of {ACTION_SIZE} is not finite")
    if index >= 0:
        raise BadObservation(
            f"gait observation {index} of {OBSERVATION_SIZE} is {observation[index]}: expected a number"
        )


def load_policy(config: QuadrupedConfig, path: Path | None = None) -> PolicyNetwork:
    """Read a robot's policy.

    Args:
        config: Constants of the robot.
        path: File of the weights; by default those shipped.

    Raises:
        BadWeights: If the file is missing, is not safetensors, lacks a tensor or has one too many, or one of another
            shape or type or with a number that is not finite in single precision, or belongs to another robot or
            another nominal gait.
    """
    path = path or WEIGHTS_FOLDER / config.weights
    name = config.spec.name
    if not os.path.exists(path):
        raise BadWeights(
            f"no gait weights for {name!r} at {path}; make them with: vuca train locomotion --robot {name}"
        )
    tensors, metadata = read_weights(path)
    for key, right in (("format", FORMAT), ("robot", name), ("gait", gait_contract(config))):
        if metadata.get(key) != right:
            raise BadWeights(f"{path}: {key} is {shown(repr(metadata.get(key)), 1000)}, expected {right!r}")
    return PolicyNetwork(checked_all(path, tensors, _shapes(path, tensors)))


def _shapes(path: Path, tensors: dict[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    sizes = [OBSERVATION_SIZE]
    for k in range(LAYERS - 1):
        size = present(path, tensors, f"bias_{k}").size
        if size == 0:
            raise BadWeights(f"{path}: tensor 'bias_{k}' is empty, expected a hidden layer")
        sizes.append(size)
    sizes.append(ACTION_SIZE)
    shapes: dict[str, tuple[int, ...]] = {"mean": (OBSERVATION_SIZE,), "scale": (OBSERVATION_SIZE,)}
    for k in range(LAYERS):
        shapes[f"weight_{k}"], shapes[f"bias_{k}"] = (sizes[k + 1], sizes[k]), (sizes[k + 1],)
    return shapes


@njit(cache=True)
def forward(observation, action, layers):
    """Evaluate the policy.

    Args:
        observation: (OBSERVATION_SIZE,).
        action: Output (ACTION_SIZE,); left alone if a number is not finite.
        layers: A :class:`Layers`.

    Returns:
        Index of an input that is not finite; OBSERVATION_SIZE plus the index of an output that is not; else -1.
    """
    x, out = layers.inputs, layers.outputs
    for i in range(len(observation)):
        if not math.isfinite(observation[i]):
            return i
        value = (np.float32(observation[i]) - layers.mean[i]) * layers.scale[i]
        x[i] = min(max(value, np.float32(-CLIP)), np.float32(CLIP))
    _layer(x, layers.weights_0, layers.bias_0, layers.hidden_0)
    _elu(layers.hidden_0)
    _layer(layers.hidden_0, layers.weights_1, layers.bias_1, layers.hidden_1)
    _elu(layers.hidden_1)
    _layer(layers.hidden_1, layers.weights_2, layers.bias_2, out)
    for i in range(len(out)):
        if not math.isfinite(out[i]):
            return len(observation) + i
    for i in range(len(out)):
        action[i] = out[i]
    return -1


@njit(cache=True)
def _layer(x, weights, bias, out):
    out[:] = bias
    for i in range(len(x)):
        xi = x[i]
        for j in range(len(out)):
            out[j] += weights[i, j] * xi


@njit(cache=True)
def _elu(values):
    for i in range(len(values)):
        if values[i] < 0.0:
            values[i] = math.expm1(values[i])
