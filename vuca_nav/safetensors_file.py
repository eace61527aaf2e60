"""Weights files (safetensors, never pickle), read with suspicion: every fault names the file and what is wrong."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vuca_nav.errors import BadWeights

DTYPES = ("F16", "F32", "F64")
"""Types that tensors may have, as safetensors names them; they are used as F32."""


def read_weights(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Tensors and metadata of a file that exists.

    Raises:
        BadWeights: If it is not safetensors, or a tensor is not of floating point.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            names = list(file.keys())
            for name in names:
                dtype = file.get_slice(name).get_dtype()
                if dtype not in DTYPES:
                    raise BadWeights(f"{path}: tensor {name!r} is of type {dtype}, expected one of {', '.join(DTYPES)}")
            return {name: file.get_tensor(name) for name in names}, metadata
    except (SafetensorError, OSError, ValueError) as error:
        raise BadWeights(f"{path} is not a safetensors file: {error}") from error


def present(path: Path, tensors: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """The tensor of that name.

    Raises:
        BadWeights: If there is none.
    """
    if name not in tensors:
        raise BadWeights(f"{path} has no tensor {name!r} (it has: {', '.join(sorted(tensors))})")
    return tensors[name]


def checked_all(
    path: Path, tensors: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, NDArray[np.float32]]:
    """The tensors of these names and shapes, as ``checked`` gives them.

    Raises:
        BadWeights: If one is missing or not as it must be, or there is one more.
    """
    odd = sorted(set(tensors) - set(shapes))
    if odd:
        raise BadWeights(f"{path}: tensor {odd[0]!r} does not belong there (expected: {', '.join(sorted(shapes))})")
    return {name: checked(path, tensors, name, shape) for name, shape in shapes.items()}


def checked(path: Path, tensors: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """The tensor of that name, in single precision.

    Raises:
        BadWeights: If it is missing, of another shape, or holds numbers that are not finite; ``scale`` must be
            positive, too.
    """
    tensor = present(path, tensors, name)
    if tensor.shape != shape:
        raise BadWeights(f"{path}: tensor {name!r} has shape {tensor.shape}, expected {shape}")
    with np.errstate(over="ignore"):
        single = tensor.astype(np.float32)
    if not np.isfinite(single).all():
        raise BadWeights(f"{path}: tensor {name!r} holds numbers that are not finite in single precision")
    if name == "scale" and not (single > 0.0).all():
        raise BadWeights(f"{path}: tensor 'scale' holds numbers that are not positive")
    return single
