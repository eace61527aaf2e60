"""The map that ``--without U`` gives to the stack: the world's standing obstacles as an occupancy grid."""

import numpy as np

from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from worlds.clearance import clearance_field
from worlds.world import TALLEST, World


def rasterise(world: World, height: float = TALLEST) -> OccupancyGrid:
    """Occupied cells wherever an obstacle stands within half a cell of the centre, free cells elsewhere.

    Cells that the world's own map leaves unknown are unknown here, too, unless an obstacle stands there.

    The map's frame is the world's, since the stack is given its true start. Outside the bounds all is unknown.

    Args:
        world: Its moving obstacles are left out.
        height: Height of the robot [m]; what hangs above it is left out, too.
    """
    x_min, y_min, x_max, y_max = world.bounds
    grid = OccupancyGrid(GridConfig(), (0.5 * (x_min + x_max), 0.5 * (y_min + y_max)))
    clearance = clearance_field(world.below(height), world.bounds, grid.resolution, grid.resolution, world.open_borders)
    level = np.where(clearance.distance <= 0.5 * grid.resolution, 1, -1).astype(np.int8)
    if world.grid is not None and world.grid.unknown:
        xs, ys = np.meshgrid(
            clearance.origin[0] + (np.arange(level.shape[1]) + 0.5) * grid.resolution,
            clearance.origin[1] + (np.arange(level.shape[0]) + 0.5) * grid.resolution,
        )
        level[(level < 0) & world.grid.is_in(world.grid.unknown, xs, ys)] = 0
    grid.fill(level, clearance.origin)
    return grid
