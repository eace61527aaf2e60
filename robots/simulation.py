"""The simulation of one robot in one world: it takes commands and returns scans and odometry.

The true pose, the clearance and the contacts are for metrics and for the judge of an episode only.
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from robots.bodies.body import Body
from robots.bodies.kinematics import heading_rate, place_planar, planar_pose, rotation_of
from robots.clearance import FootprintClearance
from robots.noise import NoiseConfig
from robots.physics import Physics
from robots.sensors import LidarNoise
from robots.witness import Beams, ContactFacts, Witness
from vuca_nav.errors import BadArgument, VucaError
from vuca_nav.geometry import between
from vuca_nav.telemetry.interface import SceneShape, Telemetry
from vuca_nav.types import STOP, FloatArray, Odometry, Pose2, Scan, Twist2, VelocityCommand
from vuca_nav.wire import round_odometry, seconds, tick_nanoseconds
from worlds.arrays import pack_shapes
from worlds.mjcf import obstacle_name, part_name
from worlds.motion.movers import MoverField
from worlds.raycast import RayCaster
from worlds.world import Cylinder, Shape, World

SAFE_DISTANCE = 0.10
"""Clearance from which on no contact is possible within one control step [m]: at 60 Hz the two would have to close in
at 6 m/s."""


class SimulationDiverged(VucaError):
    """The physics produced numbers that are not finite."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Rates of the simulation's loops; each divides the one before it exactly.

    Raises:
        BadArgument: If a rate does not divide the one before it.
    """

    physics: int = 300
    """Rate of MuJoCo's steps [Hz]."""
    control: int = 60
    """Rate of the commands to the actuators, of the odometry and of the moving obstacles [Hz]."""
    tick: int = 30
    """Rate of the stack's loop, and of the calls of ``Simulation.step`` [Hz]."""

    def __post_init__(self):
        for fast, slow in (("physics", "control"), ("control", "tick")):
            a, b = getattr(self, fast), getattr(self, slow)
            if b <= 0 or a % b:
                raise BadArgument(f"rates: {fast} {a} Hz is not a multiple of {slow} {b} Hz")


