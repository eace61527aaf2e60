"""Whether a robot that has lost its place finds it again: carried away, blind, or with frozen odometry.

``python -m eval.analysis.measurements.lost --seeds 0:50 --out FILE.jsonl`` drives each mission once for each fault.
While it is under way the robot is carried off by 3 m, not through a wall, and turned by half a turn, or sees nothing
for 5 s, or its odometry stays as it is for 2 s. It is found again if, from 20 s after the end of the fault on at the
latest and until the mission ends, its estimate errs by less than 0.2 m and 5 degrees.
"""

import math
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
import tyro

from eval.analysis.measurements.files import measure
from eval.episode import Episode, EpisodeConfig
from eval.methods import BEST, is_users_own
from eval.store import Row
from eval.suites import parse_seeds
from robots.simulation import Simulation
from vuca_nav.cli import optional, run_module, show
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_file
from vuca_nav.geometry import distance, wrap_angle
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Odometry, Pose2, Scan, Twist2

KIND = "lost"
Fault = Literal["carried", "blind", "frozen"]
FAULTS: tuple[Fault, ...] = get_args(Fault)
LENGTHS: dict[Fault, float] = {"carried": 0.0, "blind": 5.0, "frozen": 2.0}
"""How long each fault lasts [s]."""
AWAY, AROUND = 3.0, math.pi
"""How far the robot is carried, and by how much it is turned [m, rad]."""
CLEAR = 0.3
"""Least clearance of the place that it is carried to [m]."""
STEP = 0.25
"""Distance of the points of the way there that must be free: nobody carries it through a wall [m]."""
DIRECTIONS = 48
"""Directions in which such a place is looked for."""
LEAST_WAY = 6.0
"""The fault comes once the robot has gone so far: from there on there is a map to be lost in [m] ..."""
LATEST = 30.0
"""... or so late, if it goes less [s]; the fault waits for the robot to move."""
MOVING = 0.25
"""Speed from which on the robot moves [m/s]."""
WITHIN = 20.0
"""Time in which it has to be found again [s]."""
NEAR, TURNED = 0.2, math.radians(5.0)
"""Error below which it is [m, rad]."""
WATCHED = 45.0
"""How long a mission is watched after the end of the fault [s]."""


class _Events(Telemetry):
    """Keeps what the stack says."""

    def __init__(self) -> None:
        self.now = 0.0
        self.events: list[tuple[float, str]] = []

    def time(self, seconds: float) -> None:
        self.now = seconds

    def event(self, text: str, level: str = "INFO") -> None:
        self.events.append((self.now, text))


class _Injector:
    """Does one fault to what a robot senses, or to the robot itself.

    Args:
        fault: The fault.
        simulation: The robot.
        rng: Chooses where it is carried.
    """

    def __init__(self, fault: Fault, simulation: Simulation, rng: np.random.Generator):
        self.fault: Fault = fault
        self._simulation, self._rng = simulation, rng
        self.began: float | None = None
        self._frozen: Odometry | None = None

    @property
    def ends(self) -> float:
        """Time at which the fault is over; ``inf`` before it has begun [s]."""
        return math.inf if self.began is None else self.began + LENGTHS[self.fault]

    def begin(self) -> None:
        """Begin now, if there is a place to be carried to."""
        if self.fault == "carried":
            place = self._place()
            if place is None:
                return
            self._simulation.carry_to(place)
        self.began = self._simulation.time

    def _place(self) -> Pose2 | None:
        """A place where the robot fits, 3 m away and turned round; None if there is none."""
        x, y, yaw = self._simulation.true_pose
        first = self._rng.uniform(0.0, 2.0 * math.pi)
        for k in self._rng.permutation(DIRECTIONS):
            angle = first + 2.0 * math.pi * int(k) / DIRECTIONS
            place = Pose2(x + AWAY * math.cos(angle), y + AWAY * math.sin(angle), wrap_angle(yaw + AROUND))
            on_the_way = (
                Pose2(x + away * math.cos(angle), y + away * math.sin(angle), yaw)
                for away in np.arange(STEP, AWAY, STEP).tolist()
            )
            is_free = self._simulation.clearance_at(place) > CLEAR
            if is_free and all(self._simulation.clearance_at(point) > 0.0 for point in on_the_way):
                return place
        return None

    def spoil(self, scan: Scan, odometry: Odometry) -> tuple[Scan, Odometry]:
        """The readings as the stack gets them."""
        if self.began is None or self._simulation.time > self.ends:
            return scan, odometry
        if self.fault == "blind":
            return Scan(scan.stamp, np.full(len(scan.ranges), np.inf)), odometry
        if self.fault == "frozen":
            if self._frozen is None:
                self._frozen = odometry
            still = replace(self._frozen, stamp=odometry.stamp, twist=Twist2(0.0, 0.0, 0.0))
            return scan, still
        return scan, odometry


