"""Robots as files: ``robot.yaml``, after the JSON schema beside this module; docs/your-own-robot.md describes it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from robots.own.folder import BadRobot, RobotFolder
from vuca_nav.errors import BadArgument
from vuca_nav.types import FloatArray, LidarSpec, Pose2
from vuca_nav.yaml_file import Document, Limits, read_yaml
from worlds.importers.schema import first_fault

SCHEMA_FILE = Path(__file__).with_name("robot.schema.json")
_LIMITS = Limits(nodes=2000, depth=8, aliases=0)
_AXES = ("max_v_x", "min_v_x", "max_v_y", "max_w_z", "max_a_x", "max_a_y", "max_a_w")
_TAKES = {
    "differential": (("left", "right"), ("wheels", "velocity")),
    "skid-steer": (("left", "right"), ("skid-steer", "velocity")),
    "omnidirectional": (("wheels",), ("velocity",)),
    "own": (("interface",), ("wheels", "skid-steer", "velocity")),
}
"""What each type of drive must name, and the models of odometry that go with it."""
_SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class DriveFile:
    """What moves the robot; what is None follows from the description."""

    kind: str
    """"differential", "skid-steer", "omnidirectional" or "own"."""
    left: tuple[str, ...] = ()
    """Joints of the drive wheels on the left."""
    right: tuple[str, ...] = ()
    """Joints of the drive wheels on the right."""
    wheels: tuple[str, ...] = ()
    """Joints of the wheels of an omnidirectional base."""
    casters: tuple[str, ...] = ()
    """Geoms or bodies that slide without friction."""
    interface: str = ""
    """A velocity interface of the user's own, ``module:Class``."""
    wheel_radius: float | None = None
    """[m]"""
    track: float | None = None
    """[m]"""
    track_factor: float = 1.0
    """Factor on the track by which a turn rate becomes wheel speeds."""
    turn_control: str = "wheels"
    """"wheels" if the turn rate is what the wheels' speeds make of it, "gyro" if a gyro corrects it."""
    max_effort: float | None = None
    """Torque limit of each wheel [N m], or force limit of an omnidirectional base [N]."""
    max_wheel_speed: float | None = None
    """[rad/s]"""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of all wheels."""
        return (*self.left, *self.right, *self.wheels)


@dataclass(frozen=True, slots=True)
class OdometryFile:
    """How the robot estimates its own motion."""

    model: str
    """"wheels", "skid-steer" or "velocity"."""
    heading: str = "gyro"
    """"gyro" or "wheels"."""
    noise: dict[str, float] = field(default_factory=dict)
    """Fields of NoiseConfig that the robot has its own values of."""


@dataclass(frozen=True, slots=True)
class RobotFile:
    """A robot's file, checked by itself; whether it goes with its description is checked by ``robots.own.body``."""

    name: str
    description: str
    model: str
    """Path of the MJCF or URDF, relative to the file."""
    drive: DriveFile
    limits: dict[str, float]
    """Limits of BodySpec by their names."""
    delay: float
    """[s]"""
    lidar: LidarSpec
    odometry: OdometryFile
    footprint: FloatArray | None
    """Outline as given, (n, 2) [m]."""
    height: float | None
    """Height over all as given [m]."""


def read_robot_file(folder: RobotFolder) -> RobotFile:
    """Read and check the file of a robot.

    Raises:
        BadRobot: No such file, broken YAML, a field that is not as the schema wants it or does not go with the others;
            the message gives the file, the field and its line.
    """
    document = read_yaml(folder.file, BadRobot, _LIMITS)
    folder.read(folder.file)
    fault = first_fault(document.value, SCHEMA_FILE)
    if fault is not None:
        raise _wrong(folder, document, *fault)
    d = document.value
    for where, problem in _contradictions(d):
        raise _wrong(folder, document, where, problem)
    return RobotFile(
        name=d["name"],
        description=d.get("description", "a robot of one's own"),
        model=d["model"],
        drive=_drive(d["drive"]),
        limits={name: _value(d["limits"], name, 0.0) for name in _AXES},
        delay=_value(d, "delay", 0.0),
        lidar=_lidar(folder, document),
        odometry=_odometry(d["odometry"]),
        footprint=_footprint(folder, document) if "footprint" in d else None,
        height=float(d["height"]) if "height" in d else None,
    )


def _wrong(folder: RobotFolder, document: Document, where: str, problem: str) -> BadRobot:
    line = document.line_of(where)
    return folder.wrong(where or "the file", f"{problem} (line {line})" if line else problem)


def _value(fields: dict[str, Any], name: str, default: float | None) -> Any:
    """A number with its source."""
    return float(fields[name]["value"]) if name in fields else default


