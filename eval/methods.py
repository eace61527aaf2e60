"""The methods that can be put in an episode, by name."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.exploration.critic import SHIPPED, LearnedCritic, load_critic
from vuca_nav.exploration.explorer import ExplorerConfig
from vuca_nav.mapping.slam import SlamConfig
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.network import LEARNED_GATE, UNIFORM_GATE, Gate
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.shield.shield import Shield
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import BodySpec, LidarSpec

GAMMA = 300.0
"""How much longer a way may be if that surely spares meeting somebody, where nobody asks for another [m]."""
EXPLORATION_RATE = 1.0
"""At which the target is chosen anew where V^h has a say [Hz]: in the paper's 5 s whoever comes along a corridor is
here."""


@dataclass(frozen=True, slots=True)
class StackRequest:
    """What a method is built for."""

    body: BodySpec
    lidar: LidarSpec
    localisation: Literal["slam", "odometry"]
    """"odometry" where the odometry is the true pose (``--without A``)."""
    telemetry: Telemetry
    policy: str | None = None
    """Weights file instead of the method's own."""
    gamma: float | None = None
    """Of the safety term instead of the method's own [m]."""
    safety: str | None = None
    """Weights file of the critic of V^h instead of the shipped one."""


@dataclass(frozen=True, slots=True)
class Method:
    """A way to build a navigator."""

    description: str
    build: Callable[[StackRequest], Navigator]
    learned: "Learned | None" = None
    """What drives it, if that is learned."""


@dataclass(frozen=True, slots=True)
class Learned:
    """A navigator with a learned local policy under our cerebrum."""

    weights: str
    """Name of its file in ``WEIGHTS_FOLDER``."""
    gate: Gate = LEARNED_GATE
    safety: bool = False
    """Whether a critic of safety rates the frontiers, V^h, beside D^h."""

    shielded: bool = False
    """Whether a shield stands between the policy and the body."""

    @property
    def path(self) -> Path:
        """Of its weights file."""
        return WEIGHTS_FOLDER / f"{self.weights}.safetensors"

    @property
    def is_shipped(self) -> bool:
        """Whether all that it needs is there."""
        return self.path.is_file() and (not self.safety or SHIPPED.is_file())

    def files(self, policy: str | None = None, safety: str | None = None) -> tuple[Path, Path | None]:
        """Of the policy's weights and of the critic's, None without V^h; those that are given instead of its own."""
        critic = SHIPPED if safety is None else Path(safety)
        return self.path if policy is None else Path(policy), critic if self.safety else None

    def build(self, request: StackRequest) -> Navigator:
        """The whole stack.

        Raises:
            VucaError: The weights cannot be used.
        """
        body, lidar, telemetry = request.body, request.lidar, request.telemetry
        weights, critic = self.files(request.policy, request.safety)
        policy = LearnedPolicy(body, lidar, load_weights(weights), self.gate, telemetry)
        guarded = Shield(body, lidar, policy) if self.shielded else policy
        config = _config(request)
        if critic is None:
            return Navigator(body, lidar, guarded, config, telemetry)
        gamma = GAMMA if request.gamma is None else request.gamma
        config = replace(config, explorer=ExplorerConfig(gamma=gamma), exploration_rate=EXPLORATION_RATE)
        return Navigator(body, lidar, guarded, config, telemetry, LearnedCritic(body, lidar, load_critic(critic)))


def _config(request: StackRequest) -> NavigatorConfig:
    return NavigatorConfig(slam=SlamConfig(localisation=request.localisation))


def _dwa_dh(request: StackRequest) -> Navigator:
    window = DynamicWindow(request.body, request.lidar)
    return Navigator(request.body, request.lidar, window, _config(request), request.telemetry)


def _learned(
    description: str, weights: str, gate: Gate = LEARNED_GATE, *, safety: bool = False, shielded: bool = False
) -> Method:
    learned = Learned(weights, gate, safety, shielded)
    return Method(description, learned.build, learned)


