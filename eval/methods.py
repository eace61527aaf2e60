"""The methods of an episode: a table of configurations, and the function that builds a stack of one.

A method is data. A user's change to one is an option (``MethodOptions``), not another name; ``resolve`` gives the
configuration that runs, and ``build`` the stack. A new method is an entry of ``METHODS``; one of the user's own is
named ``module:build``.
"""

import hashlib
import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

from eval.baselines.move_base.config import LayersConfig, MoveBaseConfig
from eval.baselines.move_base.stack import MoveBase
from eval.baselines.oracle.config import OracleConfig
from eval.baselines.oracle.stack import Oracle
from eval.baselines.oracle.truth import Truth
from eval.method_config import ALERT_RATE, GAMMA, PAPER_EXPLORER, ExplorerSettings, MethodConfig
from eval.user_method import Request, UserMethod
from vuca_nav.build import OWN_VALUE, StackConfig, build_navigator, check_tracks
from vuca_nav.data_files import read_bytes
from vuca_nav.errors import BadArgument, BadWeights, UnknownName
from vuca_nav.exploration.critic import SHIPPED, load_critic
from vuca_nav.exploration.explorer import ExplorerConfig
from vuca_nav.mapping.slam import SlamConfig
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.dynamic_window import DynamicWindow, DynamicWindowConfig
from vuca_nav.policy.handover import Handover
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.network import Gate, PolicyNetwork
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.recovery import RecoveryConfig
from vuca_nav.safetensors_file import MOST_BYTES
from vuca_nav.shield.shield import Shield, ShieldConfig
from vuca_nav.stack import Stack
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import BodySpec, LidarSpec

AnyConfig = MethodConfig | MoveBaseConfig | OracleConfig | UserMethod
"""The configuration of any stack: the project's own, a baseline, or one of the user's."""


class Method(NamedTuple):
    """An entry of the table of methods."""

    description: str
    config: AnyConfig


PAPER_GAMMA = 2.0
"""Weight of V^h in ``paper``, without dimension: the best of the sweep in docs/results/tuning-paper.md, whose
differences are within chance."""


TUNED_MOVE_BASE = MoveBaseConfig(
    layers=LayersConfig(inflation_radius=0.9, cost_scaling=4.0),
    window=DynamicWindowConfig(comfort=0.6, comfort_weight=1.5, horizon=2.6),
)
"""The best set of the sweep in docs/results/tuning-move_base.md."""


def _network(weights: str, **changes: Any) -> MethodConfig:
    return MethodConfig("network", WEIGHTS_FOLDER / f"{weights}.safetensors", **changes)


def _paper(**changes: Any) -> MethodConfig:
    """The paper's system: its stuck rule gives a target up, and nothing else is tried."""
    return _network("paper", gate=Gate(), explorer=PAPER_EXPLORER, recovers=False, tracks="map", **changes)


