"""Settings of move_base."""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from eval.method_config import ExplorerSettings
from vuca_nav.checks import check_not_negative, check_positive
from vuca_nav.policy.dynamic_window import DynamicWindowConfig

Behaviour = Literal["conservative clear", "rotate", "aggressive clear"]
"""Recovery behaviours: forget marks beyond some metres, turn about once, forget marks beyond the robot itself."""


@dataclass(frozen=True, slots=True)
class LayersConfig:
    """Settings of the layered costmap (costmap_2d)."""

    downsample: int = 2
    """Number of map cells to a costmap cell, each way: 0.05 m to 0.1 m."""
    obstacle_range: float = 2.5
    """Range up to which returns are marked in the obstacle layer [m]: costmap_2d's default."""
    raytrace_range: float = 3.0
    """Range up to which beams clear marks [m]: costmap_2d's default."""
    inflation_radius: float = 0.55
    """Distance from an obstacle beyond which it costs nothing [m]: costmap_2d's default."""
    cost_scaling: float = 10.0
    """Rate at which the cost falls beyond the inscribed radius [1/m]: costmap_2d's default."""
    beyond: float = 8.0
    """Unknown space around what is known and the goal through which paths may lead [m]."""
    escape_radius: float = 0.6
    """Radius about the robot in which inscribed cells may be crossed [m]. The original has none and finds no plan where
    noise puts the robot too near to a wall."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_positive(self, "obstacle_range", "raytrace_range", "cost_scaling", "beyond")
        check_not_negative(self, "inflation_radius", "escape_radius")


@dataclass(frozen=True, slots=True)
class RecoveryConfig:
    """Settings of the recovery behaviours."""

    behaviours: tuple[Behaviour, ...] = ("conservative clear", "rotate", "aggressive clear", "rotate")
    """Behaviours in the order in which they are tried: move_base's default."""
    planner_patience: float = 5.0
    """Time without a plan after which the next behaviour is tried [s]: move_base's default."""
    progress_time: float = 10.0
    """Time without ``progress_distance`` after which it is tried (``oscillation_timeout``) [s]: 0, off, is the default;
    10 s is what the tutorials set."""
    progress_distance: float = 0.5
    """[m]: ``oscillation_distance``'s default."""
    conservative_distance: float = 3.0
    """Half side of the square about the robot in which marks stay [m]: ``conservative_reset_dist``'s default."""
    aggressive_factor: float = 4.0
    """The same of the aggressive one, in radii of the robot: move_base's default."""
    turn_share: float = 0.5
    """Share of the greatest yaw rate at which the robot turns about."""


@dataclass(frozen=True, slots=True)
class MoveBaseConfig:
    """move_base, stage by stage; perception and SLAM are those of all methods."""

    explorer: ExplorerSettings | None = None
    """Choice of frontiers by D^h; None to plan straight to the goal, the unknown taken as free."""
    planning_rate: float = 1.0
    """[Hz]"""
    look_ahead: float = 2.0
    """Farthest point of the path that the dynamic window heads for, along the path [m]: half the side of move_base's
    local costmap is 3 m."""
    layers: LayersConfig = field(default_factory=LayersConfig)
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    window: DynamicWindowConfig = field(default_factory=DynamicWindowConfig)

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_positive(self, "planning_rate", "look_ahead")

    def row(self) -> dict[str, Any]:
        """The configuration as JSON holds it."""
        return {"baseline": "move_base", **asdict(self)}
