"""The layered costmap: the map, marks of the lidar's returns over it, and their inflation (costmap_2d, navfn)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.baselines.move_base.config import LayersConfig
from vuca_nav.kernel_cache import njit
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.planning.cells import ALL_HEADINGS, OCCUPIED, UNKNOWN, chamfer, coarsen
from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.survey import Survey
from vuca_nav.types import BodySpec, FloatArray, Pose2

_NEUTRAL, _FACTOR, _INSCRIBED = 50.0, 0.8, 252.0
"""navfn's cost of a free cell, its factor of the costmap's cost, and the greatest cost that is not inscribed."""


class ObstacleLayer:
    """Marks of returns, movers' as well: a mark stays until a beam passes through it, or a recovery forgets it.

    The map is a layer of its own. It leaves moving tracks out; here they are obstacles like all others.
    """

    def __init__(self, config: LayersConfig):
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget all marks."""
        self.marks: NDArray[np.bool_] = np.zeros((0, 0), np.bool_)
        """(rows, columns) mask over the cells of the map."""
        self._origin = (0.0, 0.0)
        self._resolution = 1.0

    def update(self, grid: OccupancyGrid, map_from_base: Pose2, ranges: FloatArray, angles: FloatArray) -> None:
        """Clear along the beams of a scan, then mark their ends.

        Args:
            grid: The map, whose cells are marked.
            map_from_base: Pose at which the scan was taken.
            ranges: (num_beams,) [m]; beams without a return do nothing (``inf_is_valid`` is off by default).
            angles: (num_beams,) directions in base_link [rad].
        """
        self._cover(grid)
        c = self._config
        x, y = map_from_base.x - grid.origin[0], map_from_base.y - grid.origin[1]
        _mark(
            self.marks,
            (x / grid.resolution, y / grid.resolution, map_from_base.yaw),
            ranges,
            angles,
            (c.obstacle_range, c.raytrace_range, grid.resolution),
        )

    def clear_beyond(self, distance: float, position: tuple[float, float]) -> None:
        """Forget the marks outside of a square about a position of the map.

        Args:
            distance: Half the side of the square [m].
            position: Its centre [m].
        """
        j, i = ((p - o) / self._resolution for p, o in zip(position, self._origin))
        reach = distance / self._resolution
        rows = slice(max(round(i - reach), 0), max(round(i + reach), 0))
        columns = slice(max(round(j - reach), 0), max(round(j + reach), 0))
        kept = self.marks[rows, columns].copy()
        self.marks[:] = False
        self.marks[rows, columns] = kept

    def _cover(self, grid: OccupancyGrid) -> None:
        """Follow the map as it grows."""
        if self.marks.shape != grid.level.shape:
            marks = np.zeros(grid.level.shape, np.bool_)
            j, i = (round((a - b) / grid.resolution) for a, b in zip(self._origin, grid.origin))
            rows, columns = self.marks.shape
            if rows:
                marks[i : i + rows, j : j + columns] = self.marks
            self.marks = marks
        self._origin, self._resolution = grid.origin, grid.resolution


class LayeredCostmap(Costmap):
    """A costmap of the map and the obstacle layer, inflated as costmap_2d does and weighed as navfn does.

    Args:
        grid: The map.
        obstacles: The obstacle layer over it.
        body: The body that is driven.
        robot: Its position in the map [m].
        goal: The goal, which the costmap covers where the unknown is passable [m]; None where it is not.
        config: Settings.
    """

    leaves_only = False
    """navfn crosses whatever is near the robot."""

    def __init__(
        self,
        grid: OccupancyGrid,
        obstacles: ObstacleLayer,
        body: BodySpec,
        robot: tuple[float, float],
        goal: tuple[float, float] | None,
        config: LayersConfig,
    ):
        step = self.resolution = grid.resolution * config.downsample
        x_min, y_min, x_max, y_max = grid.known_box
        margin = 2.0 * step
        if goal is not None:
            x_min, y_min, x_max, y_max = (
                min(x_min, goal[0]),
                min(y_min, goal[1]),
                max(x_max, goal[0]),
                max(y_max, goal[1]),
            )
            margin = config.beyond
        i0, j0 = grid.cell(x_min - margin, y_min - margin)
        i1, j1 = grid.cell(x_max + margin, y_max + margin)
        self.origin = (grid.origin[0] + j0 * grid.resolution, grid.origin[1] + i0 * grid.resolution)
        self.radius = body.radius
        self.state = coarsen(_window(grid.level, obstacles.marks, (i0, j0, i1 + 1, j1 + 1)), config.downsample)
        inscribed = inscribed_radius(body.footprint)
        cap = math.ceil(max(config.inflation_radius, body.radius + 0.2) / step * 5.0) + 5
        # navfn plans for a point in the inflated grid: every heading fits, and no place is tight.
        self.clearance = self.fine = chamfer(self.state, cap)
        self.headings = np.full(self.state.shape, ALL_HEADINGS, np.uint16)
        self.unit, self.turning = step / 5.0, 0.0
        self.escape_weight = round(self.UNIT * 2.0 * (1.0 + _FACTOR * _INSCRIBED / _NEUTRAL))
        inflation = _Inflation(
            inscribed,
            config.inflation_radius,
            config.cost_scaling,
            step,
            self.UNIT,
            self.escape_weight,
            goal is not None,
        )
        i, j = self.cell(*robot)
        self.weight = _weigh(self.state, self.clearance, inflation, i, j, config.escape_radius / step)


