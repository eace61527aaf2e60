"""Survey of the map for one body at one moment: its costmap and the cheapest paths from its place."""

from dataclasses import replace
from functools import cache

from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.planning.costmap import NOTHING_MOVES, Costmap, CostmapConfig
from vuca_nav.planning.paths import PathField
from vuca_nav.types import FloatArray, Pose2

SQUEEZE = 0.05
"""Width of a cell of the map [m]: with one noisy return too many at either side, a way looks narrower by that."""


class Survey:
    """Makes costmaps and path fields on demand.

    Args:
        grid: The navigation grid.
        discs: (k, 3) discs that cover the body [m].
        map_from_base: Pose of the body.
        moving_in_map: (m, 3) x, y and radius of the tracks that surely move [m]: they bar no path.
        config: Settings of the costmap.
        barred: (k, 3) x, y and radius of places in the map that no path may lead through [m].
        doubting: Whether all paths may lead through small obstacles that have not been seen lately.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        discs: FloatArray,
        map_from_base: Pose2,
        moving_in_map: FloatArray,
        config: CostmapConfig,
        barred: FloatArray = NOTHING_MOVES,
        doubting: bool = False,
    ):
        self.grid, self.map_from_base = grid, map_from_base
        position = map_from_base.x, map_from_base.y

        @cache
        def paths(doubting: bool, squeezing: bool) -> PathField:
            margins = replace(config, margin=config.margin - SQUEEZE) if squeezing else config
            costmap = Costmap(grid, discs, position, margins, moving_in_map, doubting)
            costmap.bar(barred)
            return PathField(costmap, position)

        self._paths, self._doubting = paths, doubting

    def paths(self, *, doubting: bool = False, squeezing: bool = False) -> PathField:
        """All cheapest paths from the robot.

        Args:
            doubting: Whether they may lead through small obstacles that have not been seen lately.
            squeezing: Whether they may lead through places that are too narrow on the map by its own error.
        """
        return self._paths(doubting or self._doubting, squeezing)
