"""Survey: what the map means to this body at one moment, its costmap and the cheapest paths from where it is."""

from functools import cache

from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.planning.costmap import Costmap, CostmapConfig
from vuca_nav.planning.paths import PathField
from vuca_nav.types import FloatArray, Pose2


class Survey:
    """Works out costmaps and path fields when first asked for them.

    Args:
        grid: The navigation grid.
        radius: Of the body [m].
        map_from_base: Where it is.
        moving_in_map: (m, 3) x, y and radius of the tracks that surely move [m]: they bar no path.
        config: Of the costmap.
    """

    def __init__(
        self, grid: OccupancyGrid, radius: float, map_from_base: Pose2, moving_in_map: FloatArray, config: CostmapConfig
    ):
        self.grid, self.map_from_base = grid, map_from_base
        position = map_from_base.x, map_from_base.y

        @cache
        def paths(doubting: bool) -> PathField:
            return PathField(Costmap(grid, radius, position, config, moving_in_map, doubting), position)

        self._paths = paths

    def paths(self, *, doubting: bool = False) -> PathField:
        """All cheapest paths from the robot.

        Args:
            doubting: Whether they may lead through small things that have not been seen lately.
        """
        return self._paths(doubting)