class Simulation:
    """One robot in one world. A call of ``step`` is a tick, 1/30 s.

    A lidar that is slower gives its last scan again, with its stamp, until it has a new one; scans are taken at ticks.
    Readings are rounded as messages carry them (``vuca_nav.wire``): a stack behind a wire gets the same numbers.

    Args:
        world: The scene with its start.
        body: The robot. One body may serve several simulations.
        seed: Seed of the sensors' noise. The world's own seed decides how the moving obstacles move.
        noise: Size of the sensors' errors.
        telemetry: Listener to the scene, the robot and the moving obstacles.
        perfect_odometry: Report the true pose instead of dead reckoning.
        rates: Rates of physics, control and ticks.

    Attributes:
        rate: Rate of the ticks [Hz].
        time: Time since the start [s].
        true_pose: Pose of base_link in the world.
        model: MuJoCo model of the robot on the floor, see :class:`robots.physics.Physics`.
        data: MuJoCo state of that model.
        scene_model: MuJoCo model of the robot in the scene.
        contact: Kind ("wall", "cart", ...) of the first obstacle or mover that the robot has touched; None before.
        contact_name: Name of that obstacle or mover's part, e.g. "wall_12".
        contact_facts: How that contact came about; None before.
        fallen: Whether the robot lies on the floor or leans too far to recover.
        clearance: Distance of the footprint to the nearest obstacle or mover now, ``inf`` if there is none [m].

    Raises:
        BadArgument: If the rates do not fit the body.
    """

    def __init__(
        self,
        world: World,
        body: Body,
        seed: np.random.SeedSequence | int,
        *,
        noise: NoiseConfig,
        telemetry: Telemetry | None = None,
        perfect_odometry: bool = False,
        rates: Rates | None = None,
    ):
        rates = rates or Rates()
        self.world, self.body = world, body
        self._seed = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
        self._noise, self._telemetry = noise, telemetry or Telemetry()
        self._perfect_odometry = perfect_odometry
        self._rates, self.rate = rates, rates.tick
        self._control_dt = 1.0 / rates.control
        self._substeps = rates.physics // rates.control
        self._controls = rates.control // rates.tick

        self._physics = Physics(world, body, rates.physics)
        self.model, self.data = self._physics.model, self._physics.data
        self.scene_model = self._physics.scene_model
        base = self.model.body(f"{body.spec.name}/").id
        start = self.model.jnt_qposadr[self.model.body_jntadr[base]]
        self._base_qpos = self.data.qpos[start : start + 7]
        self._base_qvel = self.data.qvel[self.model.jnt_dofadr[self.model.body_jntadr[base]] :][:6]
        self._bound = body.bind(self.model, self.data, self._control_dt, noise)

        self._movers = MoverField(world)
        static = pack_shapes([obstacle.shape for obstacle in world.obstacles])
        parts = self._movers.part_shapes
        self._caster = RayCaster(static, parts, body.lidar)
        self._proximity = FootprintClearance(static, parts, body.spec.footprint, body.height)
        self._radius = body.spec.radius
        names = [f"{mover.kind}_{m}" for m, mover in enumerate(world.movers)]
        self._witness = Witness(static, parts, self._movers.part_mover, names)
        self._obstacle_of = {obstacle_name(i, o.kind): i for i, o in enumerate(world.obstacles)}
        self._part_of = {shape.name: p for p, shape in enumerate(mover_shapes(world))}
        self._lidar_noise = LidarNoise(body.lidar, noise, self._rng(0))
        self._lidar_offset = body.lidar.height - body.base_height
        self._rotation, self._origin = np.empty((3, 3)), np.empty(3)
        self._clean = np.empty(body.lidar.num_beams)

        self._visuals = body.visuals()
        self._visual_bodies = np.array(
            [self.model.body(f"{body.spec.name}/{visual.body}").id for visual in self._visuals], np.int64
        )
        self._part_positions = np.empty((len(self._visuals), 3))
        self._part_quaternions = np.empty((len(self._visuals), 4))
        self._ticks = self._scans = 0
        self._scan = Scan(0.0, np.full(body.lidar.num_beams, np.inf))
        self.time, self.true_pose = 0.0, world.start
        self.contact: str | None = None
        self.contact_name: str | None = None
        self.contact_facts: ContactFacts | None = None
        self.fallen, self.clearance = False, math.inf

    @property
    def movers(self) -> MoverField:
        """The moving obstacles as they are now, for metrics and for baselines that know the truth."""
        return self._movers

    def reset(self) -> tuple[Scan, Odometry]:
        """Return to the start, the noise included, and take the first scan."""
        self._physics.reset()
        self._lidar_noise = LidarNoise(self.body.lidar, self._noise, self._rng(0))
        self._movers.reset()
        self._bound.reset(self.world.start, self._rng(1))
        for _ in range(round(self.body.settle_time * self._rates.control)):
            self._bound.apply(STOP)
            self._physics.step_in_scene(self._substeps, self._movers.part_poses)
        # A body that rises shifts its base by centimetres; the mission begins where its start is.
        place_planar(self._base_qpos, self._base_qvel, *self.world.start)
        mujoco.mj_forward(self.model, self.data)
        self._bound.start_odometry()
        self._ticks, self._scans, self.time = 0, 0, 0.0
        self.contact = self.contact_name = self.contact_facts = None
        self._witness.reset()

        telemetry, bounds = self._telemetry, self.world.bounds
        telemetry.time(0.0)
        telemetry.scene(scene_shapes(self.world), bounds, self.world.goal)
        telemetry.robot_model([visual.mesh for visual in self._visuals])
        telemetry.mover_model(mover_shapes(self.world))
        return self._observe()

    def step(self, command: VelocityCommand) -> tuple[Scan, Odometry]:
        """Carry out a command for a tick.

        Returns:
            The lidar's latest scan, and the odometry now.

        Raises:
            BadArgument: If the command is not three finite numbers.
            SimulationDiverged: If the physics has produced numbers that are not finite.
        """
        command = checked_command(command, self.time)
        for _ in range(self._controls):
            x, y, yaw = planar_pose(self._base_qpos)
            self._witness.moves(self._movers.time, self._movers.velocities)
            self._movers.step(self._control_dt, (x, y, self._radius))
            self._bound.apply(command)
            self._advance_physics(x, y, yaw)
            self._bound.update_odometry()
        self._ticks += 1
        self.time = seconds(tick_nanoseconds(self._ticks, self._rates.tick))
        self._telemetry.time(self.time)
        return self._observe()

    def clearance_at(self, world_from_base: Pose2) -> float:
        """Distance of the footprint to the nearest obstacle or mover, were the robot at a pose [m]."""
        return self._proximity.distance(*world_from_base, self._movers.part_poses)

    def carry_to(self, world_from_base: Pose2) -> None:
        """Put the robot somewhere else, as a person would who lifts it: its odometry does not notice."""
        place_planar(self._base_qpos, self._base_qvel, *world_from_base)
        mujoco.mj_forward(self.model, self.data)

    def copy_scene(self, data: mujoco.MjData) -> None:
        """Write the robot in the scene as it is now into a state of ``scene_model``, for pictures."""
        self._physics.copy_scene(data, self._movers.part_poses)

    def __reduce__(self):
        # A copy of MuJoCo's arrays would no longer be what MuJoCo steps: such a robot would stand for ever.
        raise TypeError(
            "a Simulation can be neither copied nor pickled; another of the same world and seed is the same"
        )

    def _advance_physics(self, x: float, y: float, yaw: float) -> None:
        """Advance the physics by one control step, in the scene if a contact with it is possible."""
        lean = 2.0 * math.hypot(self._base_qpos[4], self._base_qpos[5])  # sine of the tilt, or more
        poses = self._movers.part_poses
        if self._proximity.is_beyond(SAFE_DISTANCE + lean * self.body.height, x, y, yaw, poses):
            self._physics.step_alone(self._substeps)
            return
        touched = self._physics.step_in_scene(self._substeps, poses)
        if self.contact is None and touched is not None:
            self.contact_name, self.contact = touched.name, touched.kind
            part, obstacle = self._part_of.get(touched.name), self._obstacle_of.get(touched.name)
            self.contact_facts = self._witness.tell(self._movers.time, touched, part, obstacle)

    def _observe(self) -> tuple[Scan, Odometry]:
        x, y, yaw = planar_pose(self._base_qpos)
        if not math.isfinite(x + y + yaw + self._base_qvel.sum()):
            raise SimulationDiverged(
                f"the physics diverged by {self.time:.3f} s, after {self.true_pose}: "
                f"seed {self._seed.entropy}, world {self.world.name!r} seed {self.world.seed}"
            )
        self.true_pose = Pose2(x, y, yaw)
        self.fallen = self._bound.has_fallen()
        poses = self._movers.part_poses
        self.clearance = self._proximity.distance(x, y, yaw, poses)
        scan = self._sense(poses)

        self._telemetry.true_pose(self.true_pose)
        np.take(self.data.xpos, self._visual_bodies, axis=0, out=self._part_positions)
        np.take(self.data.xquat, self._visual_bodies, axis=0, out=self._part_quaternions)
        self._telemetry.robot_parts(self._part_positions, self._part_quaternions)
        self._telemetry.movers(poses)
        odometry = self._true_odometry() if self._perfect_odometry else self._bound.odometry(self.time)
        return scan, round_odometry(odometry)

    def _sense(self, poses: FloatArray) -> Scan:
        """The lidar's latest scan; a new one if one is due by its rate."""
        rotation_of(self._base_qpos, self._lidar_offset, self._rotation, self._origin)
        due = math.floor(self._ticks * self.body.lidar.rate / self._rates.tick + 1e-9)
        if self._ticks > 0 and due == self._scans:
            return self._scan
        self._scans = due
        origin, mount = self._origin, self.body.lidar.mount
        if mount[:2] != (0.0, 0.0):
            origin = origin + self._rotation[:, :2] @ np.array([mount.x, mount.y])
        self._caster.cast(origin, self._rotation, poses, self._clean)
        self._witness.looks(self.time, Beams(origin, self._caster.directions, self._clean), poses)
        self._scan = Scan(self.time, self._lidar_noise.corrupt(self._clean))
        return self._scan

    def _true_odometry(self) -> Odometry:
        v_x, v_y = self._base_qvel[:2].tolist()  # in the world; the angular velocity is in the body
        w_z = heading_rate(self._base_qvel[3:], self._rotation[2])
        c, s = math.cos(self.true_pose.yaw), math.sin(self.true_pose.yaw)
        twist = Twist2(c * v_x + s * v_y, c * v_y - s * v_x, w_z)
        true = between(self.world.start, self.true_pose)
        return replace(self._bound.odometry(self.time), odom_from_base=true, twist=twist)

    def _rng(self, stream: int) -> np.random.Generator:
        """The random stream of one use, the same after every reset."""
        seed = self._seed
        key = (*seed.spawn_key, stream)
        return np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=key))


