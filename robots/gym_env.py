"""A mission in MuJoCo as a gymnasium environment, to try a policy of one's own on these bodies.

``gymnasium.make("vuca_nav.environments:vuca/Navigation-v0", world="square", robot="go2")``
"""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.scene_camera import SceneCamera
from robots.simulation import Rates, Simulation
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import distance
from vuca_nav.perception.readings import as_numbers
from vuca_nav.policy.observation import command_from_action, limits_of
from vuca_nav.task import COLLISION, GOAL_TOLERANCE, REACHED, REWARDS, time_limit
from vuca_nav.types import Odometry, Scan, VelocityCommand
from worlds.checks import check_task
from worlds.registry import make_world
from worlds.world import World

ENV_ID = "vuca/Navigation-v0"
WEIGHTS = REWARDS["fusion"]
"""Weights of the rewards: the column of Zhang et al., Table I, for the fused policy; progress, the goal and a collision
count."""
MAX_GOAL_DISTANCE = 1000.0
"""Bound of the observation space [m]."""
MAX_TWIST = 20.0
"""Bound of the observation space [m/s, rad/s]."""
AXES = ("v_x", "v_y", "w_z")

Observation = dict[str, Any]
"""Float32 arrays by name."""


class NavigationEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A robot on its way to a goal in a world with static and moving obstacles.

    Observation: ``scan``, the ranges beginning behind the robot and going round to the left, the lidar's greatest
    range where nothing came back (num_beams,) [m]; ``goal`` in base_link as a perfect localisation would give it
    (2,) [m]; ``twist``, the measured velocity (3,) [m/s, m/s, rad/s].

    Action: shares of the body's limits in [-1, 1], as in the arena that policies are trained in; backwards, of its
    greatest backward velocity. A quadruped has v_x, v_y, w_z, a differential base v_x, w_z.

    An episode terminates at the goal, at the first contact and at a fall, and is truncated at the time limit. A step
    after its end is undefined, with a warning after a termination.

    A copy, by ``copy`` or ``pickle``, goes on from the same state to the same bits. It is made by carrying out the
    episode's actions again, which takes as long as they took.

    Args:
        world: A world's name or a scene file, or another file as ``map:FILE``.
        robot: A body's name.
        region: Region of the factory, 1 to 4.
        movers: Number of moving obstacles, for the worlds that take it.
        rate: Actions a second; it must divide the lidar's 30 Hz.
        tolerance: Distance from the goal within which it counts as reached [m]; None: the world's own.
        noise: Size of the sensors' errors.
        render_mode: None, or ``rgb_array`` for pictures of the scene from above the robot.

    Attributes:
        axes: Names of the action's numbers.

    Raises:
        UnknownName: If there is no such world or robot.
        BadArgument: If the rate does not divide the lidar's, the world does not take an option, or there is no such
            render mode.
        NoOpenGL: If there shall be pictures and this process cannot draw.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  (gymnasium's own form)

    def __init__(
        self,
        world: str = "static",
        robot: str = "tiago",
        region: int | None = None,
        movers: int | None = None,
        rate: int = 10,
        tolerance: float | None = None,
        noise: NoiseConfig | None = None,
        render_mode: str | None = None,
    ):
        if render_mode not in (None, "rgb_array"):
            raise BadArgument(f"render_mode {render_mode!r}: None or 'rgb_array' would be right")
        self._robot, self._body = robot, make_body(robot)
        spec, lidar, ticks = self._body.spec, self._body.lidar, Rates().tick
        if not isinstance(rate, int | np.integer) or rate < 1 or ticks % rate:
            raise BadArgument(f"rate {rate!r} Hz: one that divides the simulation's {ticks} Hz would be right")
        is_right = isinstance(tolerance, int | float | np.number) and 0.0 < tolerance < math.inf
        if tolerance is not None and not is_right:
            raise BadArgument(f"tolerance {tolerance!r}: a distance above 0 m would be right")
        self._name, self._region, self._movers = world, region, movers
        self._scans, self._given_tolerance, self._noise = ticks // rate, tolerance, noise or NoiseConfig()
        self._make_world(0)  # an unknown name is reported at once
        self.render_mode, self.metadata = render_mode, {**self.metadata, "render_fps": rate}
        self._camera = None if render_mode is None else SceneCamera()

        self._limits = limits_of(spec)
        self._moves = np.array([True, spec.max_v_y > 0.0, True])
        self.axes = tuple(axis for axis, moves in zip(AXES, self._moves) if moves)
        self.action_space = spaces.Box(-1.0, 1.0, (len(self.axes),), np.float32)
        self.observation_space = spaces.Dict(
            {
                "scan": spaces.Box(0.0, lidar.max_range, (lidar.num_beams,), np.float32),
                "goal": spaces.Box(-MAX_GOAL_DISTANCE, MAX_GOAL_DISTANCE, (2,), np.float32),
                "twist": spaces.Box(-MAX_TWIST, MAX_TWIST, (3,), np.float32),
            }
        )
        self._simulation: Simulation | None = None
        self._world: World | None = None
        self._seed, self._limit, self._distance, self._terminated = 0, 0.0, 0.0, False
        self._tolerance = GOAL_TOLERANCE
        self._commands: list[VelocityCommand] = []

    def _make_world(self, seed: int) -> World:
        return make_world(
            self._name,
            seed,
            region=self._region,
            movers=self._movers,
            footprint_radius=self._body.spec.radius,
            height=self._body.height,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Make a new world with a new robot in it.

        Args:
            seed: Seed of the world and of the sensors' noise, as of a mission; drawn at random if None.
            options: Ignored: there are none.
        """
        super().reset(seed=seed)
        chosen = int(self.np_random.integers(2**31)) if seed is None else seed
        world = self._make_world(chosen)
        tolerance = world.tolerance if self._given_tolerance is None else self._given_tolerance
        shortest = check_task(world, self._body.spec.footprint, height=self._body.height, tolerance=tolerance)
        self._world, self._seed, self._commands, self._terminated = world, chosen, [], False
        self._limit = world.time_limit or time_limit(shortest, self._body.spec.max_v_x)
        self._tolerance = tolerance
        self._distance = distance(world.start, world.goal)
        self._simulation = Simulation(world, self._body, chosen, noise=self._noise)
        scan, odometry = self._simulation.reset()
        return self._observation(self._simulation, scan, odometry), {"seed": chosen, "shortest_path": shortest}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out an action.

        Args:
            action: Shares of the body's limits, one for each of ``axes``; clipped to [-1, 1].

        Raises:
            ResetNeeded: If the environment has not been reset.
            BadArgument: If the action is not as many finite numbers.
        """
        simulation = self._running("step")
        numbers = as_numbers(action, "the action")
        if numbers.shape != (len(self.axes),) or not np.isfinite(numbers).all():
            right = f"{len(self.axes)} finite numbers in [-1, 1], {', '.join(self.axes)},"
            raise BadArgument(f"action {action}: {right} would be right")
        if self._terminated:
            gymnasium.logger.warn("step() after the episode has terminated is undefined behaviour: call reset() first")
        share = np.zeros(3)
        share[self._moves] = numbers
        command = VelocityCommand(*command_from_action(share, self._limits).tolist())
        self._commands.append(command)
        scan, odometry, reached, crashed = self._drive(simulation, command)

        away = distance(simulation.true_pose, simulation.world.goal)
        reward = WEIGHTS.w_g * (self._distance - away)
        reward += WEIGHTS.w_r * REACHED * reached + WEIGHTS.w_c * COLLISION * crashed
        self._distance = away
        self._terminated = crashed or reached
        info = {
            "success": reached,
            "contact": simulation.contact,
            "fallen": bool(simulation.fallen),
            "time": simulation.time,
        }
        truncated = not self._terminated and simulation.time >= self._limit
        return self._observation(simulation, scan, odometry), float(reward), self._terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Draw the scene as it is now, (480, 640, 3); None if there shall be no pictures.

        Raises:
            ResetNeeded: If the environment has not been reset.
        """
        if self._camera is None:
            gymnasium.logger.warn("render() draws nothing without a render mode: make(..., render_mode='rgb_array')")
            return None
        return self._camera.picture(self._running("render"))

    def close(self) -> None:
        """Let go of the simulation and of what the graphics driver holds."""
        self._simulation = self._world = None
        if self._camera is not None:
            self._camera.close()

    def _running(self, call: str) -> Simulation:
        if self._simulation is None:
            raise ResetNeeded(f"{call}() before reset(): call reset() first")
        return self._simulation

    def _drive(self, simulation: Simulation, command: VelocityCommand) -> tuple[Scan, Odometry, bool, bool]:
        """Drive until the next action is due or the episode ends; whether the goal was reached, and a crash."""
        reached = crashed = False
        for _ in range(self._scans):
            scan, odometry = simulation.step(command)
            crashed = simulation.contact is not None or bool(simulation.fallen)
            reached = not crashed and distance(simulation.true_pose, simulation.world.goal) < self._tolerance
            if crashed or reached:
                break
        return scan, odometry, reached, crashed  # type: ignore[possibly-undefined]

    def _observation(self, simulation: Simulation, scan: Scan, odometry: Odometry) -> Observation:
        x, y, yaw = simulation.true_pose
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy = simulation.world.goal[0] - x, simulation.world.goal[1] - y
        goal = np.array([c * dx + s * dy, c * dy - s * dx])
        ranges = np.minimum(scan.ranges, self._body.lidar.max_range)
        return {
            "scan": ranges.astype(np.float32),
            "goal": np.clip(goal, -MAX_GOAL_DISTANCE, MAX_GOAL_DISTANCE).astype(np.float32),
            "twist": np.clip(np.array(odometry.twist), -MAX_TWIST, MAX_TWIST).astype(np.float32),
        }

    def __getstate__(self) -> dict[str, Any]:
        """The episode by its world, seed and commands: MuJoCo's own arrays cannot be copied as they are."""
        made_again = ("_body", "_camera", "_simulation")
        return {name: value for name, value in self.__dict__.items() if name not in made_again}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._body = make_body(self._robot)
        self._camera = None if self.render_mode is None else SceneCamera()
        self._simulation = None
        if self._world is not None:
            self._simulation = Simulation(self._world, self._body, self._seed, noise=self._noise)
            self._simulation.reset()
            for command in self._commands:
                self._drive(self._simulation, command)


gymnasium.register(id=ENV_ID, entry_point=NavigationEnv)  # type: ignore[arg-type]
