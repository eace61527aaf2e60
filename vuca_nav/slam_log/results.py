"""What a run of SLAM over a log leaves: a map, a trajectory, a table."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vuca_nav.files import write_whole
from vuca_nav.mapping.graph_slam import GraphSlam
from vuca_nav.mapping.map_file import write_map
from vuca_nav.slam_log.keyframe_map import KeyframeMap
from vuca_nav.slam_log.mapping_run import LogResult
from vuca_nav.slam_log.relations import relation_errors
from vuca_nav.slam_log.robot_log import RobotLog
from vuca_nav.types import FloatArray


def write_trajectory(path: Path, stamps: FloatArray, poses: FloatArray) -> None:
    """Write a trajectory in the format of TUM: a line each of time, x, y, z and the quaternion x, y, z, w.

    Args:
        path: The file.
        stamps: (n,) [s].
        poses: (n, 3) x, y [m], yaw [rad].
    """
    lines = ["# time x y z qx qy qz qw"]
    for stamp, (x, y, yaw) in zip(stamps.tolist(), poses.tolist()):
        lines.append(f"{stamp:.6f} {x:.6f} {y:.6f} 0 0 0 {math.sin(0.5 * yaw):.9f} {math.cos(0.5 * yaw):.9f}")
    write_whole(path, "\n".join(lines) + "\n")


def write_maps(paths: Iterable[Path], slam: GraphSlam) -> int:
    """Draw the map as it is in the end, and write it as ``NAME.yaml``, ``NAME.pgm`` and ``NAME.png``.

    Args:
        paths: The YAML files.
        slam: SLAM after the run.

    Returns:
        The number of keyframes that are not in the map, for they do not fit into its greatest size.
    """
    drawn = KeyframeMap()
    drawn.update(slam.store)
    for path in paths:
        write_map(drawn.grid, path)
    return drawn.left_out


def write_trajectories(out: Path, log: RobotLog, result: LogResult) -> None:
    """Write ``trajectory.tum`` and ``online.tum`` into a directory."""
    write_trajectory(out / "trajectory.tum", log.stamps, result.final)
    write_trajectory(out / "online.tum", log.stamps, result.online)


def summary(log: RobotLog, result: LogResult, relations: FloatArray | None) -> dict[str, Any]:
    """The facts of a run, as ``--json`` prints them."""
    duration = float(log.stamps[-1] - log.stamps[0])
    way = float(np.hypot(*np.diff(result.final[:, :2], axis=0).T).sum())
    back_end = result.slam.back_end
    facts: dict[str, Any] = {
        "scans": len(log.stamps),
        "skipped": log.skipped,
        "warnings": list(log.warnings),
        "duration": duration,
        "path_length": way,
        "times_real_time": duration / result.seconds if result.seconds > 0.0 else None,
        "ms_per_scan": {
            "median": float(np.median(result.milliseconds)),
            "p999": float(np.percentile(result.milliseconds, 99.9)),
        },
        "keyframes": len(result.slam.store.keyframes),
        "submaps": len(result.slam.store.submaps),
        "closures": back_end.num_closed,
    }
    if relations is not None:
        for name, poses in (("final", result.final), ("online", result.online)):
            facts[name] = relation_errors(relations, log.stamps, poses)._asdict()
    return facts


def table(facts: dict[str, Any]) -> str:
    """The facts for a reader."""
    spent = facts["ms_per_scan"]
    rate = facts["times_real_time"]
    lines = [
        f"scans            {facts['scans']}, {sum(facts['skipped'].values())} skipped",
        f"way              {facts['path_length']:.1f} m in {facts['duration']:.1f} s",
        f"speed            {rate:.0f} times real time" if rate is not None else "speed            -",
        f"time a scan      median {spent['median']:.2f} ms, 99.9% below {spent['p999']:.2f} ms",
        f"map              {facts['submaps']} submaps, {facts['closures']} loop closures",
    ]
    for name in ("final", "online"):
        if name in facts:
            e = facts[name]
            lines.append(
                f"{name:17}{e['m_mean']:.4f} +- {e['m_sd']:.4f} m, {e['deg_mean']:.3f} +- {e['deg_sd']:.3f} deg "
                f"over {e['n']} relations"
            )
    lines += [f"skipped          {number} scans: {cause}" for cause, number in facts["skipped"].items()]
    lines += [f"warning          {warning}" for warning in facts["warnings"]]
    return "\n".join(lines)
