"""An empty building to drive in."""

from vuca_nav.types import Pose2
from worlds.world import Box, Obstacle, World

MIDDLE = Pose2(30.0, 30.0, 0.0)


def hall(size: float = 60.0, start: Pose2 = MIDDLE) -> World:
    """An empty floor between four walls."""
    middle, half = size / 2.0, size / 2.0 + 0.1
    walls = (
        Box(middle, middle - half, size + 0.4, 0.2, 0.0, 2.0),
        Box(middle, middle + half, size + 0.4, 0.2, 0.0, 2.0),
        Box(middle - half, middle, 0.2, size, 0.0, 2.0),
        Box(middle + half, middle, 0.2, size, 0.0, 2.0),
    )
    obstacles = tuple(Obstacle("wall", wall) for wall in walls)
    return World("hall", 0, (0.0, 0.0, size, size), obstacles, (), start, (1.0, 1.0))
