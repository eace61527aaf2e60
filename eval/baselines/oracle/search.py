"""Search over position, heading, velocities and time: weighted A* over commands that are held for half a second.

Where the future is known, the time still to go comes from a coarse search over position and time alone. It knows of
the waits before a corridor that a mover is in, which would otherwise be searched for one state after the other.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.baselines.oracle.config import SearchConfig
from eval.baselines.oracle.truth import Future, Outlines
from vuca_nav.footprint import cover_by_discs
from vuca_nav.kernel_cache import njit
from vuca_nav.types import BodySpec, FloatArray, Pose2
from worlds.clearance import ClearanceField
from worlds.heap import pop, push
from worlds.motion.movers import TICK_RATE

STEP = 0.1
"""Time between two looks for collisions [s]."""
TICKS = 3
"""Ticks of a ``Future`` in a step."""
_ARRIVED = 0.2
"""Distance of a path's end from the goal [m]: the mission's tolerance is 0.3 m."""
_TIGHT = 5.0
"""Factor of the way through cells where the robot's centre has too little clearance, in the way still to go."""
COARSE = 5
"""Cells of the true map to a cell of the coarse search, each way: 0.25 m."""
_NEVER = 30000
"""Number of slices to a goal that is not reached."""
_DOUBT = 100.0
"""Time on top of the way still to go where the coarse search finds none [s]."""
_X, _Y, _YAW, _V, _W = range(5)


class Path(NamedTuple):
    """States at every ``STEP``, the first being now."""

    states: FloatArray
    """(n, 5) x, y [m], yaw [rad], forward velocity [m/s], yaw rate [rad/s]."""
    arrives: bool
    """Whether it ends at the goal."""
    expanded: int
    """Number of states that were expanded."""


class Scene(NamedTuple):
    """What a path must not touch, for the kernel."""

    clearance: FloatArray
    """(rows, columns) distance of each cell's centre to the nearest static obstacle [m]."""
    to_go: FloatArray
    """(rows, columns) length of the way from each cell to the goal [m]."""
    origin_x: float
    origin_y: float
    resolution: float
    """Of ``clearance`` and ``to_go`` [m]."""
    slices: NDArray[np.int16]
    """(slices, rows, columns) of ``_slices_to_go``; none where the future is not known."""
    slice_time: float
    """Time between two slices [s]."""
    discs: FloatArray
    """(k, 3) discs that cover the footprint: x, y, radius [m]."""
    outlines: Outlines


class _Settings(NamedTuple):
    """Settings of the search, for the kernel."""

    commands: FloatArray
    """(c, 2) forward velocity and yaw rate of each command."""
    max_v: float
    max_a: float
    max_a_w: float
    substeps: int
    cell: float
    headings: int
    greed: float
    nodes: int
    static_margin: float
    mover_margin: float
    horizon: int
    """Number of steps after which a path may end."""
    latest: int
    """Number of steps after which it must have ended."""
    since: float
    """Time since the first of the scene's slices [s]."""


class _Nodes(NamedTuple):
    """States of the search; they are added and never removed."""

    state: FloatArray
    """(nodes, 5)"""
    parent: NDArray[np.int64]
    command: NDArray[np.int64]
    """Command that led there."""
    time: NDArray[np.int64]
    """In steps."""


