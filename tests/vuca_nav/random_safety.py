"""A safety critic's file with random numbers in it."""

import json
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from vuca_nav.exploration.critic import FORMAT
from vuca_nav.policy.observation import ObservationConfig

TRACKED = ObservationConfig(kind="tracked")


def random_tensors(hidden: int = 24) -> dict[str, np.ndarray]:
    """Every tensor of the format, scaled so that chances differ and none is certain."""
    rng = np.random.default_rng(0)
    tensors = {}
    for k, (inputs, outputs) in enumerate(pairwise((TRACKED.size, hidden, hidden, 1))):
        tensors[f"weight_{k}"] = rng.normal(size=(outputs, inputs)) / np.sqrt(inputs)
        tensors[f"bias_{k}"] = 0.3 * rng.normal(size=outputs)
    return {name: tensor.astype(np.float32) for name, tensor in tensors.items()}


def random_safety(path: Path, changes: dict[str, str | None] | None = None) -> Path:
    """A whole file; ``changes`` replace what it says of itself, None leaves out."""
    says = {"format": FORMAT, "observation": json.dumps(asdict(TRACKED)), **(changes or {})}
    save_file(random_tensors(), path, {name: text for name, text in says.items() if text is not None})
    return path
