"""What the arena is made of: worlds, movers, bodies and everything that is imperfect."""

import math
from dataclasses import dataclass, replace

from vuca_nav.errors import BadArgument

KINDS = ("static", "dynamic", "mixed", "square", "corridor")
"""Walls and roadblocks; open ground with movers; walls, roadblocks and movers; the plaza with movers; the corridors of
the factory's first quarter with movers."""
BODY_KINDS = ("tiago", "go2", "random")
TRAINING_SEED = 1_000_000
"""First seed of the training worlds: evaluation has 0 to 999, so that no policy has seen what it is tested on."""
MAX_LATENCY = 8
"""More ticks of latency than any stack has; commands are remembered for no longer."""


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
    """Of the position that SLAM gives the goal by [m]; docs/experiments.md has 0.02 to 0.04 over an episode."""
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
        if not (0.0 <= self.dropout <= 1.0 and 0.0 <= self.empty_scan <= 1.0 and 0.0 <= self.response_spread < 1.0):
            raise BadArgument("dropout and empty_scan are shares from 0 to 1, response_spread one below 1")
        if self.pose_time <= 0.0:
            raise BadArgument(f"pose_time {self.pose_time} s must be positive")

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
    """Fewest and most, in the worlds that have any: 4 to 24 is what evaluation has."""
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
    """Of the first layout; the others follow."""
    imperfections: Imperfections = Imperfections()

    def __post_init__(self) -> None:
        """Raises BadArgument for what is out of its range."""
        for names in (KINDS, BODY_KINDS):
            weights = [getattr(self, name) for name in names]
            if min(weights) < 0.0 or not 0.0 < sum(weights) < math.inf:
                raise BadArgument(f"weights of {', '.join(names)} must be 0 or more and not all 0, got {weights}")
        for name in ("movers", "mover_speeds", "lengths"):
            low, high = getattr(self, name)
            if not 0 <= low <= high:
                raise BadArgument(f"{name} {low, high}: the first must be at least 0 and at most the second")
        if self.movers[1] > 120:
            raise BadArgument(f"movers {self.movers}: at most 120")
        if self.decision_rate < 1 or 30 % self.decision_rate:
            raise BadArgument(f"decision_rate {self.decision_rate} Hz: 30 Hz must be a multiple of it")
        if self.layouts < 1 or self.pairs < 1 or self.num_bodies < 1 or self.world_seed < 0:
            raise BadArgument("layouts, pairs and num_bodies must be 1 or more, world_seed 0 or more")

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