def found_after(times: FloatArray, is_right: FloatArray, end: float) -> float | None:
    """Time from the end of a fault to the moment from which on the estimate stays right [s]; None if it does not.

    Args:
        times: (n,) times of the estimates [s].
        is_right: (n,) whether each is right.
        end: End of the fault [s].
    """
    after = times >= end
    times, right = times[after], np.asarray(is_right[after], np.bool_)
    if not len(right) or not right[-1]:
        return None
    wrong = np.flatnonzero(np.logical_not(right))
    return float(times[wrong[-1] + 1] - end) if len(wrong) else 0.0


def lost_in(config: EpisodeConfig, fault: Fault) -> Row:
    """Drive a mission with one fault.

    Returns:
        ``began``: time of the fault; ``found_after`` its end [s], None if it was not found, or not kept; ``outcome``
        of the mission, "watched" if it went on; ``contact``: what it touched, after which it goes on;
        ``error_before`` and ``error_at_end``: the greatest before the fault, and the last one [m]; ``events``.
    """
    events = _Events()
    episode = Episode(config)
    simulation, navigator, scan, odometry = episode.begin(events)
    injector = _Injector(fault, simulation, np.random.default_rng((config.seed, FAULTS.index(fault))))
    times, right, off = [], [], []
    way, before = 0.0, simulation.true_pose
    outcome: str | None = None
    while outcome is None:
        command = navigator.step(*injector.spoil(scan, odometry))
        estimate, truth = navigator.map_from_base, simulation.true_pose
        away, turned = distance(estimate, truth), abs(wrap_angle(estimate.yaw - truth.yaw))
        times.append(simulation.time)
        right.append(away < NEAR and turned < TURNED)
        off.append(away)
        scan, odometry = simulation.step(command)
        step = distance(simulation.true_pose, before)
        way, before = way + step, simulation.true_pose
        is_due = way > LEAST_WAY or simulation.time > LATEST
        if injector.began is None and is_due and step * simulation.rate > MOVING:
            injector.begin()
            before = simulation.true_pose
        outcome = episode.judge(simulation)
        if outcome == "collision":  # what is measured is where it thinks that it is
            outcome = "fall" if simulation.fallen else None
        if outcome is None and simulation.time > injector.ends + WATCHED:
            outcome = "watched"
    end = injector.ends
    of_before = [error for time, error in zip(times, off) if injector.began is None or time <= injector.began]
    return {
        "began": injector.began,
        "found_after": found_after(np.array(times), np.array(right), end),
        "watched": max(times[-1] - end, 0.0) if math.isfinite(end) else 0.0,
        "outcome": outcome,
        "contact": simulation.contact,
        "error_before": round(max(of_before), 3),
        "error_at_end": round(off[-1], 3),
        "events": [[round(time, 2), text] for time, text in events.events if injector.began and time >= injector.began],
    }


