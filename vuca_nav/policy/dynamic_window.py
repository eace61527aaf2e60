"""The dynamic window approach (Fox, Burgard and Thrun 1997) on the present scan.

Each admissible pair of velocities that the body can reach soon is held for ``horizon`` seconds; the trajectory is
judged by its end, its clearance from the returns, and its turning. Moving obstacles are taken to stand.

Trajectories begin where the body will be when it answers. A body that is longer than wide may get to a place where it
can neither go on nor turn; it then backs or sidesteps out to where it can turn on the spot.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vuca_nav.footprint import cover_by_discs
from vuca_nav.geometry import compose
from vuca_nav.kernel_cache import njit
from vuca_nav.perception.distance_field import DistanceField, clearance_at, smooth_clearance_at
from vuca_nav.perception.percept import Percept
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.delay import CommandDelay
from vuca_nav.types import STANDING, STOP, BodySpec, LidarSpec, Pose2, VelocityCommand

ROUGHLY = 2.0
"""Greatest difference between a clearance read from the nearest cell and one that is interpolated, in cells."""
PASSED = 0.2
"""Distance at which a trajectory passes the waypoint [m]."""
LEAST_COMFORT = 0.1
"""Clearance that is comfortable however narrow the way is [m]: beneath it the body keeps to the middle."""
LEAST_AT_GOAL = 0.02
"""Clearance that is comfortable wherever the goal is [m]."""
ROUNDING = 1e-9
"""Slack of the lower bounds of costs, so that no rounding makes one too high."""


@dataclass(frozen=True, slots=True)
class DynamicWindowConfig:
    """Settings of the dynamic window. Costs are in metres of distance to the waypoint."""

    window: float = 0.3
    """Time of acceleration that bounds the velocities that are tried [s]."""
    num_v_x: int = 9
    num_w_z: int = 21
    horizon: float = 1.8
    """Length of the trajectories [s]."""
    time_step: float = 0.1
    """[s]"""
    margin: float = 0.04
    """Inflation of the footprint [m]: range noise (two sigma)."""
    comfort: float = 0.35
    """Clearance beyond which obstacles cost nothing [m]."""
    comfort_weight: float = 0.8
    """Cost of touching; falls with the square."""
    heading_weight: float = 0.35
    """Cost of a radian off the direction to the waypoint at the trajectory's end."""
    turn_weight: float = 0.04
    """Cost of a change of yaw rate by 1 rad/s: against weaving."""
    backward_weight: float = 0.5
    """Cost of a metre backwards."""
    late_weight: float = 0.3
    """Cost of a second by which a waypoint is passed later, if it is not the goal [m/s]."""
    brake_margin: float = 0.1
    """Clearance left when braking [m]."""
    recovery_turn: float = 0.5
    """Share of the greatest yaw rate at which the body turns on the spot when no motion is admissible."""
    patience: float = 1.0
    """Time without progress after which a body that cannot turn on the spot makes its way out [s]."""
    progress_way: float = 0.15
    """Way that counts as progress [m]."""
    progress_turn: float = 0.3
    """Turn that counts as progress [rad]."""
    escape_speed: float = 0.2
    """Speed on the way out [m/s]."""
    escape_time: float = 4.0
    """Longest time of the way out, after which the window is searched again [s]."""
    escape_horizon: float = 1.0
    """Length of the way out's trajectories [s]."""
    escape_clearance: float = 0.05
    """Clearance beyond that of a turn on the spot at which the way out ends [m]: hysteresis."""


class WindowSettings(NamedTuple):
    """Settings of the window's kernel, from ``DynamicWindowConfig`` and the body."""

    num_v_x: int
    num_w_z: int
    steps: int
    """Number of steps of a trajectory."""
    time_step: float
    """[s]"""
    horizon: float
    """[s]"""
    margin: float
    """[m]"""
    comfort: float
    """[m]"""
    comfort_weight: float
    heading_weight: float
    turn_weight: float
    backward_weight: float
    late_weight: float
    brake_margin: float
    """[m]"""
    max_a_x: float
    """[m/s^2]"""
    radius: float
    """Of the circle about the footprint [m]."""


