"""Mirror symmetry: what is learnt on one side holds on the other."""

import torch
from torch import Tensor

from vuca_nav.policy.observation import ObservationConfig

ACTION_SIGNS = (1.0, -1.0, -1.0)
"""Signs of v_x, v_y and w_z under exchange of left and right."""


def observation_mirror(config: ObservationConfig) -> tuple[Tensor, Tensor]:
    """Make order (size,) and signs (size,): ``mirrored = observation[:, order] * signs``."""
    order, signs = config.mirror()
    return torch.from_numpy(order), torch.from_numpy(signs)
