"""A mission in MuJoCo as a gymnasium environment, to try a policy of one's own on these bodies.

``gymnasium.make("robots.gym_env:vuca/Navigation-v0", world="square", robot="go2")``
"""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.simulation import Simulation
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import distance
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

Observation = dict[str, Any]
"""Float32 arrays by name."""


class NavigationEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A robot on its way to a goal in a world with static and moving obstacles.

    Observation: ``scan``, the ranges beginning behind the robot and going round to the left, the lidar's greatest
    range where nothing came back (num_beams,) [m]; ``goal`` in base_link as a perfect localisation would give it
    (2,) [m]; ``twist``, the measured velocity (3,) [m/s, m/s, rad/s]. Action: v_x, v_y [m/s] and w_z [rad/s]; a
    differential base ignores v_y. An episode terminates at the goal, at the first contact and at a fall, and is
    truncated at the time limit.

    Args:
        world: A world's name or a scene file.
        robot: A body's name.
        region: Region of the factory, 1 to 4.
        movers: Number of moving obstacles, for the worlds that take it.
        rate: Actions a second; it must divide the lidar's 30 Hz.
        tolerance: Distance from the goal within which it counts as reached [m].
        noise: Size of the sensors' errors.

    Raises:
        UnknownName: If there is no such world or robot.
        BadArgument: If the rate does not divide the lidar's, or the world does not take an option.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  (gymnasium's own form)

    def __init__(
        self,
        world: str = "static",
        robot: str = "tiago",
        region: int | None = None,
        movers: int | None = None,
        rate: int = 10,
        tolerance: float = GOAL_TOLERANCE,
        noise: NoiseConfig | None = None,
    ):
        self._body = make_body(robot)
        spec, lidar = self._body.spec, self._body.lidar
        if rate < 1 or round(lidar.rate) % rate:
            raise BadArgument(f"rate {rate} Hz: one that divides the lidar's {lidar.rate:g} Hz would be right")
        self._name, self._region, self._movers = world, region, movers
        self._scans, self._tolerance, self._noise = round(lidar.rate) // rate, tolerance, noise or NoiseConfig()
        self._make_world(0)  # an unknown name is reported at once
        low, high = (spec.min_v_x, -spec.max_v_y, -spec.max_w_z), (spec.max_v_x, spec.max_v_y, spec.max_w_z)
        self._low, self._high = np.array(low, np.float32), np.array(high, np.float32)
        self.action_space = spaces.Box(self._low, self._high, dtype=np.float32)
        self.observation_space = spaces.Dict(
            {
                "scan": spaces.Box(0.0, lidar.max_range, (lidar.num_beams,), np.float32),
                "goal": spaces.Box(-MAX_GOAL_DISTANCE, MAX_GOAL_DISTANCE, (2,), np.float32),
                "twist": spaces.Box(-MAX_TWIST, MAX_TWIST, (3,), np.float32),
            }
        )

    def _make_world(self, seed: int) -> World:
        radius = self._body.spec.radius
        return make_world(self._name, seed, region=self._region, movers=self._movers, footprint_radius=radius)

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
        shortest = check_task(world, self._body.spec.radius)
        self._goal, self._limit = world.goal, time_limit(shortest, self._body.spec.max_v_x)
        self._simulation = Simulation(world, self._body, chosen, noise=self._noise)
        scan, odometry = self._simulation.reset()
        self._distance = distance(world.start, world.goal)
        return self._observation(scan, odometry), {"seed": chosen, "shortest_path": shortest}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out an action.

        Args:
            action: v_x, v_y, w_z; clipped to the body's limits.

        Raises:
            BadArgument: If it is not three finite numbers.
        """
        if np.shape(action) != (3,) or not np.isfinite(action).all():
            raise BadArgument(f"action {action}: three finite numbers, v_x, v_y and w_z, would be right")
        command = VelocityCommand(*(float(value) for value in np.clip(action, self._low, self._high)))
        simulation = self._simulation
        reached = crashed = False
        for _ in range(self._scans):
            scan, odometry = simulation.step(command)
            crashed = simulation.contact is not None or simulation.fallen
            reached = not crashed and distance(simulation.true_pose, self._goal) < self._tolerance
            if crashed or reached:
                break
        away = distance(simulation.true_pose, self._goal)
        reward = WEIGHTS.w_g * (self._distance - away)
        reward += WEIGHTS.w_r * REACHED * reached + WEIGHTS.w_c * COLLISION * crashed
        self._distance = away
        ended = crashed or reached
        info = {"success": reached, "contact": simulation.contact, "fallen": simulation.fallen, "time": simulation.time}
        observation = self._observation(scan, odometry)  # type: ignore[possibly-undefined]
        return observation, float(reward), ended, not ended and simulation.time >= self._limit, info

    def _observation(self, scan: Scan, odometry: Odometry) -> Observation:
        x, y, yaw = self._simulation.true_pose
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy = self._goal[0] - x, self._goal[1] - y
        ranges = np.minimum(scan.ranges, self._body.lidar.max_range)
        return {
            "scan": ranges.astype(np.float32),
            "goal": np.array([c * dx + s * dy, c * dy - s * dx], np.float32),
            "twist": np.clip(np.array(odometry.twist), -MAX_TWIST, MAX_TWIST).astype(np.float32),
        }


gymnasium.register(id=ENV_ID, entry_point=NavigationEnv)  # type: ignore[arg-type]
