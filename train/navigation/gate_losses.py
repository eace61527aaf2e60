"""Losses of a gate beside the policy's rewards: its mutual information, and the skills it is taught."""

import math

from tensordict import TensorDict
from torch import Tensor, nn

from train.navigation.config import NavigationPpoConfig
from train.navigation.networks import FusedActor, NetworkConfig
from train.navigation.skills import SKILLS, skill_labels
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig


class GateLoss:
    """The gate's shares for the actor, its mutual information, and the skills it is taught first.

    Args:
        actor: The actor with the gate.
        observation: The observation that it reads.
        config: Weights of the terms.

    Raises:
        BadArgument: If a gate is to be taught that has not four experts.
    """

    def __init__(
        self, actor: FusedActor, network: NetworkConfig, observation: ObservationConfig, config: NavigationPpoConfig
    ):
        if config.teach_gate and (network.experts != len(SKILLS) or config.critic_first < 1):
            raise BadArgument(f"teach_gate needs {len(SKILLS)} experts and critic_first of 1 or more")
        self._actor, self._observation, self._config = actor, observation, config

    def prepare(self, part: TensorDict) -> None:
        """Put the gate's shares into a minibatch."""
        part.set("gate", self._actor.gate(part["observation"]))

    def extra(self, part: TensorDict, *, critic_only: bool) -> Tensor | None:
        """Compute the loss: mutual information while the policy learns, the skills while only the critic does."""
        config, shares = self._config, part["gate"]
        if not critic_only:
            if config.gate_information == 0.0:
                return None
            return -config.gate_information * (entropy(shares.mean(0)) - entropy(shares).mean())
        if not config.teach_gate:
            return None
        labels = skill_labels(part["observation"], self._observation)
        return nn.functional.nll_loss(shares.clamp_min(1e-8).log(), labels)


def entropy(shares: Tensor) -> Tensor:
    """Entropy of distributions (..., k) [nat]; ln k where all are alike."""
    return -(shares * shares.clamp_min(math.exp(-50.0)).log()).sum(-1)
