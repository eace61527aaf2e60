"""The run of SLAM over a log, as fast as it goes."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vuca_nav.mapping.graph_slam import Anchored, GraphSlam, GraphSlamConfig
from vuca_nav.perception.percept import LevelScan
from vuca_nav.perception.ring import BeamGeometry
from vuca_nav.slam_log.robot_log import RobotLog
from vuca_nav.slam_log.shown import ShownRun
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2

WARM_UP = 60
"""Number of scans that are run before the clock starts, and forgotten: they load the compiled kernels."""


@dataclass(frozen=True, slots=True)
class LogResult:
    """What SLAM made of a log."""

    slam: GraphSlam
    online: FloatArray
    """(n, 3) ``map_from_base`` as it was known at the time of each scan."""
    final: FloatArray
    """(n, 3) ``map_from_base`` as it is known in the end."""
    milliseconds: FloatArray
    """(n,) time of the processor that SLAM's thread took for each scan [ms]."""
    seconds: float
    """Time of the processor that it took altogether, whatever else the machine and the recording do [s]."""


def run_log(
    log: RobotLog,
    config: GraphSlamConfig | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
    telemetry: Telemetry | None = None,
) -> LogResult:
    """Run SLAM over a log; the first pose of odometry is the origin of the map.

    Args:
        log: The log.
        config: Settings of SLAM.
        progress: Told the number of scans done, and of all.
        telemetry: Shown the run; None for nobody.
    """
    slam = GraphSlam(log.lidar, config or GraphSlamConfig())
    _warm_up(slam, log)
    start = Pose2(*map(float, log.odometry[0]))
    slam.reset(start)
    n = len(log.stamps)
    level = _level_of(log)
    online, places, milliseconds = np.zeros((n, 3)), [], np.zeros(n)
    shown = None if telemetry is None else ShownRun(telemetry, log, slam)
    for k in range(n):
        before = time.thread_time()
        online[k] = _update(slam, log, k, level)
        places.append(slam.place)
        milliseconds[k] = 1e3 * (time.thread_time() - before)
        if shown is not None:
            shown.scan(k, Pose2(*online[k].tolist()), float(milliseconds[k]))
        progress(k + 1, n)
    before = time.thread_time()
    slam.finish()
    seconds = float(1e-3 * milliseconds.sum()) + time.thread_time() - before
    if shown is not None:
        shown.end()
    return LogResult(slam, online, _final(slam, places), milliseconds, seconds)


def _level_of(log: RobotLog) -> LevelScan:
    beams = BeamGeometry.of(log.lidar)
    n = log.lidar.num_beams
    return LevelScan(np.zeros(n), beams.directions.copy(), np.zeros(n, np.bool_), beams.origin.copy())


def _update(slam: GraphSlam, log: RobotLog, k: int, level: LevelScan) -> Pose2:
    level.ranges[:] = log.ranges[k]
    x, y, yaw = log.odometry[k].tolist()
    return slam.update(level, Pose2(x, y, yaw), float(log.stamps[k]))


def _warm_up(slam: GraphSlam, log: RobotLog) -> None:
    """Let all kernels be compiled or loaded: SLAM over the first scans."""
    slam.reset(Pose2(*map(float, log.odometry[0])))
    level = _level_of(log)
    for k in range(min(WARM_UP, len(log.stamps))):
        _update(slam, log, k, level)


def _final(slam: GraphSlam, places: list[Anchored]) -> FloatArray:
    return np.array([place.map_from_base(slam.store) for place in places])