class SpaceTimeSearch:
    """Searches paths of one body in one scene.

    Args:
        body: The body: its footprint, its greatest velocities and accelerations are kept. It does not go sideways.
        static: Clearance of the static obstacles.
        outlines: Outlines of the movers.
        goal: The goal [m].
        config: Settings.
    """

    def __init__(
        self,
        body: BodySpec,
        static: ClearanceField,
        outlines: Outlines,
        goal: tuple[float, float],
        config: SearchConfig,
    ):
        self.config, self.body, self.goal = config, body, goal
        discs = cover_by_discs(body.footprint)
        least = float(discs[:, 2].min())
        to_go = _to_go(static.distance, static.cell(*goal), least + config.static_margin, 0.5 * least)
        unknown = np.empty((0, 0, 0), np.int16)
        self.scene = Scene(
            static.distance, to_go * static.resolution, *static.origin, static.resolution, unknown, 1.0, discs, outlines
        )
        turns = np.linspace(-1.0, 1.0, 2 * config.turns + 1)
        speeds = [body.min_v_x, 0.0, *(body.max_v_x * np.arange(1, config.speeds + 1) / config.speeds)]
        slowed = [
            (v * (1.0 - config.turn_cost * abs(t)), t * body.max_w_z) for v in dict.fromkeys(speeds) for t in turns
        ]
        self._commands = np.array(slowed, np.float64)

    def foresee(self, future: Future) -> None:
        """Take in a future that is known to its end, for all searches from now on.

        Args:
            future: The movers' places from now on.
        """
        scene, body = self.scene, self.body
        length = COARSE * scene.resolution
        ticks = round(length / body.max_v_x * TICK_RATE)  # time that a cell takes at full speed
        goal = int((self.goal[1] - scene.origin_y) / length), int((self.goal[0] - scene.origin_x) / length)
        open_ = _coarse(scene.clearance, float(scene.discs[:, 2].min()))
        reach = float(scene.discs[:, 2].min()) - 0.71 * length
        slices = _slices_to_go(open_, goal, future, scene, reach, ticks)
        self.scene = scene._replace(slices=slices, slice_time=ticks / TICK_RATE)

    def length_to_goal(self, x: float, y: float) -> float:
        """Length of the way from a point to the goal around static obstacles [m]; ``inf`` if there is none."""
        return float(_look_up(self.scene.to_go, self.scene, x, y))

    def search(
        self, pose: Pose2, velocities: tuple[float, float], future: Future, horizon: float, since: float = 0.0
    ) -> Path:
        """Search a path to the goal, or as far as the horizon.

        Args:
            pose: The robot's pose now.
            velocities: Its forward velocity [m/s] and yaw rate [rad/s].
            future: The movers' places from now on.
            horizon: Length after which a path may end [s]; ``inf`` to search to the goal.
            since: Time since the beginning of the future that was foreseen, if one was [s].

        Returns:
            The path. Where there is none that long, it is the one that goes on longest and then nearest to the goal.
        """
        c, body = self.config, self.body
        latest = 10**6 if math.isfinite(horizon) else max(1, (len(future.movers) - 1) // TICKS)
        settings = _Settings(
            commands=self._commands,
            max_v=body.max_v_x,
            max_a=body.max_a_x,
            max_a_w=body.max_a_w,
            substeps=c.substeps,
            cell=c.cell,
            headings=c.headings,
            greed=1.0,
            nodes=c.nodes,
            static_margin=c.static_margin,
            mover_margin=c.mover_margin,
            horizon=round(horizon / STEP) if math.isfinite(horizon) else 10**6,
            latest=latest,
            since=since,
        )
        start = np.array([*pose, *velocities], np.float64)
        expanded = 0
        for greed in c.greeds:
            settings = settings._replace(greed=greed)
            commands, ends, arrives, count = _search(start, self.goal, future, self.scene, settings)
            expanded += count
            if ends:
                break
        return Path(_play(start, commands, settings), arrives, expanded)


@njit(cache=True)
def _to_go(clearance, goal, enough, least):
    """Length of the way from every cell to the goal, in cells (Dijkstra over 8 neighbours); ``inf`` without one.

    Cells with less clearance than ``enough`` count ``_TIGHT`` times, those with less than ``least`` are barred.
    """
    rows, columns = clearance.shape
    cost = np.full((rows, columns), np.inf)
    keys, cells = np.empty(8 * rows * columns + 8), np.empty(8 * rows * columns + 8, np.int64)
    cost[goal[0], goal[1]] = 0.0
    size = push(keys, cells, 0, 0.0, goal[0] * columns + goal[1])
    while size > 0:
        here, cell = keys[0], cells[0]
        size = pop(keys, cells, size)
        row, column = cell // columns, cell % columns
        if here > cost[row, column]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                i, j = row + di, column + dj
                if (di == 0 and dj == 0) or i < 0 or j < 0 or i >= rows or j >= columns:
                    continue
                if clearance[i, j] < least:
                    continue
                length = math.sqrt(di * di + dj * dj) * (1.0 if clearance[i, j] >= enough else _TIGHT)
                if here + length < cost[i, j] - 1e-9:
                    cost[i, j] = here + length
                    size = push(keys, cells, size, cost[i, j], i * columns + j)
    return cost


@njit(cache=True)
def _coarse(clearance, enough):
    """Mask of the coarse cells in which the footprint's discs may fit anywhere."""
    rows, columns = (clearance.shape[0] + COARSE - 1) // COARSE, (clearance.shape[1] + COARSE - 1) // COARSE
    fits = np.zeros((rows, columns), np.bool_)
    for i in range(clearance.shape[0]):
        for j in range(clearance.shape[1]):
            if clearance[i, j] >= enough:
                fits[i // COARSE, j // COARSE] = True
    return fits


@njit(cache=True)
def _slices_to_go(fits, goal, future, scene, reach, ticks):
    """Number of slices of time from each coarse cell at each slice to the goal, (slices, rows, columns).

    In a slice a point goes to one of the 8 neighbours or waits; cells nearer than ``reach`` to a mover are barred.
    After the last slice nothing moves.
    """
    rows, columns = fits.shape
    count = (len(future.movers) - 1) // ticks + 1
    out = np.full((count, rows, columns), _NEVER, np.int16)
    length = COARSE * scene.resolution
    queue = np.empty((rows * columns, 2), np.int64)
    queue[0, 0], queue[0, 1] = goal
    last = out[count - 1]
    last[goal[0], goal[1]] = 0
    done, size = 0, 1
    while done < size:
        i, j = queue[done]
        done += 1
        for a in range(max(i - 1, 0), min(i + 2, rows)):
            for b in range(max(j - 1, 0), min(j + 2, columns)):
                if fits[a, b] and last[a, b] == _NEVER:
                    last[a, b] = last[i, j] + 1
                    queue[size, 0], queue[size, 1] = a, b
                    size += 1
    after = np.full((rows + 2, columns + 2), _NEVER, np.int16)
    for n in range(count - 2, -1, -1):
        after[1 : rows + 1, 1 : columns + 1] = out[n + 1]
        _bar_movers(after, future, scene, reach, (n + 1) * ticks, length)
        for i in range(rows):
            for j in range(columns):
                if not fits[i, j]:
                    continue
                least = after[i, j]
                for a in range(i, i + 3):
                    for b in range(j, j + 3):
                        least = min(least, after[a, b])
                out[n, i, j] = min(least + 1, _NEVER)
        out[n, goal[0], goal[1]] = 0
    return out


@njit(cache=True)
def _bar_movers(after, future, scene, reach, tick, length):
    """Set the coarse cells, of an array with a border, nearer than ``reach`` to a mover's parts to ``_NEVER``."""
    outlines = scene.outlines
    for p in range(len(outlines.half)):
        half_x, half_y = outlines.half[p]
        if half_x < 0.0:
            continue
        px, py, cos, sin = future.parts[tick, p]
        if not math.isfinite(px):  # not there, or not known
            continue
        around = (math.hypot(half_x, half_y) + max(reach, 0.0)) / length + 1.0
        column, row = (px - scene.origin_x) / length - 0.5, (py - scene.origin_y) / length - 0.5
        for i in range(max(int(row - around), 0), min(int(row + around) + 2, after.shape[0] - 2)):
            for j in range(max(int(column - around), 0), min(int(column + around) + 2, after.shape[1] - 2)):
                dx, dy = (j - column) * length, (i - row) * length
                if outlines.is_cylinder[p]:
                    away = math.sqrt(dx * dx + dy * dy) - half_x
                else:
                    out_x = max(abs(cos * dx + sin * dy) - half_x, 0.0)
                    out_y = max(abs(cos * dy - sin * dx) - half_y, 0.0)
                    away = math.sqrt(out_x * out_x + out_y * out_y)
                if away < reach:
                    after[i + 1, j + 1] = _NEVER


@njit(cache=True)
def _time_to_go(scene, state, time, settings):
    """Estimate of the time from a state to the goal [s]."""
    static = _look_up(scene.to_go, scene, state[_X], state[_Y]) / settings.max_v
    count, rows, columns = scene.slices.shape
    if count == 0:
        return static
    length = COARSE * scene.resolution
    n = min(int((settings.since + time * STEP) / scene.slice_time), count - 1)
    i, j = int((state[_Y] - scene.origin_y) / length), int((state[_X] - scene.origin_x) / length)
    i, j = min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)
    slices, without = scene.slices[n, i, j], scene.slices[count - 1, i, j]
    return static + _DOUBT if slices >= _NEVER else static + (slices - without) * scene.slice_time  # what movers delay


@njit(cache=True)
def _look_up(field, scene, x, y):
    """Value of the cell that holds a point; the nearest cell's outside."""
    rows, columns = field.shape
    i, j = int((y - scene.origin_y) / scene.resolution), int((x - scene.origin_x) / scene.resolution)
    return field[min(max(i, 0), rows - 1), min(max(j, 0), columns - 1)]


@njit(cache=True)
def _static_gap(scene, state):
    """Least clearance of the footprint from static obstacles, at least; half a cell's diagonal off [m]."""
    c, s = math.cos(state[_YAW]), math.sin(state[_YAW])
    gap = 1e9
    for k in range(len(scene.discs)):
        x = state[_X] + c * scene.discs[k, 0] - s * scene.discs[k, 1]
        y = state[_Y] + s * scene.discs[k, 0] + c * scene.discs[k, 1]
        gap = min(gap, _look_up(scene.clearance, scene, x, y) - scene.discs[k, 2])
    return gap - 0.71 * scene.resolution


@njit(cache=True)
def _mover_gap(scene, state, future, tick, enough):
    """Clearance of the footprint from the movers at a tick, or ``enough`` if it is more [m]."""
    if tick >= len(future.movers):
        return enough
    outlines = scene.outlines
    c, s = math.cos(state[_YAW]), math.sin(state[_YAW])
    gap = enough
    for k in range(len(scene.discs)):
        x = state[_X] + c * scene.discs[k, 0] - s * scene.discs[k, 1]
        y = state[_Y] + s * scene.discs[k, 0] + c * scene.discs[k, 1]
        radius = scene.discs[k, 2]
        for m in range(len(outlines.radii)):
            dx, dy = x - future.movers[tick, m, 0], y - future.movers[tick, m, 1]
            reach = outlines.radii[m] + radius + gap
            if not dx * dx + dy * dy < reach * reach:
                continue
            for p in range(outlines.first[m], outlines.first[m + 1]):
                if outlines.half[p, 0] < 0.0:
                    continue
                px, py, cos, sin = future.parts[tick, p]
                dx, dy = x - px, y - py
                if outlines.is_cylinder[p]:
                    away = math.sqrt(dx * dx + dy * dy) - outlines.half[p, 0]
                else:
                    out_x = max(abs(cos * dx + sin * dy) - outlines.half[p, 0], 0.0)
                    out_y = max(abs(cos * dy - sin * dx) - outlines.half[p, 1], 0.0)
                    away = math.sqrt(out_x * out_x + out_y * out_y)
                gap = min(gap, away - radius)
    return gap


@njit(cache=True)
def _advance(state, v, w, settings):
    """Carry a state on by a step, under a command and the limits of acceleration."""
    change_v, change_w = settings.max_a * STEP, settings.max_a_w * STEP
    v_before, w_before = state[_V], state[_W]
    state[_V] += min(max(v - v_before, -change_v), change_v)
    state[_W] += min(max(w - w_before, -change_w), change_w)
    v_middle, w_middle = 0.5 * (v_before + state[_V]), 0.5 * (w_before + state[_W])
    yaw = state[_YAW] + 0.5 * w_middle * STEP
    state[_X] += v_middle * math.cos(yaw) * STEP
    state[_Y] += v_middle * math.sin(yaw) * STEP
    state[_YAW] += w_middle * STEP


@njit(cache=True)
def _is_new(table, state, time, settings):
    """Whether no state like this was seen; it is now."""
    turn = 2.0 * math.pi / settings.headings
    key = int(math.floor(state[_X] / settings.cell)) + 100000
    key = key * 200003 + int(math.floor(state[_Y] / settings.cell)) + 100000
    key = key * 211 + int(math.floor(state[_YAW] / turn + 0.5)) % settings.headings
    key = key * 17 + int(round(4.0 * state[_V] / settings.max_v)) + 8
    key = key * 7 + (1 if state[_W] > 0.1 else (2 if state[_W] < -0.1 else 0))
    key = key * 8191 + time // settings.substeps + 1
    mask = len(table) - 1
    at = (key ^ (key >> 29) * 1000003) & mask
    while table[at] != 0:
        if table[at] == key:
            return False
        at = (at + 1) & mask
    table[at] = key
    return True


@njit(cache=True)
def _search(start, goal, future, scene, settings):
    """Commands of the path found, whether it ends as it should, whether it arrives, and the number of states seen."""
    most = settings.nodes
    nodes = _Nodes(np.empty((most, 5)), np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64))
    size_of_table = 1
    while size_of_table < 2 * most:
        size_of_table *= 2
    table = np.zeros(size_of_table, np.int64)
    keys, heap = np.empty(most), np.empty(most, np.int64)
    # Where a path begins nearer than the margin, it may stay as near.
    static_margin = min(settings.static_margin, _static_gap(scene, start) - 0.005)
    mover_margin = min(settings.mover_margin, max(_mover_gap(scene, start, future, 0, 1.0) - 0.005, 0.0))
    nodes.state[0] = start
    nodes.parent[0], nodes.command[0], nodes.time[0] = -1, -1, 0
    count, waiting, expanded = 1, push(keys, heap, 0, 0.0, 0), 0
    best, best_time, best_to_go, found, arrives = 0, 0, np.inf, -1, False
    state = np.empty(5)
    while waiting > 0 and count + len(settings.commands) < most:
        node = heap[0]
        waiting = pop(keys, heap, waiting)
        time = nodes.time[node]
        x, y = nodes.state[node, _X], nodes.state[node, _Y]
        if (x - goal[0]) ** 2 + (y - goal[1]) ** 2 < _ARRIVED**2:
            found, arrives = node, True
            break
        if time >= settings.horizon:
            found = node
            break
        expanded += 1
        to_go = _look_up(scene.to_go, scene, x, y)
        # Of paths that go on for 2 s any is good enough; then the nearest to the goal is best.
        lasting = min(time, 20)
        if lasting > best_time or (lasting == best_time and to_go < best_to_go):
            best, best_time, best_to_go = node, lasting, to_go
        for k in range(len(settings.commands)):
            state[:] = nodes.state[node]
            then, free = time, True
            for _ in range(settings.substeps):
                _advance(state, settings.commands[k, 0], settings.commands[k, 1], settings)
                then += 1
                if then > settings.latest or _static_gap(scene, state) < static_margin:
                    free = False
                    break
                if _mover_gap(scene, state, future, TICKS * then, mover_margin + 1e-6) < mover_margin:
                    free = False
                    break
                if (state[_X] - goal[0]) ** 2 + (state[_Y] - goal[1]) ** 2 < _ARRIVED**2:
                    break
            if not free or not _is_new(table, state, then, settings):
                continue
            ahead = _time_to_go(scene, state, then, settings)
            if not ahead < np.inf:
                continue
            nodes.state[count] = state
            nodes.parent[count], nodes.command[count], nodes.time[count] = node, k, then
            waiting = push(keys, heap, waiting, then * STEP + settings.greed * ahead, count)
            count += 1
    ends = found >= 0
    if not ends:
        found = best
    length, node = 0, found
    while nodes.parent[node] >= 0:
        length += 1
        node = nodes.parent[node]
    commands = np.empty((length, 2), np.int64)
    node = found
    for n in range(length - 1, -1, -1):
        commands[n, 0], commands[n, 1] = nodes.command[node], nodes.time[node] - nodes.time[nodes.parent[node]]
        node = nodes.parent[node]
    return commands, ends, arrives, expanded


@njit(cache=True)
def _play(start, commands, settings):
    """States (n, 5) at every step under a sequence of commands and their numbers of steps."""
    total = 1
    for n in range(len(commands)):
        total += commands[n, 1]
    states = np.empty((total, 5))
    state = start.copy()
    states[0] = state
    at = 1
    for n in range(len(commands)):
        for _ in range(commands[n, 1]):
            k = commands[n, 0]
            _advance(state, settings.commands[k, 0], settings.commands[k, 1], settings)
            states[at] = state
            at += 1
    return states
