"""Drives of robots of one's own: a commanded velocity in, controls of the actuators out."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

from abc import ABC, abstractmethod
from dataclasses import dataclass

import mujoco
import numpy as np

from robots.own.assembly import GYRO, PLANAR, Assembly, Wheel
from robots.own.interface import RobotInModel, VelocityInterface
from robots.own.robot_file import DriveFile
from vuca_nav.types import BodySpec, VelocityCommand

_INTEGRAL_RATE = 5.0
"""Rate of the integral that removes a wheel's steady error, as of one that skids [1/s]. Chosen: below the rate at which
the servos of a base of Jackal's mass follow, so that it does not overshoot."""


_TURN_RATE = 3.0
"""Rate of the integral that removes a skidding base's steady error of the turn rate, by its gyro [1/s]. Chosen: below
that of the wheels, which it commands."""
_MOST_TURN = 1.0
"""Greatest correction of the turn rate [rad/s]."""


class Slew:
    """A command within a body's limits: of velocity, then of acceleration, as ROS's diff_drive_controller has it."""

    def __init__(self, spec: BodySpec, dt: float):
        self._spec, self._dt = spec, dt
        self.velocity, self.change = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Come to rest."""
        self.velocity, self.change = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def towards(self, wanted: VelocityCommand, most_wheel: float = 0.0, arm: float = 0.0) -> None:
        """Advance by one control step.

        Args:
            wanted: The command.
            most_wheel: Greatest speed of a wheel over the floor, 0 without a limit [m/s]. Where a wheel would have to
                be faster, all speeds shrink alike: the arc stays the same.
            arm: Half the distance of the wheels by which a turn becomes wheel speeds [m].
        """
        spec, dt = self._spec, self._dt
        v_x = min(max(wanted.v_x, spec.min_v_x), spec.max_v_x)
        v_y = min(max(wanted.v_y, -spec.max_v_y), spec.max_v_y)
        w_z = min(max(wanted.w_z, -spec.max_w_z), spec.max_w_z)
        fastest = abs(v_x) + abs(w_z) * arm
        if most_wheel and fastest > most_wheel:
            v_x, w_z = v_x * most_wheel / fastest, w_z * most_wheel / fastest
        steps = (spec.max_a_x * dt, spec.max_a_y * dt, spec.max_a_w * dt)
        self.change = tuple(
            min(max(new - old, -step), step) for new, old, step in zip((v_x, v_y, w_z), self.velocity, steps)
        )
        self.velocity = tuple(old + change for old, change in zip(self.velocity, self.change))

    @property
    def middle(self) -> tuple[float, float, float]:
        """Velocity in the middle of the step: a servo holds one speed for all of it."""
        x, y, w = (now - 0.5 * change for now, change in zip(self.velocity, self.change))
        return x, y, w


class BoundDrive(ABC):
    """A drive in one compiled model."""

    @abstractmethod
    def reset(self) -> None:
        """Come to rest."""

    @abstractmethod
    def apply(self, command: VelocityCommand) -> None:
        """Set the actuators for the next control step."""


@dataclass(frozen=True, slots=True)
class Track:
    """What turns a velocity into the speeds of left and right wheels."""

    radius: float
    """Radius of the wheels [m]."""
    arm: float
    """Half the distance of the wheels, times the factor by which they skid [m]."""


class SideDrive(BoundDrive):
    """Wheels on the left and on the right: a differential drive, or one that turns by skidding."""

    def __init__(self, robot: RobotInModel, assembly: Assembly, drive: DriveFile):
        model, data, prefix, spec, self._dt = robot
        wheels = (*assembly.left, *assembly.right)
        self._data, self._wheels = data, wheels
        self._gyro_z = int(model.sensor(prefix + GYRO).adr[0]) + 2 if drive.turn_control == "gyro" else None
        self._turn = 0.0
        self._sides = np.array([-1.0] * len(assembly.left) + [1.0] * len(assembly.right))
        self._signs = np.array([wheel.sign for wheel in wheels])
        self._gains = np.array([wheel.gain for wheel in wheels])
        self._servos = np.array([model.actuator(prefix + wheel.servo).id for wheel in wheels])
        self._dofs = np.array([model.joint(prefix + wheel.joint).dofadr[0] for wheel in wheels])
        self._track = track_of(assembly, drive)
        self._most_wheel = (drive.max_wheel_speed or 0.0) * self._track.radius
        self._slew = Slew(spec, self._dt)
        # Torque that each wheel needs for an acceleration of the base, forwards and about its axis.
        radius, arm, number = self._track.radius, 0.5 * assembly.track, len(wheels)
        spin = float(model.dof_M0[self._dofs].sum()) / radius**2
        self._torque_per_a = (assembly.mass + spin) * radius / number
        self._torque_per_alpha = (assembly.yaw_inertia + spin * arm**2) * radius / (arm * number)
        most = np.inf if drive.max_effort is None else drive.max_effort
        self._most_offset = np.minimum(most / self._gains, 50.0)
        self._offset, self._aim = np.zeros(number), np.zeros(number)

    def reset(self) -> None:
        """Implements :class:`BoundDrive`."""
        self._slew.reset()
        self._turn = 0.0
        self._offset[:] = 0.0
        self._aim[:] = 0.0
        self._data.ctrl[self._servos] = 0.0

    def apply(self, command: VelocityCommand) -> None:
        """Implements :class:`BoundDrive`."""
        speeds = self._data.qvel[self._dofs] * self._signs
        self._offset += _INTEGRAL_RATE * self._dt * (self._aim - speeds)
        np.clip(self._offset, -self._most_offset, self._most_offset, out=self._offset)
        slew, track = self._slew, self._track
        if self._gyro_z is not None:
            error = slew.velocity[2] - float(self._data.sensordata[self._gyro_z])
            self._turn = min(max(self._turn + _TURN_RATE * self._dt * error, -_MOST_TURN), _MOST_TURN)
            if slew.velocity == (0.0, 0.0, 0.0):
                self._turn = 0.0
        slew.towards(command, self._most_wheel, track.arm)
        v_x, _, w_z = slew.middle
        a_x, _, alpha = (change / self._dt for change in slew.change)
        self._aim[:] = (v_x + self._sides * ((w_z + self._turn) * track.arm)) / track.radius
        forward = (a_x * self._torque_per_a + self._sides * (alpha * self._torque_per_alpha)) / self._gains
        self._data.ctrl[self._servos] = self._signs * (self._aim + forward + self._offset)


class PlanarDrive(BoundDrive):
    """An omnidirectional base: its rollers are taken to be ideal, and servos push the base itself."""

    def __init__(self, robot: RobotInModel):
        model, self._data, prefix, spec, self._dt = robot
        self._servos = np.array([model.actuator(prefix + name).id for name in PLANAR])
        self._slew = Slew(spec, self._dt)

    def reset(self) -> None:
        """Implements :class:`BoundDrive`."""
        self._slew.reset()
        self._data.ctrl[self._servos] = 0.0

    def apply(self, command: VelocityCommand) -> None:
        """Implements :class:`BoundDrive`."""
        self._slew.towards(command)
        self._data.ctrl[self._servos] = self._slew.middle


class UserDrive(BoundDrive):
    """An interface of the user's own behind the limits of velocity and acceleration."""

    def __init__(self, interface: VelocityInterface, spec: BodySpec, dt: float):
        self._interface, self._slew = interface, Slew(spec, dt)

    def reset(self) -> None:
        """Implements :class:`BoundDrive`."""
        self._slew.reset()
        self._interface.reset()

    def apply(self, command: VelocityCommand) -> None:
        """Implements :class:`BoundDrive`."""
        self._slew.towards(command)
        self._interface.apply(VelocityCommand(*self._slew.velocity))


def track_of(assembly: Assembly, drive: DriveFile) -> Track:
    """What turns a velocity into wheel speeds, and wheel angles into odometry."""
    return Track(assembly.radius, 0.5 * assembly.track * drive.track_factor)


def side_angle(data: mujoco.MjData, addresses: np.ndarray, wheels: tuple[Wheel, ...]) -> float:
    """Mean angle of the wheels of a side, growing as the robot goes forward [rad]."""
    return sum(float(data.qpos[k]) * wheel.sign for k, wheel in zip(addresses, wheels)) / len(wheels)
