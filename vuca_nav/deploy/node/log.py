"""What the node tells its log; the base class keeps nothing."""

from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, VelocityCommand


class NodeLog:
    """A log that keeps nothing. Times are those of this machine's clock [ns]."""

    failure: str | None = None
    """Why the log is not whole; None while it is."""

    def received(self, topic: str, type_name: str, data: bytes, log_time: int, sent: int | None = None) -> int:
        """Keep a message that came; its number on the topic."""
        return 0

    def sent(self, topic: str, type_name: str, data: bytes, log_time: int) -> int:
        """Keep a message that was published; its number on the topic."""
        return 0

    def began(self, start: Pose2, goal: tuple[float, float] | None, lidar: LidarSpec, log_time: int) -> None:
        """Keep that the stack was reset."""

    def heads_for(self, goal: tuple[float, float] | None, log_time: int) -> None:
        """Keep that the stack took another goal, or none."""

    def ticked(self, scan: Scan, number: int, odometry: Odometry, command: VelocityCommand, log_time: int) -> None:
        """Keep a step of the stack: what it saw, and its answer before the safety layer."""

    def close(self) -> None:
        """Write what is left."""
