"""The explore stage: the goal once it is known, else the best frontier, with patience (Zhang et al., Section III-C)."""

import math
from dataclasses import dataclass, field

import numpy as np

from vuca_nav.exploration.frontiers import find_frontiers
from vuca_nav.exploration.heuristic import Critic, NoCritic, Score, score_candidates
from vuca_nav.exploration.remaining import RemainingWay
from vuca_nav.geometry import transform_points
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.perception.percept import Percept
from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.survey import Survey
from vuca_nav.planning.target import Target
from vuca_nav.telemetry.interface import FrontierView, Telemetry
from vuca_nav.types import FloatArray, Pose2

_RESORTS = (
    (False, False, False),
    (True, False, False),
    (False, False, True),
    (False, True, False),
    (True, True, False),
    (True, True, True),
)
"""Settings that are tried in turn until there is a target: whether to doubt obstacles that have not been seen lately,
since a mover may have left unseen; whether to forgive blacklisted targets; whether to squeeze through what the map says
is too narrow by a cell."""
_STILL_THERE = 0.2
"""A frontier is still there if a boundary cell is so near to where it was [m]."""


@dataclass(frozen=True, slots=True)
class ExplorerConfig:
    """Settings of the choice and of its triggers."""

    score: Score = "metres"
    """How D^h and V^h are weighed against each other."""
    gamma: float = 0.0
    """Weight of V^h, which needs a critic: for the score in metres, the extra way that surely sparing a mover is worth
    [m]; for the normalised one, without dimension."""
    unknown: float | None = 4.0
    """Length that a metre of the unknown counts for in D^h near what stands there, whose way to the goal leads around
    what is known [m]. None for the straight line from the candidate to the goal, as in the paper."""
    look_ahead: float | None = 4.0
    """Length along the path to a candidate at which the critic rates it [m]: the near part of the way can be seen. None
    for the candidate itself, which the paper sets as O_g."""
    movers_only: bool = False
    """Whether V^h has a say only while something is seen to move; in the paper it always has."""
    min_frontier: float = 0.4
    """Shorter frontiers are noise [m]. Cells too near to walls do not count: an opening of 1 m has 0.4 m."""
    max_frontier: float = 3.0
    """Longer frontiers are cut into pieces [m]."""
    hysteresis: float = 3.0
    """A new choice must cost less by this than the present one [m]."""
    same_within: float = 2.0
    """A candidate this near to the present choice is the present choice, moved on [m]."""
    reached_within: float = 0.4
    """Distance within which a target counts as reached [m]."""
    entropy_change: float = 4000.0
    """Change of the map's entropy since the last choice that calls for a new one [nat]: about 30 m^2 of new floor."""
    min_interval: float = 0.5
    """Least time between two choices, whatever the triggers say [s]."""
    blacklist_time: float = 30.0
    """Time for which a target that could not be approached is left out [s]."""
    blacklist_radius: float = 1.0
    """Candidates this near to a blacklisted target are left out with it [m]."""


@dataclass(frozen=True, slots=True)
class Exploration:
    """A decision of the explorer."""

    target: Target | None
    """The chosen target; None if none can be reached."""
    paths: PathField
    """Paths from the robot over the map that the decision was based on."""


