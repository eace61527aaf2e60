"""Velocity interfaces of the user's own: a class that makes a commanded velocity move a robot's actuators."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

from abc import ABC, abstractmethod
from typing import NamedTuple

import mujoco

from vuca_nav.errors import BadArgument
from vuca_nav.types import BodySpec, VelocityCommand
from vuca_nav.user_code import Found, Wanted, load_user_code, told


class RobotInModel(NamedTuple):
    """A robot in one compiled model, as its interface gets it."""

    model: mujoco.MjModel
    data: mujoco.MjData
    prefix: str
    """What the names of the robot's description begin with in the model, as in ``my_robot/``."""
    spec: BodySpec
    control_dt: float
    """Time between two commands [s]."""


class VelocityInterface(ABC):
    """What moves a robot of one's own. It is made once for a compiled model, and resolves its names then.

    Args:
        robot: The robot in its model.
    """

    def __init__(self, robot: RobotInModel):
        self.robot = robot

    @abstractmethod
    def reset(self) -> None:
        """Forget the last episode; the state is that of the description, at rest."""

    @abstractmethod
    def apply(self, command: VelocityCommand) -> None:
        """Set ``data.ctrl`` of the robot's actuators for the next control step.

        Args:
            command: Within the robot's limits of velocity.
        """


def find_interface(name: str, where: str) -> Found:
    """Find the class of an interface; it runs the module's code.

    Args:
        name: ``module:Class``.
        where: What names it, which begins each message.

    Raises:
        BadArgument: It cannot be loaded.
    """
    right = "a class derived from robots.own.interface.VelocityInterface"
    return load_user_code(name, Wanted(where, "an interface of your own", "my_drive:Drive", right))


def make_interface(found: Found, name: str, where: str, robot: RobotInModel) -> VelocityInterface:
    """Make the interface of a robot in a model.

    Raises:
        BadArgument: Its constructor raises an exception, or makes something else.
    """
    try:
        made = found.thing(robot)
    except Exception as error:  # whatever the user's code raises is the user's to mend
        raise BadArgument(f"{where}: {name}: {told(error)}") from error
    if not isinstance(made, VelocityInterface):
        raise BadArgument(
            f"{where}: {name} made a {type(made).__name__}; a robots.own.interface.VelocityInterface would be right"
        )
    return made
