"""The command ``vuca slam``."""

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TextIO

import tyro

from vuca_nav.cli import optional, parse, show
from vuca_nav.files import prepare_directory
from vuca_nav.provenance import commit, machine
from vuca_nav.telemetry.options import ViewArguments


@dataclass(frozen=True, kw_only=True)
class SlamArguments(ViewArguments):
    """Run SLAM over a recorded log: map, trajectory, and the errors of the relations that are known to be true."""

    log: tyro.conf.Positional[Path]
    """The log: CARMEN (.clf, .log, also .gz; lines ROBOTLASER1 or FLASER), or an MCAP recording (.mcap, or the
    directory of a rosbag2) with LaserScan and Odometry or tf."""
    relations: Annotated[Path | None, optional("FILE")] = None
    """True displacements between moments of the log, a line each: t1 t2 x y z roll pitch yaw (Kuemmerle et al.
    2009)."""
    out: Annotated[Path | None, optional("DIR")] = None
    """Directory for map.yaml, map.pgm, map.png, trajectory.tum (the final graph) and online.tum (as it was known at
    each moment). If left out, none of them is written."""
    save_map: Annotated[Path | None, optional("FILE.yaml|DIR")] = None
    """Write the map alone, as vuca run does: FILE.yaml, or DIR/map.yaml, with a PGM and a PNG beside it."""
    json: bool = False
    """Print one JSON object as the last line."""


def slam(argv: list[str]) -> int:
    """Run SLAM over a recorded log: map, trajectory, relation errors."""
    arguments = parse(SlamArguments, "slam", argv)
    arguments.check_view()
    from vuca_nav.mapping.map_file import prepare_map
    from vuca_nav.slam_log.mapping_run import run_log
    from vuca_nav.slam_log.reading import read_log
    from vuca_nav.slam_log.relations import read_relations
    from vuca_nav.slam_log.results import summary, table, write_maps, write_trajectories

    relations = None if arguments.relations is None else read_relations(arguments.relations)
    maps = [] if arguments.save_map is None else [prepare_map(arguments.save_map)]
    if arguments.out is not None:
        prepare_directory(arguments.out)
        maps.append(arguments.out / "map.yaml")
    log = read_log(arguments.log)
    made_by = {"commit": commit(), "machine": machine()}
    telemetry = arguments.open_view(f"SLAM over {arguments.log}")
    try:
        if telemetry is not None:
            telemetry.made_by(made_by)
        with ScanProgress(sys.stderr) as progress:
            result = run_log(log, progress=progress, telemetry=telemetry)
        facts = summary(log, result, relations)
        show(table(facts))
        left_out = write_maps(maps, result.slam) if maps else 0
        if left_out:
            print(f"vuca slam: {left_out} keyframes lie beyond the greatest size of a map", file=sys.stderr)
        if arguments.out is not None:
            write_trajectories(arguments.out, log, result)
            print(f"map and trajectory: {arguments.out}", file=sys.stderr)
        if arguments.save_map is not None:
            print(f"map: {maps[0]}", file=sys.stderr)
        if arguments.json:
            show(json.dumps({**facts, "made_by": made_by}))
        if telemetry is not None:
            telemetry.wait()
    finally:
        if telemetry is not None:
            telemetry.close()
    return 0


class ScanProgress:
    """A line of scans done and time left. Use it as a context manager.

    Args:
        stream: Stream to write to; on a terminal the line is rewritten in place.
    """

    def __init__(self, stream: TextIO):
        self._stream, self._in_place = stream, stream.isatty()
        self._interval = 0.2 if self._in_place else 10.0
        self._began = self._last = time.perf_counter()

    def __enter__(self) -> "ScanProgress":
        """Start the clock."""
        self._began = self._last = time.perf_counter()
        return self

    def __call__(self, done: int, total: int) -> None:
        """Write the line if it is due."""
        now = time.perf_counter()
        if done == 1:  # what came before was no scan: kernels were loaded
            self._began = self._last = now
        if now - self._last < self._interval and done < total:
            return
        self._last = now
        left = (now - self._began) / done * (total - done)
        line = f"{done:6d} of {total} scans  {100.0 * done / total:3.0f}%  {left:5.0f} s left"
        self._stream.write(f"\r{line}" if self._in_place else f"{line}\n")
        self._stream.flush()

    def __exit__(self, *_: object) -> None:
        """End the terminal's line."""
        if self._in_place:
            self._stream.write("\n")
