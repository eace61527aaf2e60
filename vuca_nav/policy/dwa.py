"""The dynamic window approach (Fox, Burgard and Thrun 1997) on the present scan.

Each admissible pair of velocities that the body can reach soon is held for ``horizon`` seconds; the trajectory is
judged by where it leads, how near it passes to what the scan shows, and how it turns. What moves is taken to stand.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.types import STOP, BodySpec, FloatArray, LidarSpec, VelocityCommand


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
    reach: float = 2.6
    """Half side of the square about the robot in which the scan is looked at [m]."""
    resolution: float = 0.05
    """Of its distance field [m]."""


class DynamicWindow(LocalPolicy):
    """Differential bodies and quadrupeds alike: v_y stays 0."""

    def __init__(self, body: BodySpec, lidar: LidarSpec, config: DynamicWindowConfig = DynamicWindowConfig()):
        self.body = body
        self.config = config
        angles = lidar.angles_in_base()
        self._beams_in_base = np.column_stack([np.cos(angles), np.sin(angles)])
        self._discs = cover_by_discs(body.footprint)
        cells = 2 * round(config.reach / config.resolution)
        self._field = np.zeros((cells, cells), np.int16)
        self._last = STOP

    def reset(self) -> None:
        """Stand."""
        self._last = STOP

    def command(self, observation: LocalObservation) -> VelocityCommand:
        """The best pair of the window; a turn on the spot towards the waypoint where none is admissible."""
        body, c = self.body, self.config
        _distance_field(observation.scan.ranges, self._beams_in_base, c.resolution, c.reach, self._field)
        # The window lies about what was asked for last: the measured velocity lags behind it.
        v_x, w_z, admissible = _best(
            self._field,
            c.resolution,
            c.reach,
            self._discs,
            observation.waypoint_in_base[0],
            observation.waypoint_in_base[1],
            observation.is_final,
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
        if not admissible:
            bearing = math.atan2(observation.waypoint_in_base[1], observation.waypoint_in_base[0])
            w_z = math.copysign(c.recovery_turn * body.max_w_z, bearing)
            v_x = 0.0
        self._last = VelocityCommand(v_x, 0.0, w_z)
        return self._last


def cover_by_discs(footprint: FloatArray) -> FloatArray:
    """Equal discs along base_link's x axis that cover a convex outline.

    Args:
        footprint: (n, 2) [m].

    Returns:
        (k, 3) x, y and radius [m]; one disc about the origin for a body that is about as long as wide.
    """
    x_min, y_min = footprint.min(axis=0)
    x_max, y_max = footprint.max(axis=0)
    length, width = x_max - x_min, y_max - y_min
    circumscribed = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
    if length < 1.4 * width:
        return np.array([[0.0, 0.0, circumscribed]])
    count = math.ceil(length / width)
    piece = length / count
    radius = math.hypot(0.5 * piece, 0.5 * width)
    xs = x_min + piece * (np.arange(count) + 0.5)
    return np.column_stack([xs, np.full(count, 0.5 * (y_min + y_max)), np.full(count, radius)])


@njit(cache=True)
def _distance_field(ranges, beams, resolution, reach, field):
    """Distance to the nearest return in fifths of a cell (5-7 chamfer), rows y and columns x from -reach on."""
    n = field.shape[0]
    field[:] = 32000
    for k in range(ranges.shape[0]):
        if ranges[k] < 1.5 * reach:
            j = int((ranges[k] * beams[k, 0] + reach) / resolution)
            i = int((ranges[k] * beams[k, 1] + reach) / resolution)
            if 0 <= i < n and 0 <= j < n:
                field[i, j] = 0
    for i in range(1, n):
        for j in range(1, n - 1):
            field[i, j] = min(
                field[i, j],
                field[i - 1, j] + 5,
                field[i, j - 1] + 5,
                field[i - 1, j - 1] + 7,
                field[i - 1, j + 1] + 7,
            )
    for i in range(n - 2, -1, -1):
        for j in range(n - 2, 0, -1):
            field[i, j] = min(
                field[i, j],
                field[i + 1, j] + 5,
                field[i, j + 1] + 5,
                field[i + 1, j + 1] + 7,
                field[i + 1, j - 1] + 7,
            )


@njit(cache=True)
def _room(field, resolution, reach, discs, x, y, cos_yaw, sin_yaw):
    """Least distance between a disc's edge and a return, the body at a pose [m]."""
    n = field.shape[0]
    per_metre = 1.0 / resolution
    least = 1e9
    for k in range(discs.shape[0]):
        px = x + cos_yaw * discs[k, 0] - sin_yaw * discs[k, 1]
        py = y + sin_yaw * discs[k, 0] + cos_yaw * discs[k, 1]
        j = int((px + reach) * per_metre)
        i = int((py + reach) * per_metre)
        if 0 <= i < n and 0 <= j < n:
            least = min(least, field[i, j] * (0.2 * resolution) - discs[k, 2])
    return least


@njit(cache=True)
def _best(
    field, resolution, reach, discs, goal_x, goal_y, is_final, last_w, v_min, v_max, w_min, w_max, num_v,
    num_w, horizon, dt, margin, comfort, comfort_weight, heading_weight, turn_weight, backward_weight, brake_margin,
    max_a,
):  # fmt: skip
    """Cheapest admissible pair of velocities, and whether there was any."""
    room_now = _room(field, resolution, reach, discs, 0.0, 0.0, 1.0, 0.0) - margin
    steps = int(round(horizon / dt))
    best_cost, best_v, best_w, found = 1e30, 0.0, 0.0, False
    for b in range(num_w + 1):
        # The last one: straight ahead, which the even spacing may miss.
        w = w_min + (w_max - w_min) * b / (num_w - 1) if b < num_w else min(max(0.0, w_min), w_max)
        half_cos, half_sin = math.cos(0.5 * w * dt), math.sin(0.5 * w * dt)
        for a in range(num_v):
            v = v_min + (v_max - v_min) * a / (num_v - 1)
            x = y = 0.0
            c, s = 1.0, 0.0  # of the heading
            least = 1e9
            nearest = goal_x * goal_x + goal_y * goal_y
            free = horizon
            for step in range(steps):
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                x += v * c * dt
                y += v * s * dt
                c, s = c * half_cos - s * half_sin, s * half_cos + c * half_sin
                room = _room(field, resolution, reach, discs, x, y, c, s) - margin
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
