"""Kernels of the costmap: states of cells, their clearances, and the headings in which a body fits into them."""

import math
from typing import NamedTuple

import numpy as np

from vuca_nav.kernel_cache import njit

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
HEADINGS = 16
"""Number of headings of a body over a full turn."""
ALL_HEADINGS = 2**HEADINGS - 1
"""Bits of all headings."""


@njit(cache=True)
def coarsen(level, factor):
    """Coarsen a grid: a coarse cell is occupied if any of its cells is, free if half of them are."""
    rows, columns = level.shape[0] // factor, level.shape[1] // factor
    state = np.empty((rows, columns), np.int8)
    free, occupied = np.empty(columns * factor, np.int32), np.empty(columns * factor, np.int32)
    for i in range(rows):
        free[:], occupied[:] = 0, 0
        for a in range(factor * i, factor * (i + 1)):
            line = level[a]
            for j in range(columns * factor):
                free[j] += line[j] < 0
                occupied[j] += line[j] > 0
        for j in range(columns):
            num_free = num_occupied = 0
            for b in range(factor * j, factor * (j + 1)):
                num_free += free[b]
                num_occupied += occupied[b]
            state[i, j] = 2 if num_occupied > 0 else (1 if 2 * num_free >= factor * factor else 0)
    return state


@njit(cache=True)
def forget(state, certain, factor, most):
    """Free the connected occupied cells that extend over at most ``most`` cells each way, none of them certain."""
    rows, columns = state.shape
    visited = np.zeros((rows, columns), np.bool_)
    stack = np.empty((rows * columns, 2), np.int32)
    for i0 in range(rows):
        for j0 in range(columns):
            if state[i0, j0] != 2 or visited[i0, j0]:
                continue
            visited[i0, j0] = True
            stack[0, 0], stack[0, 1] = i0, j0
            done, size = 0, 1
            low_i, high_i, low_j, high_j, gone = i0, i0, j0, j0, True
            while done < size:
                i, j = stack[done, 0], stack[done, 1]
                done += 1
                low_i, high_i, low_j, high_j = min(low_i, i), max(high_i, i), min(low_j, j), max(high_j, j)
                for a in range(factor * i, factor * (i + 1)):
                    for b in range(factor * j, factor * (j + 1)):
                        gone = gone and not certain[a, b]
                for a in range(max(i - 1, 0), min(i + 2, rows)):
                    for b in range(max(j - 1, 0), min(j + 2, columns)):
                        if state[a, b] == 2 and not visited[a, b]:
                            visited[a, b] = True
                            stack[size, 0], stack[size, 1] = a, b
                            size += 1
            if gone and high_i - low_i < most and high_j - low_j < most:
                for k in range(size):
                    state[stack[k, 0], stack[k, 1]] = 1


@njit(cache=True)
def leave_out(state, origin, resolution, moving, margin):
    """Free the cells that moving tracks occupy."""
    for track in moving:
        reach = (track[2] + margin) / resolution
        middle_j, middle_i = (track[0] - origin[0]) / resolution - 0.5, (track[1] - origin[1]) / resolution - 0.5
        for i in range(max(int(middle_i - reach), 0), min(int(middle_i + reach) + 2, state.shape[0])):
            for j in range(max(int(middle_j - reach), 0), min(int(middle_j + reach) + 2, state.shape[1])):
                if state[i, j] == 2 and (i - middle_i) ** 2 + (j - middle_j) ** 2 <= reach * reach:
                    state[i, j] = 1


@njit(cache=True)
def chamfer(state, cap):
    """Distance to the nearest occupied cell by the 5-7 chamfer (Borgefors 1986), at most 8% too far, capped."""
    rows, columns = state.shape
    d = np.empty((rows, columns), np.int16)
    # Each row takes first from the row before, which vectorises, then from its own neighbour.
    before = np.full(columns + 2, cap, np.int16)
    for i in range(rows):
        here = d[i]
        left, middle, right = before[:columns], before[1 : columns + 1], before[2:]
        for j in range(columns):
            least = min(min(min(left[j], right[j]) + 7, middle[j] + 5), cap)
            here[j] = 0 if state[i, j] == 2 else least
        least = cap
        for j in range(columns):
            least = min(least + 5, here[j])
            here[j] = least
        before[1 : columns + 1] = here
    before[:] = cap
    for i in range(rows - 1, -1, -1):
        here = d[i]
        left, middle, right = before[:columns], before[1 : columns + 1], before[2:]
        for j in range(columns):
            here[j] = min(min(min(left[j], right[j]) + 7, middle[j] + 5), here[j])
        least = cap
        for j in range(columns - 1, -1, -1):
            least = min(least + 5, here[j])
            here[j] = least
        before[1 : columns + 1] = here
    return d


class Limits(NamedTuple):
    """Settings of the weights, for the kernel. Clearances are in fifths of the map's cells."""

    lethal: float
    """Least clearance of the centre of each disc."""
    turning: float
    """Clearance from which the body may turn about."""
    comfort: float
    """Clearance beyond which obstacles cost nothing."""
    tight_weight: float
    comfort_weight: float
    unit: int
    escape_weight: int
    factor: int
    """Number of the map's cells to a cell, each way."""