ALL: dict[str, Method] = {
    "dwa-dh": Method("SLAM, frontier exploration by D^h and waypoints, over a dynamic window controller", _dwa_dh),
    "ours": _learned(
        "the full system: the policy of fusion-plus under a shield, frontiers by D^h and V^h",
        "fusion-plus",
        safety=True,
        shielded=True,
    ),
    "ours-dh": _learned("the full system without V^h", "fusion-plus", shielded=True),
    "go-straight": _learned("stage 1's expert for going straight alone, D^h", "go-straight"),
    "obstacle-avoidance": _learned("stage 1's expert for avoiding obstacles alone, D^h", "obstacle-avoidance"),
    "single": _learned("one network trained like the fused one, D^h", "single"),
    "fusion": _learned("the fused policy as in the paper, D^h", "fusion"),
    "fusion-uniform": _learned("the fused policy, every expert with the same share, D^h", "fusion", UNIFORM_GATE),
    "fusion-plus": _learned("the fused policy beyond the paper, which sees tracks of what moves, D^h", "fusion-plus"),
    "fusion-plus-uniform": _learned("the same, every expert with the same share, D^h", "fusion-plus", UNIFORM_GATE),
    "single-plus": _learned("one network that sees what fusion-plus sees, D^h", "single-plus"),
    **{
        f"fusion-without-{n}": _learned(f"the fused policy without its expert {n}, D^h", "fusion", Gate(without=n))
        for n in range(4)
    },
}
"""All there are to be; one whose weights are not shipped runs with a weights file of one's own only."""


def runnable() -> dict[str, Method]:
    """Those of ``ALL`` whose weights are there."""
    return {name: method for name, method in ALL.items() if method.learned is None or method.learned.is_shipped}


METHODS = runnable()
"""Those that run without a weights file of one's own."""
BEST = "ours"
"""What runs when no method is named."""


def find_method(
    name: str, *, policy: str | None = None, gamma: float | None = None, safety: str | None = None
) -> Method:
    """The method of that name.

    Args:
        name: Among ``METHODS``, or with a weights file among ``ALL``.
        policy: A weights file for it.
        gamma: Of the safety term, for it [m].
        safety: A weights file of the critic of V^h, for it.

    Raises:
        UnknownName: There is none.
        BadArgument: It has no use for a weights file, for gamma or for a critic, or policy and critic look at different
            things.
        BadWeights: A weights file cannot be used.
    """
    own = policy is not None or safety is not None
    methods = ALL if own else METHODS
    if name not in methods:
        raise UnknownName("method", name, methods)
    method = methods[name]
    learned = method.learned
    if policy is not None and learned is None:
        raise BadArgument(f"method {name!r} drives by no weights; --policy goes with: {_names(safety=False)}")
    for option, value in (("--gamma", gamma), ("--safety", safety)):
        if value is not None and not (learned and learned.safety):
            raise BadArgument(f"method {name!r} has no V^h; {option} goes with: {_names(safety=True)}")
    if own and learned is not None:
        weights, critic = learned.files(policy, safety)
        load_weights(weights)
        if critic is not None:
            load_critic(critic)
    return method


def identity_of(
    method: str, *, policy: str | None = None, gamma: float | None = None, safety: str | None = None
) -> dict[str, Any]:
    """What tells evaluations of one method apart: its weights, by name and content, and gamma.

    Args:
        method: Its name.
        policy: As in ``find_method``.
        gamma: As there.
        safety: As there.

    Raises:
        VucaError: As there.
    """
    learned = find_method(method, policy=policy, gamma=gamma, safety=safety).learned
    if learned is None:
        return {}
    weights, critic = learned.files(policy, safety)
    identity = {"policy": policy or learned.weights, "sha256": _digest(weights)}
    if critic is None:
        return identity
    return identity | {
        "gamma": GAMMA if gamma is None else gamma,
        "safety": safety or SHIPPED.stem,
        "safety_sha256": _digest(critic),
    }


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def settings_of(navigator: Navigator) -> dict[str, Any]:
    """All that a navigator was built with but body, lidar and weights: of its stages, its policy and its shield."""
    policy = navigator.policy
    settings: dict[str, Any] = {"navigator": asdict(navigator.config)}
    if isinstance(policy, Shield):
        settings["shield"] = asdict(policy.config)
        policy = policy.policy
    if isinstance(policy, DynamicWindow):
        settings["dynamic_window"] = asdict(policy.config)
    if isinstance(policy, LearnedPolicy):
        settings["gate"] = asdict(policy.network.gate)
    return settings


def _names(*, safety: bool) -> str:
    return ", ".join(name for name, m in ALL.items() if m.learned is not None and (m.learned.safety or not safety))
