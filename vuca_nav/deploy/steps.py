"""The recorded steps of a bundle: what the stack saw and said in the simulator, to compare with what it says elsewhere.

Ranges are in single precision, as a LaserScan and the simulator's lidar have them.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vuca_nav.data_files import shown
from vuca_nav.errors import BadBundle, BadWeights
from vuca_nav.safetensors_file import read_weights
from vuca_nav.types import FloatArray, Odometry, Pose2, Scan, Twist2

FORMAT = "vuca-steps-1"
MOST_TICKS, MOST_STEPS, MOST_BEAMS = 100_000, 100_000, 100_000
"""Greatest numbers of ticks, of a network's steps, and of a scan's beams."""


class Steps(NamedTuple):
    """T ticks of missions one after the other, and S steps of the policy and M of the critic in them."""

    first_ticks: NDArray[np.int64]
    """(K,) tick at which each mission begins."""
    starts: FloatArray
    """(K, 3) start of each, a pose in the map [m, m, rad]."""
    goals: FloatArray
    """(K, 2) its goal in the map [m]."""
    scan_stamps: FloatArray
    """(T,) [s]"""
    ranges: NDArray[np.float32]
    """(T, num_beams) [m]"""
    odometry: FloatArray
    """(T, 10) stamp, pose, twist, vertical, as ``Odometry`` has them."""
    commands: FloatArray
    """(T, 3) the stack's commands [m/s, m/s, rad/s]."""
    observations: NDArray[np.float32]
    """(S, x) the policy's observations."""
    actions: FloatArray
    """(S, 3) its actions."""
    shares: FloatArray
    """(S, E) its experts' shares."""
    critic_observations: NDArray[np.float32]
    """(M, x) the critic's observations, each with a candidate as its goal."""
    values: FloatArray
    """(M,) V^h of these."""

    def missions(self) -> Iterator[tuple[Pose2, tuple[float, float], range]]:
        """Start, goal and ticks of each mission."""
        ends = [*self.first_ticks.tolist()[1:], len(self.commands)]
        for first, last, start, goal in zip(self.first_ticks.tolist(), ends, self.starts.tolist(), self.goals.tolist()):
            yield Pose2(*start), (goal[0], goal[1]), range(first, last)

    def sensed(self, tick: int) -> tuple[Scan, Odometry]:
        """Scan and odometry of a tick."""
        stamp, x, y, yaw, v_x, v_y, w_z, *up = self.odometry[tick].tolist()
        scan = Scan(float(self.scan_stamps[tick]), self.ranges[tick].astype(np.float64))
        return scan, Odometry(stamp, Pose2(x, y, yaw), Twist2(v_x, v_y, w_z), (up[0], up[1], up[2]))


_SHAPES: dict[str, tuple[Any, ...]] = {
    "first_ticks": ("K",), "starts": ("K", 3), "goals": ("K", 2), "scan_stamps": ("T",), "ranges": ("T", "B"),
    "odometry": ("T", 10), "commands": ("T", 3), "observations": ("S", "X"), "actions": ("S", 3), "shares": ("S", "E"),
    "critic_observations": ("M", "Y"), "values": ("M",),
}  # fmt: skip
_MOST = {"K": MOST_TICKS, "T": MOST_TICKS, "B": MOST_BEAMS, "S": MOST_STEPS, "M": MOST_STEPS, "X": 10_000, "Y": 10_000}
_SINGLE = ("ranges", "observations", "critic_observations")


def steps_file(steps: Steps, about: dict[str, str]) -> bytes:
    """The file of recorded steps.

    Args:
        steps: The steps.
        about: Metadata: robot, method, missions.
    """
    from safetensors.numpy import save

    kinds = {name: np.float32 if name in _SINGLE else np.float64 for name in steps._fields}
    tensors = {name: np.ascontiguousarray(array, kinds[name]) for name, array in steps._asdict().items()}
    return save(tensors, {"format": FORMAT, **about})


