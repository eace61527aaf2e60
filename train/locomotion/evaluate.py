"""Evaluation of a gait: errors of tracking its commands, and falls.

It runs on the full contact model, through the robot's own sensors with their noise, at the simulation's rates.

Run as ``python -m train.locomotion.evaluate --robot go2 --out FILE.json``.
"""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import copy
import itertools
import json
import math
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np
from tqdm import tqdm

from robots.bodies.kinematics import planar_pose
from robots.locomotion.quadruped import Quadruped
from robots.noise import NoiseConfig
from robots.registry import find_quadruped
from train.locomotion.floors import SILL_DEPTH, Floor, compile_model
from train.locomotion.randomise import Randomisation, randomise_robot
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_file, write_whole
from vuca_nav.types import STOP, BodySpec, FloatArray, Pose2, VelocityCommand

CONTROL, PHYSICS = 60, 300
"""Rates of control and physics, as in robots.simulation [Hz]."""
SILL, SLOPE = 0.04, 0.10
"""Heights of the highest bars [m] and slope of the steepest ramps of the rough floor."""
_NUM_SILLS = 40
_REACH = 2.0
"""Distance from the middle of the bars beyond which a robot is put back, alongside them [m]."""


class Track:
    """One robot on an endless floor, in full contact physics.

    Args:
        body: The robot.
        seed: Seed of its sensors' errors and its variation.
        vary: Vary friction, mass, motors, latency and so on as in training; else all are as built.
        floor: The floor; by default flat.
    """

    def __init__(self, body: Quadruped, seed: int, *, vary: bool, floor: Floor | None = None):
        self._body, self._rng = body, np.random.default_rng(seed)
        self._floor = floor or Floor()
        base = compile_model(body.model, PHYSICS, self._floor)
        base.opt.iterations, base.opt.ls_iterations = 10, 10
        self.model, self.data = copy.copy(base), mujoco.MjData(base)
        if vary:
            randomise_robot(self.model, base, self.data, Randomisation(), self._rng)
            self.model.actuator_delay[:] = self._rng.uniform(0.0, 1.0 / CONTROL)
        self._tilt, self._world_from_floor = self._floor.quaternion(), np.empty(9)
        mujoco.mju_quat2Mat(self._world_from_floor, self._tilt)
        joint = int(self.model.jnt_qposadr[0])
        self._qpos, self._qvel = self.data.qpos[joint : joint + 7], self.data.qvel[:6]
        self._bound = body.bind(self.model, self.data, 1.0 / CONTROL, NoiseConfig())
        self.restart()

    def restart(self) -> None:
        """Put the robot down lying, and let it stand up."""
        mujoco.mj_resetData(self.model, self.data)
        self._bound.reset(Pose2(0.0, 0.0, self._rng.uniform(-math.pi, math.pi)), self._rng)
        height = self._qpos[2] + max(self._floor.tops, default=0.0)
        self._qpos[:3] = height * self._world_from_floor[2::3]
        mujoco.mju_mulQuat(self._qpos[3:7], self._tilt, self._qpos[3:7].copy())
        mujoco.mj_forward(self.model, self.data)
        for _ in range(round(self._body.settle_time * CONTROL)):
            self.step(STOP)
        self._bound.start_odometry()

    def step(self, command: VelocityCommand) -> tuple[float, float, float]:
        """Make one control step; returns the true velocity in the heading frame, v_x, v_y [m/s], w_z [rad/s]."""
        self._bound.apply(command)
        mujoco.mj_step(self.model, self.data, nstep=PHYSICS // CONTROL)
        self._bound.update_odometry()
        if self._floor.tops:
            self._put_back()
        _, _, yaw = planar_pose(self._qpos)
        c, s = math.cos(yaw), math.sin(yaw)
        v_x, v_y = self._qvel[0], self._qvel[1]
        up = np.empty(9)
        mujoco.mju_quat2Mat(up, self._qpos[3:7])
        return c * v_x + s * v_y, c * v_y - s * v_x, float(up[6:9] @ self._qvel[3:6])

    def push(self, speed: float) -> None:
        """Change the velocity suddenly in a random direction by ``speed`` [m/s]."""
        angle = self._rng.uniform(-math.pi, math.pi)
        self._qvel[0] += speed * math.cos(angle)
        self._qvel[1] += speed * math.sin(angle)

    @property
    def fallen(self) -> bool:
        """Whether the robot leans by more than 50 degrees, has given up, or has its trunk near the floor."""
        return self._bound.has_fallen_at(float(self._world_from_floor[2::3] @ self._qpos[:3]))

    def _put_back(self) -> None:
        """Move the robot back to where the floor is the same, so that it never ends."""
        for axis, reach in ((0, 0.5 * self._floor.length), (1, _REACH)):
            along = self._world_from_floor[axis::3]
            place = along @ self._qpos[:3]
            if abs(place) > reach:
                self._qpos[:3] -= math.copysign(2.0 * reach, place) * along


def grid(spec: BodySpec) -> list[VelocityCommand]:
    """Grid of 5 x 3 x 4 commands over a body's range of v_x, v_y, w_z."""
    v_x, v_y = np.linspace(spec.min_v_x, spec.max_v_x, 5), np.linspace(-spec.max_v_y, spec.max_v_y, 3)
    axes = (v_x, v_y, np.linspace(-spec.max_w_z, spec.max_w_z, 4))
    return [VelocityCommand(*map(float, command)) for command in itertools.product(*axes)]


@dataclass(frozen=True, slots=True)
class Tracking:
    """Errors over a grid of commands, in v_x, v_y [m/s], w_z [rad/s]."""

    rmse: tuple[float, float, float]
    """Root mean square of the momentary error, over all commands."""
    mean_error: tuple[float, float, float]
    """Root mean square, over the commands, of the mean velocity's error."""
    falls: int
    commands: int


def track_grid(body: Quadruped, *, push_every: float | None, seconds: float = 10.0, seed: int = 0) -> Tracking:
    """Track each command of the grid for some seconds on a varied robot, the first second left out.

    After a fall the robot counts as standing still for the rest of the seconds.
    """
    errors: list[FloatArray] = []
    falls = 0
    for k, command in enumerate(tqdm(grid(body.spec), desc="tracking", unit="command", file=sys.stderr)):
        track = Track(body, 1000 * seed + k, vary=True)
        rows = []
        for tick in range(round(seconds * CONTROL)):
            if push_every and tick % round(push_every * CONTROL) == round(0.5 * push_every * CONTROL):
                track.push(0.5)
            rows.append(track.step(command))
            if track.fallen:
                falls += 1
                break
        errors.append(tracking_errors(rows, command, round(seconds * CONTROL)))
    stacked = np.concatenate(errors)
    means = np.array([e.mean(axis=0) for e in errors])
    return Tracking(_rms(stacked), _rms(means), falls, len(errors))


def tracking_errors(rows: list[tuple[float, float, float]], command: VelocityCommand, num_ticks: int) -> FloatArray:
    """Velocity less command (num_ticks - CONTROL, 3) [m/s, m/s, rad/s]: first second left out, missing rows 0."""
    velocities = np.zeros((num_ticks, 3))
    velocities[: len(rows)] = np.array(rows).reshape(-1, 3)
    return velocities[CONTROL:] - command


def rough_floor(minute: int, rng: np.random.Generator) -> Floor:
    """Make bars of 2-4 cm, each second one of 4 cm; and a slope of up to 10%, each third minute the full 10%."""
    slope = SLOPE if minute % 3 == 0 else rng.uniform(0.0, SLOPE)
    tops = rng.uniform(0.5 * SILL, SILL, _NUM_SILLS)
    tops[::2] = SILL
    depths = rng.uniform(0.1 * SILL_DEPTH, SILL_DEPTH, _NUM_SILLS)
    return Floor(float(slope), rng.uniform(-math.pi, math.pi), tuple(tops.tolist()), tuple(depths.tolist()))


def count_falls(body: Quadruped, minutes: float, *, rough: bool, push_every: float = 5.0, seed: int = 0) -> int:
    """Count falls in minutes of random commands with pushes of 0.5 m/s, a new robot and floor each minute."""
    falls = 0
    spec = body.spec
    low = np.array([spec.min_v_x, -spec.max_v_y, -spec.max_w_z])
    high = np.array([spec.max_v_x, spec.max_v_y, spec.max_w_z])
    for minute in tqdm(range(math.ceil(minutes)), desc="falls", unit="min", file=sys.stderr):
        rng = np.random.default_rng((seed, minute, 7))
        floor = rough_floor(minute, rng) if rough else Floor()
        track = Track(body, 100_000 + 1000 * seed + minute, vary=True, floor=floor)
        command = STOP
        for tick in range(60 * CONTROL):
            if tick % (3 * CONTROL) == 0:
                command = STOP if rng.random() < 0.1 else VelocityCommand(*rng.uniform(low, high).tolist())
            if tick % round(push_every * CONTROL) == CONTROL:
                track.push(0.5)
            track.step(command)
            if track.fallen:
                falls += 1
                track.restart()
    return falls


def real_time_factor(body: Quadruped, seconds: float = 20.0) -> float:
    """Measure the real-time factor of physics and gait alone, walking, on one core."""
    track = Track(body, 0, vary=False)
    command = VelocityCommand(0.6, 0.0, 0.4)
    start = time.perf_counter()
    for _ in range(round(seconds * CONTROL)):
        track.step(command)
    return seconds / (time.perf_counter() - start)


def _rms(errors: FloatArray) -> tuple[float, float, float]:
    v_x, v_y, w_z = np.sqrt((errors**2).mean(axis=0)).tolist()
    return v_x, v_y, w_z


@dataclass(frozen=True)
class EvaluateArguments:
    """Measure how a gait tracks its commands, and how often it falls."""

    robot: str = "go2"
    weights: Path | None = None
    """File of the weights; by default those shipped."""
    out: Path | None = None
    """JSON file of the results, written over if it exists."""
    minutes: float = 60.0
    """Minutes of random commands, on flat floor and on sills and ramps; 0 leaves them out."""
    seed: int = 0


def main(arguments: EvaluateArguments) -> None:
    """Print a table and write JSON.

    Raises:
        BadArgument: If a number is out of its range, or ``--out`` cannot be written.
        UnknownName: If there is no such quadruped.
    """
    if arguments.seed < 0 or not 0.0 <= arguments.minutes < math.inf:
        raise BadArgument(f"--seed and --minutes must be 0 or more, got {arguments.seed} and {arguments.minutes}")
    if arguments.out is not None:
        prepare_file(arguments.out)
    body = Quadruped(find_quadruped(arguments.robot), arguments.weights)
    results: dict = {"robot": arguments.robot, "minutes": arguments.minutes}
    results["real_time_factor"] = real_time_factor(body)
    for name, push in (("undisturbed", None), ("pushed", 2.0)):
        results[name] = asdict(track_grid(body, push_every=push, seed=arguments.seed))
        print(name, json.dumps(results[name]), flush=True)
    if arguments.minutes > 0.0:
        for name, rough in (("falls_flat", False), ("falls_rough", True)):
            results[name] = count_falls(body, arguments.minutes, rough=rough, seed=arguments.seed)
            print(name, results[name], flush=True)
    print(json.dumps(results))
    if arguments.out is not None:
        write_whole(arguments.out, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    run_module("evaluate", main, EvaluateArguments)
