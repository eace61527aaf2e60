"""A quadruped as a Body: its MJCF, its gait, its leg odometry."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from robots.bodies.body import Body, BoundBody, VisualPart
from robots.bodies.meshes import merged_parts
from robots.locomotion.config import QuadrupedConfig
from robots.locomotion.gait import FALLEN_UP, START_UP_TIME, Gait, Mode
from robots.locomotion.model import QuadrupedModel, joint_names
from robots.locomotion.network import PolicyNetwork, load_policy
from robots.locomotion.odometry import LegOdometer, LegSensors
from robots.noise import NoiseConfig
from vuca_nav.types import Odometry, Pose2, VelocityCommand
from worlds.mjcf import RootElement

LEAST_WORTH = 0.3
"""Share of the weight on the feet from which on the odometry follows the legs: below it, between footfalls, no foot
stands, and it follows the filtered estimate. Chosen."""
_REST_TIME = 0.8
"""Time for the policy to come to rest after the start-up [s]."""


class Quadruped(Body):
    """A robot on four legs that walks by a learned gait.

    Args:
        config: The robot's constants.
        weights: File of the weights of its policy; by default those shipped.

    Raises:
        BadUrdf: If the robot's description lacks something.
        BadWeights: If the weights are missing, broken or another robot's.
    """

    def __init__(self, config: QuadrupedConfig, weights: Path | None = None):
        self.config = config
        self.model = QuadrupedModel(config)
        self.policy: PolicyNetwork = load_policy(config, weights)
        self.spec, self.lidar, self.height = config.spec, config.lidar, config.height
        self.base_height = config.trot.hip_height
        self.settle_time = START_UP_TIME + _REST_TIME

    def mjcf(self) -> RootElement:
        """Implements :class:`~robots.bodies.body.Body`."""
        return self.model.mjcf()

    def bind(
        self, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig
    ) -> "BoundQuadruped":
        """Implements :class:`~robots.bodies.body.Body`."""
        return BoundQuadruped(self, model, data, control_dt, noise)

    def visuals(self) -> tuple[VisualPart, ...]:
        """Implements :class:`~robots.bodies.body.Body`."""
        return self._visuals

    @cached_property
    def _visuals(self) -> tuple[VisualPart, ...]:
        bodies = self.model.bodies()
        name_of = {link: name for name, (link, _) in bodies.items()}
        owner = {link: own for own, fused in bodies.values() for link in fused}
        return tuple(VisualPart(name_of[link], part) for link, part in merged_parts(self.model.urdf, owner, {}))


class BoundQuadruped(BoundBody):
    """A quadruped in one compiled model."""

    def __init__(
        self, body: Quadruped, model: mujoco.MjModel, data: mujoco.MjData, control_dt: float, noise: NoiseConfig
    ):
        self._config, self._dt, self._noise = body.config, control_dt, noise
        name = body.spec.name
        base = model.body(f"{name}/").id
        start = model.jnt_qposadr[model.body_jntadr[base]]
        self._qpos = data.qpos[start : start + 7]
        self._all_qpos, self._all_qvel = data.qpos, data.qvel
        joints = [f"{name}/{joint}" for joint in joint_names()]
        self._angles = np.array([model.joint(joint).qposadr[0] for joint in joints])
        actuators = [model.actuator(joint).id for joint in joints]
        self._ctrl = data.ctrl[actuators[0] : actuators[0] + len(actuators)]
        assert actuators == list(range(actuators[0], actuators[0] + len(actuators)))
        self._actuators = actuators

        def sensor(first: str, size: int) -> np.ndarray:
            address = int(model.sensor(f"{name}/{first}").adr[0])
            return data.sensordata[address : address + size]

        self._gyro, self._attitude = sensor("gyro", 3), sensor("attitude", 4)
        self._q, self._dq = sensor(f"{joint_names()[0]}_angle", 12), sensor(f"{joint_names()[0]}_speed", 12)
        self._model, self._data = model, data
        self._gait = Gait(body.model, body.policy, control_dt)
        self._sensors = LegSensors(noise, np.random.default_rng(0), control_dt)
        self._odometer = LegOdometer(noise, np.random.default_rng(0), control_dt)
        self._measured = False

    @property
    def gait(self) -> Gait:
        """The gait that drives the legs."""
        return self._gait

    def reset(self, pose: Pose2, rng: np.random.Generator) -> None:
        """Lie on the floor with folded legs; implements :class:`~robots.bodies.body.BoundBody`."""
        self._all_qpos[:] = 0.0
        self._all_qvel[:] = 0.0
        self._qpos[:] = (
            pose.x, pose.y, self._config.lying_height, math.cos(pose.yaw / 2.0), 0.0, 0.0, math.sin(pose.yaw / 2.0)
        )  # fmt: skip
        self._all_qpos[self._angles] = np.tile(self._config.lying, 4)
        self._ctrl[:] = self._all_qpos[self._angles]
        self._forget_targets()
        mujoco.mj_forward(self._model, self._data)
        self._sensors = LegSensors(self._noise, rng, self._dt)
        self._odometer = LegOdometer(self._noise, rng, self._dt)
        self._measure()
        self._gait.reset(self._sensors.q)
        self._measured = False

    def start_odometry(self) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        self._odometer.start()

    def apply(self, command: VelocityCommand) -> None:
        """Bring the command within the body's limits and let the gait set the joints' targets."""
        if not self._measured:
            self._take_in()
        spec, s = self._config.spec, self._sensors
        within = VelocityCommand(
            min(max(command.v_x, spec.min_v_x), spec.max_v_x),
            min(max(command.v_y, -spec.max_v_y), spec.max_v_y),
            min(max(command.w_z, -spec.max_w_z), spec.max_w_z),
        )
        self._ctrl[:] = self._gait.step(within, s.gyro, s.up, s.q, s.dq)
        self._measured = False

    def update_odometry(self) -> None:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        self._take_in()
        gait, sensors = self._gait, self._sensors
        velocity = gait.leg_velocity if gait.worth > LEAST_WORTH else gait.velocity
        self._odometer.update(velocity, sensors.gyro, sensors.up)

    def odometry(self, stamp: float) -> Odometry:
        """Implements :class:`~robots.bodies.body.BoundBody`."""
        up = self._sensors.up
        return replace(self._odometer.odometry(stamp), up=(float(up[0]), float(up[1]), float(up[2])))

    def has_fallen(self) -> bool:
        """Whether the robot leans by more than 50 degrees, has given up, or has its trunk near the floor (z = 0)."""
        return self.has_fallen_at(self._qpos[2])

    def has_fallen_at(self, height: float) -> bool:
        """Whether the robot has fallen, with base_link at ``height`` above another floor [m]."""
        x, y = self._qpos[4], self._qpos[5]
        upright = 1.0 - 2.0 * (x * x + y * y)
        given_up = self._gait.mode is Mode.FALLEN
        return bool(given_up or upright < FALLEN_UP or height < self._config.fall_height)

    def _forget_targets(self) -> None:
        """Fill the delay line to the servos with the present targets."""
        model, data = self._model, self._data
        for actuator, target in zip(self._actuators, self._ctrl):
            depth = int(model.actuator_history[actuator, 0])
            if depth:
                times = data.time + model.opt.timestep * np.arange(-depth, 0.0)
                mujoco.mj_initCtrlHistory(model, data, actuator, times, np.full((depth, 1), target))

    def _take_in(self) -> None:
        self._measure()
        s = self._sensors
        self._gait.measure(s.gyro, s.up, s.q, s.dq)
        self._measured = True

    def _measure(self) -> None:
        self._sensors.sample(self._gyro, self._attitude, self._q, self._dq)
