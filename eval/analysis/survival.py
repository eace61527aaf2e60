"""Search for a way to survive: commands of the body that keep it clear of everything, all movements known.

A short-horizon search over the body's kinematic response to its commands (``robots/bodies/responses``): depth first,
the clearest way first, one node for each voxel of state and time. It knows nothing of goals. It is exhaustive up to its
voxels and its commands; what it finds is to be driven in the simulation before it is believed.
"""

import json
import math
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from robots.bodies.tiago import WHEEL_MAX_SPEED, WHEEL_RADIUS, WHEEL_SEPARATION
from robots.clearance import overlaps
from vuca_nav.kernel_cache import njit
from vuca_nav.types import BodySpec, FloatArray, Pose2, VelocityCommand
from worlds.arrays import ShapeArrays
from worlds.level_raycast import BOUND, LOWER, UPPER, level_columns

TICK_RATE = 30.0
"""Rate of commands [Hz]."""
SEGMENT = 8
"""Ticks for which the search keeps a command, 0.27 s."""
MOST_NODES = 200_000
"""Number of nodes after which the search gives up."""
VOXEL = np.array([0.1, 0.1, 0.25, 0.25, 0.25, 0.7])
"""Sizes of a voxel along x, y, yaw, v_x, v_y, w_z [m, rad, m/s, rad/s]."""
_TABLE = 1 << 20
"""Slots of the table of voxels: five times the number of nodes."""
_FAR = 2.0
"""Clearance above which more is no better [m]."""


class BodyModel(NamedTuple):
    """How a body answers its commands, axis by axis: v_x, v_y, w_z."""

    lowest: FloatArray
    """(3,) least velocity [m/s, m/s, rad/s]."""
    highest: FloatArray
    """(3,) greatest velocity."""
    step: FloatArray
    """(3,) greatest change of velocity in a tick."""
    gain: FloatArray
    """(3,) velocity over command."""
    keep: FloatArray
    """(3,) share of the difference from the command that is left after a tick."""
    delay: np.ndarray
    """(3,) ticks until a command is answered, at most ``SEGMENT``."""
    wheel_arm: float
    """Half the distance of the drive wheels [m]; 0 for a body whose axes do not limit each other."""
    wheel_speed: float
    """Greatest speed of a drive wheel at its rim [m/s]."""


class Scene(NamedTuple):
    """Obstacles, and where the movers' parts are at each tick."""

    footprint: FloatArray
    """Convex outline in base_link, inflated (n, 2) [m]."""
    radius: float
    """Radius of the circle about it [m]."""
    static: FloatArray
    """Obstacles within reach (s, 10), as ``level_columns`` gives them."""
    parts: FloatArray
    """Parts within reach (p, 10); the first four columns are not read."""
    poses: FloatArray
    """x, y, cos, sin of the parts after each tick (ticks, p, 4) [m]."""


class Start(NamedTuple):
    """State of the body at the moment from which ways are searched."""

    pose: FloatArray
    """x, y, yaw [m, rad]."""
    velocity: FloatArray
    """v_x, v_y, w_z of base_link [m/s, rad/s]."""
    pending: FloatArray
    """Commands that were given and may not be answered yet, the last one last (SEGMENT, 3)."""


class Survival(NamedTuple):
    """Result of a search."""

    commands: tuple[VelocityCommand, ...]
    """Commands of every tick that survive; empty if there are none."""
    poses: FloatArray
    """x, y, yaw by the model after every tick (ticks, 3) [m, rad]."""
    is_exhausted: bool
    """Whether all ways were tried, up to voxels and commands."""