METHODS: dict[str, Method] = {
    "dwa-dh": Method(
        "SLAM, frontier exploration by D^h and waypoints, over a dynamic window controller",
        MethodConfig("dynamic-window"),
    ),
    "ours": Method(
        "the full system: the policy of fusion-plus under a shield, frontiers by D^h and V^h",
        _network(
            "fusion-plus",
            gate=Gate(),
            hands_over=True,
            shield=True,
            critic=SHIPPED,
            explorer=ExplorerSettings(alert_rate=ALERT_RATE),
            gamma=GAMMA,
        ),
    ),
    "ours-dh": Method(
        "the full system without V^h", _network("fusion-plus", gate=Gate(), hands_over=True, shield=True)
    ),
    "paper": Method(
        "the paper's system as printed: fusion, unshielded; frontiers by D^h and its own V^h, normalised",
        _paper(critic=OWN_VALUE, gamma=PAPER_GAMMA),
    ),
    "paper-dh": Method("the paper's system without V^h", _paper()),
    "move_base": Method(
        "ROS's move_base: straight to the goal, the unknown taken as free; layered costmap, dynamic window, recoveries",
        TUNED_MOVE_BASE,
    ),
    "move_base+dh": Method("the same, with frontiers by D^h", replace(TUNED_MOVE_BASE, explorer=PAPER_EXPLORER)),
    "oracle": Method(
        "upper bound: knows the true map, its pose and the movers' future; a search through space and time",
        OracleConfig(),
    ),
    "oracle-map": Method(
        "knows the true map and its pose, and takes the movers in sight to go straight on",
        OracleConfig(knows_future=False),
    ),
    "go-straight": Method("stage 1's expert for going straight alone, D^h", _network("go-straight")),
    "obstacle-avoidance": Method("stage 1's expert for avoiding obstacles alone, D^h", _network("obstacle-avoidance")),
    "single": Method("one network trained like the fused one, D^h", _network("single")),
    "fusion": Method("the fused policy as in the paper, D^h", _network("fusion", gate=Gate())),
    "fusion-plus": Method(
        "the fused policy beyond the paper, which sees tracks of what moves, D^h", _network("fusion-plus", gate=Gate())
    ),
    "single-plus": Method("one network that sees what fusion-plus sees, D^h", _network("single-plus")),
    "drl": Method(
        "Long et al. as publicly reproduced, the paper's baseline2: heads for the goal itself, without map or path",
        _network("drl", explorer=None),
    ),
}
BEST = "ours-dh"
"""The method that runs where none is named. In the demo's mission (factory region 1, seed 8) `ours` circles four times
before one junction, and in the building TIAGo arrives in 2 of 10 missions with V^h (seeds 11 to 20), in 9 without."""
BEST_WITH_CRITIC = "ours"
"""The method that runs where none is named and V^h is asked for."""


UNIFORM = "uniform"


@dataclass(frozen=True, slots=True)
class MethodOptions:
    """Changes to a method; an option left at its default stays the method's own."""

    policy: str | None = None
    """Weights file of the network."""
    gate: str | None = None
    """``"uniform"`` gives every expert the same share."""
    without_expert: int | None = None
    """Leave an expert out, by its number from 1 on."""
    no_shield: bool = False
    """Leave the shield out."""
    critic: str | None = None
    """Weights file of the critic of V^h."""
    gamma: float | None = None
    """Weight of V^h, in the method's unit."""
    monitor: bool = False
    """Put the safety layer of a deployed robot under the method, whichever it is."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a gamma that is negative or not finite, or another gate than the uniform one."""
        if self.gate not in (None, UNIFORM):
            raise BadArgument(f"--gate must be {UNIFORM}, or left out for the trained gate; got {self.gate!r}")
        if self.gamma is not None and not 0.0 <= self.gamma < math.inf:
            raise BadArgument(f"--gamma must be 0 or more, got {self.gamma}")

    def given(self) -> dict[str, Any]:
        """The options that are not at their defaults."""
        values = asdict(self)
        return {name: value for name, value in values.items() if value is not None and value is not False}


UNCHANGED = MethodOptions()
"""The method as it is."""


class _Lack(NamedTuple):
    """A stage that a method must have for an option to go with it, and the message if it has none."""

    message: str
    has: Callable[[MethodConfig], bool]

    def goes_with(self, config: AnyConfig) -> bool:
        """Whether a method has the stage."""
        return isinstance(config, MethodConfig) and self.has(config)


_NO_NETWORK = _Lack("drives by no weights", lambda config: config.weights is not None)
_NO_GATE = _Lack("has no gate over several experts", lambda config: config.gate is not None)
_NO_SHIELD = _Lack("has no shield", lambda config: config.shield)
_NO_CRITIC = _Lack("has no V^h", lambda config: config.critic is not None)
_LACKS: dict[str, _Lack] = {
    "policy": _NO_NETWORK,
    "gate": _NO_GATE,
    "without_expert": _NO_GATE,
    "no_shield": _NO_SHIELD,
    "critic": _NO_CRITIC,
    "gamma": _NO_CRITIC,
}