def read_steps(path: Path) -> Steps:
    """Read the recorded steps of a bundle.

    Raises:
        BadBundle: If the file is not one of recorded steps.
    """
    try:
        tensors, metadata = read_weights(path)
    except BadWeights as error:
        raise BadBundle(str(error)) from error
    if metadata.get("format") != FORMAT or set(tensors) != set(_SHAPES):
        raise BadBundle(
            f"{path}: format is {shown(repr(metadata.get('format')))}, expected {FORMAT!r} with its tensors"
        )
    sizes: dict[str, int] = {}
    for name, shape in _SHAPES.items():
        found = tensors[name].shape
        right = len(found) == len(shape) and all(
            size == (sizes.setdefault(axis, size) if isinstance(axis, str) else axis)
            for size, axis in zip(found, shape)
        )
        if not right:
            raise BadBundle(f"{path}: tensor {name!r} has shape {found}, expected {shape} with {sizes}")
        if name != "ranges" and not np.isfinite(tensors[name]).all():
            raise BadBundle(f"{path}: tensor {name!r} holds numbers that are not finite")
    for axis, most in _MOST.items():
        if sizes[axis] > most:
            raise BadBundle(f"{path}: {sizes[axis]} is too many, at most {most} are read")
    first = tensors["first_ticks"].astype(np.int64)
    if len(first) == 0 or first[0] != 0 or (np.diff(first) <= 0).any() or first[-1] >= sizes["T"]:
        raise BadBundle(f"{path}: tensor 'first_ticks' does not divide {sizes['T']} ticks into missions")
    return Steps(**{**tensors, "first_ticks": first})


class StepsRecorder:
    """Collects the steps of a stack as it drives."""

    def __init__(self) -> None:
        self._missions: list[tuple[int, Pose2, tuple[float, float]]] = []
        self._ticks: list[tuple[float, NDArray[np.float32], list[float], list[float]]] = []
        self.acted: list[tuple[NDArray[np.float32], list[float], list[float]]] = []
        """Observation, action and shares of each step of the policy."""
        self.rated: list[tuple[NDArray[np.float32], float]] = []
        """Observation and V^h of each step of the critic."""

    @property
    def ticks(self) -> int:
        """Number of ticks so far."""
        return len(self._ticks)

    def begin(self, start: Pose2, goal: tuple[float, float]) -> None:
        """Begin a mission."""
        self._missions.append((self.ticks, start, goal))

    def add(self, scan: Scan, odometry: Odometry, command: tuple[float, float, float]) -> None:
        """Take in a tick."""
        sensed = [odometry.stamp, *odometry.odom_from_base, *odometry.twist, *odometry.up]
        self._ticks.append((scan.stamp, scan.ranges.astype(np.float32), sensed, list(command)))

    def steps(self) -> Steps:
        """The steps so far."""
        stamps, ranges, odometry, commands = zip(*self._ticks)
        first, starts, goals = zip(*self._missions)
        observations, actions, shares = zip(*self.acted) if self.acted else ((), (), ())
        rated, values = zip(*self.rated) if self.rated else ((), ())
        return Steps(
            np.array(first), np.array(starts), np.array(goals), np.array(stamps), np.array(ranges), np.array(odometry),
            np.array(commands), _rows(observations, 0), _rows(actions, 3), _rows(shares, 0), _rows(rated, 0),
            np.array(values, np.float64),
        )  # fmt: skip


def _rows(rows: tuple[Any, ...], columns: int) -> NDArray[Any]:
    return np.array(rows) if rows else np.zeros((0, columns))


def greatest_difference(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Greatest difference of two arrays of one shape; infinite if the shapes differ or a number is not finite."""
    if a.shape != b.shape:
        return math.inf
    difference = float(np.abs(a - b).max(initial=0.0))
    return difference if math.isfinite(difference) else math.inf
