"""Logs of any format, by what they are called."""

from pathlib import Path

from vuca_nav.errors import BadLog
from vuca_nav.slam_log.carmen import read_carmen
from vuca_nav.slam_log.robot_log import RobotLog


def read_log(path: Path) -> RobotLog:
    """Read a log: MCAP by the suffix or as a directory of a rosbag2, else CARMEN.

    Raises:
        BadLog: If it cannot be read.
    """
    if path.is_dir() or path.suffix.lower() == ".mcap":
        from vuca_nav.slam_log.mcap_log import read_mcap

        return read_mcap(path)
    if path.suffix.lower() in (".bag", ".db3"):
        raise BadLog(f"{path} is a recording of another format; convert it into MCAP: rosbags-convert --help")
    return read_carmen(path)
