"""A run of SLAM over a log as it is shown: the growing map, the scan in it, the pose, the way, the loop closures."""

import numpy as np

from vuca_nav.geometry import compose, transform_points
from vuca_nav.mapping.graph_slam import GraphSlam
from vuca_nav.perception.ring import BeamGeometry
from vuca_nav.slam_log.keyframe_map import KeyframeMap
from vuca_nav.slam_log.robot_log import RobotLog
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2, Scan

_MAPS = 300
"""A log's map is shown so many times at most, however long it is: maps are most of a recording."""
_LEAST_PERIOD = 1.0
"""[s]"""


class ShownRun:
    """``scan(k, ...)`` after each scan, ``end()`` after the last.

    Args:
        telemetry: Told of the run; its clock begins with the log.
        log: The log.
        slam: SLAM as it runs.
    """

    def __init__(self, telemetry: Telemetry, log: RobotLog, slam: GraphSlam):
        self._telemetry, self._log, self._slam = telemetry, log, slam
        self._map = KeyframeMap()
        self._beams = BeamGeometry.of(log.lidar)
        self._num_closed = 0
        self._period = max(float(log.stamps[-1] - log.stamps[0]) / _MAPS, _LEAST_PERIOD)
        self._drawn_at = -np.inf

    def scan(self, k: int, map_from_base: Pose2, milliseconds: float) -> None:
        """Show a scan.

        Args:
            k: Its number.
            map_from_base: Pose that SLAM has found.
            milliseconds: Time that it took [ms].
        """
        now = float(self._log.stamps[k] - self._log.stamps[0])
        telemetry = self._telemetry
        telemetry.time(now)
        telemetry.scan_time(milliseconds)
        telemetry.estimated_pose(map_from_base, Pose2(*self._log.odometry[k].tolist()))
        ranges = self._log.ranges[k].astype(np.float64)
        telemetry.scan(Scan(now, ranges), transform_points(map_from_base, self._returns(ranges)))
        if self._slam.back_end.num_closed != self._num_closed:
            self._tell_closures()
        if now - self._drawn_at >= self._period:
            self._drawn_at = now
            self._draw()

    def end(self) -> None:
        """Show how all lies in the end."""
        self._tell_closures()
        self._draw()

    def _returns(self, ranges: FloatArray) -> FloatArray:
        """The returns in base_link, (n, 2) [m]."""
        is_return = (ranges >= self._log.lidar.min_range) & (ranges < self._log.lidar.max_range)
        return self._beams.origin + ranges[is_return, None] * self._beams.directions[is_return]

    def _draw(self) -> None:
        store = self._slam.store
        if self._map.update(store):
            self._telemetry.event("the map is drawn anew: submaps have moved")
        self._telemetry.trajectory(self._map.way(store))
        self._telemetry.grid(self._map.grid)
        self._telemetry.entropy(self._map.grid.entropy)
        self._tell_closures()

    def _tell_closures(self) -> None:
        submaps = self._slam.store.submaps
        closures = [edge for edge in self._slam.back_end.graph.edges if edge.is_closure]
        for edge in closures[self._num_closed :]:
            self._telemetry.event(f"loop closure: submap {edge.second} is tied to submap {edge.first}")
        self._num_closed = len(closures)
        pairs = sorted({(edge.first, edge.second) for edge in closures})
        ends = [[compose(submaps[k].map_from_local, submaps[k].node)[:2] for k in pair] for pair in pairs]
        if ends:
            self._telemetry.closures(np.array(ends))
