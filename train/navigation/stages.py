"""The policies that can be trained (Zhang et al., Section III-B, and beyond): a stage for each."""

from dataclasses import dataclass, replace
from pathlib import Path

from train.arena.config import KINDS, ArenaConfig
from train.arena.rewards import DRL
from train.navigation.config import NavigationPpoConfig
from train.navigation.networks import NetworkConfig
from vuca_nav.checks import check_counts, check_fields, check_not_negative
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.policy.observation import ObservationConfig


@dataclass(frozen=True, slots=True)
class StageConfig:
    """Settings of a policy to be trained."""

    name: str
    """Name of its directory below ``--out``, and of its files there."""
    about: str
    """A sentence for its page."""
    rewards: str
    """A column of ``rewards.REWARDS``."""
    arena: ArenaConfig
    observation: ObservationConfig
    network: NetworkConfig
    ppo: NavigationPpoConfig
    steps: int
    """Number of decisions, of all worlds together."""
    sources: tuple[str, ...] = ()
    """The policies that the experts start as."""
    copy_noise: float = 0.05
    """Noise added to every second copy of a policy, as a share of its matrices' deviation."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
        right = "the plain name of a file, without a path"
        check_fields(self, right, lambda name: name not in ("", ".", "..") and Path(name).name == name, "name")
        check_counts(self, "steps")
        if (self.network.architecture == "convolutional") != (self.observation.kind == "frames"):
            raise BadArgument(
                f"architecture {self.network.architecture!r} with an observation of kind {self.observation.kind!r}: "
                "'convolutional' goes with 'frames', and only with it"
            )
        check_not_negative(self, "copy_noise")


_PAPER, _TRACKED = ObservationConfig(), ObservationConfig(kind="tracked")
_FIRST = NavigationPpoConfig()
_WARM = NavigationPpoConfig(first_rate=6e-4, critic_first=10)
_SECOND = NavigationPpoConfig(horizon=64, minibatch=4096, first_rate=6e-4, last_rate=5e-5, entropy=0.0, critic_first=10)
_SECOND_FROM_SCRATCH = NavigationPpoConfig(horizon=64, minibatch=4096, first_rate=1e-3, last_rate=5e-5)
_FOUR = NetworkConfig(experts=4, initial_std=0.25)
_CAREFUL = ArenaConfig(static=0.22, dynamic=0.2, mixed=0.15, square=0.08, corridor=0.35)
"""Arena with more than twice as many corridors, where most collisions are, and fewer of the other kinds but
``static``."""
_FRAMES = ObservationConfig(kind="frames", sectors=90, history=2)
_NO_OTHERS = dict.fromkeys(KINDS, 0.0)
_DRL_CIRCLE = ArenaConfig(
    circle=1.0, **_NO_OTHERS, robots=24, lengths=(8.0, 10.0), time_factor=1.5, time_slack=5.0,
    layouts=1, pairs=1024,
)  # fmt: skip
_DRL_HALL = replace(_DRL_CIRCLE, circle=0.0, hall=1.0, robots=44, lengths=(3.0, 12.0), layouts=8)
_DRL_FIRST = NavigationPpoConfig(
    worlds=24, horizon=128, minibatch=256, epochs=2, clip=0.1, entropy=5e-4, first_rate=5e-4, last_rate=1e-4
)
_DRL_SECOND = replace(_DRL_FIRST, worlds=44, first_rate=3e-4, last_rate=5e-5, critic_first=4)
_COPIES = ("go-straight", "obstacle-avoidance", "go-straight", "obstacle-avoidance")


_ALL = (
    StageConfig(
        name="go-straight",
        about="An expert for walls and roadblocks, which hates turning (Section III-B, first stage).",
        rewards="go-straight", arena=ArenaConfig().of("static"), observation=_PAPER,
        network=NetworkConfig(), ppo=_FIRST, steps=6_000_000,
    ),
    StageConfig(
        name="obstacle-avoidance",
        about="An expert for things that move, which hates to be near them (Section III-B, first stage). Warm: "
        "from scratch it learns to wait, which the printed rewards pay for.",
        rewards="obstacle-avoidance", arena=ArenaConfig().of("dynamic"), observation=_PAPER,
        network=NetworkConfig(initial_std=0.25), ppo=_WARM, steps=6_000_000, sources=("go-straight",),
    ),
    StageConfig(
        name="single",
        about="One network of an expert's size, trained from scratch in the worlds of fusion, by its rewards and in as "
        "many steps; but fusion starts from experts, which had 12 million before.",
        rewards="fusion", arena=ArenaConfig(), observation=_PAPER,
        network=NetworkConfig(), ppo=_SECOND_FROM_SCRATCH, steps=8_000_000,
    ),
    StageConfig(
        name="fusion",
        about="Four networks, two copies of each expert, their weights and biases fused at every step by a gate, "
        "all trained together (Section III-B, second stage).",
        rewards="fusion", arena=ArenaConfig(), observation=_PAPER, network=_FOUR, ppo=_SECOND,
        steps=8_000_000, sources=_COPIES,
    ),
    StageConfig(
        name="base-plus",
        about="One network that sees tracks of what moves, trained from scratch: where the other two go on from.",
        rewards="fusion", arena=ArenaConfig(), observation=_TRACKED,
        network=NetworkConfig(), ppo=_SECOND_FROM_SCRATCH, steps=30_000_000,
    ),
    StageConfig(
        name="single-plus",
        about="One network that sees tracks of what moves, trained on from base-plus as long as fusion-plus is.",
        rewards="careful", arena=_CAREFUL, observation=_TRACKED,
        network=NetworkConfig(initial_std=0.25), ppo=_SECOND, steps=20_000_000, sources=("base-plus",),
    ),
    StageConfig(
        name="fusion-plus",
        about="Four copies of base-plus, fused by a gate that is first taught which skill is called for and then paid "
        "for making up its mind.",
        rewards="careful", arena=_CAREFUL, observation=_TRACKED, network=_FOUR,
        ppo=replace(_SECOND, gate_information=0.02, teach_gate=True), steps=20_000_000, sources=("base-plus",) * 4,
    ),
    StageConfig(
        name="drl-circle",
        about="The first stage of Long et al. as publicly reproduced: 24 robots cross a circle.",
        rewards=DRL, arena=_DRL_CIRCLE, observation=_FRAMES,
        network=NetworkConfig(architecture="convolutional", initial_std=0.5), ppo=_DRL_FIRST, steps=2_000_000,
    ),
    StageConfig(
        name="drl",
        about="The baseline of Long et al. as publicly reproduced, second stage: 44 robots in a hall of mixed ground.",
        rewards=DRL, arena=_DRL_HALL, observation=_FRAMES,
        network=NetworkConfig(architecture="convolutional", initial_std=0.25), ppo=_DRL_SECOND, steps=2_000_000,
        sources=("drl-circle",),
    ),
)  # fmt: skip
STAGES = {stage.name: stage for stage in _ALL}
"""Stages by name, each after those that it starts from. ``_plus`` goes beyond the paper: in place of scan differences
the policy sees tracks of movers, and the body's limits; and the gate is first taught which skill is called for, then
paid for making up its mind."""
EVERYTHING = tuple(STAGES)
"""Names of the stages that ``vuca train all`` trains, in this order."""


def find_stage(name: str) -> StageConfig:
    """Find a stage by its name.

    Raises:
        UnknownName: If there is no such stage.
    """
    if name not in STAGES:
        raise UnknownName("policy", name, STAGES)
    return STAGES[name]


def from_scratch(stage: StageConfig) -> StageConfig:
    """Make the same stage without sources, and so without a gate that is taught while experts wait."""
    if not stage.sources:
        return stage
    ppo = replace(stage.ppo, critic_first=0, teach_gate=False, first_rate=_FIRST.first_rate)
    about = f"Networks, worlds and rewards of {stage.name}, but from random weights, with nothing taught to a gate."
    return replace(stage, about=about, sources=(), ppo=ppo)