def checked_command(command: VelocityCommand, time: float) -> VelocityCommand:
    """The command, if it is three finite numbers; raises BadArgument with the time [s] otherwise."""
    try:
        v_x, v_y, w_z = (float(value) for value in command)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadArgument(f"command at {time:.3f} s is no v_x, v_y, w_z: {command!r}") from error
    if not (math.isfinite(v_x) and math.isfinite(v_y) and math.isfinite(w_z)):
        raise BadArgument(f"command at {time:.3f} s is not finite: {command}")
    return VelocityCommand(v_x, v_y, w_z)


def scene_shapes(world: World) -> list[SceneShape]:
    """The static obstacles as telemetry takes them."""
    return [
        _scene_shape(obstacle_name(i, obstacle.kind), obstacle.shape, obstacle.kind)
        for i, obstacle in enumerate(world.obstacles)
    ]


def mover_shapes(world: World) -> list[SceneShape]:
    """The moving obstacles' parts in their movers' frames, as telemetry takes them."""
    return [
        replace(_scene_shape(part_name(m, p, mover.kind), part.shape, mover.kind), vanishes=mover.may_vanish)
        for m, mover in enumerate(world.movers)
        for p, part in enumerate(mover.parts)
    ]


def _scene_shape(name: str, shape: Shape, category: str) -> SceneShape:
    z = shape.base + shape.height / 2.0
    if isinstance(shape, Cylinder):
        half, yaw, kind = (shape.radius, shape.radius, shape.height / 2.0), 0.0, "cylinder"
    else:
        half, yaw, kind = (shape.length / 2.0, shape.width / 2.0, shape.height / 2.0), shape.yaw, "box"
    return SceneShape(name, kind, half, (shape.x, shape.y, z), yaw, category)
