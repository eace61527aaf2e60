"""Relation errors of a trajectory (Kuemmerle et al. 2009, "On measuring the accuracy of SLAM algorithms").

A relation is the true displacement between two moments, as people have matched the scans of these moments by hand. The
error of a trajectory is that of its own displacements between the same moments: it does not depend on a common frame,
and an early error does not count again at each later pose.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vuca_nav.data_files import read_text, shown
from vuca_nav.errors import BadArgument, BadLog
from vuca_nav.types import FloatArray

MOST_RELATIONS = 64 * 2**20
"""Greatest size of a file of relations [bytes]."""
NEAREST = 0.5
"""A moment farther than this from every pose of the trajectory belongs to another log [s]."""


class RelationErrors(NamedTuple):
    """Absolute errors of a trajectory's displacements."""

    n: int
    """Number of relations."""
    m_mean: float
    """Mean of the translational errors [m]."""
    m_sd: float
    """Their standard deviation [m]."""
    deg_mean: float
    """Mean of the rotational errors [degrees]."""
    deg_sd: float
    """Their standard deviation [degrees]."""


def read_relations(path: Path) -> FloatArray:
    """Read a file of relations, a line each: t1 t2 x y z roll pitch yaw, the pose at t2 in the frame of t1.

    Returns:
        (n, 5) t1, t2 [s], x, y [m], yaw [rad].

    Raises:
        BadLog: If the file is none of relations.
    """
    rows = []
    for number, line in enumerate(read_text(path, BadLog, MOST_RELATIONS).splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != 8 or not all(map(math.isfinite, values)):
            raise BadLog(f"{path}, line {number}: {shown(line)!r} is no relation, which is t1 t2 x y z roll pitch yaw")
        rows.append((values[0], values[1], values[2], values[3], values[7]))
    if not rows:
        raise BadLog(f"{path} holds no relation; a line each of t1 t2 x y z roll pitch yaw would be right")
    return np.array(rows)


def relation_errors(relations: FloatArray, stamps: FloatArray, poses: FloatArray) -> RelationErrors:
    """Errors of a trajectory; between two of its poses it is interpolated.

    Args:
        relations: (n, 5) as ``read_relations`` gives them.
        stamps: (m,) times of the trajectory, never falling [s].
        poses: (m, 3) x, y [m], yaw [rad].

    Raises:
        BadArgument: If no relation lies within the trajectory.
    """
    inside = np.ones(len(relations), bool)
    for times in relations[:, 0], relations[:, 1]:
        after = np.clip(np.searchsorted(stamps, times), 1, max(len(stamps) - 1, 1))
        gap = np.minimum(abs(stamps[after - 1] - times), abs(stamps[np.minimum(after, len(stamps) - 1)] - times))
        inside &= gap <= NEAREST
    relations = relations[inside]
    if not len(relations):
        raise BadArgument("no relation's times lie within the log's: the relations are of another log")
    first, second = (_poses_at(relations[:, k], stamps, poses) for k in (0, 1))
    found = _displacement(first, second)
    off = _displacement(relations[:, 2:], found)
    metres = np.hypot(off[:, 0], off[:, 1])
    degrees = np.degrees(abs(off[:, 2]))
    return RelationErrors(
        len(relations), float(metres.mean()), float(metres.std()), float(degrees.mean()), float(degrees.std())
    )


def _poses_at(times: FloatArray, stamps: FloatArray, poses: FloatArray) -> FloatArray:
    """Poses of a trajectory at these times (n, 3)."""
    yaw = np.unwrap(poses[:, 2])
    return np.column_stack([np.interp(times, stamps, column) for column in (poses[:, 0], poses[:, 1], yaw)])


def _displacement(first: FloatArray, second: FloatArray) -> FloatArray:
    """The second poses in the frames of the first ones (n, 3), the yaw within half a turn."""
    c, s = np.cos(first[:, 2]), np.sin(first[:, 2])
    dx, dy = second[:, 0] - first[:, 0], second[:, 1] - first[:, 1]
    yaw = (second[:, 2] - first[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    return np.column_stack([c * dx + s * dy, -s * dx + c * dy, yaw])
