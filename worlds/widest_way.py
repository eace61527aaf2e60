"""The narrowest place of the widest way from start to goal: what to say of a task that has no way."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.kernel_cache import njit
from worlds.clearance import ClearanceField, clearance_field
from worlds.world import TALLEST, World

COARSE, FINE = 0.05, 0.005
"""Cells of the grid on which the narrowest place is found, and of the one about it that gives its width [m]."""
ABOUT = 0.3
"""Half the side of the finer grid [m]."""
CAP = 1.0
"""Clearance beyond which ways count as equally wide [m]: more than a body on legs or wheels needs."""
WIDTH_ERROR = 0.01
"""Greatest error of a width, a little over the diagonal of a finer cell [m]."""
_START, _GOAL = 1, 2


class Neck(NamedTuple):
    """The narrowest place of the widest way."""

    place: tuple[float, float]
    """[m]"""
    width: float
    """Right within ``WIDTH_ERROR`` [m]."""


def widest_way(world: World, reach: float, tolerance: float = 0.0, height: float = TALLEST) -> Neck | None:
    """The narrowest place of the widest way from start to goal; None if all ways are walled up.

    Args:
        world: Any world.
        reach: The way begins within this distance of the start: the body may stand beside a wall [m].
        tolerance: It ends within this distance of the goal [m].
        height: Height of the body [m]; obstacles that hang above it are not in its way.
    """
    field = clearance_field(world.below(height), world.bounds, COARSE, CAP, world.open_borders)
    ends = (_End(world.start[:2], reach, _START), _End(world.goal, tolerance, _GOAL))
    seeds = np.zeros(field.distance.shape, np.int8)
    for end in ends:
        _sow(seeds, field, end)
        seeds[field.cell(*end.place)] |= end.bit
    found = _join(field, seeds)
    # A wall thinner than a cell may lie between two centres that are free.
    if found is None or found[0].width <= COARSE:
        return None
    neck, sides = found
    rows, columns, fine = _about(neck.place, field, world, height)
    factor = round(COARSE / FINE)
    seeds = np.kron(sides[np.ix_(rows, columns)], np.ones((factor, factor), np.int8))
    for end in ends:
        _sow(seeds, fine, end)
    found = _join(fine, seeds)
    return neck if found is None else found[0]


class _End(NamedTuple):
    """Where ways begin or end."""

    place: tuple[float, float]
    """[m]"""
    distance: float
    """Distance from the place within which they do [m]."""
    bit: int


def _sow(seeds: NDArray[np.int8], field: ClearanceField, end: _End) -> None:
    """Mark the cells whose centres are within the distance of an end."""
    rows, columns = field.distance.shape
    x = field.origin[0] + (np.arange(columns) + 0.5) * field.resolution - end.place[0]
    y = field.origin[1] + (np.arange(rows) + 0.5) * field.resolution - end.place[1]
    seeds[x[None, :] ** 2 + y[:, None] ** 2 <= end.distance**2] |= end.bit


def _join(field: ClearanceField, seeds: NDArray[np.int8]) -> tuple[Neck, NDArray[np.int8]] | None:
    """Where the parts that hold the seeds of the start and of the goal meet, and the side of each cell until then."""
    order = np.argsort(-field.distance, axis=None, kind="stable")
    which, sides = _joins(field.distance.shape, order, field.distance.ravel(), seeds.ravel())
    if which < 0:
        return None
    (place,) = field.centres(np.array([np.unravel_index(which, field.distance.shape)])).tolist()
    return Neck((place[0], place[1]), 2.0 * float(field.distance.flat[which])), sides


def _about(
    place: tuple[float, float], field: ClearanceField, world: World, height: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], ClearanceField]:
    """Rows and columns of the cells about a place, and the clearances on the finer grid over them."""
    row, column = field.cell(*place)
    cells = round(ABOUT / COARSE)
    rows = np.arange(max(row - cells, 0), min(row + cells + 1, field.distance.shape[0]))
    columns = np.arange(max(column - cells, 0), min(column + cells + 1, field.distance.shape[1]))
    x, y = field.origin[0] + columns[0] * COARSE, field.origin[1] + rows[0] * COARSE
    box = x, y, x + len(columns) * COARSE, y + len(rows) * COARSE
    fine = clearance_field(world.below(height), box, FINE, CAP, is_open=True)
    if not world.open_borders:
        x_min, y_min, x_max, y_max = world.bounds
        xs = x + (np.arange(fine.distance.shape[1]) + 0.5) * FINE
        ys = y + (np.arange(fine.distance.shape[0]) + 0.5) * FINE
        np.minimum(fine.distance, np.minimum(xs - x_min, x_max - xs)[None, :], out=fine.distance)
        np.minimum(fine.distance, np.minimum(ys - y_min, y_max - ys)[:, None], out=fine.distance)
    return rows, columns, fine


@njit(cache=True)
def _find(root, cell):
    """The root of a cell's part, with the way to it shortened (union-find)."""
    while root[cell] != cell:
        root[cell] = root[root[cell]]
        cell = root[cell]
    return cell


@njit(cache=True)
def _joins(shape, order, distance, seeds):
    """Take cells in by falling clearance until one joins the parts that hold the seeds 1 and 2.

    Returns:
        The cell, -1 if none does, and (rows, columns) int8: the seeds that each cell's part held until then.
    """
    rows, columns = shape
    root = np.full(rows * columns, -1, np.int64)
    held = np.zeros(rows * columns, np.int8)
    which = -1
    for cell in order:
        if distance[cell] <= 0.0:
            break
        row, column = cell // columns, cell % columns
        together = seeds[cell]
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                if root[r * columns + c] >= 0:
                    together |= held[_find(root, r * columns + c)]
        if together == 3:
            which = cell
            break
        root[cell], held[cell] = cell, together
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                if root[r * columns + c] >= 0:
                    root[_find(root, r * columns + c)] = cell
    sides = np.zeros((rows, columns), np.int8)
    for cell in range(rows * columns):
        if root[cell] >= 0:
            sides[cell // columns, cell % columns] = held[_find(root, cell)]
    return which, sides