class EscapeSettings(NamedTuple):
    """Settings of the way out's kernel, from ``DynamicWindowConfig`` and the body."""

    enough: float
    """Distances of the body's centre beyond this count as this much [m]."""
    speed: float
    """[m/s]"""
    min_v_x: float
    """[m/s]"""
    max_v_y: float
    """[m/s]"""
    w_z: float
    """Yaw rate of the candidates that turn [rad/s]."""
    steps: int
    """Number of steps of a trajectory."""
    time_step: float
    """[s]"""


class DynamicWindow(LocalPolicy):
    """The dynamic window as a policy, for differential bodies and quadrupeds: v_y is 0 but on the way out.

    Args:
        body: The body that is driven.
        lidar: The body's lidar.
        config: Settings.
        rate: Rate of the ticks [Hz]; by default the lidar's.
    """

    def __init__(
        self,
        body: BodySpec,
        lidar: LidarSpec,
        config: DynamicWindowConfig = DynamicWindowConfig(),
        rate: float | None = None,
    ):
        self.body = body
        self.rate = ticks = lidar.rate if rate is None else rate
        self.config = config
        self._discs = cover_by_discs(body.footprint)
        self._turning_disc = np.array([[0.0, 0.0, body.radius]])
        self._centre = np.zeros((1, 3))
        self._is_round = len(self._discs) == 1
        self._window_settings = WindowSettings(
            config.num_v_x,
            config.num_w_z,
            round(config.horizon / config.time_step),
            config.time_step,
            config.horizon,
            config.margin,
            config.comfort,
            config.comfort_weight,
            config.heading_weight,
            config.turn_weight,
            config.backward_weight,
            config.late_weight,
            config.brake_margin,
            body.max_a_x,
            body.radius,
        )
        self._escape_settings = EscapeSettings(
            body.radius + config.margin + 2.0 * config.escape_clearance,
            config.escape_speed,
            max(body.min_v_x, -config.escape_speed),
            body.max_v_y,
            config.recovery_turn * body.max_w_z,
            round(config.escape_horizon / config.time_step),
            config.time_step,
        )
        self._dt = 1.0 / ticks
        self._delay = CommandDelay(body, ticks)
        self.reset()

    def reset(self) -> None:
        """Forget the last mission; the body stands."""
        self._last = STOP
        self._delay.reset()
        self._since_progress = STANDING
        self._waited = self._escaping = 0.0

    def follow(self, command: VelocityCommand) -> None:
        """Take in a command that another policy gave the body."""
        self._last = command
        self._since_progress, self._waited, self._escaping = STANDING, 0.0, 0.0
        self._delay.add(command)

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The best pair of the window.

        Where none is admissible it is a turn on the spot towards the waypoint, or the way out to a place with the
        clearance for a turn.
        """
        command = STOP if goal is None or not percept.is_valid else self._choose(percept, goal)
        self._last = command
        self._delay.add(command)
        return command

    def _choose(self, percept: Percept, goal: LocalGoal) -> VelocityCommand:
        c, field, start = self.config, percept.distance_field, self._delay.pose()
        command = None if self._is_round else self._way_out(percept, goal, field, start)
        if command is None:
            command = self._in_window(goal, field, start)
        if command is None:
            waypoint_x, waypoint_y = goal.point_in_base
            turn = math.copysign(c.recovery_turn * self.body.max_w_z, math.atan2(waypoint_y, waypoint_x))
            command = VelocityCommand(0.0, 0.0, turn)
            if not self._is_round and self._clearance_to_turn(field, start) < 0.0:
                self._escaping = c.escape_time
                command = self._way_out(percept, goal, field, start) or STOP
        return command

    def _in_window(self, goal: LocalGoal, field: DistanceField, start: Pose2) -> VelocityCommand | None:
        """The cheapest admissible pair, if there is one."""
        body, c = self.body, self.config
        # The window lies about the last command: the measured velocity lags behind it.
        v_x, w_z, admissible = _best(
            field,
            self._discs,
            self._window_settings._replace(margin=goal.margin(c.margin, self._is_round)),
            (start.x, start.y, math.cos(start.yaw), math.sin(start.yaw)),
            (goal.point_in_base[0], goal.point_in_base[1], goal.room, goal.is_final),
            (
                max(body.min_v_x, self._last.v_x - c.window * body.max_a_x),
                min(body.max_v_x, self._last.v_x + c.window * body.max_a_x),
                max(-body.max_w_z, self._last.w_z - c.window * body.max_a_w),
                min(body.max_w_z, self._last.w_z + c.window * body.max_a_w),
            ),
            self._last.w_z,
        )
        return VelocityCommand(float(v_x), 0.0, float(w_z)) if admissible else None

    def _clearance_to_turn(self, field: DistanceField, start: Pose2) -> float:
        """Least clearance of the body over a full turn on the spot [m]."""
        return smooth_clearance_at(field, self._turning_disc, start.x, start.y, 1.0, 0.0) - self.config.margin

    def _way_out(self, percept: Percept, goal: LocalGoal, field: DistanceField, start: Pose2) -> VelocityCommand | None:
        """The velocity towards a place where the body can turn, once it is stuck where it cannot; None otherwise."""
        c = self.config
        self._watch_progress(percept, goal)
        clearance = self._clearance_to_turn(field, start)
        if self._escaping <= 0.0 and self._waited >= c.patience and clearance < 0.0:
            self._escaping = c.escape_time
        if self._escaping <= 0.0:
            return None
        if clearance >= c.escape_clearance:
            self._escaping = self._waited = 0.0
            return None
        self._escaping -= self._dt
        if self._escaping <= 0.0:
            self._waited = 0.0
        return VelocityCommand(
            *_clearest(
                field,
                self._discs,
                self._centre,
                self._escape_settings,
                (start.x, start.y, math.cos(start.yaw), math.sin(start.yaw)),
                self._last,
            )
        )

    def _watch_progress(self, percept: Percept, goal: LocalGoal) -> None:
        """Count the time without progress while the waypoint is not reached."""
        self._since_progress = compose(self._since_progress, percept.motion)
        way, turn = self.config.progress_way, self.config.progress_turn
        x, y, yaw = self._since_progress
        if math.hypot(x, y) > way or abs(yaw) > turn or math.hypot(*goal.point_in_base) < way:
            self._since_progress, self._waited = STANDING, 0.0
        self._waited += self._dt


_ESCAPE_DIRECTIONS = 16
"""Directions of the way out that are tried, besides standing."""
_LOSS_WEIGHT = 4.0
"""Weight of a loss of clearance against a gain, in tight spots."""
_CHANGE_WEIGHT, _TURN_SHARE = 0.05, 0.1
"""Cost of another velocity than the last, in metres for 1 m/s, and the share of it for 1 rad/s: 2 cm, the range noise,
for turning about at 0.2 m/s. The body must not waver between equally good ways."""
_TURN_COST = 0.01
"""Cost of turning at all [m]."""
_GETS_CLEAR = 1e-3
"""Clearance that a trajectory has to gain with each step where it begins too near an obstacle [m]."""


@njit(cache=True)
def _clearance(field, discs, precise_below, x, y, c, s):
    """Clearance of the body at a pose, precise where it is small [m]."""
    clearance = clearance_at(field, discs, x, y, c, s)
    return smooth_clearance_at(field, discs, x, y, c, s) if clearance < precise_below else clearance


@njit(cache=True)
def _best(field, discs, settings, start, target, limits, last_w):
    """Find the cheapest admissible pair of velocities, and whether there was any.

    First all trajectories are laid out without the field. Their least costs, those without an obstacle near, decide
    which one is judged first, and spare the field look-ups of those that cannot be cheaper than the best.

    Args:
        field: Distances to the returns.
        discs: (k, 3) discs that cover the body.
        settings: Settings of the window.
        start: x, y, cosine and sine of the yaw in base_link, where trajectories begin [m].
        target: x and y of the waypoint in base_link, the room that the way to it leaves [m], and whether it is the
            goal. A trajectory that passes over the waypoint need not end on it.
        limits: Least and greatest v_x [m/s] and w_z [rad/s] to try.
        last_w: Yaw rate of the last command [rad/s].
    """
    num_v, num_w, steps, dt = settings.num_v_x, settings.num_w_z, settings.steps, settings.time_step
    margin, horizon = settings.margin, settings.horizon
    start_x, start_y, start_cos, start_sin = start
    goal_x, goal_y, room, is_final = target
    # Where the way or the goal has less room than is comfortable, as much as it has is comfortable.
    comfort = min(settings.comfort, max(room - margin, LEAST_AT_GOAL if is_final else LEAST_COMFORT))
    comfort_weight = settings.comfort_weight * (comfort / settings.comfort if is_final else 1.0)
    comfort_reach = comfort + margin + ROUGHLY * field.resolution
    v_min, v_max, w_min, w_max = limits
    clearance_now = _clearance(field, discs, comfort_reach, start_x, start_y, start_cos, start_sin) - margin
    vs = np.empty(num_v)
    for a in range(num_v):
        vs[a] = v_min + (v_max - v_min) * a / (num_v - 1)
    ws = np.empty(num_w + 1)
    # Cosine and sine of the heading of each yaw rate, in the middle and at the end of each step.
    headings = np.empty((num_w + 1, steps, 4))
    xs, ys, nearest_of = np.empty(num_v), np.empty(num_v), np.empty(num_v)
    bounds = np.empty((num_w + 1) * num_v)
    first = 0
    for b in range(num_w + 1):
        # The last one is straight ahead, which the even spacing may miss.
        w = w_min + (w_max - w_min) * b / (num_w - 1) if b < num_w else min(max(0.0, w_min), w_max)
        ws[b] = w
        half_cos, half_sin = math.cos(0.5 * w * dt), math.sin(0.5 * w * dt)
        c, s = start_cos, start_sin
        xs[:], ys[:] = start_x, start_y
        nearest_of[:] = (goal_x - start_x) ** 2 + (goal_y - start_y) ** 2
        for step in range(steps):
            c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
            headings[b, step, 0], headings[b, step, 1] = c, s
            for a in range(num_v):
                xs[a] += vs[a] * c * dt
                ys[a] += vs[a] * s * dt
                nearest_of[a] = min(nearest_of[a], (goal_x - xs[a]) ** 2 + (goal_y - ys[a]) ** 2)
            c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
            headings[b, step, 2], headings[b, step, 3] = c, s
        for a in range(num_v):
            x, y, least_away = xs[a], ys[a], math.sqrt(nearest_of[a])
            away = least_away
            off = abs(math.atan2(c * (goal_y - y) - s * (goal_x - x), c * (goal_x - x) + s * (goal_y - y)))
            # One that is cut short ends somewhere on its way, and pays for touching.
            whole = away + settings.heading_weight * off * min(1.0, away)
            bound = min(whole, least_away + comfort_weight) - ROUNDING
            bound += settings.turn_weight * abs(w - last_w) + settings.backward_weight * max(0.0, -vs[a]) * horizon
            bounds[b * num_v + a] = bound
            if bound < bounds[first]:
                first = b * num_v + a
    best_cost, best, best_v, best_w = 1e30, -1, 0.0, 0.0
    for turn in range(-1, len(bounds)):
        index = first if turn < 0 else turn
        if turn == first or bounds[index] > best_cost:
            continue
        b, a = index // num_v, index % num_v
        v, w = vs[a], ws[b]
        x, y, c, s = start_x, start_y, start_cos, start_sin
        least = 1e9
        nearest = (goal_x - x) ** 2 + (goal_y - y) ** 2
        free, passed = horizon, horizon
        before = clearance_now
        for step in range(steps):
            half_x, half_y = 0.5 * v * headings[b, step, 0] * dt, 0.5 * v * headings[b, step, 1] * dt
            x += 2.0 * half_x
            y += 2.0 * half_y
            c, s = headings[b, step, 2], headings[b, step, 3]
            clearance = _clearance(field, discs, comfort_reach, x, y, c, s) - margin
            # A step is longer than a corner is wide: between two places that are this near to obstacles, look again.
            if min(before, clearance) < 0.5 * (abs(v) + abs(w) * settings.radius) * dt:
                half_c, half_s = headings[b, step, 0], headings[b, step, 1]
                between = _clearance(field, discs, comfort_reach, x - half_x, y - half_y, half_c, half_s) - margin
                clearance = min(clearance, between)
            before = clearance
            # Too near an obstacle the body may still move away from it.
            if clearance < 0.0 and clearance <= clearance_now + _GETS_CLEAR * step:
                free = step * dt
                break
            least = min(least, clearance)
            apart = (goal_x - x) ** 2 + (goal_y - y) ** 2
            if apart < nearest:
                nearest, passed = apart, (step + 1) * dt
        if free < horizon:
            if abs(v) < 1e-6 and clearance_now >= 0.0:
                continue
            if abs(v) * free < v * v / (2.0 * settings.max_a_x) + settings.brake_margin:
                continue
            least = 0.0
        away = math.sqrt(nearest)
        # Angle between the heading at the end and the direction to the waypoint.
        off = abs(math.atan2(c * (goal_y - y) - s * (goal_x - x), c * (goal_x - x) + s * (goal_y - y)))
        near = max(0.0, (comfort - max(least, 0.0)) / comfort)
        cost = (
            away
            + settings.heading_weight * off * min(1.0, away)
            + comfort_weight * near * near
            + settings.turn_weight * abs(w - last_w)
            + settings.backward_weight * max(0.0, -v) * horizon
        )
        if not is_final:
            cost += settings.late_weight * (passed if away < PASSED else horizon)
        if cost < best_cost or (cost == best_cost and index < best):
            best_cost, best, best_v, best_w = cost, index, v, w
    return best_v, best_w, best >= 0


@njit(cache=True)
def _clearest(field, discs, centre, settings, start, last):
    """Find the slow velocity that leads the body's centre farthest from all returns, its outline no nearer to them.

    The candidates are sixteen directions, each with and without turning, and standing.

    Args:
        field: Distances to the returns.
        discs: (k, 3) discs that cover the body.
        centre: (1, 3) the body's centre, a disc of no radius.
        settings: Settings of the way out.
        start: x, y, cosine and sine of the yaw in base_link, where trajectories begin [m].
        last: v_x, v_y, w_z of the last command.
    """
    dt = settings.time_step
    start_x, start_y, start_cos, start_sin = start
    now = smooth_clearance_at(field, discs, start_x, start_y, start_cos, start_sin)
    best = -1e30
    best_x, best_y, best_w = 0.0, 0.0, 0.0
    for k in range(_ESCAPE_DIRECTIONS + 1):
        moves, angle = k < _ESCAPE_DIRECTIONS, 2.0 * math.pi * k / _ESCAPE_DIRECTIONS
        v_x = settings.speed * math.cos(angle) if moves else 0.0
        v_y = settings.speed * math.sin(angle) if moves else 0.0
        if v_x < settings.min_v_x - 1e-9 or abs(v_y) > settings.max_v_y + 1e-9:
            continue
        for turn in range(-1, 2):
            w = turn * settings.w_z
            x, y, c, s = start_x, start_y, start_cos, start_sin
            half_cos, half_sin = math.cos(0.5 * w * dt), math.sin(0.5 * w * dt)
            least = now
            for _ in range(settings.steps):
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                x += (v_x * c - v_y * s) * dt
                y += (v_x * s + v_y * c) * dt
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                least = min(least, smooth_clearance_at(field, discs, x, y, c, s))
            gain = min(smooth_clearance_at(field, centre, x, y, 1.0, 0.0), settings.enough)
            # Beyond a cell's clearance a loss counts nothing.
            loss = max(0.0, min(now, field.resolution) - least)
            change = abs(v_x - last[0]) + abs(v_y - last[1]) + _TURN_SHARE * abs(w - last[2])
            value = gain - _LOSS_WEIGHT * loss - _CHANGE_WEIGHT * change - _TURN_COST * abs(turn)
            if value > best:
                best, best_x, best_y, best_w = value, v_x, v_y, w
    return best_x, best_y, best_w
