"""What was seen of every obstacle and mover until the robot touched one of them: the facts of a contact.

For metrics only, like everything true.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robots.bodies.kinematics import heading_rate, planar_pose, rotation_of
from robots.contacts import Touch
from vuca_nav.kernel_cache import njit
from vuca_nav.types import FloatArray
from worlds.arrays import ShapeArrays
from worlds.level_raycast import level_columns

STRAIGHT = math.radians(5.0)
"""Change of direction up to which a mover goes on straight [rad]: a walk turns by more, a pedestrian sways by less."""
STANDING = 0.05
"""Speed up to which a mover stands [m/s], as in the classes of contacts."""
LOOKS = 10.0
"""Rate at which the scans are searched for what is in sight [Hz]."""
LOST_SIGHT = 0.5
"""Time that something may be missed by every beam without being out of sight [s]: a leg is thinner than the gap of two
beams from some metres on."""
_ON_SURFACE = 1e-6
"""Distance up to which a return lies on a surface [m]: far above rounding."""


@dataclass(frozen=True, slots=True)
class ContactFacts:
    """The first contact of the robot, in the world's frame, with the velocities before the impact."""

    name: str
    """Name of the other: the obstacle's, or the mover's, e.g. "wall_12" or "cart_3"."""
    kind: str
    """Its kind, e.g. "wall"."""
    time: float
    """Time since the start [s]."""
    point: tuple[float, float]
    """Point of contact [m]."""
    normal: tuple[float, float]
    """Horizontal unit vector at that point from the robot to the other."""
    bearing: float
    """Direction of the point in base_link, 0 ahead, positive to the left [rad]."""
    robot_velocity: tuple[float, float]
    """Velocity of base_link [m/s]."""
    point_velocity: tuple[float, float]
    """Velocity of the robot's own point of contact: base_link's, and what its turning adds [m/s]."""
    other_velocity: tuple[float, float]
    """Velocity of the other, 0 for an obstacle [m/s]."""
    straight_for: float | None
    """Time for which the other had gone straight, 0 if it stood [s]; None for an obstacle."""
    in_sight_for: float
    """Time for which the other had been in the lidar's line of sight, 0 if it was not [s]."""


class Beams(NamedTuple):
    """A scan without noise, in the world."""

    origin: FloatArray
    """Where the beams begin, (3,) [m]."""
    directions: FloatArray
    """Unit vectors, (num_beams, 3)."""
    ranges: FloatArray
    """(num_beams,), ``inf`` where nothing came back [m]."""


class _Shapes(NamedTuple):
    """Surfaces to look for: obstacles first, then the movers' parts."""

    columns: FloatArray
    """(s, 10) as ``level_columns`` gives them; the parts' places are those of the last look."""
    owner: np.ndarray
    """(s,) index of the obstacle, or the number of obstacles and the mover's index."""


