"""The dynamic window approach (Fox, Burgard and Thrun 1997) on the present scan.

Each admissible pair of velocities that the body can reach soon is held for ``horizon`` seconds; the trajectory is
judged by where it leads, how near it passes to what the scan shows, and how it turns. What moves is taken to stand.

Trajectories begin where the body will be when it answers. A body that is longer than wide may get to where it can go
neither on nor round; it then backs or sidesteps out to where it can turn on the spot.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from vuca_nav.footprint import cover_by_discs
from vuca_nav.geometry import compose
from vuca_nav.perception.distance_field import DistanceField, clearance_at
from vuca_nav.perception.percept import Percept
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.delay import CommandDelay
from vuca_nav.types import STANDING, STOP, BodySpec, LidarSpec, Pose2, VelocityCommand


@dataclass(frozen=True, slots=True)
class DynamicWindowConfig:
    """Costs are in metres: what it is worth to be so much nearer to the waypoint."""

    window: float = 0.3
    """Velocities within so much acceleration are tried [s]."""
    num_v_x: int = 9
    num_w_z: int = 21
    horizon: float = 1.8
    """[s]"""
    time_step: float = 0.1
    """[s]"""
    margin: float = 0.04
    """Added to the footprint: range noise (two sigma) [m]."""
    comfort: float = 0.35
    """From this distance to the footprint's edge on, nearness costs nothing [m]."""
    comfort_weight: float = 0.8
    """Cost of touching; falls with the square."""
    heading_weight: float = 0.35
    """Cost of a radian off the direction to the waypoint at the trajectory's end."""
    turn_weight: float = 0.04
    """Cost of a change of yaw rate by 1 rad/s: against weaving."""
    backward_weight: float = 0.5
    """Cost of a metre backwards."""
    brake_margin: float = 0.1
    """Room left when braking [m]."""
    recovery_turn: float = 0.5
    """Share of the greatest yaw rate at which it turns on the spot when no motion is admissible."""
    patience: float = 1.0
    """Without getting on for so long, a body that cannot turn where it is makes its way out [s] ..."""
    progress_way: float = 0.15
    """... where getting on is so much way [m] ..."""
    progress_turn: float = 0.3
    """... or so much turning [rad]."""
    escape_speed: float = 0.2
    """Of the way out [m/s]."""
    escape_time: float = 4.0
    """After which the window is asked again [s]."""
    escape_horizon: float = 1.0
    """[s]"""
    escape_room: float = 0.05
    """Beyond what turning on the spot takes, at which the way out ends: hysteresis [m]."""


class DynamicWindow(LocalPolicy):
    """Differential bodies and quadrupeds alike: v_y stays 0 but on the way out of a tight spot."""

    def __init__(self, body: BodySpec, lidar: LidarSpec, config: DynamicWindowConfig = DynamicWindowConfig()):
        self.body = body
        self.config = config
        self._discs = cover_by_discs(body.footprint)
        self._turning_disc = np.array([[0.0, 0.0, body.radius]])
        self._centre = np.zeros((1, 3))
        self._is_round = len(self._discs) == 1
        self._dt = 1.0 / lidar.rate
        self._delay = CommandDelay(body, lidar.rate)
        self.reset()

    def reset(self) -> None:
        """Stand."""
        self._last = STOP
        self._delay.reset()
        self._since_progress = STANDING
        self._waited = self._escaping = 0.0

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The best pair of the window.

        Where none is admissible it is a turn on the spot towards the waypoint, or the way to where there is clearance
        for that.
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
        # The window lies about what was asked for last: the measured velocity lags behind it.
        v_x, w_z, admissible = _best(
            field,
            self._discs,
            start.x,
            start.y,
            math.cos(start.yaw),
            math.sin(start.yaw),
            goal.point_in_base[0],
            goal.point_in_base[1],
            goal.is_final,
            self._last.w_z,
            max(body.min_v_x, self._last.v_x - c.window * body.max_a_x),
            min(body.max_v_x, self._last.v_x + c.window * body.max_a_x),
            max(-body.max_w_z, self._last.w_z - c.window * body.max_a_w),
            min(body.max_w_z, self._last.w_z + c.window * body.max_a_w),
            c.num_v_x,
            c.num_w_z,
            c.horizon,
            c.time_step,
            c.margin,
            c.comfort,
            c.comfort_weight,
            c.heading_weight,
            c.turn_weight,
            c.backward_weight,
            c.brake_margin,
            body.max_a_x,
        )
        return VelocityCommand(v_x, 0.0, w_z) if admissible else None

    def _clearance_to_turn(self, field: DistanceField, start: Pose2) -> float:
        """What is left around the body when it turns on the spot once round [m]."""
        return clearance_at(field, self._turning_disc, start.x, start.y, 1.0, 0.0) - self.config.margin

    def _way_out(self, percept: Percept, goal: LocalGoal, field: DistanceField, start: Pose2) -> VelocityCommand | None:
        """Towards where it can turn, once it has stood for long where it cannot; None if it need not."""
        body, c = self.body, self.config
        self._watch_progress(percept, goal)
        room = self._clearance_to_turn(field, start)
        if self._escaping <= 0.0 and self._waited >= c.patience and room < 0.0:
            self._escaping = c.escape_time
        if self._escaping <= 0.0:
            return None
        if room >= c.escape_room:
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
                body.radius + c.margin + 2.0 * c.escape_room,
                start.x,
                start.y,
                math.cos(start.yaw),
                math.sin(start.yaw),
                self._last,
                c.escape_speed,
                max(body.min_v_x, -c.escape_speed),
                body.max_v_y,
                c.recovery_turn * body.max_w_z,
                c.escape_horizon,
                c.time_step,
            )
        )

    def _watch_progress(self, percept: Percept, goal: LocalGoal) -> None:
        """How long it has not got on though there is way to go."""
        self._since_progress = compose(self._since_progress, percept.motion)
        way, turn = self.config.progress_way, self.config.progress_turn
        x, y, yaw = self._since_progress
        if math.hypot(x, y) > way or abs(yaw) > turn or math.hypot(*goal.point_in_base) < way:
            self._since_progress, self._waited = STANDING, 0.0
        self._waited += self._dt