class LayeredSurvey(Survey):
    """Cheapest paths over the layered costmap, for the explorer.

    Args:
        grid: The map.
        costmap: The layered costmap of this moment.
        map_from_base: Pose of the body.
    """

    def __init__(self, grid: OccupancyGrid, costmap: LayeredCostmap, map_from_base: Pose2):
        self.grid, self.map_from_base = grid, map_from_base
        field = PathField(costmap, (map_from_base.x, map_from_base.y))
        self._paths, self._doubting = lambda doubting, squeezing: field, False  # forgetting is the recoveries' part


class _Inflation(NamedTuple):
    """Settings of the weights, for the kernel."""

    inscribed: float
    """[m]"""
    radius: float
    """[m]"""
    scaling: float
    """[1/m]"""
    step: float
    """Side of a cell [m]."""
    unit: int
    escape_weight: int
    unknown_passable: bool


def inscribed_radius(footprint: FloatArray) -> float:
    """Radius of the greatest circle about base_link within a convex footprint (n, 2) [m]."""
    edges = np.roll(footprint, -1, axis=0) - footprint
    across = footprint[:, 0] * edges[:, 1] - footprint[:, 1] * edges[:, 0]
    return float((across / np.hypot(edges[:, 0], edges[:, 1])).min())


def _window(level: NDArray[np.int8], marks: NDArray[np.bool_], box: tuple[int, int, int, int]) -> NDArray[np.int8]:
    """Levels of rows i0 to i1 and columns j0 to j1, marks occupied, unknown outside of the grid."""
    i0, j0, i1, j1 = box
    out = np.zeros((i1 - i0, j1 - j0), np.int8)
    rows, columns = level.shape
    a0, b0, a1, b1 = max(i0, 0), max(j0, 0), min(i1, rows), min(j1, columns)
    inside = level[a0:a1, b0:b1].copy()
    inside[marks[a0:a1, b0:b1]] = 1
    out[a0 - i0 : a1 - i0, b0 - j0 : b1 - j0] = inside
    return out


@njit(cache=True)
def _mark(marks, pose, ranges, angles, reach):
    """Clear the cells that beams pass, up to the cell before their end, then mark the ends."""
    x, y, yaw = pose
    obstacle_range, raytrace_range, resolution = reach
    rows, columns = marks.shape
    for k in range(len(ranges)):
        if not ranges[k] < np.inf:
            continue
        c, s = math.cos(yaw + angles[k]), math.sin(yaw + angles[k])
        steps = int((min(ranges[k], raytrace_range) / resolution - 1.0) * 2.0)
        for n in range(steps):
            i, j = int(y + 0.5 * n * s), int(x + 0.5 * n * c)
            if 0 <= i < rows and 0 <= j < columns:
                marks[i, j] = False
    for k in range(len(ranges)):
        if ranges[k] <= obstacle_range:
            away = ranges[k] / resolution
            i = int(y + away * math.sin(yaw + angles[k]))
            j = int(x + away * math.cos(yaw + angles[k]))
            if 0 <= i < rows and 0 <= j < columns:
                marks[i, j] = True


@njit(cache=True)
def _weigh(state, clearance, inflation, robot_i, robot_j, escape):
    """Weight of each cell, ``unit`` where it is free and nothing near: navfn's ``50 + 0.8 cost``; 0 is impassable."""
    rows, columns = state.shape
    weight = np.zeros((rows, columns), np.int16)
    for i in range(rows):
        for j in range(columns):
            if state[i, j] == OCCUPIED or (state[i, j] == UNKNOWN and not inflation.unknown_passable):
                continue
            # An occupied cell's surface is half a cell nearer than its centre.
            away = (clearance[i, j] / 5.0 - 0.5) * inflation.step
            if away > inflation.inscribed:
                cost = 0.0
                if away <= inflation.radius:
                    cost = _INSCRIBED * math.exp(-inflation.scaling * (away - inflation.inscribed))
                weight[i, j] = round(inflation.unit * (1.0 + _FACTOR * cost / _NEUTRAL))
            elif (i - robot_i) ** 2 + (j - robot_j) ** 2 <= escape * escape:
                weight[i, j] = inflation.escape_weight
    # The robot's own cell is free (navfn's clearRobotCell); here with its neighbours, the map being finer.
    for i in range(max(robot_i - 2, 0), min(robot_i + 3, rows)):
        for j in range(max(robot_j - 2, 0), min(robot_j + 3, columns)):
            if weight[i, j] == 0:
                weight[i, j] = inflation.escape_weight
    return weight
