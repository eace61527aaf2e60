"""Maps that the stack is given beforehand: the world's standing obstacles (``--without U``), or a file (``--map``)."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from worlds.clearance import clearance_field
from worlds.importers.occupancy_map import FREE, OCCUPIED, CellMap, read_map
from worlds.world import TALLEST, World

_SAME = 1e-5
"""Deviation of a ratio of cells' sides from a whole number that is rounding: over 4,000 cells 0.04 of a cell."""
_MOST_SPLIT = 50
"""Greatest ratio of a map's cells to the grid's, either way: cells of 1 mm, or of 2.5 m."""


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


def read_prior_map(path: str | Path) -> OccupancyGrid:
    """Read a map of ROS's map_server as a grid of the stack; its frame is the world's.

    Larger cells are split. Of smaller ones a cell is occupied if one of them is, and free if all are. Corners between
    two cells of the grid go to the nearest one.

    Raises:
        BadWorld: As by ``read_map``: file or image cannot be read, a field is wrong, or it is too large.
        BadArgument: If the map is turned, its cells are no whole multiple or part of the grid's, or it is too large for
            a grid.
    """
    found = read_map(path)
    x, y, yaw = found.origin
    if abs(yaw) > 1e-6:
        raise BadArgument(
            f"--map {path}: its origin is turned by {yaw:g} rad; 0 would be right, with the image turned instead"
        )
    config = GridConfig()
    level, corner = _resampled(path, found, config.resolution)
    rows, columns = level.shape
    grid = OccupancyGrid(config, (x + 0.5 * columns * config.resolution, y + 0.5 * rows * config.resolution))
    try:
        grid.fill(level, corner)
    except BadArgument as error:
        raise BadArgument(f"--map {path}: {error}") from error
    return grid


def _resampled(path: str | Path, found: CellMap, side: float) -> tuple[NDArray[np.int8], tuple[float, float]]:
    """The map in cells of another side [m]: -1 free, 0 unknown, 1 occupied, and its lower-left corner [m]."""
    level = np.zeros(found.cells.shape, np.int8)
    level[found.cells == FREE] = -1
    level[found.cells == OCCUPIED] = 1
    x, y, _ = found.origin
    larger, smaller = found.resolution / side, side / found.resolution
    ratio = round(max(larger, smaller))
    if abs(max(larger, smaller) - ratio) > _SAME * ratio or ratio > _MOST_SPLIT:
        raise BadArgument(
            f"--map {path}: its cells have a side of {found.resolution:g} m; {side:g} m, or a whole multiple or part "
            f"of that, as {2.0 * side:g} or {0.5 * side:g} m, would be right"
        )
    if ratio == 1:
        return level, (x, y)
    if larger > 1.0:
        return level.repeat(ratio, axis=0).repeat(ratio, axis=1), (x, y)
    # Blocks are those of the grid, whose lines lie at whole multiples of the side.
    first_x, first_y = math.floor(x / side + _SAME), math.floor(y / side + _SAME)
    left = max(round((x - first_x * side) / found.resolution), 0)
    below = max(round((y - first_y * side) / found.resolution), 0)
    rows, columns = found.cells.shape
    padded = np.zeros((-(-(below + rows) // ratio) * ratio, -(-(left + columns) // ratio) * ratio), np.int8)
    padded[below : below + rows, left : left + columns] = level
    blocks = padded.reshape(padded.shape[0] // ratio, ratio, padded.shape[1] // ratio, ratio)
    return blocks.max(axis=(1, 3)), (first_x * side, first_y * side)
