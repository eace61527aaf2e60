"""CARMEN logs (.clf, .log, also gzipped): the text format of most public SLAM data sets of buildings.

Lines of one kind are taken, ROBOTLASER1 or else FLASER; the format is documented in each log's own first lines.
"""

import gzip
import io
import math
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vuca_nav.data_files import read_bytes
from vuca_nav.errors import BadLog
from vuca_nav.geometry import between
from vuca_nav.slam_log.robot_log import RobotLog, check_use
from vuca_nav.types import MOST_BEAMS, STANDING, FloatArray, LidarSpec, Pose2

MOST_BYTES = 2**31
"""Greatest size of a log, before it is unpacked [bytes]."""
MOST_LINE = 32 * MOST_BEAMS
"""Greatest length of a line [bytes]."""
FLASER_RANGE = 80.0
"""FLASER lines do not tell the greatest range: that of the SICK LMS which wrote them [m]."""
SATURATED, BELOW = 5, 0.5
"""A log's greatest range stands for no return if it is so many times as frequent as all within this below it [m]."""
MIN_RANGE = 0.05
"""Least range that is a return: a zero stands for none [m]."""
STEADY = 0.005
"""Deviation up to which the lidar's pose on the robot is one and the same [m, rad]."""


class _Line(NamedTuple):
    """A scan of a log."""

    stamp: float
    ranges: FloatArray
    lidar: Pose2
    """Pose of the lidar by odometry, or corrected by somebody."""
    robot: Pose2
    """Pose of the robot by odometry."""
    start_angle: float
    resolution: float
    max_range: float


def read_carmen(path: Path) -> RobotLog:
    """Read a log.

    Scans that are incomplete, of another size than most, without a finite pose or time, or older than the one before
    are left out and counted.

    Raises:
        BadLog: If the file is no CARMEN log, is cut off within its compression, or more than half of its scans are of
            no use.
    """
    content = read_bytes(path, MOST_BYTES, BadLog)
    found: dict[str, list[_Line]] = {"ROBOTLASER1": [], "FLASER": []}
    odometry: list[tuple[float, Pose2]] = []
    broken: Counter[str] = Counter()
    parsers = {"ROBOTLASER1": _robot_laser, "FLASER": _front_laser}
    try:
        for line in _lines(content, path):
            kind, _, rest = line.partition(b" ")
            name = kind.decode("ascii", errors="replace")
            try:
                if name in parsers:
                    found[name].append(parsers[name](rest.split()))
                elif name == "ODOM":
                    words = rest.split()
                    x, y, yaw = (float(word) for word in words[:3])
                    odometry.append((float(words[-3]), Pose2(x, y, yaw)))
            except (ValueError, IndexError):
                if not rest.strip().startswith(b"laser_type"):
                    broken[name] += 1
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise BadLog(f"{path} is cut off or damaged within its compression: {error}") from error
    kind = "ROBOTLASER1" if found["ROBOTLASER1"] or broken["ROBOTLASER1"] else "FLASER"
    if not found[kind]:
        raise BadLog(
            f"{path} holds no scan that can be read: a CARMEN log with lines ROBOTLASER1 or FLASER would be right"
        )
    return _log_of(path, found[kind], odometry, broken[kind])


def _lines(content: bytes, path: Path) -> Iterator[bytes]:
    stream: io.BufferedIOBase = io.BytesIO(content)
    if content[:2] == b"\x1f\x8b":
        stream = gzip.GzipFile(fileobj=stream)  # type: ignore[assignment]
    while line := stream.readline(MOST_LINE):
        if len(line) == MOST_LINE and not line.endswith(b"\n"):
            raise BadLog(f"{path} has a line longer than {MOST_LINE} bytes: it is no CARMEN log")
        if b"\0" in line:
            raise BadLog(f"{path} is no text: a CARMEN log would be right, or a recording with the suffix .mcap")
        yield line


def _robot_laser(words: list[bytes]) -> _Line:
    """ROBOTLASER1: type, start angle, field of view, resolution, maximum, accuracy, remission, n, ranges, m, ..."""
    start, resolution, maximum = float(words[1]), float(words[3]), float(words[4])
    n = int(words[7])
    ranges = _ranges(words[8 : 8 + n], n)
    rest = words[9 + n + int(words[8 + n]) :]
    if len(rest) != 14:
        raise ValueError("incomplete")
    values = [float(word) for word in rest[:6]]
    return _Line(float(rest[-3]), ranges, Pose2(*values[:3]), Pose2(*values[3:6]), start, resolution, maximum)


