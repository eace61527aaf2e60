"""Static transforms: where the lidar stands in base_link, by ``/tf_static``."""

import math
from typing import Any, NamedTuple

from vuca_nav.deploy.messages import Refused
from vuca_nav.perception.readings import FARTHEST
from vuca_nav.types import Pose2
from vuca_nav.wire import round_yaw

MOST_FRAMES = 1000
"""Greatest number of frames that are remembered; a humanoid has about a hundred."""
LEAST_LEVEL = math.cos(math.radians(3.0))
"""A lidar whose axis leans more than this is no planar lidar about the vertical: 0.5 m of height at 10 m."""


class LidarMount(NamedTuple):
    """Where a lidar stands."""

    base_from_lidar: Pose2
    is_inverted: bool
    """Whether it hangs upside down."""


class _Motion(NamedTuple):
    """A rigid motion: a unit quaternion x, y, z, w and a translation."""

    turn: tuple[float, float, float, float]
    move: tuple[float, float, float]


class StaticTransforms:
    """The tree of frames that ``/tf_static`` tells."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, _Motion]] = {}

    def add(self, message: Any) -> None:
        """Take in a tf2_msgs/TFMessage.

        Raises:
            Refused: If a transform is none, or there are too many frames. What was known stays.
        """
        found = {}
        for stamped in message.transforms:
            place, turn = stamped.transform.translation, stamped.transform.rotation
            move, quaternion = (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
            if not all(abs(value) < FARTHEST for value in move):
                raise Refused("a translation is not finite, or too far out")
            length = math.sqrt(sum(part * part for part in quaternion))
            if not abs(length - 1.0) < 1e-2:
                raise Refused("a quaternion is no rotation")
            x, y, z, w = (part / length for part in quaternion)
            parent, child = stamped.header.frame_id.lstrip("/"), stamped.child_frame_id.lstrip("/")
            found[child] = parent, _Motion((x, y, z, w), move)
        if len(self._parents | found) > MOST_FRAMES:
            raise Refused(f"there are more than {MOST_FRAMES} frames")
        self._parents |= found

    def mount(self, base: str, lidar: str) -> LidarMount | None:
        """Where the lidar stands in the robot's base; None while the transforms do not tell.

        Args:
            base: The base's frame.
            lidar: The lidar's frame.

        Raises:
            Refused: If the lidar's plane is not level.
        """
        base_from_lidar = self._path(base, lidar)
        if base_from_lidar is None:
            return None
        (x, y, z, w), move = base_from_lidar
        upward = 1.0 - 2.0 * (x * x + y * y)
        if abs(upward) < LEAST_LEVEL:
            raise Refused("the lidar's plane is not level with the base")
        forward = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)  # of the lidar's x axis, in the base
        yaw = round_yaw(math.atan2(forward[1], forward[0]))
        return LidarMount(Pose2(move[0], move[1], yaw), is_inverted=upward < 0.0)

    def _path(self, base: str, lidar: str) -> _Motion | None:
        """The transform of the lidar's frame into the base's: up from both to the root that they share."""
        ups: list[dict[str, _Motion]] = []
        for frame in (base, lidar):
            here, motion = frame, _Motion((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
            above = {here: motion}
            while here in self._parents:
                here, step = self._parents[here]
                if here in above:  # transforms that lead in a circle
                    break
                motion = _compose(step, motion)
                above[here] = motion
            ups.append(above)
        shared = next((frame for frame in ups[1] if frame in ups[0]), None)
        return None if shared is None else _compose(_inverse(ups[0][shared]), ups[1][shared])


def _rotate(turn: tuple[float, float, float, float], point: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z, w = turn
    a, b, c = point
    p, q, r = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + 2.0 * (w * p + y * r - z * q),
        b + 2.0 * (w * q + z * p - x * r),
        c + 2.0 * (w * r + x * q - y * p),
    )


def _compose(a: _Motion, b: _Motion) -> _Motion:
    x, y, z, w = a.turn
    p, q, r, s = b.turn
    turn = (
        w * p + x * s + y * r - z * q,
        w * q - x * r + y * s + z * p,
        w * r + x * q - y * p + z * s,
        w * s - x * p - y * q - z * r,
    )
    moved = _rotate(a.turn, b.move)
    return _Motion(turn, (a.move[0] + moved[0], a.move[1] + moved[1], a.move[2] + moved[2]))


def _inverse(a: _Motion) -> _Motion:
    x, y, z, w = a.turn
    turn = (-x, -y, -z, w)
    moved = _rotate(turn, a.move)
    return _Motion(turn, (-moved[0], -moved[1], -moved[2]))
