"""The robot's base as the node sees it: how it is told a velocity, and how it tells its odometry."""

from abc import ABC, abstractmethod
from typing import Any

from vuca_nav.deploy.messages import SensedOdometry, odometry_of, twist_message, twist_stamped_message
from vuca_nav.deploy.robot_file import RobotFile
from vuca_nav.types import VelocityCommand


class Base(ABC):
    """A base behind two topics.

    Attributes:
        command_topic: Topic of the velocity commands, with its type in ``command_type``.
        odometry_topic: Topic of the odometry, with its type in ``odometry_type``.
        commands_are_ours: Whether nobody else may publish commands; a second publisher then stops the robot.
    """

    command_topic: str
    command_type: str
    odometry_topic: str
    odometry_type: str
    commands_are_ours: bool = True

    @abstractmethod
    def command_message(self, command: VelocityCommand, stamp: int) -> Any:
        """A command as its message.

        Args:
            command: The command.
            stamp: Stamp of the newest reading that it answers [ns].
        """

    @abstractmethod
    def odometry(self, message: Any, up: tuple[float, float, float] | None) -> SensedOdometry:
        """The odometry of a message.

        Args:
            message: The message.
            up: The vertical in base_link, if an IMU shows it.

        Raises:
            Refused: If it cannot be true.
        """


class RosBase(Base):
    """A base as ROS 2 has it: ``cmd_vel`` and ``odom``.

    Args:
        robot: Frames and topics.
        stamped: Whether commands are TwistStamped; otherwise Twist, which cannot say what they answer.
    """

    odometry_type = "nav_msgs/msg/Odometry"

    def __init__(self, robot: RobotFile, stamped: bool):
        self._frames, self._stamped = robot.frames, stamped
        self.command_topic, self.odometry_topic = robot.topics.cmd_vel, robot.topics.odom
        self.command_type = "geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist"

    def command_message(self, command: VelocityCommand, stamp: int) -> Any:
        """A command as TwistStamped or Twist."""
        return twist_stamped_message(command, stamp, self._frames) if self._stamped else twist_message(command)

    def odometry(self, message: Any, up: tuple[float, float, float] | None) -> SensedOdometry:
        """The odometry of a nav_msgs/Odometry."""
        return odometry_of(message, self._frames, up)
