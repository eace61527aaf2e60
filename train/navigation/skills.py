"""The four skills of Zhang et al., Section III-B, read off an observation: what a gate can be taught first."""

import math

import torch
from torch import Tensor

from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.task import NEAR_RANGE

SKILLS = ("forward", "emergency stop", "turn", "backward")
"""Names of the skills in the order of the experts: copies of go-straight, obstacle-avoidance, go-straight and
obstacle-avoidance."""
AHEAD = math.radians(45.0)
"""Half of the sector ahead that is searched for obstacles [rad]."""
NEAR, TOO_NEAR = NEAR_RANGE, 0.3
"""Clearances ahead at which to stop, and to back off [m]; the first is where R_o begins to count."""
ASIDE = math.radians(35.0)
"""Angle off the heading from which on a goal asks for a turn [rad]."""


def skill_labels(observation: Tensor, config: ObservationConfig) -> Tensor:
    """Label the skill that each observation calls for.

    Args:
        observation: Observations, (n, size).
        config: Composition of the observation.

    Returns:
        (n,) indices into ``SKILLS``: backward if an obstacle ahead is too near, otherwise emergency stop if it is near,
        otherwise turn if the goal is aside, otherwise forward.
    """
    sectors = config.sectors
    middles = -math.pi + (torch.arange(sectors) + 0.5) * (2.0 * math.pi / sectors)
    ahead = middles.abs() < max(AHEAD, math.pi / sectors + 1e-6)
    clearance = 0.5 * (observation[:, :sectors][:, ahead].amin(1) + 1.0) * config.max_range
    cosine = observation[:, config.goal_slice.start + 1]
    labels = (cosine < math.cos(ASIDE)).long() * 2
    labels[clearance < NEAR] = 1
    labels[clearance < TOO_NEAR] = 3
    return labels
