"""Weights files with random numbers in them, for tests of what reads and runs them."""

import json
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import FORMAT

PAPER = ObservationConfig()


def random_tensors(
    observation: ObservationConfig = PAPER,
    experts: int = 4,
    hidden: int = 32,
    gate: tuple[int, ...] = (16,),
    critic: int = 24,
    seed: int = 0,
) -> dict[str, np.ndarray]:
    """Every tensor of the format, scaled so that no layer saturates."""
    rng = np.random.default_rng(seed)
    x = observation.size
    tensors = {"mean": 0.1 * rng.normal(size=x), "scale": rng.uniform(0.5, 2.0, x)}

    def layers(prefix: str, sizes: list[int], stack: tuple[int, ...] = ()) -> None:
        for k, (inputs, outputs) in enumerate(pairwise(sizes)):
            tensors[f"{prefix}weight_{k}"] = rng.normal(size=(*stack, outputs, inputs)) / np.sqrt(inputs)
            tensors[f"{prefix}bias_{k}"] = 0.3 * rng.normal(size=(*stack, outputs))

    layers("", [x, hidden, hidden, 3], (experts,))
    layers("critic_", [x, critic, critic, 1])
    if experts > 1:
        layers("gate_", [x, *gate, experts])
    return {name: tensor.astype(np.float32) for name, tensor in tensors.items()}


def metadata(observation: ObservationConfig = PAPER, activation: str = "relu") -> dict[str, str]:
    """What a file says of itself."""
    return {"format": FORMAT, "activation": activation, "observation": json.dumps(asdict(observation))}


def random_policy(path: Path, observation: ObservationConfig = PAPER, activation: str = "relu", **sizes) -> Path:
    """A whole file."""
    save_file(random_tensors(observation, **sizes), path, metadata(observation, activation))
    return path