def _front_laser(words: list[bytes]) -> _Line:
    """FLASER: n, ranges, pose of the lidar, pose of the robot, time, host, time of the logger."""
    n = int(words[0])
    ranges = _ranges(words[1 : 1 + n], n)
    rest = words[1 + n :]
    if len(rest) != 9:
        raise ValueError("incomplete")
    values = [float(word) for word in rest[:6]]
    resolution = math.pi / (n - 1 if n % 2 else n)
    return _Line(
        float(rest[-3]), ranges, Pose2(*values[:3]), Pose2(*values[3:6]), -0.5 * math.pi, resolution, FLASER_RANGE
    )


def _ranges(words: list[bytes], n: int) -> FloatArray:
    if not 1 < n <= MOST_BEAMS or len(words) != n:
        raise ValueError("incomplete")
    return np.array([float(word) for word in words])


def _log_of(path: Path, lines: list[_Line], odometry: list[tuple[float, Pose2]], broken: int) -> RobotLog:
    skipped = Counter({"incomplete": broken})
    sizes = Counter((len(line.ranges), line.start_angle, line.resolution) for line in lines)
    (beams, start, resolution), _ = sizes.most_common(1)[0]
    if not (math.isfinite(start) and 0.0 < abs(resolution) * (beams - 1) < 2.0 * math.pi + 1e-3):
        raise BadLog(
            f"{path}: {beams} beams from {start:g} rad on, each {resolution:g} rad from the next, are no lidar"
        )
    lines = _with_odometry(lines, odometry)
    kept: list[_Line] = []
    for line in lines:
        if (len(line.ranges), line.start_angle, line.resolution) != (beams, start, resolution):
            skipped["another size"] += 1
        elif not math.isfinite(sum(line.robot) + line.stamp):
            skipped["no finite pose or time"] += 1
        elif np.isnan(line.ranges).mean() > 0.5:
            skipped["more than half of the ranges NaN"] += 1
        elif kept and line.stamp < kept[-1].stamp:
            skipped["time runs backwards"] += 1
        else:
            kept.append(line)
    skipped = +skipped
    check_use(path, len(kept), skipped)
    ranges = np.array([line.ranges for line in kept], np.float32)
    lidar = LidarSpec(
        num_beams=beams,
        min_range=MIN_RANGE,
        max_range=_max_range(ranges, kept[0].max_range),
        angle_min=start,
        angle_increment=resolution,
        mount=_mount(kept),
    )
    poses = np.array([line.robot for line in kept])
    return RobotLog(lidar, np.array([line.stamp for line in kept]), ranges, poses, dict(skipped))


def _with_odometry(lines: list[_Line], odometry: list[tuple[float, Pose2]]) -> list[_Line]:
    """The scans with the poses of ODOM lines, where they have none of their own."""
    if not odometry or len({line.robot for line in lines}) > 1:
        return lines
    stamps, poses = np.array([stamp for stamp, _ in odometry]), [pose for _, pose in odometry]
    last = np.clip(np.searchsorted(stamps, [line.stamp for line in lines], side="right") - 1, 0, None)
    return [line._replace(robot=poses[k], lidar=poses[k]) for line, k in zip(lines, last)]


def _max_range(ranges: np.ndarray, stated: float) -> float:
    """Range from which on there is no return: the stated one, or that at which the log's ranges saturate."""
    valid = ranges[np.isfinite(ranges) & (ranges > MIN_RANGE)]
    stated = stated if math.isfinite(stated) and stated > MIN_RANGE else FLASER_RANGE
    if not len(valid):
        return stated
    greatest = float(valid.max())
    at_greatest = np.count_nonzero(valid > greatest - 0.015)
    below = np.count_nonzero(valid > greatest - BELOW) - at_greatest
    if greatest < stated and at_greatest > max(SATURATED * below, SATURATED):
        return greatest - 0.015
    return stated


def _mount(lines: Iterable[_Line]) -> Pose2:
    """Pose of the lidar on the robot; that of the robot if it is not one and the same all along: one was corrected."""
    mounts = np.array([between(line.robot, line.lidar) for line in lines])
    mount = np.median(mounts, axis=0)
    if not np.isfinite(mounts).all() or abs(mounts - mount).max() > STEADY:
        return STANDING
    return Pose2(*(round(float(value), 6) + 0.0 for value in mount))
