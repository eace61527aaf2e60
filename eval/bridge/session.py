"""Missions over the wire, one after the other, judged and kept as those of ``vuca eval``."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from eval.bridge.remote_stack import Lockstep, Pace, PaceConfig, RealTime, RemoteStack, StackSilent
from eval.bridge.robot_wire import RobotWire
from eval.episode import Episode, EpisodeConfig
from eval.evaluate import Evaluation, evaluate
from eval.methods import BEST, UNCHANGED
from eval.provenance import common, driver_of
from eval.runner import Crash, RunEpisode
from eval.store import Row
from eval.suites import Task
from robots.simulation import Simulation
from vuca_nav.stack import Stack
from vuca_nav.telemetry.interface import Telemetry

FindStack = Callable[[], AbstractContextManager[RemoteStack]]
"""Finds the stack on the other side of the wire, and lets it go at the end."""
Drive = Callable[[EpisodeConfig, RemoteStack], Row]
"""Runs one mission."""
_LOOK = 0.1
"""Time between two looks for a stack [s]."""


class BridgedEpisode(Episode):
    """An episode that a stack on the other side of the wire drives.

    Args:
        config: The episode; its method is a name and no more.
        stack: The other side.

    Raises:
        VucaError: The configuration cannot be used.
    """

    def __init__(self, config: EpisodeConfig, stack: Stack):
        super().__init__(replace(config, method=BEST, options=UNCHANGED))  # which is not built
        self.config, self._stack = config, stack

    def build(self, telemetry: Telemetry) -> tuple[Simulation, Stack]:
        """The simulation, and the other side of the wire."""
        return self.simulation(telemetry), self._stack


def make_pace(config: PaceConfig) -> Pace:
    """The pace that a configuration asks for."""
    return Lockstep(config.timeout) if config.lockstep else RealTime(config.factor)


def wait_for_stack(wire: RobotWire, timeout: float, check: Callable[[], None] = lambda: None) -> None:
    """Wait until a stack has found the robot.

    Args:
        wire: The robot's topics.
        timeout: Longest wait [s].
        check: Called while waiting; raises if waiting is in vain.

    Raises:
        StackSilent: If none does in time.
    """
    deadline = time.monotonic() + timeout
    told = False
    while missing := wire.missing():
        if time.monotonic() > deadline:
            raise StackSilent(
                f"no stack has found the robot within {timeout:g} s: {', '.join(missing)}; start it in the same ROS "
                "domain (ROS_DOMAIN_ID) and on the same network interface, or wait longer by --timeout"
            )
        if not told:
            print("waiting for a stack ...", file=sys.stderr)
            told = True
        check()
        time.sleep(_LOOK)


def drive(config: EpisodeConfig, stack: RemoteStack) -> Row:
    """The row of one mission over the wire."""
    return BridgedEpisode(config, stack).run().row()


def drive_all(
    configs: Sequence[EpisodeConfig],
    find_stack: FindStack,
    out: Path,
    command: str,
    settings: Row,
    drive: Drive = drive,
) -> Evaluation:
    """Run missions into a directory; run again, it goes on where it was.

    Args:
        configs: The missions, all of one robot and method.
        find_stack: Finds the other side of the wire; entered if there is a mission to run.
        out: The directory.
        command: The command as typed.
        settings: What the rows depend on beside the missions, for ``config.json``.
        drive: Runs one mission.

    Raises:
        VucaError: The directory cannot be used, or the stack does not answer: the rows before are kept.
    """

    def run(todo: Sequence[EpisodeConfig], _workers: int | None, _job: RunEpisode) -> Iterator[Row | Crash]:
        with find_stack() as stack:
            for config in todo:
                yield drive(config, stack)

    first, driver = configs[0], driver_of(configs[0])
    seeds = [config.seed for config in configs]
    identity: dict[str, Any] = {
        "suite": "bridge",
        "robots": [first.robot],
        "methods": [first.method],
        "configurations": {first.method: settings},
        "seeds": [seeds[0], seeds[-1] + 1],
        "episodes": len(configs),
        "tasks": [asdict(task_of(first))],
    }
    made_by = {**common(), "settings": {driver: settings}}
    return evaluate(identity, configs, out, workers=1, command=command, run=run, made_by=made_by)


def task_of(config: EpisodeConfig) -> Task:
    """The place and the difficulties of an episode."""
    return Task(**{field.name: getattr(config, field.name) for field in fields(Task)})
