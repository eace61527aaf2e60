"""``python -m eval.bridge.real_time``: vuca deploy and vuca bridge as two processes in real time.

Outcomes stand beside those of the same missions in one process, timing beside that of an idle loop in the same minutes.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.analysis.report.tables import Column, Table, Value, markdown
from eval.analysis.statistics import mcnemar_exact
from eval.bridge.processes import SIMULATED_CLOCK, IdleLoop
from eval.bridge.remote_stack import TICK_RATE, RealTime, RemoteStack
from eval.bridge.session import BridgedEpisode
from eval.bridge.trials import Cell, Deployed, TrialArguments, cells_of, drive_alone, drive_over_the_wire
from eval.episode import EpisodeConfig
from eval.progress import ProgressLine
from eval.store import Row
from vuca_nav.cli import run_module, show
from vuca_nav.files import write_whole

NOTE = (
    "Missions of vuca deploy and vuca bridge as two processes in real time, and the same in one process, which waits "
    "for each command. p is McNemar's exact test of arrivals. Latency: from a scan's publication to its command's. "
    "Jitter: deviation of the time between two commands from 1/30 s, beside that of an idle loop of 30 Hz in the same "
    "minutes. Late ticks are those of the simulator, which delay all that follows."
)
COLUMNS = (
    Column("robot, task"),
    Column("missions"),
    Column("arrived, real time"),
    Column("arrived, one process"),
    Column("p", 3),
    Column("latency, median [ms]"),
    Column("latency, 99.9th percentile [ms]"),
    Column("jitter, 99.9th percentile [ms]"),
    Column("idle loop's [ms]"),
    Column("late ticks [%]"),
)


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
        with self._path.open("a") as file:
            file.write(f"{json.dumps({'seed': config.seed, 'late': pace.overruns - late, **times})}\n")
        return row


def run(arguments: RealTimeArguments) -> None:
    """Drive all missions both ways, and measure."""
    lines = []
    for cell in cells_of(arguments):
        alone = drive_alone(cell, arguments)
        timings, pace = arguments.out / cell.name / "timing.jsonl", RealTime()
        deployed = Deployed(cell, arguments, SIMULATED_CLOCK, pace)
        with IdleLoop(TICK_RATE) as idle:
            drive = TimedDrive(pace, idle, timings)
            wire = drive_over_the_wire(cell, arguments, deployed, {"real_time_factor": 1.0}, drive)
        lines.append(_line(cell, wire, alone, timings))
    text = "\n".join(markdown(Table("real_time", "Real time over the wire", NOTE, COLUMNS, lines)))
    write_whole(arguments.out / "real_time.md", f"{text}\n")
    show(text)


def jitter(periods: list[float]) -> np.ndarray:
    """Deviations of periods from that of the ticks [s]."""
    return np.abs(np.array(periods) - 1.0 / TICK_RATE)


def _line(cell: Cell, wire: list[Row], alone: list[Row], timings: Path) -> list[Value]:
    """The cell's line of the table."""
    found = [json.loads(line) for line in timings.read_text().splitlines()]
    latencies, periods, idle = ([t for each in found for t in each[name]] for name in ("latencies", "periods", "idle"))
    first, second = (np.array([row["outcome"] == "success" for row in rows]) for rows in (alone, wire))
    late = sum(each["late"] for each in found) / sum(row["steps"] for row in wire)
    return [
        cell.name,
        len(wire),
        int(second.sum()),
        int(first.sum()),
        mcnemar_exact(first, second),
        *(1e3 * float(np.quantile(latencies, q)) for q in (0.5, 0.999)),
        *(1e3 * float(np.quantile(jitter(values), 0.999)) for values in (periods, idle)),
        100.0 * late,
    ]


if __name__ == "__main__":
    run_module("real_time", run, RealTimeArguments)