def resolve(name: str, options: MethodOptions = UNCHANGED) -> AnyConfig:
    """The configuration that runs: a method's own, changed by options.

    Args:
        name: Name of a method in ``METHODS``, in its exact spelling, or ``module:build``, which imports the module.
        options: Changes to it.

    Raises:
        UnknownName: There is no such method.
        BadArgument: An option does not go with the method, there is no such expert, or the module cannot be loaded.
        BadWeights: A weights file that is given cannot be used.
    """
    if name not in METHODS and not is_users_own(name):
        raise UnknownName("method", name, METHODS)
    config, given = METHODS[name].config if name in METHODS else UserMethod(name), options.given()
    for option in given:
        lack = _LACKS.get(option)
        if lack is not None and not lack.goes_with(config):
            those = ", ".join(other for other, method in METHODS.items() if lack.goes_with(method.config))
            raise BadArgument(f"method {name!r} {lack.message}; {flag_of(option)} goes with: {those}")
    if not isinstance(config, MethodConfig):
        config.row()  # a module that cannot be loaded is noticed now
        return config
    if config.gate is not None:
        gate = Gate(uniform=options.gate == UNIFORM, without=options.without_expert)
        config = replace(config, gate=gate)
    if options.no_shield:
        config = replace(config, shield=False)
    if options.policy is not None:
        config = replace(config, weights=Path(options.policy))
    if config.critic is not None:
        config = replace(
            config,
            critic=config.critic if options.critic is None else Path(options.critic),
            gamma=config.gamma if options.gamma is None else options.gamma,
        )
    if given.keys() & {"policy", "gate", "without_expert", "critic"}:
        _check_files(config, given)
    return config


def taken_by(name: str, options: Iterable[str]) -> set[str]:
    """Those of some options, by name, that go with a method.

    Args:
        name: Name of a method, or ``module:build``, which takes only what goes with any method.
        options: Names of fields of ``MethodOptions``.

    Raises:
        UnknownName: There is no such method.
    """
    if not is_users_own(name) and name not in METHODS:
        raise UnknownName("method", name, METHODS)
    config = UserMethod(name) if is_users_own(name) else METHODS[name].config
    return {option for option in options if option not in _LACKS or _LACKS[option].goes_with(config)}


def _check_files(config: MethodConfig, given: dict[str, Any]) -> None:
    """Raise VucaError if weights cannot be read, or the policy's do not go with the gate."""
    if config.weights is not None:
        weights = load_weights(config.weights)
        if "gate" in given and weights.experts == 1:
            raise BadArgument(f"{config.weights} has a single expert; --gate goes with weights of several")
        PolicyNetwork(weights, config.gate or Gate())
        check_tracks(config.tracks, weights)
    if isinstance(config.critic, Path):
        check_tracks(config.tracks, load_critic(config.critic))


def is_users_own(name: str) -> bool:
    """Whether a method's name is that of a factory in the user's own Python, ``module:build``."""
    return ":" in name


def flag_of(option: str) -> str:
    """An option as it is typed, ``--without-expert`` for ``without_expert``."""
    return f"--{option.replace('_', '-')}"


def title_of(method: str, options: dict[str, Any]) -> str:
    """A method as it is typed, with its options: ``ours --gamma 0 --no-shield``.

    Args:
        method: Its name.
        options: Values by name, as a row of a result has them; names that ``MethodOptions`` lacks are ignored.
    """
    typed = [method]
    for option in fields(MethodOptions):
        value = options.get(option.name)
        if value is not None and value is not False:
            typed += [flag_of(option.name)] if value is True else [flag_of(option.name), str(value)]
    return " ".join(typed)


