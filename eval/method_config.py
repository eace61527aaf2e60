"""The configuration of a method: which stages a stack has, and their settings."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from vuca_nav.build import OWN_VALUE
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.critic import SHIPPED
from vuca_nav.exploration.heuristic import Score
from vuca_nav.perception.perception import PerceptionConfig
from vuca_nav.policy.network import Gate
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER

GAMMA = 300.0
"""Default extra way that is worth it if it surely spares meeting a mover [m]."""
ALERT_RATE = 1.0
"""Rate at which the target is chosen anew while V^h has a say [Hz]: in the paper's 5 s, whatever comes along a corridor
has arrived."""


@dataclass(frozen=True, slots=True)
class ExplorerSettings:
    """Settings of the choice of the exploration point."""

    score: Score = "metres"
    """How D^h and V^h are weighed: as lengths, or each divided by its spread, as the paper prints it."""
    rate: float = 0.2
    """Rate at which it is chosen anew, besides the triggers [Hz]: the paper's."""
    alert_rate: float | None = None
    """The rate while something is seen to move, the only time at which V^h has a say then [Hz]. None for the same rate,
    and a say at all times: the paper's."""
    hysteresis: float = 3.0
    """Cost by which another candidate must be better than the present one [m]."""
    unknown: float | None = 4.0
    """Length that a metre of the unknown counts for in D^h near what stands there, whose way to the goal leads around
    what is known [m]. None for the straight line from the candidate to the goal, as in the paper."""
    look_ahead: float | None = 4.0
    """Length along the path to a candidate at which the critic rates it [m]; None for the candidate itself, as in the
    paper."""


PAPER_EXPLORER = ExplorerSettings(score="normalised", rate=0.2, hysteresis=0.0, unknown=None, look_ahead=None)
"""The choice as the paper prints it (Section III-C): both terms normalised over the candidates, every 5 s and at the
four triggers, without a bonus for staying."""


@dataclass(frozen=True, slots=True)
class MethodConfig:
    """A stack, stage by stage; a field that is None is a stage that the method does without."""

    controller: Literal["dynamic-window", "network"]
    """Local controller: samples commands and simulates them, or a trained network gives them."""
    weights: Path | None = None
    """Weights file of the network."""
    gate: Gate | None = None
    """Source of the shares of the network's experts; None for a network of a single expert."""
    hands_over: bool = False
    """Whether the dynamic window drives in ways narrower than those that networks are trained on."""
    shield: bool = False
    """Whether a shield filters the controller's commands."""
    critic: Path | Literal["own-value"] | None = None
    """Weights file of the critic whose V^h rates the exploration's candidates, or ``OWN_VALUE``."""
    explorer: ExplorerSettings | None = ExplorerSettings()
    """None if the controller heads for the goal itself: nothing is explored, and no path is planned."""
    gamma: float | None = None
    """Weight of V^h: extra way that is worth it if it surely spares meeting a mover [m], or without dimension for the
    normalised score; None without a critic."""
    recovers: bool = True
    """Whether the stack backs out, clears, tries another way and waits, in turn, where it makes no progress."""
    tracks: Literal["all", "map"] = "all"
    """What may use the percept's tracks: all stages, or map and costmap alone. Where it is the map alone, weights that
    take tracks, a critic that takes them, and a shield are refused."""
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    """Settings of perception, for all stages alike."""

    def __post_init__(self) -> None:
        """Raises BadArgument for a controller without its weights, and for parts that do not go together."""
        if (self.controller == "network") != (self.weights is not None):
            raise BadArgument(f"controller {self.controller!r} with weights {self.weights}: only a network has them")
        if self.hands_over and self.weights is None:
            raise BadArgument("hands_over goes with weights, which are not given")
        for name, needs in (("gate", "weights"), ("gamma", "critic"), ("critic", "explorer")):
            if getattr(self, name) is not None and getattr(self, needs) is None:
                raise BadArgument(f"{name} goes with {needs}, which are not given")
        if self.critic == OWN_VALUE and self.weights is None:
            raise BadArgument(f"critic {OWN_VALUE!r} goes with weights, which are not given")
        if self.tracks == "map" and self.shield:
            raise BadArgument("a shield foresees tracks, which are for map and costmap alone")

    def row(self) -> dict[str, Any]:
        """The configuration as JSON holds it; shipped files are named by their stem, wherever they are installed."""
        return asdict(self) | {"weights": _stem_or_path(self.weights), "critic": _stem_or_path(self.critic)}


def _stem_or_path(path: Path | str | None) -> str | None:
    if not isinstance(path, Path):
        return path
    return path.stem if path.parent in (WEIGHTS_FOLDER, SHIPPED.parent) else str(path)
