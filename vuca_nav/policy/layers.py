"""Layers of networks, in single precision, added up in a fixed order whatever the processor."""

import math

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit


def inputs_first(weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Matrix (..., inputs, outputs) of a layer, for ``layer``, from (..., outputs, inputs)."""
    return np.ascontiguousarray(np.swapaxes(weight, -1, -2))


@njit(cache=True, nogil=True)
def layer(x, weights, bias):
    """Linear layer ``W x + b``, (outputs,), added up in the order of the inputs; ``weights`` is (inputs, outputs)."""
    out = bias.copy()
    for i in range(len(x)):
        xi = x[i]
        if xi != 0.0:
            for j in range(len(out)):
                out[j] += weights[i, j] * xi
    return out


@njit(cache=True, nogil=True)
def activate(values, elu):
    """Apply ELU, or else ReLU, in place."""
    if elu:
        for i in range(len(values)):
            if values[i] < 0.0:
                values[i] = math.expm1(values[i])
    else:
        for i in range(len(values)):
            values[i] = max(values[i], np.float32(0.0))