def body_model(body: BodySpec) -> BodyModel:
    """The identified response of a body; for one that was never identified, its limits and its delay."""
    source = files("robots.bodies") / "responses" / f"{body.name}.json"
    known = json.loads(source.read_text()) if source.is_file() else {}
    absent = {"gain": 1.0, "lag": 0.0, "delay": body.delay}
    axes = [{**absent, **known.get(axis, {})} for axis in ("v_x", "v_y", "w_z")]
    wheels = (WHEEL_SEPARATION / 2.0, WHEEL_RADIUS * WHEEL_MAX_SPEED) if body.name == "tiago" else (0.0, 0.0)
    return BodyModel(
        lowest=np.array([body.min_v_x, -body.max_v_y, -body.max_w_z]),
        highest=np.array([body.max_v_x, body.max_v_y, body.max_w_z]),
        step=np.array([body.max_a_x, body.max_a_y, body.max_a_w]) / TICK_RATE,
        gain=np.array([axis["gain"] for axis in axes]),
        keep=np.array([math.exp(-1.0 / (TICK_RATE * axis["lag"])) if axis["lag"] > 0.0 else 0.0 for axis in axes]),
        delay=np.array([min(round(axis["delay"] * TICK_RATE), SEGMENT) for axis in axes]),
        wheel_arm=wheels[0],
        wheel_speed=wheels[1],
    )


def commands_of(body: BodySpec) -> FloatArray:
    """Commands that the search tries (n, 3): five speeds and five turns, and three sideways for a body that can."""
    v_x = [body.min_v_x, 0.5 * body.min_v_x, 0.0, 0.5 * body.max_v_x, body.max_v_x]
    v_y = [-body.max_v_y, 0.0, body.max_v_y] if body.max_v_y > 0.0 else [0.0]
    w_z = [-body.max_w_z, -0.5 * body.max_w_z, 0.0, 0.5 * body.max_w_z, body.max_w_z]
    return np.unique(np.array(np.meshgrid(v_x, v_y, w_z)).reshape(3, -1).T, axis=0)


def start_of(model: BodyModel, pose: Pose2, commands: FloatArray) -> Start:
    """The state of a body that has answered commands from a stand.

    Args:
        model: The body's response.
        pose: Its true pose now.
        commands: (n, 3) commands of the ticks before now, long enough to forget how it began.
    """
    pending, velocity = np.zeros((SEGMENT, 3)), np.zeros(3)
    for command in commands:
        pending = np.vstack([pending[1:], _within_wheels(model, np.asarray(command, float))])
        for axis in range(3):
            velocity[axis] = _answer(model, axis, pending[SEGMENT - 1 - model.delay[axis], axis], velocity[axis])
    return Start(np.array(pose, float), velocity, pending)


def scene_about(
    start: Pose2,
    body: BodySpec,
    height: float,
    shapes: tuple[ShapeArrays, ShapeArrays],
    part_poses: FloatArray,
    margin: float,
) -> Scene:
    """What the body may meet from a pose on.

    Args:
        start: The body's pose now.
        body: The body.
        height: Its height [m].
        shapes: Shapes of the obstacles, and of the movers' parts.
        part_poses: x, y, yaw of the parts after each tick from now on (ticks, p, 3).
        margin: Least distance that the footprint is to keep [m].
    """  # fmt: skip
    edges = np.roll(body.footprint, -1, axis=0) - body.footprint
    across = np.abs(edges[:, 0] * body.footprint[:, 1] - edges[:, 1] * body.footprint[:, 0])
    inscribed = float((across / np.hypot(edges[:, 0], edges[:, 1])).min())
    footprint = body.footprint * (1.0 + margin / inscribed)
    radius = float(np.hypot(*footprint.T).max())
    reach = body.max_v_x * len(part_poses) / TICK_RATE + radius + 0.3
    static, parts = (level_columns(s) for s in shapes)
    within = [(s[:, LOWER] < height) & (s[:, UPPER] > 0.0) for s in (static, parts)]
    # The nearest point of a box is no nearer than its circle; long walls are always kept.
    within[0] &= np.hypot(*(static[:, :2] - start[:2]).T) - static[:, BOUND] < reach
    if len(parts):
        away = np.hypot(part_poses[:, :, 0] - start.x, part_poses[:, :, 1] - start.y).min(axis=0)
        within[1] &= away - parts[:, BOUND] < reach
    near = part_poses[:, within[1]]
    poses = np.stack([near[..., 0], near[..., 1], np.cos(near[..., 2]), np.sin(near[..., 2])], axis=-1)
    return Scene(
        np.ascontiguousarray(footprint), radius, np.ascontiguousarray(static[within[0]]),
        np.ascontiguousarray(parts[within[1]]), np.ascontiguousarray(poses),
    )  # fmt: skip


