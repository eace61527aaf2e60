"""What the arena is made of: worlds, movers, bodies and everything that is imperfect."""

import math
from dataclasses import dataclass, replace

from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive, check_ranges, check_shares
from vuca_nav.errors import BadArgument
from vuca_nav.task import GOAL_TOLERANCE
from worlds.registry import TRAINING_SEED

KINDS = ("static", "dynamic", "mixed", "square", "corridor")
"""Walls and roadblocks; open ground with movers; walls, roadblocks and movers; the plaza with movers; the corridors of
the factory's first quarter with movers."""
BODY_KINDS = ("tiago", "go2", "random")
MAX_LATENCY = 8
"""More ticks of latency than any stack has; commands are remembered for no longer."""
MOST_MOVERS = 120
"""In one world: more than any of ours has."""


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Errors of sensors, of the pose and of the way a command is carried out. Sigmas of normal distributions."""

    range_sigma: float = 0.02
    """Of one range [m] (robots.noise)."""
    dropout: float = 0.01
    """Share of beams that return nothing (robots.noise)."""
    empty_scan: float = 0.002
    """Share of scans that return nothing at all."""
    twist_sigma: float = 0.02
    """Of the measured velocity, in shares of the body's limits."""
    odometry_scale: float = 0.03
    """Relative error of odometry's distances, per episode (robots.noise)."""
    odometry_turn: float = 0.02
    """Relative error of odometry's turns, per episode (robots.noise)."""
    pose_sigma: float = 0.04
    """Of the position that SLAM gives the goal by [m]; over an episode it errs by 0.02 to 0.04."""
    yaw_sigma: float = 0.01
    """Of its heading [rad]."""
    pose_time: float = 5.0
    """Over which the pose's error stays alike [s]."""
    latency: tuple[int, int] = (0, 2)
    """Least and greatest delay of a command beside the body's own, per episode [ticks of 1/30 s]."""
    response_spread: float = 0.3
    """The body's lags, delays and noise are drawn within so much of what was identified, gains within a tenth of it."""
    velocity_noise: float = 1.0
    """Times what was identified about the response."""

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        low, high = self.latency
        if not 0 <= low <= high <= MAX_LATENCY:
            raise BadArgument(f"latency {self.latency}: ticks from 0 to {MAX_LATENCY}, the first at most the second")
        check_shares(self, "dropout", "empty_scan")
        check_fields(self, "a share below 1", lambda share: 0.0 <= share < 1.0, "response_spread")
        check_positive(self, "pose_time")
        check_not_negative(
            self, "range_sigma", "twist_sigma", "odometry_scale", "odometry_turn", "pose_sigma", "yaw_sigma",
            "velocity_noise",
        )  # fmt: skip

    @classmethod
    def none(cls) -> "Imperfections":
        """Everything exact; bodies respond as identified, without the noise."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, (0, 0), 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ArenaConfig:
    """Which episodes the arena draws."""

    static: float = 0.2
    """Weight of this kind of world among all; so the other four."""
    dynamic: float = 0.25
    mixed: float = 0.3
    square: float = 0.1
    corridor: float = 0.15
    movers: tuple[int, int] = (6, 20)
    """Fewest and most, in the worlds that have any."""
    mover_speeds: tuple[float, float] = (0.2, 2.0)
    """Slowest and fastest, over the body's own greatest speed."""
    patrols: float = 0.25
    """Share of the movers that go straight to and fro; half of them across the robot's straight way."""
    pausing: float = 0.2
    """Share that stops and goes."""
    lengths: tuple[float, float] = (1.5, 12.0)
    """Of the shortest way to the goal [m]."""
    time_factor: float = 3.0
    """An episode may take so many times the shortest way at full speed ..."""
    time_slack: float = 10.0
    """... and so much more [s]."""
    tiago: float = 0.4
    """Weight of this body among all; so the other two."""
    go2: float = 0.4
    random: float = 0.2
    """Of drawn bodies: discs, boxes and ovals, with and without sideways motion."""
    num_bodies: int = 48
    """How many are drawn."""
    decision_rate: int = 10
    """[Hz]; 30 must be a multiple."""
    num_beams: int = 180
    layouts: int = 48
    """Different layouts of each kind of world."""
    pairs: int = 64
    """Different tasks in each layout."""
    world_seed: int = TRAINING_SEED
    """Of the first layout, the others follow: from 1,000,000 on, so that no policy has seen what it is tested on."""
    imperfections: Imperfections = Imperfections()

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        for names in (KINDS, BODY_KINDS):
            weights = [getattr(self, name) for name in names]
            if min(weights) < 0.0 or not 0.0 < sum(weights) < math.inf:
                raise BadArgument(f"weights of {', '.join(names)} must be 0 or more and not all 0, got {weights}")
        check_ranges(self, "movers", "mover_speeds", "lengths")
        check_fields(self, f"at most {MOST_MOVERS}", lambda pair: pair[1] <= MOST_MOVERS, "movers")
        reached = f"in part beyond the {GOAL_TOLERANCE} m within which a goal counts as reached"
        check_fields(self, reached, lambda pair: pair[1] > GOAL_TOLERANCE, "lengths")
        check_fields(self, "a divisor of 30 Hz", lambda rate: rate >= 1 and 30 % rate == 0, "decision_rate")
        check_counts(self, "num_beams", "layouts", "pairs", "num_bodies")
        check_not_negative(self, "world_seed", "time_slack")
        check_shares(self, "patrols", "pausing")
        check_positive(self, "time_factor")

    def of(self, kind: str) -> "ArenaConfig":
        """The same with only this kind of world.

        Raises:
            BadArgument: There is no such kind.
        """
        if kind not in KINDS:
            raise BadArgument(f"no kind of world {kind!r}; there are {', '.join(KINDS)}")
        return replace(self, **{name: float(name == kind) for name in KINDS})  # type: ignore[arg-type]

    def driven_by(self, body: str) -> "ArenaConfig":
        """The same with only this kind of body.

        Raises:
            BadArgument: There is no such body.
        """
        if body not in BODY_KINDS:
            raise BadArgument(f"no body {body!r}; there are {', '.join(BODY_KINDS)}")
        return replace(self, **{name: float(name == body) for name in BODY_KINDS})  # type: ignore[arg-type]

    @property
    def shares(self) -> tuple[float, ...]:
        """Of the kinds of worlds, summing to 1."""
        weights = [getattr(self, name) for name in KINDS]
        return tuple(weight / sum(weights) for weight in weights)

    @property
    def body_shares(self) -> tuple[float, ...]:
        """Of the kinds of bodies, summing to 1."""
        weights = [getattr(self, name) for name in BODY_KINDS]
        return tuple(weight / sum(weights) for weight in weights)
