"""A stack from its description: the one function by which episodes and a deployed bundle build the same stages."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from vuca_nav.errors import BadArgument
from vuca_nav.exploration.critic import CriticWeights, LearnedCritic, load_critic, value_network
from vuca_nav.exploration.heuristic import NoCritic
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.base import LocalPolicy
from vuca_nav.policy.dynamic_window import DynamicWindow, DynamicWindowConfig
from vuca_nav.policy.handover import Handover
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.network import LEARNED_GATE, Gate
from vuca_nav.policy.weights_file import PolicyWeights, load_weights
from vuca_nav.shield.shield import Shield, ShieldConfig
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import BodySpec, LidarSpec

OWN_VALUE = "own-value"
"""The critic that the policy was trained with, in its own weights file: the paper's V^h."""


@dataclass(frozen=True, slots=True)
class StackConfig:
    """A stack in full: every setting of every stage; a field that is None is a stage that the stack does without."""

    window: DynamicWindowConfig | None = None
    """The dynamic window, where that is the local controller; with weights, the controller in narrow ways alone."""
    weights: Path | None = None
    """Weights file of the network, where that is the local controller."""
    gate: Gate = LEARNED_GATE
    """Source of the shares of the network's experts."""
    shield: ShieldConfig | None = None
    """The filter of the controller's commands."""
    critic: Path | Literal["own-value"] | None = None
    """Weights file of the critic whose V^h rates the exploration's candidates, or ``OWN_VALUE``."""
    tracks: Literal["all", "map"] = "all"
    """What may use the percept's tracks: all stages, or map and costmap alone, so that weights that take tracks are
    refused."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Rates, and the settings of the other stages. Perception remembers at least as long as the networks look back."""

    def __post_init__(self) -> None:
        """Raise BadArgument unless there is a local controller, with what goes with it."""
        if self.window is None and self.weights is None:
            raise BadArgument("a stack has a dynamic window, the weights of a network, or both; neither is given")
        if self.critic == OWN_VALUE and self.weights is None:
            raise BadArgument(f"critic {OWN_VALUE!r} goes with weights, which are not given")


def build_navigator(
    config: StackConfig, body: BodySpec, lidar: LidarSpec, telemetry: Telemetry = Telemetry()
) -> Navigator:
    """Build the stack.

    Args:
        config: Its description.
        body: The body that is driven.
        lidar: The body's lidar.
        telemetry: Receives what the stages report.

    Raises:
        BadWeights: A weights file cannot be used.
        BadArgument: The parts do not go together, or not with the body or the lidar.
    """
    weights = None if config.weights is None else load_weights(config.weights)
    critic = critic_of(config.critic, weights)
    networks = [network for network in (weights, critic) if network is not None]
    for network in networks:
        check_tracks(config.tracks, network)
    memory = max((network.observation.memory for network in networks), default=0.0)
    settings = config.navigator
    perception = replace(settings.perception, memory=max(settings.perception.memory, memory))
    settings = replace(settings, perception=perception)
    if weights is not None:
        policy: LocalPolicy = LearnedPolicy(body, lidar, weights, config.gate, telemetry, settings.rate)
        if config.window is not None:
            policy = Handover(policy, DynamicWindow(body, lidar, config.window, rate=settings.rate))
    else:
        policy = DynamicWindow(body, lidar, config.window or DynamicWindowConfig(), rate=settings.rate)
    if config.shield is not None:
        policy = Shield(body, lidar, policy, config.shield, rate=settings.rate)
    safety = NoCritic() if critic is None else LearnedCritic(body, lidar, critic, settings.rate)
    return Navigator(body, lidar, policy, settings, telemetry, safety)


def critic_of(critic: Path | str | None, weights: PolicyWeights | None) -> CriticWeights | None:
    """The critic that rates the exploration's candidates.

    Args:
        critic: As ``StackConfig.critic``.
        weights: The policy's weights, which hold a critic of their own.

    Raises:
        BadWeights: The critic's file cannot be used.
    """
    if isinstance(critic, Path):
        return load_critic(critic)
    return None if critic is None or weights is None else value_network(weights)


def check_tracks(tracks: str, taken: PolicyWeights | CriticWeights) -> None:
    """Raise BadArgument if a network takes tracks that the stack has for map and costmap alone."""
    if tracks == "map" and taken.observation.kind == "tracked":
        raise BadArgument(f"{taken.path} takes tracks, which this method has for map and costmap alone")