def lost_of(config: EpisodeConfig, *, faults: Sequence[Fault] = FAULTS) -> Row:
    """Drive a mission once for each fault: the episode's own fields, and ``faults`` as ``lost_in`` gives them."""
    return {**config.row(), "faults": {fault: lost_in(config, fault) for fault in faults}}


def table(rows: Sequence[Row]) -> str:
    """How many were found again, fault by fault."""
    lines = [f"{'fault':10}{'missions':>9}{'found again':>13}{'median':>9}{'slowest':>9}  not found, by seed"]
    for fault in FAULTS:
        results = [(row["seed"], row["faults"][fault]) for row in rows if fault in row["faults"]]
        counted = [(seed, one) for seed, one in results if one["began"] is not None and one["watched"] > 0.0]
        if not counted:
            continue
        found = sorted(one["found_after"] for _, one in counted if is_found(one))
        missed = ", ".join(str(seed) for seed, one in counted if not is_found(one))
        median, slowest = (f"{found[len(found) // 2]:.1f} s", f"{found[-1]:.1f} s") if found else ("-", "-")
        lines.append(f"{fault:10}{len(counted):9}{len(found):13}{median:>9}{slowest:>9}  {missed or '-'}")
    return "\n".join(lines)


def is_found(result: dict[str, Any]) -> bool:
    """Whether the robot was found again in time."""
    return result["found_after"] is not None and result["found_after"] <= WITHIN


@dataclass(frozen=True, kw_only=True)
class LostArguments:
    """Take a robot's place from it in many missions, and count how often it finds it again.

    Each mission is driven once for each fault: the robot is carried off by 3 m and turned by half a turn; it gets scans
    without a return for 5 s; its odometry stays as it is for 2 s. Found again means an error below 0.2 m and 5 degrees
    within 20 s, kept to the end.
    """

    seeds: str
    """The missions' seeds, A:B for A to B - 1."""
    out: Path
    """The file of measurements, as runs/lost-tiago.jsonl; begun again, it goes on where it was."""
    method: str = BEST
    """A method's name (see vuca list methods)."""
    robot: str = "tiago"
    """A robot's name (see vuca list robots)."""
    world: str = "factory"
    """A world's name (see vuca list worlds), or a scene file ending in .yaml."""
    region: Annotated[int | None, tyro.conf.arg(metavar="K", help_behavior_hint="4 in the factory")] = None
    """Number of quarters of the factory."""
    without: str = ""
    """Difficulties left out: V moving obstacles, U the map unknown, C corridors, A noise of the sensors."""
    fault: tuple[Fault, ...] = FAULTS
    """The faults."""
    workers: Annotated[int | None, optional("W")] = None
    """Number of processes; by default one for each core."""


def main(arguments: LostArguments) -> None:
    """Drive, spoil, and write.

    Raises:
        VucaError: The missions cannot be run, or the file cannot be written or gone on with.
    """
    seeds = parse_seeds(arguments.seeds)
    region = 4 if arguments.region is None and arguments.world == "factory" else arguments.region
    config = EpisodeConfig(arguments.world, region, arguments.robot, arguments.method, without=arguments.without)
    if is_users_own(config.method):
        raise BadArgument(
            "a method of your own runs Python code, which this measurement does not; take one by its name"
        )
    prepare_file(arguments.out)
    configs = [replace(config, seed=seed) for seed in seeds]
    command = shlex.join(["python", "-m", "eval.analysis.measurements.lost", *sys.argv[1:]])
    job = partial(lost_of, faults=arguments.fault)
    settings = {"faults": list(arguments.fault), "away": AWAY, "within": WITHIN, "watched": WATCHED}
    rows, crashes = measure(
        arguments.out, KIND, configs, job, workers=arguments.workers, command=command, settings=settings
    )
    show(table(rows))
    if crashes:
        raise BadArgument(f"{len(crashes)} missions could not be run; give the same command again")


if __name__ == "__main__":
    run_module("lost", main, LostArguments)
