"""What can be trained: a row for each policy."""

import math
from dataclasses import dataclass, replace

from train.arena.config import ArenaConfig
from train.navigation.networks import NetworkConfig
from train.navigation.ppo import PpoConfig
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.policy.observation import ObservationConfig


@dataclass(frozen=True, slots=True)
class StageConfig:
    """A policy to be trained."""

    name: str
    about: str
    """A sentence for its page."""
    rewards: str
    """A column of Table I."""
    arena: ArenaConfig
    observation: ObservationConfig
    network: NetworkConfig
    ppo: PpoConfig
    steps: int
    """Decisions to be made, of all worlds together."""
    sources: tuple[str, ...] = ()
    """The policies that the experts start as."""
    copy_noise: float = 0.05
    """What is added to every second copy of a policy, as a share of its matrices' deviation."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        if self.steps < 1 or not 0.0 <= self.copy_noise < math.inf:
            raise BadArgument(f"steps must be 1 or more, copy_noise 0 or more, got {self.steps}, {self.copy_noise}")


_PAPER, _COMPENSATED = ObservationConfig(), ObservationConfig(kind="compensated")
_FIRST = PpoConfig()
_WARM = PpoConfig(first_rate=6e-4, critic_first=10)
_SECOND = PpoConfig(horizon=64, minibatch=4096, first_rate=6e-4, last_rate=5e-5, entropy=0.0, critic_first=10)
_SECOND_FROM_SCRATCH = PpoConfig(horizon=64, minibatch=4096, first_rate=1e-3, last_rate=5e-5)
_FOUR = NetworkConfig(experts=4, initial_std=0.25)
_COPIES = ("go_straight", "obstacle_avoidance", "go_straight", "obstacle_avoidance")


def _first_stage(suffix: str, observation: ObservationConfig) -> tuple[StageConfig, StageConfig]:
    """The two experts."""
    straight = f"go_straight{suffix}"
    return (
        StageConfig(
            name=straight,
            about="An expert for walls and roadblocks, which hates turning (Section III-B, first stage).",
            rewards="go_straight", arena=ArenaConfig().of("static"), observation=observation,
            network=NetworkConfig(), ppo=_FIRST, steps=8_000_000,
        ),
        StageConfig(
            name=f"obstacle_avoidance{suffix}",
            about="An expert for things that move, which hates to be near them (Section III-B, first stage). Warm: "
            "from scratch it learns to wait, which the printed rewards pay for.",
            rewards="obstacle_avoidance", arena=ArenaConfig().of("dynamic"), observation=observation,
            network=NetworkConfig(initial_std=0.25), ppo=_WARM, steps=8_000_000, sources=(straight,),
        ),
    )  # fmt: skip


def _second_stage(suffix: str, observation: ObservationConfig, gate_information: float) -> tuple[StageConfig, ...]:
    """One network, and four fused, in all worlds."""
    return (
        StageConfig(
            name=f"single{suffix}",
            about="One network of an expert's size, trained from scratch as long and for the same as the fused ones.",
            rewards="fusion", arena=ArenaConfig(), observation=observation,
            network=NetworkConfig(), ppo=_SECOND_FROM_SCRATCH, steps=24_000_000,
        ),
        StageConfig(
            name=f"fusion{suffix}",
            about="Four networks, two copies of each expert, their weights and biases fused at every step by a gate, "
            "all trained together (Section III-B, second stage).",
            rewards="fusion", arena=ArenaConfig(), observation=observation, network=_FOUR,
            ppo=replace(_SECOND, gate_information=gate_information, teach_gate=gate_information > 0.0),
            steps=24_000_000,
            sources=tuple(f"{source}{suffix}" for source in _COPIES),
        ),
    )  # fmt: skip


_ALL = (
    *_first_stage("", _PAPER),
    *_second_stage("", _PAPER, 0.0),
    *_first_stage("_plus", _COMPENSATED),
    *_second_stage("_plus", _COMPENSATED, 0.02),
)
STAGES = {stage.name: stage for stage in _ALL}
"""Every policy, each after those that it starts from. ``_plus`` goes beyond the paper: past scans are carried along by
odometry before they are compared, the body's limits are seen, and the gate is first taught
which skill is called for, then paid for making up its mind."""
EVERYTHING = tuple(STAGES)
"""What ``vuca train all`` trains, in this order."""


def find_stage(name: str) -> StageConfig:
    """A stage by its name.

    Raises:
        UnknownName: If there is no such stage.
    """
    if name not in STAGES:
        raise UnknownName("policy", name, (*STAGES, "all", "locomotion"))
    return STAGES[name]


def from_scratch(stage: StageConfig) -> StageConfig:
    """The same stage without anything to start from."""
    return replace(stage, sources=(), ppo=replace(stage.ppo, critic_first=0, first_rate=_FIRST.first_rate))
