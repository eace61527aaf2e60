"""A gait that learned nothing: the nominal trot."""

import dataclasses
from pathlib import Path

import numpy as np
from safetensors.numpy import save_file

from robots.bodies.go2 import GO2
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.network import FORMAT, gait_contract
from robots.locomotion.quadruped import Quadruped


def untaught(folder: Path, **changes) -> Quadruped:
    """A Go2 whose policy always says zero, its weights in ``folder``, with other constants if any are named."""
    config = dataclasses.replace(GO2, **changes)
    sizes = (OBSERVATION_SIZE, 4, 4, ACTION_SIZE)
    tensors: dict[str, np.ndarray] = {
        "mean": np.zeros(OBSERVATION_SIZE, np.float32),
        "scale": np.ones(OBSERVATION_SIZE, np.float32),
    }
    for k in range(3):
        tensors[f"weight_{k}"] = np.zeros((sizes[k + 1], sizes[k]), np.float32)
        tensors[f"bias_{k}"] = np.zeros(sizes[k + 1], np.float32)
    path = folder / "untaught.safetensors"
    save_file(tensors, path, {"format": FORMAT, "robot": config.spec.name, "gait": gait_contract(config)})
    return Quadruped(config, path)
