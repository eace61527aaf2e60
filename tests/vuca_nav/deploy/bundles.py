"""Small bundles for tests, made without a simulator."""

from pathlib import Path

import numpy as np
from safetensors.numpy import save

from tests.vuca_nav.random_policy import metadata, random_tensors
from vuca_nav.build import StackConfig
from vuca_nav.deploy.bundle import as_yaml
from vuca_nav.deploy.manifest import NAVIGATOR, POLICY, ROBOT, STEPS, write_bundle
from vuca_nav.deploy.robot_file import robot_file_of
from vuca_nav.shield.shield import ShieldConfig
from vuca_nav.types import BodySpec, LidarSpec

ABOUT = {"robot": "box", "method": "net"}
CONFIG = StackConfig(weights=Path(POLICY), shield=ShieldConfig(margin=0.0625))


def body(name: str = "box") -> BodySpec:
    """A box of 0.6 x 0.4 m."""
    corners = np.array([[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]])
    return BodySpec(name, corners, 1.0, -0.2, 0.0, 1.0, 1.0, 0.0, 2.0)


def files(name: str = "box") -> dict[str, bytes]:
    """The files of a bundle of a random network."""
    return {
        NAVIGATOR: as_yaml(CONFIG, "a test"),
        ROBOT: as_yaml(robot_file_of(body(name), LidarSpec(height=0.25)), "a test"),
        POLICY: save(random_tensors(hidden=8, gate=(8,), critic=8), metadata()),
        STEPS: save({"commands": np.zeros((1, 3), np.float32)}),
    }


def write(out: Path, **about: object) -> Path:
    """Write such a bundle."""
    write_bundle(out, files(), {**ABOUT, **about})
    return out
