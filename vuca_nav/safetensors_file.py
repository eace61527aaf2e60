"""Weights files (safetensors, never pickle), read with suspicion: every fault names the file and what is wrong."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vuca_nav.data_files import parse_json, read_bytes, shown
from vuca_nav.errors import BadWeights

DTYPES = ("F16", "F32", "F64")
"""Types that tensors may have, as safetensors names them; they are used as F32."""
MOST_BYTES = 256 * 2**20
"""Greatest size of a file [bytes]; the largest that is shipped has 0.8 MB."""
MOST_HEADER = 2**20
"""Greatest size of a header [bytes]; those that are shipped have less than 2 kB."""
MOST_WEIGHT = 1e6
"""Greatest magnitude of a number in a tensor: three layers of a thousand units then stay below the greatest number of
single precision. Those that are shipped have less than 10."""


def read_weights(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Tensors and metadata of a file that exists.

    Raises:
        BadWeights: If it is not a regular file, is not safetensors, is too large, or a tensor is not of floating point.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    content = read_bytes(path, MOST_BYTES, BadWeights)
    metadata = _checked_header(path, content)
    try:
        return load(content), metadata
    except (SafetensorError, ValueError, OverflowError) as error:
        raise BadWeights(f"{path} is not a safetensors file: {shown(error, 200)}") from error


def _checked_header(path: Path, content: bytes) -> dict[str, str]:
    """The metadata of a file whose header is small and names tensors of floating point only."""
    size, broken = int.from_bytes(content[:8], "little"), f"{path} is not a safetensors file: its header"
    if not 2 <= size <= min(len(content) - 8, MOST_HEADER):
        raise BadWeights(f"{broken} has {size} bytes, in a file of {len(content)}; at most {MOST_HEADER} are read")
    try:
        text = content[8 : 8 + size].decode()
    except UnicodeDecodeError:
        raise BadWeights(f"{broken} is not a text in UTF-8") from None
    header = parse_json(text, broken, BadWeights)
    if not isinstance(header, dict):
        raise BadWeights(f"{broken} is not a JSON object")
    metadata = header.pop("__metadata__", {})
    if not isinstance(metadata, dict) or not all(isinstance(value, str) for value in metadata.values()):
        raise BadWeights(f"{broken} has metadata that are not texts by name")
    for name, entry in header.items():
        dtype = entry.get("dtype") if isinstance(entry, dict) else None
        if dtype not in DTYPES:
            raise BadWeights(
                f"{path}: tensor {shown(name)!r} is of type {shown(dtype)}, expected one of {', '.join(DTYPES)}"
            )
    return metadata


def present(path: Path, tensors: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """The tensor of that name.

    Raises:
        BadWeights: If there is none.
    """
    if name not in tensors:
        raise BadWeights(f"{path} has no tensor {name!r} (it has: {shown(', '.join(sorted(tensors)), 500)})")
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
        raise BadWeights(
            f"{path}: tensor {shown(odd[0])!r} does not belong there (expected: {', '.join(sorted(shapes))})"
        )
    return {name: checked(path, tensors, name, shape) for name, shape in shapes.items()}


def checked(path: Path, tensors: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """The tensor of that name, in single precision.

    Raises:
        BadWeights: If it is missing, of another shape, or holds numbers that are not finite or beyond ``MOST_WEIGHT``;
            ``scale`` must be positive, too.
    """
    tensor = present(path, tensors, name)
    if tensor.shape != shape:
        raise BadWeights(f"{path}: tensor {name!r} has shape {tensor.shape}, expected {shape}")
    with np.errstate(over="ignore"):
        single = tensor.astype(np.float32)
    if not np.isfinite(single).all():
        raise BadWeights(f"{path}: tensor {name!r} holds numbers that are not finite in single precision")
    if (np.abs(single) > MOST_WEIGHT).any():
        raise BadWeights(f"{path}: tensor {name!r} holds numbers beyond {MOST_WEIGHT:g}, as no trained network does")
    if name == "scale" and not (single > 0.0).all():
        raise BadWeights(f"{path}: tensor 'scale' holds numbers that are not positive")
    return single