class Witness:
    """Remembers since when every mover has gone straight, and since when everything has been in sight.

    Args:
        static: Shapes of the obstacles.
        parts: Shapes of the movers' parts.
        part_mover: Index of the mover that each part belongs to.
        mover_names: Name of each mover.
    """

    def __init__(self, static: ShapeArrays, parts: ShapeArrays, part_mover: np.ndarray, mover_names: list[str]):
        self._num_static, self._mover_names = len(static), mover_names
        owner = np.concatenate([np.arange(len(static)), len(static) + part_mover]).astype(np.int64)
        self._shapes = _Shapes(np.concatenate([level_columns(static), level_columns(parts)]), owner)
        self._part_mover = part_mover
        num_owners = len(static) + len(mover_names)
        self._seen_first, self._seen_last = np.zeros(num_owners), np.full(num_owners, -np.inf)
        self._straight_since = np.zeros(len(mover_names))
        self._direction = np.zeros((len(mover_names), 2))
        self._velocities = np.zeros((len(mover_names), 2))
        self._next_look = 0.0

    def reset(self) -> None:
        """Forget the last episode."""
        self._seen_first[:], self._seen_last[:] = 0.0, -np.inf
        self._straight_since[:], self._direction[:], self._velocities[:] = 0.0, 0.0, 0.0
        self._next_look = 0.0

    def moves(self, time: float, velocities: FloatArray) -> None:
        """Take in the velocities of the movers (m, 2) [m/s] from a moment [s] on."""
        self._velocities[:] = velocities
        _follow(time, velocities, self._direction, self._straight_since)

    def looks(self, time: float, beams: Beams, part_poses: FloatArray) -> None:
        """Take in the ends of the lidar's beams, if it is time to.

        Args:
            time: Time since the start [s].
            beams: The beams, without noise.
            part_poses: (num_parts, 3) x, y, yaw of the movers' parts.
        """
        if time < self._next_look - 1e-6:
            return
        self._next_look = time + 1.0 / LOOKS
        rows = self._shapes.columns[self._num_static :]
        rows[:, :2] = part_poses[:, :2]
        rows[:, 2], rows[:, 3] = np.cos(part_poses[:, 2]), np.sin(part_poses[:, 2])
        _look(time, beams, self._shapes, self._seen_first, self._seen_last)

    def tell(self, time: float, touch: Touch, part: int | None, obstacle: int | None) -> ContactFacts:
        """The facts of a contact.

        Args:
            time: Time since the start [s].
            touch: The contact.
            part: Index of the movers' part that was touched; None for an obstacle.
            obstacle: Index of the obstacle that was touched; None for a part.
        """
        x, y, yaw = planar_pose(touch.base_pose)
        rotation, origin = np.empty((3, 3)), np.empty(3)
        rotation_of(touch.base_pose, 0.0, rotation, origin)
        v_x, v_y = touch.base_velocity[:2].tolist()
        w_z = heading_rate(touch.base_velocity[3:], rotation[2])
        to_x, to_y = float(touch.point[0]) - x, float(touch.point[1]) - y
        if touch.normal is None:  # touched from above: the way to the place is all there is
            away = math.hypot(to_x, to_y) or 1.0
            normal = to_x / away, to_y / away
        else:
            normal = float(touch.normal[0]), float(touch.normal[1])
        bearing = math.atan2(to_y, to_x) - yaw
        if part is None:
            assert obstacle is not None
            owner, name, velocity, straight_for = obstacle, touch.name, (0.0, 0.0), None
        else:
            mover = int(self._part_mover[part])
            owner, name = self._num_static + mover, self._mover_names[mover]
            velocity = float(self._velocities[mover, 0]), float(self._velocities[mover, 1])
            stands = math.hypot(*velocity) <= STANDING
            straight_for = 0.0 if stands else time - float(self._straight_since[mover])
        in_sight = time - self._seen_last[owner] <= LOST_SIGHT
        return ContactFacts(
            name=name,
            kind=touch.kind,
            time=time,
            point=(float(touch.point[0]), float(touch.point[1])),
            normal=normal,
            bearing=(bearing + math.pi) % (2.0 * math.pi) - math.pi,
            robot_velocity=(v_x, v_y),
            point_velocity=(v_x - w_z * to_y, v_y + w_z * to_x),
            other_velocity=velocity,
            straight_for=straight_for,
            in_sight_for=time - float(self._seen_first[owner]) if in_sight else 0.0,
        )


@njit(cache=True)
def _follow(time, velocities, direction, since):
    """Note the movers that have turned, begun to move, or stopped."""
    least = math.cos(STRAIGHT)
    for m in range(len(velocities)):
        v_x, v_y = velocities[m, 0], velocities[m, 1]
        speed = math.sqrt(v_x * v_x + v_y * v_y)
        if speed <= STANDING:
            direction[m, 0] = direction[m, 1] = 0.0
            since[m] = time
        elif v_x * direction[m, 0] + v_y * direction[m, 1] < least * speed:
            direction[m, 0], direction[m, 1] = v_x / speed, v_y / speed
            since[m] = time


@njit(cache=True)
def _look(time, beams, shapes, first, last):
    """Note what the beams end on."""
    columns, owner = shapes
    hits = np.full(beams.directions.shape, np.inf)
    for k in range(len(hits)):
        if beams.ranges[k] < np.inf:
            hits[k] = beams.origin + beams.ranges[k] * beams.directions[k]
    for s in range(len(owner)):
        who = owner[s]
        if last[who] == time:
            continue
        cx, cy, cos, sin, half_x, half_y, is_cylinder, bound, low, high = columns[s]
        reach = (bound + _ON_SURFACE) ** 2
        for k in range(len(hits)):
            dx, dy = hits[k, 0] - cx, hits[k, 1] - cy
            square = dx * dx + dy * dy
            if not square <= reach or not low - _ON_SURFACE <= hits[k, 2] <= high + _ON_SURFACE:
                continue
            if is_cylinder != 0.0 or (
                abs(cos * dx + sin * dy) <= half_x + _ON_SURFACE and abs(cos * dy - sin * dx) <= half_y + _ON_SURFACE
            ):
                if time - last[who] > LOST_SIGHT:
                    first[who] = time
                last[who] = time
                break
