"""Settings of the oracles."""

from dataclasses import asdict, dataclass, field
from typing import Any

from vuca_nav.checks import check_counts, check_not_negative, check_positive


@dataclass(frozen=True, slots=True)
class SearchConfig:
    """Settings of the search over position, heading, velocities and time."""

    substeps: int = 5
    """Steps of 0.1 s for which a command is held; after each one collisions are looked for."""
    turns: int = 2
    """Yaw rates to either side that are tried."""
    speeds: int = 2
    """Forward speeds that are tried, besides standing and going backwards."""
    turn_cost: float = 0.25
    """Share of the greatest speed that turning at the greatest rate takes away: wheels have to do both (TIAGo: 0.2)."""
    cell: float = 0.2
    """Two states nearer than this to each other, and alike in all else, are one [m]."""
    headings: int = 24
    """Number of headings that are told apart."""
    greeds: tuple[float, ...] = (1.2, 2.0, 4.0)
    """Factors of the time still to go in the order of the search, tried in turn: a greater one finds a path sooner, and
    a longer one."""
    nodes: int = 60_000
    """Greatest number of states of a try; where none finds a path, the best so far is driven."""
    static_margin: float = 0.06
    """Clearance from obstacles that a path keeps, where it begins with so much [m]."""
    mover_margin: float = 0.08
    """The same from movers: tracking errors, and their motion within 0.1 s [m]."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_counts(self, "substeps", "turns", "speeds", "headings", "nodes")
        check_positive(self, "cell")
        check_not_negative(self, "turn_cost", "static_margin", "mover_margin")


@dataclass(frozen=True, slots=True)
class OracleConfig:
    """An oracle."""

    knows_future: bool = True
    """Whether the movers' future is known; else those in sight are taken to go straight on."""
    foresight: float = 3.0
    """Time for which movers in sight are taken to go straight on [s]; after it they are left out."""
    horizon: float = 5.0
    """Length of a path where the future is not known to the end [s]."""
    period: float = 0.5
    """Time between two searches there [s]; with a future that is known, half of a path that does not arrive."""
    tolerance: float = 0.1
    """Distance from the path at which it is searched anew [m]."""
    search: SearchConfig = field(default_factory=SearchConfig)

    def __post_init__(self) -> None:
        """Raise BadArgument for a setting out of its range."""
        check_positive(self, "foresight", "horizon", "period", "tolerance")

    def row(self) -> dict[str, Any]:
        """The configuration as JSON holds it."""
        return {"baseline": "oracle", **asdict(self)}
