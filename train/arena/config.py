"""Settings of the arena: worlds, movers, bodies and everything that is imperfect."""

import math
from dataclasses import dataclass, replace

from vuca_nav.checks import check_counts, check_fields, check_not_negative, check_positive, check_ranges, check_shares
from vuca_nav.errors import BadArgument
from vuca_nav.task import GOAL_TOLERANCE
from worlds.registry import TRAINING_SEED

KINDS = ("static", "dynamic", "mixed", "square", "corridor")
"""Kinds of worlds: walls and roadblocks; open ground with movers; walls, roadblocks and movers; the plaza with movers;
the corridors of the factory's first quarter with movers."""
CROWDED_KINDS = ("circle", "hall")
"""Kinds of worlds that many robots share, and nothing else moves in: open ground; ground of four sorts."""
ALL_KINDS = (*KINDS, *CROWDED_KINDS)
BODY_KINDS = ("tiago", "go2", "random")
MAX_LATENCY = 8
"""Greatest latency [ticks]: more than any stack has; commands are remembered for no longer."""
MOST_MOVERS = 120
"""Greatest number of movers in one world: more than any of the registry has."""


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Errors of sensors, of the pose and of the body; sigmas are of normal distributions."""

    range_sigma: float = 0.02
    """Sigma of a range [m] (robots.noise)."""
    dropout: float = 0.01
    """Share of beams without a return (robots.noise)."""
    empty_scan: float = 0.002
    """Share of scans without any return."""
    twist_sigma: float = 0.02
    """Sigma of the measured velocity, in shares of the body's limits."""
    odometry_scale: float = 0.03
    """Relative error of odometry's distances, per episode (robots.noise)."""
    odometry_turn: float = 0.02
    """Relative error of odometry's turns, per episode (robots.noise)."""
    pose_sigma: float = 0.04
    """Sigma of SLAM's position, which the goal is given by [m]; over an episode it errs by 0.02 to 0.04."""
    yaw_sigma: float = 0.01
    """Sigma of SLAM's heading [rad]."""
    pose_time: float = 5.0
    """Correlation time of the pose's error [s]."""
    latency: tuple[int, int] = (0, 2)
    """Least and greatest delay of a command beside the body's own, per episode [ticks of 1/30 s]."""
    response_spread: float = 0.3
    """Relative spread of the body's lags, delays and noise about what was identified; gains spread by a tenth at
    most."""
    velocity_noise: float = 1.0
    """Factor on the response's noise as identified."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
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
        """Make everything exact; bodies respond as identified, without the noise."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, (0, 0), 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ArenaConfig:
    """Settings of the episodes that the arena draws."""

    static: float = 0.2
    """Weight of this kind of world among all; likewise the other six."""
    dynamic: float = 0.25
    mixed: float = 0.3
    square: float = 0.1
    corridor: float = 0.15
    circle: float = 0.0
    hall: float = 0.0
    robots: int = 1
    """Number of robots in each world, moving obstacles to one another; more than one only in ``CROWDED_KINDS``. A world
    keeps its layout until all episodes begin anew."""
    movers: tuple[int, int] = (6, 20)
    """Fewest and most movers, in the worlds that have any."""
    mover_speeds: tuple[float, float] = (0.2, 2.0)
    """Slowest and fastest speed of a mover, as multiples of the body's own greatest speed."""
    patrols: float = 0.25
    """Share of the movers that go straight to and fro; half of them across the robot's straight path."""
    pausing: float = 0.2
    """Share of the movers that stop and go."""
    lengths: tuple[float, float] = (1.5, 12.0)
    """Least and greatest length of the shortest path to the goal [m]."""
    time_factor: float = 3.0
    """Time limit of an episode, as a multiple of the shortest path's time at full speed ..."""
    time_slack: float = 10.0
    """... and the time added to it [s]."""
    tiago: float = 0.4
    """Weight of this body among all; likewise the other two."""
    go2: float = 0.4
    random: float = 0.2
    """Weight of drawn bodies: discs, boxes and ovals, with and without sideways motion."""
    num_bodies: int = 48
    """Number of drawn bodies."""
    decision_rate: int = 10
    """Decisions a second [Hz]; must divide 30."""
    num_beams: int = 180
    layouts: int = 48
    """Number of different layouts of each kind of world."""
    pairs: int = 64
    """Number of different tasks in each layout."""
    world_seed: int = TRAINING_SEED
    """Seed of the first layout, which the others follow: from 1,000,000 on, so that no policy has seen what it is
    tested on."""
    imperfections: Imperfections = Imperfections()

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
        for names in (ALL_KINDS, BODY_KINDS):
            weights = [getattr(self, name) for name in names]
            if min(weights) < 0.0 or not 0.0 < sum(weights) < math.inf:
                raise BadArgument(f"weights of {', '.join(names)} must be 0 or more, not all 0")
        check_ranges(self, "movers", "mover_speeds", "lengths")
        check_fields(self, f"at most {MOST_MOVERS}", lambda pair: pair[1] <= MOST_MOVERS, "movers")
        reached = f"in part beyond the {GOAL_TOLERANCE} m within which a goal counts as reached"
        check_fields(self, reached, lambda pair: pair[1] > GOAL_TOLERANCE, "lengths")
        check_fields(self, "a divisor of 30 Hz", lambda rate: rate >= 1 and 30 % rate == 0, "decision_rate")
        check_counts(self, "num_beams", "layouts", "pairs", "num_bodies", "robots")
        if self.robots > 1 and any(getattr(self, kind) for kind in KINDS):
            raise BadArgument(
                f"{self.robots} robots a world go with {', '.join(CROWDED_KINDS)} only; give the other kinds a weight "
                "of 0"
            )
        check_not_negative(self, "world_seed", "time_slack")
        check_shares(self, "patrols", "pausing")
        check_positive(self, "time_factor")

    def of(self, kind: str) -> "ArenaConfig":
        """Make the same configuration with only this kind of world.

        Raises:
            BadArgument: If there is no such kind.
        """
        if kind not in ALL_KINDS:
            raise BadArgument(f"no kind of world {kind!r}; there are {', '.join(ALL_KINDS)}")
        return replace(self, **{name: float(name == kind) for name in ALL_KINDS})  # type: ignore[arg-type]

    def driven_by(self, body: str) -> "ArenaConfig":
        """Make the same configuration with only this kind of body.

        Raises:
            BadArgument: If there is no such body.
        """
        if body not in BODY_KINDS:
            raise BadArgument(f"no body {body!r}; there are {', '.join(BODY_KINDS)}")
        return replace(self, **{name: float(name == body) for name in BODY_KINDS})  # type: ignore[arg-type]

    @property
    def shares(self) -> tuple[float, ...]:
        """Shares of ``ALL_KINDS``, summing to 1."""
        weights = [getattr(self, name) for name in ALL_KINDS]
        return tuple(weight / sum(weights) for weight in weights)

    @property
    def body_shares(self) -> tuple[float, ...]:
        """Shares of the kinds of bodies, summing to 1."""
        weights = [getattr(self, name) for name in BODY_KINDS]
        return tuple(weight / sum(weights) for weight in weights)
