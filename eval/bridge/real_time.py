"""``python -m eval.bridge.real_time``: vuca deploy and vuca bridge as two processes in real time.

Outcomes stand beside those of the same missions in one process, timing beside that of an idle loop in the same minutes.
"""

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.analysis.report.tables import Column, Share, Table, Value, markdown
from eval.analysis.statistics import Estimate, mcnemar_exact, paired_difference
from eval.bridge.processes import SIMULATED_CLOCK, IdleLoop
from eval.bridge.remote_stack import TICK_RATE, RealTime, RemoteStack
from eval.bridge.session import BridgedEpisode
from eval.bridge.trials import (
    Deployed,
    Driven,
    TrialArguments,
    cells_of,
    drive_alone,
    drive_over_the_wire,
    driven_in,
)
from eval.episode import EpisodeConfig
from eval.kept import MOST_BYTES
from eval.progress import ProgressLine
from eval.store import Row
from vuca_nav.cli import run_module, show
from vuca_nav.data_files import parse_json, read_text
from vuca_nav.errors import BadArgument
from vuca_nav.files import write_whole

SETTINGS = {"real_time_factor": 1.0}
"""What the rows depend on beside the missions."""
NOTE = (
    "Missions of vuca deploy and vuca bridge as two processes in real time, and the same in one process, which waits "
    "for each command: outcomes differ by timing alone, as a command a tick later is another mission. The difference "
    "of arrivals is real time less one process, with Agresti and Min's 95% interval; p is McNemar's exact test. "
    "Latency: from a scan's publication to its command's, at most 3 ms in the median and 15 ms at the 99.9th "
    "percentile. Jitter: deviation of the time between two commands from 1/30 s, beside that of an idle loop of 30 Hz "
    "in the same minutes, at most 5 ms above it; without the first second of a mission, in which the robot stands, and "
    "before which the simulated clock does. Late ticks are those of the simulator, which delay all that follows. "
    "Load: the machine's load average at the end of a mission."
)
COLUMNS = (
    Column("robot, task"),
    Column("missions"),
    Column("arrived, real time"),
    Column("arrived, one process"),
    Column("difference", signed=True),
    Column("only real time"),
    Column("only one process"),
    Column("p", 3),
    Column("latency, median [ms]"),
    Column("latency, 99.9th percentile [ms]"),
    Column("jitter, 99.9th percentile [ms]"),
    Column("idle loop's [ms]"),
    Column("late ticks [%]"),
    Column("load, median", 1),
)
STANDING = 30
"""Commands of the first second of a mission: the first ones come every 0.1 s, as the simulated clock stands."""
TIMES = ("latencies", "periods", "idle")
TIMING = "timing.jsonl"
"""File of the times in the directory of a cell, a line for each mission."""


@dataclass(frozen=True, kw_only=True)
class RealTimeArguments(TrialArguments):
    """Which missions are driven."""

    seeds: str = "0:10"
    """The seeds A to B - 1."""


class TimedDrive:
    """Drives missions over the wire, and keeps their times.

    Args:
        pace: The pace, which takes the times.
        idle: A loop that does nothing, at the same time.
        path: File of the times, a line a mission.
    """

    def __init__(self, pace: RealTime, idle: IdleLoop, path: Path):
        self._pace, self._idle, self._path = pace, idle, path

    def __call__(self, config: EpisodeConfig, stack: RemoteStack) -> Row:
        """The row of one mission."""
        pace = self._pace
        self._idle.take()
        pace.latencies.clear()
        pace.periods.clear()
        late = pace.overruns
        with ProgressLine(sys.stderr) as progress:
            row = BridgedEpisode(config, stack).run(progress=progress).row()
        times = {"latencies": list(pace.latencies), "periods": list(pace.periods), "idle": self._idle.take()}
        line = {"seed": config.seed, "late": pace.overruns - late, "load": os.getloadavg()[0], **times}
        with self._path.open("a") as file:
            file.write(f"{json.dumps(line)}\n")
        return row


def run(arguments: RealTimeArguments) -> None:
    """Drive all missions both ways, and measure."""
    found = []
    for cell in cells_of(arguments):
        drive_alone(cell, arguments)
        pace = RealTime()
        deployed = Deployed(cell, arguments, SIMULATED_CLOCK, pace)
        with IdleLoop(TICK_RATE) as idle:
            drive = TimedDrive(pace, idle, arguments.out / cell.name / TIMING)
            drive_over_the_wire(cell, arguments, deployed, SETTINGS, drive)
        found.append(driven_in(arguments.out / cell.name))
    text = "\n".join(markdown(table_of([driven for driven in found if driven is not None])))
    write_whole(arguments.out / "real_time.md", f"{text}\n")
    show(text)


def table_of(found: Sequence[Driven]) -> Table:
    """The table of cells: outcomes both ways, and times.

    Raises:
        BadArgument: The times of a cell are missing or no times.
    """
    return Table("real_time", "Real time over the wire", NOTE, COLUMNS, [_line(driven) for driven in found])


def jitter(periods: list[float]) -> np.ndarray:
    """Deviations of periods from that of the ticks [s]."""
    return np.abs(np.array(periods) - 1.0 / TICK_RATE)


def _line(driven: Driven) -> list[Value]:
    """The cell's line of the table."""
    timings, (wire, alone) = _timings(driven.directory / TIMING), driven.arrived()
    latencies, idle = ([t for each in timings for t in each[name]] for name in ("latencies", "idle"))
    periods = [t for each in timings for t in each["periods"][STANDING:]]
    late = sum(each["late"] for each in timings) / sum(row["steps"] for row in driven.wire)
    loads = [each["load"] for each in timings if "load" in each]
    return [
        driven.name,
        driven.missions,
        *(Share(int(arrived.sum()), len(arrived)) for arrived in (wire, alone)),
        Estimate(*paired_difference(alone, wire)),
        int((wire & ~alone).sum()),
        int((alone & ~wire).sum()),
        mcnemar_exact(alone, wire),
        *(1e3 * float(np.quantile(latencies, q)) for q in (0.5, 0.999)),
        *(1e3 * float(np.quantile(jitter(values), 0.999)) if values else None for values in (periods, idle)),
        100.0 * late,
        float(np.median(loads)) if loads else None,
    ]


def _timings(path: Path) -> list[Row]:
    """The times of a cell's missions."""
    wrong = f"{path} is not the times of missions"
    found = [parse_json(line, wrong, BadArgument) for line in read_text(path, BadArgument, MOST_BYTES).splitlines()]
    if not all(isinstance(each, dict) and {*TIMES, "late"} <= each.keys() for each in found):
        raise BadArgument(wrong)
    return found


if __name__ == "__main__":
    run_module("real_time", run, RealTimeArguments)
