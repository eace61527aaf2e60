import numpy as np
import pytest

from vuca_nav.mapping.graph_slam import Anchored
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.redraw import Drawing, DrawnMap, RedrawRule
from vuca_nav.mapping.submaps import Submap, SubmapStore
from vuca_nav.types import STANDING, Pose2

WALL = np.column_stack([np.full(21, 3.02), np.arange(-0.5, 0.55, 0.05)])
PERSON = np.column_stack([np.full(5, 1.52), np.arange(-0.1, 0.15, 0.05)])
HERE = Anchored(0, STANDING)
SHIFT = Pose2(0.0, 0.5, 0.0)


def insert(grid: OccupancyGrid, ends: np.ndarray) -> None:
    box = np.concatenate([np.minimum(ends.min(axis=0), 0.0), np.maximum(ends.max(axis=0), 0.0)])
    grid.insert(STANDING, ends, len(ends), np.zeros(len(ends)), box)


def drawn_map() -> DrawnMap:
    """A person stood before a wall in the one keyframe, and has left since."""
    drawn = DrawnMap(OccupancyGrid(GridConfig()), RedrawRule(0.025, 8))
    seen = np.concatenate([WALL, PERSON])
    insert(drawn.grid, seen)
    drawn.drawings.append(Drawing(HERE, 1, seen.astype(np.float32), len(seen), np.zeros(len(seen), np.float32), (0, 0)))
    for _ in range(10):
        insert(drawn.grid, WALL)
    return drawn


def moved_store(by: Pose2) -> SubmapStore:
    return SubmapStore([Submap(None, STANDING, np.zeros((3, 3)), 0, map_from_local=by)])


def redraw(drawn: DrawnMap, store: SubmapStore) -> Pose2 | None:
    corrections = [drawn.step(store, 1, HERE) for _ in range(3)]
    return next((one for one in corrections if one is not None), None)


def test_a_redrawn_map_shows_what_stayed_and_not_what_left():
    drawn = drawn_map()
    assert redraw(drawn, moved_store(SHIFT)) == pytest.approx(SHIFT)
    assert drawn.map_from_base(HERE) == pytest.approx(SHIFT)
    assert [drawn.grid.state(3.02, 0.5 + y) for y in (-0.3, 0.0, 0.3)] == [1, 1, 1]
    assert drawn.grid.state(3.02, -0.3) == 0
    assert drawn.grid.state(1.52, 0.5) == -1  # a beam to the wall passes there


def test_a_redrawn_map_knows_when_its_cells_were_seen():
    drawn = drawn_map()
    redraw(drawn, moved_store(SHIFT))
    cell = drawn.grid.cell(3.02, 0.5)
    assert drawn.grid.scan_index == 11
    assert drawn.grid.not_updated_for(9)[cell]
    assert not drawn.grid.not_updated_for(10)[cell]


def test_submaps_that_move_by_less_than_half_a_cell_are_not_drawn_anew():
    drawn = drawn_map()
    grid = drawn.grid
    assert redraw(drawn, moved_store(Pose2(0.02, 0.0, 0.0))) is None
    assert drawn.grid is grid
