"""The policy as it is shipped: a small multilayer perceptron in a safetensors file, evaluated without torch."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numba import njit
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
from vuca_nav.errors import BadWeights, VucaError
from vuca_nav.weights import checked, present, read_weights

FORMAT = "vuca-gait-1"
WEIGHTS_FOLDER = Path(__file__).parent / "weights"
LAYERS = 3
CLIP = 10.0
"""Of the normalised observation."""


class BadObservation(VucaError):
    """An observation that is not finite: no action can be trusted."""


def gait_contract(config: QuadrupedConfig) -> str:
    """What a policy was trained around, and must be run around: as text, for the weights' metadata."""
    spec = config.spec
    gait = {
        "kp": config.kp, "kd": config.kd, "action_scale": config.action_scale, "control_rate": config.control_rate,
        "slew": (spec.max_a_x, spec.max_a_y, spec.max_a_w), "side_slip": config.side_slip,
        "yaw_lever": config.yaw_lever, "velocity_gain": VELOCITY_GAIN, "trim_rate": TRIM_RATE,
        "trim_limits": (TRIM_LIMIT, TRIM_LIMIT, TURN_TRIM_LIMIT), "rate_scale": RATE_SCALE, "gyro_scale": GYRO_SCALE,
        **asdict(config.trot),
    }  # fmt: skip
    return json.dumps(gait, sort_keys=True)


class PolicyNetwork:
    """Two hidden ELU layers on a normalised observation.

    Args:
        tensors: ``mean``, ``scale`` (inputs,), then ``weight_k`` (outputs, inputs) and ``bias_k`` for k = 0, 1, 2.
    """

    def __init__(self, tensors: dict[str, NDArray[np.float32]]):
        # Transposed: the kernel adds up columns, which vectorises without reordering a sum.
        weights = [np.ascontiguousarray(tensors[f"weight_{k}"].T) for k in range(LAYERS)]
        biases = [tensors[f"bias_{k}"] for k in range(LAYERS)]
        scratch = [np.empty(size, np.float32) for size in (OBSERVATION_SIZE, *map(len, biases))]
        self._arrays = (tensors["mean"], tensors["scale"], *weights, *biases, *scratch)

    def __call__(self, observation: NDArray[np.float64], action: NDArray[np.float64]) -> None:
        """The policy's mean action for an observation (OBSERVATION_SIZE,), into ``action`` (ACTION_SIZE,).

        Raises:
            BadObservation: If a number is not finite, or what comes of it is not; says which. The action is left alone.
        """
        bad = _forward(observation, action, *self._arrays)
        if bad >= OBSERVATION_SIZE:
            raise BadObservation(f"gait action {bad - OBSERVATION_SIZE} of {ACTION_SIZE} is not finite")
        if bad >= 0:
            raise BadObservation(
                f"gait observation {bad} of {OBSERVATION_SIZE} is {observation[bad]}: expected a number"
            )


def load_policy(config: QuadrupedConfig, path: Path | None = None) -> PolicyNetwork:
    """Read a robot's policy.

    Args:
        config: The robot.
        path: Of the weights; by default those shipped.

    Raises:
        BadWeights: If the file is missing, is not safetensors, lacks a tensor or has one of another shape or
            type or with a number that is not finite in single precision, or belongs to another robot or another
            nominal gait.
    """
    path = path or WEIGHTS_FOLDER / config.weights
    name = config.spec.name
    if not path.is_file():
        raise BadWeights(
            f"no gait weights for {name!r} at {path}; make them with: vuca train locomotion --robot {name}"
        )
    tensors, metadata = read_weights(path)
    for key, right in (("format", FORMAT), ("robot", name), ("gait", gait_contract(config))):
        if metadata.get(key) != right:
            raise BadWeights(f"{path}: {key} is {metadata.get(key)!r}, expected {right!r}")
    return PolicyNetwork({key: checked(path, tensors, key, shape) for key, shape in _shapes(path, tensors).items()})


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
def _forward(observation, action, mean, scale, w0, w1, w2, b0, b1, b2, x, h0, h1, h2):
    """Returns the index of an input that is not finite, or behind those of an output, -1 if there is none."""
    for i in range(len(observation)):
        if not math.isfinite(observation[i]):
            return i
        value = (np.float32(observation[i]) - mean[i]) * scale[i]
        x[i] = min(max(value, np.float32(-CLIP)), np.float32(CLIP))
    _layer(x, w0, b0, h0)
    _elu(h0)
    _layer(h0, w1, b1, h1)
    _elu(h1)
    _layer(h1, w2, b2, h2)
    for i in range(len(h2)):
        if not math.isfinite(h2[i]):
            return len(observation) + i
    for i in range(len(h2)):
        action[i] = h2[i]
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
