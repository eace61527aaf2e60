"""The network of Long et al., evaluated without torch: two convolutions over the frames of the scan, and three layers.

Sizes as in the public reproduction, https://github.com/Acmece/rl-collision-avoidance; only the number of beams differs.
"""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit
from vuca_nav.policy.frames import GOAL_SIZE, SPEED_SIZE
from vuca_nav.policy.layers import activate, layer

CONVOLUTIONS = ((32, 5), (32, 3))
"""Channels and width of the kernel of each convolution."""
STRIDE, PADDING = 2, 1
HIDDEN = (256, 128)
"""Units of the two hidden layers; the second reads goal and speed, too."""
SCALARS = GOAL_SIZE + SPEED_SIZE
OUTPUTS = 2
"""Number of outputs: v, by a sigmoid, and w, by a tangent."""


def convolved_size(sectors: int) -> int:
    """Number of values that the convolutions make of frames of so many sectors, 0 or less if these are too few."""
    for _, kernel in CONVOLUTIONS:
        sectors = (sectors + 2 * PADDING - kernel) // STRIDE + 1
    return CONVOLUTIONS[-1][0] * sectors


def network_shapes(frames: int, sectors: int, outputs: int, stack: tuple[int, ...] = ()) -> dict[str, tuple[int, ...]]:
    """Shapes of the tensors of a network that reads frames of so many sectors.

    Args:
        frames: Number of frames.
        sectors: Sectors of a frame.
        outputs: Number of outputs.
        stack: Leading dimensions of the layers' tensors.

    Returns:
        Shapes by the names in a weights file: ``conv_weight_k``, ``conv_bias_k``, ``weight_k`` and ``bias_k``.
    """
    shapes: dict[str, tuple[int, ...]] = {}
    for k, (channels, kernel) in enumerate(CONVOLUTIONS):
        shapes |= {f"conv_weight_{k}": (channels, frames, kernel), f"conv_bias_{k}": (channels,)}
        frames = channels
    sizes = ((convolved_size(sectors), HIDDEN[0]), (HIDDEN[0] + SCALARS, HIDDEN[1]), (HIDDEN[1], outputs))
    for k, (inputs, units) in enumerate(sizes):
        shapes |= {f"weight_{k}": (*stack, units, inputs), f"bias_{k}": (*stack, units)}
    return shapes


class ConvolutionalLayers(NamedTuple):
    """A policy for the kernel."""

    mean: np.ndarray
    """(x,) mean that is subtracted from the observation."""
    scale: np.ndarray
    """(x,) factor that the difference is multiplied by."""
    sectors: int
    """Sectors of a frame."""
    convolutions: tuple[np.ndarray, np.ndarray]
    """(channels in, width, channels out) of each convolution. Like the layers' they are transposed: the kernels add up
    rows of outputs, which vectorises without reordering a sum."""
    convolution_biases: tuple[np.ndarray, np.ndarray]
    """(channels,) of each convolution."""
    weights: tuple[np.ndarray, np.ndarray, np.ndarray]
    """(inputs, outputs) of each layer; the inputs of the first are ordered by place, then channel."""
    biases: tuple[np.ndarray, np.ndarray, np.ndarray]
    """(outputs,) of each layer."""


@njit(cache=True, nogil=True)
def act_by_convolutions(observation, action, layers):
    """Compute the mean action for an observation.

    Args:
        observation: (x,) numbers, an observation of kind ``frames``.
        action: (3,) shares of the body's limits, written to; left alone if any number is not finite.
        layers: A ``ConvolutionalLayers``.

    Returns:
        Whether observation and action are finite.
    """
    sectors, channels = layers.sectors, layers.convolutions[0].shape[0]
    count = sectors * channels
    x = np.empty(len(observation), np.float32)
    for i in range(len(observation)):
        if not math.isfinite(observation[i]):
            return False
        x[i] = (observation[i] - layers.mean[i]) * layers.scale[i]
    scan = np.empty((sectors, channels), np.float32)
    for c in range(channels):
        for s in range(sectors):
            scan[s, c] = x[c * sectors + s]
    once = _convolve(scan, layers.convolutions[0], layers.convolution_biases[0])
    twice = _convolve(once, layers.convolutions[1], layers.convolution_biases[1])
    hidden = layer(twice.ravel(), layers.weights[0], layers.biases[0])
    activate(hidden, False)
    joined = layer(np.concatenate((hidden, x[count:])), layers.weights[1], layers.biases[1])
    activate(joined, False)
    out = layer(joined, layers.weights[2], layers.biases[2])
    if not (math.isfinite(out[0]) and math.isfinite(out[1])):
        return False
    action[0], action[1], action[2] = 1.0 / (1.0 + math.exp(-out[0])), 0.0, math.tanh(out[1])
    return True


@njit(cache=True, nogil=True)
def _convolve(x, weights, bias):
    """Convolution and ReLU of (places, channels in), (places, channels out)."""
    inputs, kernel, channels = weights.shape
    places = (len(x) + 2 * PADDING - kernel) // STRIDE + 1
    out = np.empty((places, channels), np.float32)
    for p in range(places):
        row = out[p]
        row[:] = bias
        for w in range(kernel):
            at = p * STRIDE + w - PADDING
            if 0 <= at < len(x):
                for c in range(inputs):
                    value = x[at, c]
                    if value != 0.0:
                        for j in range(channels):
                            row[j] += weights[c, w, j] * value
        activate(row, False)
    return out


def arrange(
    normalisation: tuple[np.ndarray, np.ndarray], sectors: int,
    convolutions: list[tuple[np.ndarray, np.ndarray]], layers: list[tuple[np.ndarray, np.ndarray]],
) -> ConvolutionalLayers:  # fmt: skip
    """Arrange the tensors of a weights file for the kernel.

    Args:
        normalisation: Mean and scale of the observation, each (x,).
        sectors: Sectors of a frame.
        convolutions: Weight (channels, inputs, width) and bias of each convolution.
        layers: Weight (outputs, inputs) and bias of each layer.
    """
    channels = len(convolutions[-1][1])
    (first, *others), biases = [weight for weight, _ in layers], [bias for _, bias in layers]
    # Torch flattens channels first.
    first = first.reshape(len(first), channels, -1).transpose(0, 2, 1).reshape(len(first), -1)
    kernels = [np.ascontiguousarray(weight.transpose(1, 2, 0)) for weight, _ in convolutions]
    weights = [np.ascontiguousarray(weight.T) for weight in (first, *others)]
    return ConvolutionalLayers(
        *normalisation, sectors, (kernels[0], kernels[1]), (convolutions[0][1], convolutions[1][1]),
        (weights[0], weights[1], weights[2]), (biases[0], biases[1], biases[2]),
    )  # fmt: skip