def survive(start: Start, scene: Scene, model: BodyModel, commands: FloatArray) -> Survival:
    """Search for commands that keep the footprint clear of everything for as long as the scene's movers are known.

    Args:
        start: State of the body.
        scene: What it may meet.
        model: Its response.
        commands: (n, 3) commands to choose from.
    """
    found, chosen, nodes = _search(start, scene, model, commands, VOXEL, MOST_NODES)
    if not len(chosen):
        return Survival((), np.zeros((0, 3)), bool(found < 0 and nodes < MOST_NODES))
    ticks = len(scene.poses)
    given = np.repeat(commands[chosen], SEGMENT, axis=0)[:ticks]
    poses = _roll_out(start, model, given)
    return Survival(tuple(VelocityCommand(*row) for row in given.tolist()), poses, False)


@njit(cache=True)
def _answer(model, axis, command, velocity):
    """Velocity of an axis after a tick of a command."""
    change = (1.0 - model.keep[axis]) * (model.gain[axis] * command - velocity)
    return velocity + min(max(change, -model.step[axis]), model.step[axis])


@njit(cache=True)
def _within_wheels(model, command):
    """The command as the drive wheels can follow it: both speeds shrink alike."""
    fastest = abs(command[0]) + abs(command[2]) * model.wheel_arm
    if model.wheel_arm > 0.0 and fastest > model.wheel_speed:
        return command * (model.wheel_speed / fastest)
    return command.copy()


@njit(cache=True)
def _drive(model, state, before, command, tick):
    """Move the state (x, y, yaw, v_x, v_y, w_z) on by a tick.

    Args:
        model: A ``BodyModel``.
        state: (6,); changed.
        before: (SEGMENT, 3) commands before this segment, the last one last.
        command: (3,) command of this segment.
        tick: Number of the tick in the segment.
    """
    for axis in range(3):
        late = model.delay[axis]
        asked = command[axis] if tick >= late else before[SEGMENT - late + tick, axis]
        state[3 + axis] = _answer(model, axis, asked, state[3 + axis])
    middle = state[2] + 0.5 * state[5] / TICK_RATE
    cos, sin = math.cos(middle), math.sin(middle)
    state[0] += (state[3] * cos - state[4] * sin) / TICK_RATE
    state[1] += (state[3] * sin + state[4] * cos) / TICK_RATE
    state[2] += state[5] / TICK_RATE


@njit(cache=True)
def _roll_out(start, model, commands):
    poses = np.empty((len(commands), 3))
    state = np.empty(6)
    state[:3], state[3:] = start.pose, start.velocity
    before = start.pending.copy()
    for t in range(len(commands)):
        if t > 0 and t % SEGMENT == 0:
            before[:] = _within_wheels(model, commands[t - 1])
        _drive(model, state, before, _within_wheels(model, commands[t]), t % SEGMENT)
        poses[t] = state[:3]
    return poses


@njit(cache=True)
def _is_free(state, tick, scene, moved):
    """Whether the inflated footprint touches nothing after a tick."""
    x, y, cos, sin = state[0], state[1], math.cos(state[2]), math.sin(state[2])
    for p in range(len(scene.parts)):
        pose = scene.poses[tick, p]
        offset = x - pose[0], y - pose[1], pose[2], pose[3]
        if overlaps(scene.parts[p], offset, cos, sin, scene.footprint, scene.radius, moved):
            return False
    for s in range(len(scene.static)):
        shape = scene.static[s]
        offset = x - shape[0], y - shape[1], shape[2], shape[3]
        if overlaps(shape, offset, cos, sin, scene.footprint, scene.radius, moved):
            return False
    return True


