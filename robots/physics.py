"""MuJoCo's steps of one robot in one world: with the scene where it is near, without it where it is out of reach.

A factory has 200 static shapes and 60 parts of moving obstacles. A physics step places all of them and culls them
against the robot, which costs as much as the robot itself, although in nineteen steps of twenty the scene is out of
reach. So there are two models: the robot on an empty floor, which is the one that the rest of the simulation sees, and
the robot in the scene. A step near an obstacle carries the robot's state into the second model, steps that one, and
carries the state back. Both give the same bits as long as nothing of the scene touches the robot.
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings and dm_control's generated elements are invisible to a static checker.)

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from robots.bodies.body import Body
from robots.bodies.kinematics import place_mocap
from robots.contacts import SceneContacts, Touch
from vuca_nav.types import FloatArray
from worlds.mjcf import build_arena, obstacle_name, part_name
from worlds.world import World

_STATE = (
    mujoco.mjtState.mjSTATE_FULLPHYSICS
    | mujoco.mjtState.mjSTATE_WARMSTART
    | mujoco.mjtState.mjSTATE_CTRL
    | mujoco.mjtState.mjSTATE_QFRC_APPLIED
)
"""Parts of MuJoCo's state that the next step depends on, but for mocap poses and forces on single bodies."""

_NOT_FOR_ONE_ROBOT = int(mujoco.mjtDisableBit.mjDSBL_ISLAND | mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
"""Searches that find nothing on an empty floor: one robot is one island of constraints, and the floor is one geom.
Without them a step takes a tenth less time and gives the same bits."""


class Physics:
    """One robot, free to move, in one world.

    Args:
        world: The scene with its moving obstacles.
        body: The robot.
        rate: Physics steps a second [Hz].

    Attributes:
        model: The robot on an empty floor.
        data: State of ``model``: positions, velocities, controls and sensors of the robot are always those of the
            last step. Quantities that MuJoCo derives from them are those of the last step out of
            reach of the scene.
        scene_model: The robot in the scene.
    """

    def __init__(self, world: World, body: Body, rate: float):
        self.model = build_model(replace(world, obstacles=(), movers=()), body, rate)
        self.model.opt.disableflags |= _NOT_FOR_ONE_ROBOT
        self.data = mujoco.MjData(self.model)
        self.scene_model = build_model(world, body, rate)
        self._scene_data = mujoco.MjData(self.scene_model)
        self._contacts = SceneContacts(self.scene_model, _kinds(world))
        self._state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        robot = self.model.body(f"{body.spec.name}/").id
        shift = self.scene_model.nbody - self.model.nbody  # the robot's bodies come last in both
        self._per_body = [
            (getattr(self.data, name)[robot:], getattr(self._scene_data, name)[robot + shift :])
            for name in ("xfrc_applied", "xpos", "xquat")
        ]
        joint = self.scene_model.body_jntadr[robot + shift]
        base = self.scene_model.jnt_qposadr[joint], self.scene_model.jnt_dofadr[joint]
        self._base = self._scene_data.qpos[base[0] :][:7], self._scene_data.qvel[base[1] :][:6]
        self._before = np.empty(7), np.empty(6)
        self._mocap = self._scene_data.mocap_pos, self._scene_data.mocap_quat

    def reset(self) -> None:
        """Put both models back to their initial states."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_resetData(self.scene_model, self._scene_data)

    def step_alone(self, steps: int) -> None:
        """Step the robot on the floor; nothing of the scene may be within its reach meanwhile."""
        mujoco.mj_step(self.model, self.data, nstep=steps)

    def step_in_scene(self, steps: int, part_poses: FloatArray) -> Touch | None:
        """Step the robot in the scene.

        Args:
            steps: Number of physics steps.
            part_poses: x, y, yaw in the world of each part of the moving obstacles, which stand still meanwhile
                (num_parts, 3) [m, rad].

        Returns:
            The first contact of the robot with an obstacle or a part, None if it touched none.
        """
        model, data = self.scene_model, self._scene_data
        forces, *poses = self._per_body
        place_mocap(part_poses, *self._mocap)
        mujoco.mj_getState(self.model, self.data, self._state, _STATE)
        mujoco.mj_setState(model, data, self._state, _STATE)
        forces[1][:] = forces[0]
        touched = None
        for _ in range(steps):
            if touched is None:
                for before, now in zip(self._before, self._base, strict=True):
                    before[:] = now
            mujoco.mj_step(model, data)
            touched = touched or self._contacts.first(data, *self._before)
        mujoco.mj_getState(model, data, self._state, _STATE)
        mujoco.mj_setState(self.model, self.data, self._state, _STATE)
        self.data.sensordata[:] = data.sensordata
        for alone, in_scene in poses:
            alone[:] = in_scene
        return touched

    def copy_scene(self, data: mujoco.MjData, part_poses: FloatArray) -> None:
        """Write the robot in the scene as it is now, for pictures.

        Args:
            data: A state of ``scene_model`` of the caller's own, overwritten.
            part_poses: As for ``step_in_scene``.
        """
        place_mocap(part_poses, data.mocap_pos, data.mocap_quat)
        mujoco.mj_getState(self.model, self.data, self._state, _STATE)
        mujoco.mj_setState(self.scene_model, data, self._state, _STATE)
        mujoco.mj_forward(self.scene_model, data)


def build_model(world: World, body: Body, physics_rate: float) -> mujoco.MjModel:
    """Compile the scene with the robot, free to move. The integrator is the body's choice."""
    arena = build_arena(world)
    arena.attach(body.mjcf()).add("freejoint")
    option = arena.option
    option.timestep = 1.0 / physics_rate
    option.cone = body.friction_cone
    option.iterations, option.ls_iterations = 10, 10  # converges in 1-2; more only costs when something is wrong
    option.flag.autoreset = "disable"  # a diverged episode must end, not silently start over
    return mujoco.MjModel.from_xml_string(arena.to_xml_string(), arena.get_assets())


def _kinds(world: World) -> dict[str, str]:
    """Kind of every geom of the scene but the floor, by the geom's name."""
    kinds: Sequence[tuple[str, str]] = [
        *((obstacle_name(i, o.kind), o.kind) for i, o in enumerate(world.obstacles)),
        *((part_name(m, p, v.kind), v.kind) for m, v in enumerate(world.movers) for p in range(len(v.parts))),
    ]
    return dict(kinds)