@dataclass(slots=True)
class Explorer:
    """Chooses P_exploration."""

    config: ExplorerConfig = field(default_factory=ExplorerConfig)
    critic: Critic = field(default_factory=NoCritic)
    telemetry: Telemetry = field(default_factory=Telemetry)
    goal: tuple[float, float] = (0.0, 0.0)
    goal_reach: float = 0.0
    target: Target | None = None
    _blacklist: list[tuple[float, float, float]] = field(default_factory=list)
    _chosen_at: float = -math.inf
    _entropy: float = 0.0
    _goal_was_known: bool = False

    def reset(self, goal: tuple[float, float], goal_reach: float = 0.0) -> None:
        """Start a mission.

        Args:
            goal: Goal in the map [m].
            goal_reach: Distance from the goal of a place that stands for it where the body cannot stand on it [m].
        """
        self.goal, self.goal_reach = goal, goal_reach
        self.target = None
        self._blacklist = []
        self._chosen_at = -math.inf
        self._entropy = 0.0
        self._goal_was_known = False

    def trigger(self, now: float, grid: OccupancyGrid, robot: tuple[float, float]) -> str | None:
        """Cause for a new choice at once, None if there is none: the four conditions of Section III-C.

        Args:
            now: Time [s].
            grid: The navigation grid as it is now.
            robot: Position in the map [m].
        """
        if now - self._chosen_at < self.config.min_interval:
            return None
        if self.target is None:
            return "there is no target"
        if self.target.is_goal:
            return None
        if not self._goal_was_known and grid.state(*self.goal) != 0:
            return "the goal's state became known"
        if math.dist(robot, self.target.approach) < self.config.reached_within:
            self.give_up(now)  # all of it can be seen from here
            return "the exploration point was reached"
        if not _is_frontier(grid, self.target.point):
            return "the exploration point's state changed"
        if abs(grid.entropy - self._entropy) > self.config.entropy_change:
            return "the map changed a lot"
        return None

    def give_up(self, now: float) -> None:
        """Blacklist the present target for a while, and forget it."""
        if self.target is not None and not self.target.is_goal:
            self._blacklist.append((*self.target.point, now + self.config.blacklist_time))
        self.target = None

    def follow(self, map_correction: Pose2) -> None:
        """Move the target and the blacklist along with the map."""

        def moved(point: tuple[float, float]) -> tuple[float, float]:
            (x, y) = transform_points(map_correction, np.array([point]))[0].tolist()
            return x, y

        self._blacklist = [(*moved((x, y)), until) for x, y, until in self._blacklist]
        if self.target is not None and not self.target.is_goal:
            self.target = Target(moved(self.target.point), moved(self.target.approach), is_goal=False)

    def update(self, cause: str | None, percept: Percept, survey: Survey) -> Exploration:
        """Choose anew if there is cause, or no way leads to the target any more.

        Args:
            cause: Cause of a new choice; None to stay with the target as long as it can be reached.
            percept: The percept of this tick.
            survey: Survey of the map as it is now.
        """
        paths, last = survey.paths(), self.target
        squeezing = False
        if last is not None and not paths.reaches(*last.approach):
            # A noisy return must not make the robot turn back in a door.
            squeezed = survey.paths(squeezing=True)
            if squeezed.reaches(*last.approach):
                paths, squeezing = squeezed, True
            else:
                cause = "no path leads to the target"
        if cause is None and last is not None:
            return Exploration(last, paths)
        for doubting, forgiving, squeezes in _RESORTS:
            paths = survey.paths(doubting=doubting, squeezing=squeezing or squeezes)
            self.target = last  # it is known to be preferred
            if self._choose(percept, survey, paths, forgiving=forgiving) is not None:
                break
        target = self.target
        if target is not None and (last is None or target.point != last.point):
            what = "the goal" if target.is_goal else f"({target.point[0]:.1f}, {target.point[1]:.1f})"
            self.telemetry.event(f"{cause}: now heading for {what}")
        return Exploration(target, paths)

    def _choose(self, percept: Percept, survey: Survey, paths: PathField, *, forgiving: bool) -> Target | None:
        """Choose anew; None if only blacklisted targets can be reached and they are not forgiven."""
        config, grid, costmap, now = self.config, survey.grid, paths.costmap, percept.stamp
        self._chosen_at, self._entropy = now, grid.entropy
        self._goal_was_known = grid.state(*self.goal) != 0
        self._blacklist = [entry for entry in self._blacklist if entry[2] > now]
        near = paths.standing_place(*self.goal, self.goal_reach)
        if near is not None:
            self.target = Target(self.goal, near, is_goal=True)
            return self.target
        found = find_frontiers(costmap, paths, config.min_frontier, config.max_frontier, costmap.radius)
        if not len(found.points_in_map):
            # Only chinks are left; better to look into one than to stand.
            found = find_frontiers(costmap, paths, costmap.resolution, config.max_frontier, 0.0)
        points, approach, lengths = found
        if len(points):
            keep = ~self._is_blacklisted(points)
            if forgiving and not keep.any():
                self._blacklist = []
                keep[:] = True
            points, approach, lengths = points[keep], approach[keep], lengths[keep]
        if not len(points):
            self.target = None
            return None
        remaining = self._remaining(points, costmap)
        leads_on = np.isfinite(remaining)
        points, approach, lengths, remaining = (some[leads_on] for some in (points, approach, lengths, remaining))
        goal_cost = lengths + remaining
        pose = survey.map_from_base
        rated = points if config.look_ahead is None else paths.on_the_way(approach, config.look_ahead)
        if config.movers_only and not len(percept.moving):
            safety = np.ones(len(points))
        else:
            safety = self.critic.values(rated, percept, pose)
        if self.target is not None and not self.target.is_goal:
            away = np.hypot(points[:, 0] - self.target.point[0], points[:, 1] - self.target.point[1])
            goal_cost = goal_cost - config.hysteresis * (away < config.same_within)
        self.telemetry.safety(lambda asked: self.critic.values(asked, percept, pose))
        scores = score_candidates(goal_cost, safety, config.gamma, config.score)
        chosen = int(np.argmin(scores.total))
        self.telemetry.frontiers(FrontierView(points, scores.goal_term, scores.safety_term, scores.total, chosen))
        self.target = Target(
            (float(points[chosen, 0]), float(points[chosen, 1])),
            (float(approach[chosen, 0]), float(approach[chosen, 1])),
            is_goal=False,
        )
        return self.target

    def _remaining(self, points: FloatArray, costmap: Costmap) -> FloatArray:
        """Length of the way from each candidate to the goal, (n,) [m]; ``inf`` for those that cannot lead there.

        By straight lines, if none can: the map may be wrong, or the goal within something.
        """
        if self.config.unknown is not None:
            lengths = RemainingWay(costmap, self.goal, self.config.unknown).lengths(points)
            if np.isfinite(lengths).any():
                return lengths
        return np.hypot(points[:, 0] - self.goal[0], points[:, 1] - self.goal[1])

    def _is_blacklisted(self, points: np.ndarray) -> np.ndarray:
        result = np.zeros(len(points), np.bool_)
        for x, y, _ in self._blacklist:
            result |= np.hypot(points[:, 0] - x, points[:, 1] - y) < self.config.blacklist_radius
        return result


def _is_frontier(grid: OccupancyGrid, point: tuple[float, float]) -> bool:
    """Whether there still is a boundary cell near the point."""
    reach = round(_STILL_THERE / grid.resolution)
    i, j = grid.cell(*point)
    window = grid.level[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1]
    free, unknown = window < 0, window == 0
    return bool(
        (free[1:] & unknown[:-1]).any()
        or (free[:-1] & unknown[1:]).any()
        or (free[:, 1:] & unknown[:, :-1]).any()
        or (free[:, :-1] & unknown[:, 1:]).any()
    )