@njit(cache=True)
def _best(
    field, discs, start_x, start_y, start_cos, start_sin, goal_x, goal_y, is_final, last_w, v_min,
    v_max, w_min, w_max, num_v, num_w, horizon, dt, margin, comfort, comfort_weight, heading_weight, turn_weight,
    backward_weight, brake_margin, max_a,
):  # fmt: skip
    """Cheapest admissible pair of velocities, and whether there was any."""
    room_now = clearance_at(field, discs, start_x, start_y, start_cos, start_sin) - margin
    steps = int(round(horizon / dt))
    best_cost, best_v, best_w, found = 1e30, 0.0, 0.0, False
    for b in range(num_w + 1):
        # The last one: straight ahead, which the even spacing may miss.
        w = w_min + (w_max - w_min) * b / (num_w - 1) if b < num_w else min(max(0.0, w_min), w_max)
        half_cos, half_sin = math.cos(0.5 * w * dt), math.sin(0.5 * w * dt)
        for a in range(num_v):
            v = v_min + (v_max - v_min) * a / (num_v - 1)
            x, y = start_x, start_y
            c, s = start_cos, start_sin  # of the heading
            least = 1e9
            nearest = (goal_x - x) ** 2 + (goal_y - y) ** 2
            free = horizon
            for step in range(steps):
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                x += v * c * dt
                y += v * s * dt
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                room = clearance_at(field, discs, x, y, c, s) - margin
                # From too near an obstacle one may still move away from it.
                if room < 0.0 and room <= room_now + 1e-3 * step:
                    free = step * dt
                    break
                least = min(least, room)
                nearest = min(nearest, (goal_x - x) ** 2 + (goal_y - y) ** 2)
            if free < horizon:
                if abs(v) < 1e-6 and room_now >= 0.0:
                    continue
                if abs(v) * free < v * v / (2.0 * max_a) + brake_margin:
                    continue
                least = 0.0
            away = math.sqrt(nearest) if is_final else math.hypot(goal_x - x, goal_y - y)
            # Angle between the heading at the end and the direction to the waypoint.
            off = abs(math.atan2(c * (goal_y - y) - s * (goal_x - x), c * (goal_x - x) + s * (goal_y - y)))
            near = max(0.0, (comfort - max(least, 0.0)) / comfort)
            cost = (
                away
                + heading_weight * off * min(1.0, away)
                + comfort_weight * near * near
                + turn_weight * abs(w - last_w)
                + backward_weight * max(0.0, -v) * horizon
            )
            if cost < best_cost:
                best_cost, best_v, best_w, found = cost, v, w, True
    return best_v, best_w, found


@njit(cache=True)
def _clearest(
    field, discs, centre, enough, start_x, start_y, start_cos, start_sin, last, speed, v_min,
    v_y_max, w_max, horizon, dt,
):  # fmt: skip
    """Slow velocity that leads the body's centre farthest from all returns without leading its outline nearer.

    Distances of the centre beyond ``enough`` count as that much. Sixteen directions, each with and without turning;
    to stand is one choice more.
    """
    now = clearance_at(field, discs, start_x, start_y, start_cos, start_sin)
    steps = int(round(horizon / dt))
    best = -1e30
    best_x, best_y, best_w = 0.0, 0.0, 0.0
    for k in range(17):
        v_x = speed * math.cos(0.125 * math.pi * k) if k < 16 else 0.0
        v_y = speed * math.sin(0.125 * math.pi * k) if k < 16 else 0.0
        if v_x < v_min - 1e-9 or abs(v_y) > v_y_max + 1e-9:
            continue
        for turn in range(-1, 2):
            w = turn * w_max
            x, y, c, s = start_x, start_y, start_cos, start_sin
            half_cos, half_sin = math.cos(0.5 * w * dt), math.sin(0.5 * w * dt)
            least = now
            for _ in range(steps):
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                x += (v_x * c - v_y * s) * dt
                y += (v_x * s + v_y * c) * dt
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                least = min(least, clearance_at(field, discs, x, y, c, s))
            gain = min(clearance_at(field, centre, x, y, 1.0, 0.0), enough)
            # Nearer than now counts four times what it gains where it is tight, and nothing from a cell of room on.
            loss = max(0.0, min(now, field.resolution) - least)
            # Two centimetres, the range noise, for going the other way: it must not waver between equally good ways.
            change = abs(v_x - last[0]) + abs(v_y - last[1]) + 0.1 * abs(w - last[2])
            value = gain - 4.0 * loss - 0.05 * change - 0.01 * abs(turn)
            if value > best:
                best, best_x, best_y, best_w = value, v_x, v_y, w
    return best_x, best_y, best_w
