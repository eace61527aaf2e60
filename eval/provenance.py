"""What ``config.json`` of an evaluation holds of its making.

Versions, commit, the machine's arithmetic, noise, and all settings of the method.
"""

import importlib.metadata
from dataclasses import asdict

from eval.episode import EpisodeConfig
from eval.methods import resolve, settings_of
from eval.store import Row
from robots.arithmetic import fingerprint
from robots.noise import NoiseConfig
from robots.registry import make_body
from vuca_nav.provenance import commit


def provenance(config: EpisodeConfig) -> Row:
    """Everything that decides on the bits of a result: versions, commit, libraries, arithmetic, all settings.

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
    made_by |= {"commit": commit(), "arithmetic": fingerprint(), "noise": asdict(NoiseConfig())}
    return made_by | settings
