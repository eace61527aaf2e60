"""The interface of a body. Nothing above it knows whether it rolls or walks.

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
    """A mesh and the body of the robot's MJCF it hangs on."""

    body: str
    """Name inside the robot's own MJCF."""
    mesh: MeshPart


class BoundBody(ABC):
    """A body in one compiled model. Called at the control rate; names are resolved once, when it is made."""

    @abstractmethod
    def reset(self, pose: Pose2, rng: np.random.Generator) -> None:
        """Be put down at a pose, with all that is remembered of an earlier episode forgotten.

        It is commanded to stop for ``settle_time`` before anything else.

        Args:
            pose: Of base_link in the world.
            rng: For the odometry's errors and whatever else is random about the body.
        """

    @abstractmethod
    def start_odometry(self) -> None:
        """Take here and now as the odometry's origin."""

    @abstractmethod
    def apply(self, command: VelocityCommand) -> None:
        """Set the actuators for the next control step. The command is finite; limits are the body's affair."""

    @abstractmethod
    def update_odometry(self) -> None:
        """Read the sensors after a control step and integrate them."""

    @abstractmethod
    def odometry(self, stamp: float) -> Odometry:
        """What the body believes now."""

    @abstractmethod
    def has_fallen(self) -> bool:
        """Whether it lies, or leans so far that it cannot go on."""


class Body(ABC):
    """A robot: what the stack must know of it, its MJCF, and how a velocity command moves it.

    The MJCF's model name is the spec's name, its root body carries the free joint once attached, and that body's
    frame is base_link with its origin at ``base_height`` above the floor when it stands.
    """

    spec: BodySpec
    lidar: LidarSpec
    height: float
    """Of the highest point above the floor [m]: what hangs higher is no obstacle."""
    base_height: float
    """Of base_link above the floor when it stands [m]."""
    settle_time: float
    """From ``reset`` until it stands still and can be commanded [s]."""

    @abstractmethod
    def mjcf(self) -> RootElement:
        """A new model of the robot alone, without its free joint."""

    @abstractmethod
    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig) -> BoundBody:
        """Find the robot's joints, actuators and sensors in a compiled model.

        Args:
            model: Holds the robot's MJCF, attached under its own name.
            data: Of that model; borrowed for good.
            control_dt: Time between two commands [s].
            noise: Of the sensors.
        """

    @abstractmethod
    def visuals(self) -> tuple[VisualPart, ...]:
        """What it looks like, for telemetry."""