@njit(cache=True)
def fine_obstacles(state, level, factor):
    """Occupied cells of the map that are still obstacles by the coarser state, as ``chamfer`` takes them."""
    rows, columns = state.shape
    fine = np.zeros((rows * factor, columns * factor), np.int8)
    for i in range(rows):
        for j in range(columns):
            if state[i, j] != 2:
                continue
            for a in range(factor * i, factor * (i + 1)):
                for b in range(factor * j, factor * (j + 1)):
                    if level[a, b] > 0:
                        fine[a, b] = 2
    return fine


@njit(cache=True)
def best_places(fine, factor):
    """Greatest clearance within each coarse cell."""
    rows, columns = fine.shape[0] // factor, fine.shape[1] // factor
    best = np.zeros((rows, columns), np.int16)
    for i in range(rows):
        for a in range(factor * i, factor * (i + 1)):
            line, out = fine[a], best[i]
            for j in range(columns):
                for b in range(factor * j, factor * (j + 1)):
                    out[j] = max(out[j], line[b])
    return best


@njit(cache=True)
def to_best_places(points, clearance, fine, turning, origin, resolution):
    """Move points to the middle of the map's cells of the greatest clearance within their tight cells."""
    factor = fine.shape[0] // clearance.shape[0]
    for point in points:
        i, j = int((point[1] - origin[1]) / resolution), int((point[0] - origin[0]) / resolution)
        if not (0 <= i < clearance.shape[0] and 0 <= j < clearance.shape[1]) or clearance[i, j] >= turning:
            continue
        count = sum_a = sum_b = 0
        for a in range(factor * i, factor * (i + 1)):
            for b in range(factor * j, factor * (j + 1)):
                if fine[a, b] == clearance[i, j]:
                    count, sum_a, sum_b = count + 1, sum_a + a, sum_b + b
        point[0] = origin[0] + (sum_b / count + 0.5) * resolution / factor
        point[1] = origin[1] + (sum_a / count + 0.5) * resolution / factor


@njit(cache=True)
def _fitting(fine, discs, lethal, x, y):
    """Bits of the headings in which every disc keeps its clearance.

    Args:
        fine: Clearances on the map's cells.
        discs: (HEADINGS, k, 2) centres of the discs for each heading, in cells.
        lethal: Least clearance.
        x: Column of the body's centre, fractional.
        y: Row of the body's centre, fractional.
    """
    rows, columns = fine.shape
    bits = 0
    for h in range(len(discs)):
        fits = True
        for k in range(discs.shape[1]):
            j, i = int(math.floor(x + discs[h, k, 0])), int(math.floor(y + discs[h, k, 1]))
            if 0 <= i < rows and 0 <= j < columns and fine[i, j] < lethal:
                fits = False
                break
        if fits:
            bits |= 1 << h
    return bits


@njit(cache=True)
def weigh(state, clearance, fine, discs, limits, robot):
    """Weigh each cell by its clearance, and find the headings in which the body fits into it.

    Args:
        state: States of the cells.
        clearance: Clearance of the best place of each.
        fine: Clearances on the map's cells.
        discs: Discs of the body for each heading, in cells of the map.
        limits: Settings.
        robot: Row and column of the robot, and the radius within which it may leave a tight spot, in cells.

    Returns:
        The cost of entering each cell, 0 where a path must not go, and the bits of the headings.
    """
    rows, columns = state.shape
    weight = np.zeros((rows, columns), np.int16)
    headings = np.zeros((rows, columns), np.uint16)
    robot_i, robot_j, escape = robot
    unit, factor = limits.unit, limits.factor
    tight = max(limits.turning - limits.lethal, 1.0)
    for i in range(rows):
        for j in range(columns):
            if state[i, j] != 1:
                continue
            c = clearance[i, j]
            if c >= limits.turning:
                cost = 1.0
                if c < limits.comfort:
                    cost += limits.comfort_weight * (limits.comfort - c) / (limits.comfort - limits.turning)
                weight[i, j], headings[i, j] = int(unit * cost), ALL_HEADINGS
                continue
            bits = 0
            if c >= limits.lethal:
                for a in range(factor * i, factor * (i + 1)):
                    for b in range(factor * j, factor * (j + 1)):
                        if fine[a, b] >= limits.lethal:
                            bits |= _fitting(fine, discs, limits.lethal, b + 0.5, a + 0.5)
            if bits:
                cost = 1.0 + limits.comfort_weight + limits.tight_weight * (limits.turning - c) / tight
                weight[i, j], headings[i, j] = int(unit * cost), bits
            elif (i - robot_i) ** 2 + (j - robot_j) ** 2 <= escape * escape:
                weight[i, j], headings[i, j] = limits.escape_weight, ALL_HEADINGS
    # Under the robot it is free by definition, whatever the map says.
    for i in range(max(robot_i - 2, 0), min(robot_i + 3, rows)):
        for j in range(max(robot_j - 2, 0), min(robot_j + 3, columns)):
            headings[i, j] = ALL_HEADINGS
            if weight[i, j] == 0:
                weight[i, j] = limits.escape_weight
    return weight, headings
