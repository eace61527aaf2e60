"""What ``config.json`` of an evaluation holds of its making: versions, commit, noise, all settings of the method."""

import importlib.metadata
from dataclasses import asdict

from eval.episode import EpisodeConfig
from eval.methods import resolve, settings_of
from eval.store import Row
from robots.noise import NoiseConfig
from robots.registry import make_body
from vuca_nav.provenance import commit


def provenance(config: EpisodeConfig) -> Row:
    """Everything that decides on the bits of a result: versions, commit, libraries, all settings.

    Args:
        config: An episode of the evaluation. The settings are those of its robot and method with all difficulties:
            a task names those that it leaves out.

    Raises:
        VucaError: There is no such robot or method, or it cannot be built.
    """
    made_by: Row = {
        name: importlib.metadata.version(name) for name in ("vuca-nav", "mujoco", "numpy", "numba", "scipy")
    }
    body = make_body(config.robot)
    settings = settings_of(resolve(config.method, config.options), body.spec, body.lidar)
    return {**made_by, "commit": commit(), "noise": asdict(NoiseConfig()), **settings}