@njit(cache=True)
def _promise(state, tick, scene):
    """Clearance of the body's circle from the movers' circles, now and half a second on, up to ``_FAR`` [m]."""
    least = _FAR
    for ahead in (0, 15):
        t = min(tick + ahead, len(scene.poses) - 1)
        x, y = state[0], state[1]
        if ahead:
            cos, sin = math.cos(state[2]), math.sin(state[2])
            x += 0.5 * (state[3] * cos - state[4] * sin)
            y += 0.5 * (state[3] * sin + state[4] * cos)
        for p in range(len(scene.parts)):
            away = math.hypot(scene.poses[t, p, 0] - x, scene.poses[t, p, 1] - y)
            least = min(least, away - scene.radius - scene.parts[p, BOUND])
    return least


@njit(cache=True)
def _is_new(table, state, tick, voxel):
    """Whether the state is the first in its voxel; notes it."""
    key = np.uint64(tick + 1)
    for k in range(6):
        size = voxel[k]
        value = state[k] % (2.0 * math.pi) if k == 2 else state[k]
        key = key * np.uint64(1000003) + np.uint64(np.int64(math.floor(value / size)) + np.int64(1 << 20))
    key ^= key >> np.uint64(29)
    key *= np.uint64(0xBF58476D1CE4E5B9)  # of splitmix64, so that near voxels lie far apart in the table
    key ^= key >> np.uint64(32)
    slot = np.int64(key & np.uint64(_TABLE - 1))
    while table[slot] != np.uint64(0):
        if table[slot] == key:
            return False
        slot = (slot + 1) & (_TABLE - 1)
    table[slot] = key
    return True


@njit(cache=True)
def _search(start, scene, model, commands, voxel, most):
    """Find a node at the end of the horizon.

    Returns:
        The node, -1 if there is none; the indices of the commands of its segments; and the number of nodes.
    """
    ticks, n = len(scene.poses), len(commands)
    states, parent, command_of = np.empty((most, 6)), np.full(most, -1), np.full(most, -1)
    tick_of = np.zeros(most, np.int64)
    table = np.zeros(_TABLE, np.uint64)
    feasible = np.empty((n, 3))
    for c in range(n):
        feasible[c] = _within_wheels(model, commands[c])
    states[0, :3], states[0, 3:] = start.pose, start.velocity
    stack = np.empty(most, np.int64)
    stack[0], height, count = 0, 1, 1
    moved, before = np.empty_like(scene.footprint), np.empty((SEGMENT, 3))
    child, promise = np.empty((n, 6)), np.empty(n)
    while height > 0:
        height -= 1
        node = stack[height]
        tick = tick_of[node]
        if tick >= ticks:
            segments = (tick + SEGMENT - 1) // SEGMENT
            chosen = np.empty(segments, np.int64)
            at = node
            for k in range(segments - 1, -1, -1):
                chosen[k] = command_of[at]
                at = parent[at]
            return node, chosen, count
        if node == 0:
            before[:] = start.pending
        else:
            before[:] = feasible[command_of[node]]
        end = min(tick + SEGMENT, ticks)
        for c in range(n):
            child[c] = states[node]
            promise[c] = -np.inf
            free = True
            for t in range(tick, end):
                _drive(model, child[c], before, feasible[c], t - tick)
                if not _is_free(child[c], t, scene, moved):
                    free = False
                    break
            if free and _is_new(table, child[c], end, voxel):
                promise[c] = _promise(child[c], end - 1, scene)
        for c in np.argsort(promise):  # the best last, so that it is taken first
            if promise[c] == -np.inf or count >= most:
                continue
            states[count], parent[count], command_of[count], tick_of[count] = child[c], node, c, end
            stack[height] = count
            height, count = height + 1, count + 1
    return -1, np.empty(0, np.int64), count
