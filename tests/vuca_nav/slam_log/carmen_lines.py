"""CARMEN lines made here, for tests."""

from vuca_nav.types import Pose2


def robot_laser(stamp: float, ranges, robot: Pose2, lidar: Pose2 | None = None, *, fov: float, start: float) -> str:
    """A ROBOTLASER1 line."""
    n = len(ranges)
    lidar = robot if lidar is None else lidar
    values = " ".join(f"{r:.4f}" for r in ranges)
    poses = " ".join(f"{value:.6f}" for value in (*lidar, *robot))
    return (
        f"ROBOTLASER1 0 {start:.6f} {fov:.6f} {fov / n:.8f} 30.0 0.01 0 {n} {values} 0 {poses} "
        f"0 0 0 0 0 {stamp:.6f} host {stamp:.6f}\n"
    )


def front_laser(stamp: float, ranges, robot: Pose2) -> str:
    """A FLASER line."""
    values = " ".join(f"{r:.4f}" for r in ranges)
    pose = " ".join(f"{value:.6f}" for value in robot)
    return f"FLASER {len(ranges)} {values} {pose} {pose} {stamp:.6f} host {stamp:.6f}\n"