def identity_of(config: AnyConfig) -> dict[str, Any]:
    """Identity of an evaluation's method: the resolved configuration, weights and modules by name and by content.

    Args:
        config: Result of ``resolve``.

    Raises:
        BadWeights: A weights file cannot be read.
    """
    if not isinstance(config, MethodConfig):
        return config.row()
    files = {"weights_sha256": config.weights, "critic_sha256": config.critic}
    return config.row() | {name: _digest(path) for name, path in files.items() if isinstance(path, Path)}


def build(
    method: AnyConfig,
    body: BodySpec,
    lidar: LidarSpec,
    localisation: Literal["slam", "odometry"] = "slam",
    telemetry: Telemetry = Telemetry(),
    truth: Truth | None = None,
) -> Stack:
    """Build the stack of a method for a body.

    Args:
        method: Result of ``resolve``.
        body: The body that is driven.
        lidar: The body's lidar.
        localisation: "odometry" where the odometry is the true pose (``--without A``).
        telemetry: Receives what the stages report.
        truth: The episode as it is, for the oracles; no other method sees it.

    Raises:
        VucaError: Weights cannot be used, the user's own factory fails, or an oracle is not given the truth.
    """
    if isinstance(method, OracleConfig):
        if truth is None:
            raise BadArgument("an oracle drives in the simulation only, where the truth is known")
        return Oracle(method, truth, telemetry)
    request = Request(body, lidar, localisation, telemetry)
    if isinstance(method, UserMethod):
        return method.build(request)
    if isinstance(method, MoveBaseConfig):
        return MoveBase(method, request)
    return build_navigator(stack_config(method, localisation), body, lidar, telemetry)


def stack_config(method: MethodConfig, localisation: Literal["slam", "odometry"] = "slam") -> StackConfig:
    """The description of a method's stack in full.

    Args:
        method: Result of ``resolve``.
        localisation: "odometry" where the odometry is the true pose.
    """
    chooses = method.explorer or ExplorerSettings()
    explorer = ExplorerConfig(
        score=chooses.score,
        gamma=method.gamma or 0.0,
        hysteresis=chooses.hysteresis,
        unknown=chooses.unknown,
        movers_only=chooses.alert_rate is not None,
        look_ahead=chooses.look_ahead,
    )
    return StackConfig(
        window=DynamicWindowConfig() if method.weights is None or method.hands_over else None,
        weights=method.weights,
        gate=method.gate or Gate(),
        shield=ShieldConfig() if method.shield else None,
        critic=method.critic,
        tracks=method.tracks,
        navigator=NavigatorConfig(
            exploration_rate=chooses.rate,
            alert_rate=chooses.alert_rate,
            direct=method.explorer is None,
            perception=method.perception,
            slam=SlamConfig(localisation=localisation),
            recovery=RecoveryConfig() if method.recovers else None,
            explorer=explorer,
        ),
    )


def settings_of(method: AnyConfig, body: BodySpec, lidar: LidarSpec) -> dict[str, Any]:
    """Settings of a method's stages, policy and shield; body, lidar and weights are left out.

    Args:
        method: Result of ``resolve``.
        body: The body that is driven.
        lidar: The body's lidar.

    Raises:
        VucaError: It cannot be built.
    """
    if isinstance(method, OracleConfig):
        return {}
    navigator = build(method, body, lidar)
    if not isinstance(navigator, Navigator):
        return {}
    policy = navigator.policy
    settings: dict[str, Any] = {"navigator": asdict(navigator.config)}
    if isinstance(policy, Shield):
        settings["shield"] = asdict(policy.config)
        policy = policy.policy
    if isinstance(policy, Handover):
        settings["dynamic_window"] = asdict(policy.window.config)
        policy = policy.policy
    if isinstance(policy, DynamicWindow):
        settings["dynamic_window"] = asdict(policy.config)
    if isinstance(policy, LearnedPolicy):
        settings["gate"] = asdict(policy.network.gate)
    return settings


def _digest(path: Path) -> str:
    return hashlib.sha256(read_bytes(path, MOST_BYTES, BadWeights)).hexdigest()
