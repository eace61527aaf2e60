"""The interface of a body: code above it does not depend on whether the robot has wheels or legs.

A ``Body`` is a description; ``bind`` gives the object that drives it in one compiled model.
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

from abc import ABC, abstractmethod
from dataclasses import dataclass

import mujoco
import numpy as np

from robots.noise import NoiseConfig
from vuca_nav.telemetry.interface import MeshPart
from vuca_nav.types import BodySpec, LidarSpec, Odometry, Pose2, VelocityCommand
from worlds.mjcf import RootElement


@dataclass(frozen=True, slots=True)
class VisualPart:
    """A mesh with the body of the robot's MJCF that it is fixed to."""

    body: str
    """Name of that body inside the robot's own MJCF."""
    mesh: MeshPart


class BoundBody(ABC):
    """A body in one compiled model. Called at the control rate; names are resolved once, when it is made."""

    @abstractmethod
    def reset(self, pose: Pose2, rng: np.random.Generator) -> None:
        """Put the robot down at a pose and forget the last episode.

        The caller commands it to stop for ``settle_time`` before any other command.

        Args:
            pose: Pose of base_link in the world.
            rng: Source of the odometry's errors and of all other randomness of the body.
        """

    @abstractmethod
    def start_odometry(self) -> None:
        """Take the present pose as the origin of the odometry."""

    @abstractmethod
    def apply(self, command: VelocityCommand) -> None:
        """Set the actuators for the next control step.

        Args:
            command: A finite command; the body brings it within its limits.
        """

    @abstractmethod
    def update_odometry(self) -> None:
        """Read the sensors after a control step and integrate them."""

    @abstractmethod
    def odometry(self, stamp: float) -> Odometry:
        """Estimate of the odometry after the last update.

        Args:
            stamp: Time of the estimate [s].
        """

    @abstractmethod
    def has_fallen(self) -> bool:
        """Whether the robot lies on the floor, or leans so far that it cannot go on."""


class Body(ABC):
    """A robot: the specification that the stack needs, its MJCF, and the way a velocity command moves it.

    The MJCF's model name is the spec's name, its root body carries the free joint once attached, and that body's
    frame is base_link with its origin at ``base_height`` above the floor when it stands.
    """

    spec: BodySpec
    lidar: LidarSpec
    height: float
    """Height of the highest point above the floor [m]; shapes that hang higher are no obstacles."""
    base_height: float
    """Height of base_link above the floor when the robot stands [m]."""
    settle_time: float
    """Time from ``reset`` until the robot stands still and can be commanded [s]."""
    friction_cone: str = "pyramidal"
    """MuJoCo's cone of friction: "pyramidal" is faster, "elliptic" slides alike in every direction of the world, for a
    body that skids."""

    @abstractmethod
    def mjcf(self) -> RootElement:
        """Make a new model of the robot alone, without its free joint."""

    @abstractmethod
    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig) -> BoundBody:
        """Find the robot's joints, actuators and sensors in a compiled model.

        Args:
            model: Compiled model that holds the robot's MJCF, attached under its own name.
            data: State of that model, kept for as long as the bound body lives.
            control_dt: Time between two commands [s].
            noise: Size of the sensors' errors.
        """

    @abstractmethod
    def visuals(self) -> tuple[VisualPart, ...]:
        """Meshes of the robot, for telemetry."""
