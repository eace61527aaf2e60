"""A robot of one's own as a Body: its files are read, checked, and let down on a floor before anything drives it."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from robots.bodies.body import Body, BoundBody, VisualPart
from robots.bodies.kinematics import planar_pose
from robots.noise import NoiseConfig
from robots.own.assembly import GYRO, assemble
from robots.own.compiling import as_bad_robot
from robots.own.description import read_description
from robots.own.drives import BoundDrive, PlanarDrive, SideDrive, UserDrive, side_angle, track_of
from robots.own.folder import RobotFolder
from robots.own.interface import RobotInModel, find_interface, make_interface
from robots.own.odometry import VelocityOdometer
from robots.own.robot_file import read_robot_file
from robots.own.settling import settle, stance_of, try_out
from robots.sensors import WheelOdometer
from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument
from vuca_nav.types import BodySpec, Odometry, Pose2, VelocityCommand
from worlds.mjcf import RootElement, from_xml_string

SETTLE_TIME = 0.5
"""Time to sink into the contacts, and to come to rest [s]."""
_FALLEN = math.cos(math.radians(30.0))
"""Vertical part of the upward axis below which a wheeled robot has tipped over."""


class OwnRobot(Body):
    """A robot of one's own, by its file.

    Args:
        file: A ``robot.yaml``; what it names lies in its folder.
        trust: Whether the velocity interface that it may name, which is Python code, may be run.

    Attributes:
        robot: The file's content.
        assembly: The MJCF, and what in it is what.
        digest: Hash of all files that the robot is made of.

    Raises:
        BadRobot: The file, the description, or what they make together cannot be used; says what would be right.
        BadArgument: The velocity interface of the user's own may not be run, or cannot be loaded.
    """

    friction_cone = "elliptic"

    def __init__(self, file: Path, *, trust: bool = False):
        folder = RobotFolder(file)
        robot = self.robot = read_robot_file(folder)
        if robot.drive.kind == "own" and not trust:
            raise BadArgument(
                f"{file}: drive.interface: {shown(robot.drive.interface)} is Python code of your own; --trust runs it, "
                "if you trust it"
            )
        self.assembly = assemble(folder, read_description(folder, robot.model), robot.drive)
        self.interface = None
        self._where = f"{file}: drive.interface"
        if robot.drive.kind == "own":
            self.interface = find_interface(robot.drive.interface, self._where)
        self.digest = folder.digest + (f" {self.interface.digest}" if self.interface else "")
        self.lidar, self.settle_time = robot.lidar, SETTLE_TIME
        stance = stance_of(folder, self.assembly, robot.footprint, robot.height)
        self.height, self.base_height = stance.height, stance.base_height
        self.spec = BodySpec(name=robot.name, footprint=stance.footprint, delay=robot.delay, **robot.limits)
        with as_bad_robot(file):
            self.base_height = settle(folder, self)
            try_out(folder, self)

    def mjcf(self) -> RootElement:
        """Implements :class:`~robots.bodies.body.Body`."""
        root = from_xml_string(self.assembly.xml, assets=self.assembly.assets)
        root.model = self.robot.name
        root.compiler.angle = "radian"
        # Explicit, as for TIAGo: implicit integrators damp the servos after the contacts have been solved for.
        root.option.integrator = "implicitfast" if self.interface else "Euler"
        return root

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig) -> "BoundOwn":
        """Implements :class:`~robots.bodies.body.Body`."""
        if noise != NoiseConfig.none():
            noise = replace(noise, **self.robot.odometry.noise)
        return BoundOwn(self, RobotInModel(model, data, f"{self.spec.name}/", self.spec, control_dt), noise)

    def visuals(self) -> tuple[VisualPart, ...]:
        """Implements :class:`~robots.bodies.body.Body`."""
        return self.assembly.visuals

    def drive_in(self, robot: RobotInModel) -> BoundDrive:
        """Make what moves the robot in a model."""
        kind, assembly = self.robot.drive.kind, self.assembly
        if self.interface is not None:
            interface = make_interface(self.interface, self.robot.drive.interface, self._where, robot)
            return UserDrive(interface, robot.spec, robot.control_dt)
        return PlanarDrive(robot) if kind == "omnidirectional" else SideDrive(robot, assembly, self.robot.drive)


class BoundOwn(BoundBody):
    """A robot of one's own in one compiled model."""

    def __init__(self, body: OwnRobot, robot: RobotInModel, noise: NoiseConfig):
        model, data, prefix, _, self._dt = robot
        self._body, self._model, self._data, self._noise = body, model, data, noise
        base = model.body(prefix).id
        joint = model.body_jntadr[base]
        start, first = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        self._qpos, self._qvel = data.qpos[start : start + 7], data.qvel[first : first + 6]
        self._gyro_z = int(model.sensor(prefix + GYRO).adr[0]) + 2
        assembly = body.assembly
        self._left, self._right = (
            np.array([model.joint(prefix + wheel.joint).qposadr[0] for wheel in side], np.intp)
            for side in (assembly.left, assembly.right)
        )
        self._drive = body.drive_in(robot)
        self._odometer = self._new_odometer(np.random.default_rng(0))

    def reset(self, pose: Pose2, rng: np.random.Generator) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        data = self._data
        data.qpos[:] = self._model.qpos0
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0
        half = 0.5 * pose.yaw
        self._qpos[:] = (pose.x, pose.y, self._body.base_height, math.cos(half), 0.0, 0.0, math.sin(half))
        self._drive.reset()
        self._odometer = self._new_odometer(rng)

    def start_odometry(self) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        if isinstance(self._odometer, WheelOdometer):
            self._odometer.start(*self._angles())
        else:
            self._odometer.start()

    def apply(self, command: VelocityCommand) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        self._drive.apply(command)

    def update_odometry(self) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        turn_rate = float(self._data.sensordata[self._gyro_z])
        if isinstance(self._odometer, WheelOdometer):
            self._odometer.update(*self._angles(), turn_rate)
        else:
            yaw = planar_pose(self._qpos)[2]
            c, s, v_x, v_y = math.cos(yaw), math.sin(yaw), float(self._qvel[0]), float(self._qvel[1])
            self._odometer.update(c * v_x + s * v_y, c * v_y - s * v_x, turn_rate)

    def odometry(self, stamp: float) -> Odometry:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        return self._odometer.odometry(stamp)

    def has_fallen(self) -> bool:
        """Whether the robot leans by more than 30 degrees."""
        x, y = self._qpos[4], self._qpos[5]
        return bool(1.0 - 2.0 * (x * x + y * y) < _FALLEN)

    def _angles(self) -> tuple[float, float]:
        """Angles of the wheels on the left and on the right [rad]."""
        assembly = self._body.assembly
        left, right = ((self._left, assembly.left), (self._right, assembly.right))
        return side_angle(self._data, *left), side_angle(self._data, *right)

    def _new_odometer(self, rng: np.random.Generator) -> WheelOdometer | VelocityOdometer:
        body, odometry = self._body, self._body.robot.odometry
        if odometry.model == "velocity":
            return VelocityOdometer(self._noise, rng, self._dt)
        track = track_of(body.assembly, body.robot.drive)
        heading = 2.0 * track.arm if odometry.heading == "wheels" else None
        return WheelOdometer(self._noise, rng, track.radius, self._dt, heading)