def _contradictions(d: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Fields that do not go with others, each with what would be right."""
    drive, limits = d["drive"], d["limits"]
    kind = drive["type"]
    needed, models = _TAKES[kind]
    for name in needed:
        if name not in drive:
            yield "drive", f"{name} missing; a drive of the type {kind} needs {' and '.join(needed)}"
    sides = [name for name in _SIDES if name in drive]
    if kind == "own" and len(sides) == 1:
        yield "drive", f"{sides[0]} without the other side; both would be right, or none"
    for name in (*_SIDES, "wheels", "interface"):
        if name in drive and name not in needed and not (kind == "own" and name in _SIDES):
            yield f"drive.{name}", f"it does not go with a drive of the type {kind}, which takes {', '.join(needed)}"
    model, heading = d["odometry"]["model"], d["odometry"].get("heading", "gyro")
    if model not in models:
        yield "odometry.model", f"{model!r} does not go with a drive of the type {kind}; {' or '.join(models)} would"
    if model != "velocity" and kind == "own" and len(sides) < 2:
        yield "odometry.model", f"{model!r} needs the drive's left and right wheels; velocity would do without"
    if model == "velocity" and heading == "wheels":
        yield "odometry.heading", "a velocity has no wheels to take it from; gyro would be right"
    joints = [joint for name in (*_SIDES, "wheels") for joint in drive.get(name, ())]
    twice = next((joint for k, joint in enumerate(joints) if joint in joints[:k]), None)
    if twice is not None:
        yield "drive", f"it names the joint {twice!r} twice; once would be right"
    sideways = kind in ("omnidirectional", "own")
    if not sideways and _value(limits, "max_v_y", 0.0) > 0.0:
        yield "limits.max_v_y", f"a drive of the type {kind} does not move sideways; 0 would be right"
    for name in ("max_v_x", "max_w_z", "max_a_x", "max_a_w"):
        if not _value(limits, name, 0.0) > 0.0:
            yield f"limits.{name}", "0 is not above 0; a robot that moves would be right"
    if _value(limits, "max_v_y", 0.0) > 0.0 and not _value(limits, "max_a_y", 0.0) > 0.0:
        yield "limits", "max_a_y missing; a robot that moves sideways needs it"


def _drive(d: dict[str, Any]) -> DriveFile:
    return DriveFile(
        kind=d["type"],
        left=tuple(d.get("left", ())),
        right=tuple(d.get("right", ())),
        wheels=tuple(d.get("wheels", ())),
        casters=tuple(d.get("casters", ())),
        interface=d.get("interface", ""),
        wheel_radius=_value(d, "wheel_radius", None),
        track=_value(d, "track", None),
        track_factor=_value(d, "track_factor", 1.0),
        turn_control=d.get("turn_control", "wheels"),
        max_effort=_value(d, "max_effort", None),
        max_wheel_speed=_value(d, "max_wheel_speed", None),
    )


def _lidar(folder: RobotFolder, document: Document) -> LidarSpec:
    d = document.value["lidar"]
    field_of_view, beams = float(d["field_of_view"]), int(d["beams"])
    mount = Pose2(float(d["mount"]["x"]), float(d["mount"]["y"]), float(d["mount"]["yaw"]))
    all_round = field_of_view > 2.0 * math.pi - 1e-3
    try:
        return LidarSpec(
            num_beams=beams,
            min_range=float(d["min_range"]),
            max_range=float(d["max_range"]),
            rate=float(d["rate"]),
            height=float(d["height"]),
            angle_min=-0.5 * field_of_view if not all_round else -math.pi,
            angle_increment=None if all_round else field_of_view / (beams - 1),
            mount=mount,
        )
    except BadArgument as error:
        raise _wrong(folder, document, "lidar", str(error)) from error


def _odometry(d: dict[str, Any]) -> OdometryFile:
    noise = {name: float(number["value"]) for name, number in d.get("noise", {}).items()}
    return OdometryFile(d["model"], d.get("heading", "gyro"), noise)


def _footprint(folder: RobotFolder, document: Document) -> FloatArray:
    """The outline as given, if it is convex and goes counter-clockwise about base_link."""
    corners = np.array(document.value["footprint"], float)
    edges = np.roll(corners, -1, axis=0) - corners
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    about = corners[:, 0] * edges[:, 1] - corners[:, 1] * edges[:, 0]
    angles = np.arctan2(turns, (edges * np.roll(edges, -1, axis=0)).sum(axis=1))
    if not (turns > 0.0).all() or abs(angles.sum() - 2.0 * math.pi) > 1e-6:
        raise _wrong(folder, document, "footprint", "it is not a convex outline that goes counter-clockwise")
    if not (about > 0.0).all():
        raise _wrong(
            folder, document, "footprint", "base_link, at 0, 0, is not inside; an outline about it would be right"
        )
    return corners
