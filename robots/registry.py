"""The registry of bodies: robots by their names, and those of one's own by their files."""

from collections.abc import Callable
from pathlib import Path

from robots.bodies.a1 import A1, UnitreeA1
from robots.bodies.body import Body
from robots.bodies.go2 import GO2, Go2
from robots.bodies.tiago import Tiago, TiagoRear
from robots.locomotion.config import QuadrupedConfig
from robots.own.body import OwnRobot
from robots.own.folder import RobotFolder
from robots.own.robot_file import read_robot_file
from vuca_nav.errors import BadArgument, UnknownName

ROVER_FILE = Path(__file__).parent / "bodies" / "rover" / "robot.yaml"
OWN = "mjcf:"
"""What the name of a robot of one's own begins with; its file follows."""


def rover() -> Body:
    """A four-wheel skid-steer base of Jackal's size, in primitives."""
    return OwnRobot(ROVER_FILE)


ROBOTS: dict[str, Callable[[], Body]] = {
    "a1": UnitreeA1,
    "go2": Go2,
    "rover": rover,
    "tiago": Tiago,
    "tiago-rear": TiagoRear,
}

QUADRUPEDS: dict[str, QuadrupedConfig] = {config.spec.name: config for config in (A1, GO2)}
"""Quadrupeds by name; ``vuca train locomotion`` makes their gaits."""


def find_quadruped(name: str) -> QuadrupedConfig:
    """Find the constants of the quadruped of that name.

    Raises:
        UnknownName: If there is none; lists those there are.
    """
    if name not in QUADRUPEDS:
        raise UnknownName("quadruped", name, QUADRUPEDS)
    return QUADRUPEDS[name]


def check_robot(name: str) -> None:
    """Refuse a robot's name that is none; the file of a robot of one's own is not read.

    Raises:
        UnknownName: If there is none; lists those there are.
        BadArgument: If it is a file's path without ``mjcf:``.
    """
    if name in ROBOTS or name.startswith(OWN):
        return
    if name.endswith((".yaml", ".yml", ".xml", ".urdf")):
        raise BadArgument(f"--robot {name}: a robot of your own is given by its file as {OWN}robot.yaml")
    raise UnknownName("robot", name, (*ROBOTS, f"{OWN}robot.yaml"))


def runs_user_code(name: str) -> bool:
    """Whether making a robot runs Python of the user's own.

    Raises:
        VucaError: If the file of a robot of one's own cannot be read.
    """
    return name.startswith(OWN) and read_robot_file(RobotFolder(_file_of(name))).drive.kind == "own"


def make_body(name: str, *, trust: bool = False) -> Body:
    """Make the body of that name.

    Args:
        name: A name of ``ROBOTS``, or ``mjcf:`` and the path of a robot's file (docs/your-own-robot.md).
        trust: Whether Python of the user's own may be run, which moves a robot whose file names an interface.

    Raises:
        UnknownName: If there is none; lists those there are.
        BadArgument: If a robot would run Python of the user's own without ``trust``.
        VucaError: If a robot of one's own cannot be used.
    """
    check_robot(name)
    return ROBOTS[name]() if name in ROBOTS else OwnRobot(_file_of(name), trust=trust)


def digest_of(body: Body) -> str | None:
    """Hash of the files that a body is made of; None for one that is code."""
    return body.digest if isinstance(body, OwnRobot) else None


def _file_of(name: str) -> Path:
    return Path(name.removeprefix(OWN))
