"""Files of measurements, which ``vuca report`` takes beside the directories of evaluations.

A file holds lines of JSON. The first says what was measured and by what: ``measurement``, ``made_by`` (code, libraries,
the machine's arithmetic, or the weights) and ``runs`` (each command with its machine and commit). Each further line is
a row. A file may be kept compressed, like rows of episodes.
"""

import json
import lzma
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from eval.checked import COUNT, NUMBER, NUMBERS, ROW_KINDS, RUN_KINDS, TEXT, Kind, check_values
from eval.episode import EpisodeConfig
from eval.evaluate import pause_of_progress
from eval.kept import MOST_BYTES, SUFFIX, told_command, unpacked
from eval.methods import identity_of, resolve
from eval.provenance import bits_of, driver_of, made_with, provenance
from eval.runner import Crash, RunEpisode, key_of, run_episodes
from eval.store import Row, append_row
from vuca_nav.data_files import parse_json, read_text, shown
from vuca_nav.errors import BadArgument
from vuca_nav.files import DirectoryLock, prepare_file, write_whole
from vuca_nav.provenance import machine

PLAIN_SUFFIX = ".jsonl"


class Measurement(NamedTuple):
    """A file of measurements."""

    kind: str
    """What was measured, a name of ``KINDS``."""
    source: Path
    made_by: Row
    """What decides on the bits of the rows: code, libraries, the machine's arithmetic, noise; or the weights."""
    runs: list[Row]
    """Each run of the command: ``began``, ``command``, ``machine``, ``commit``."""
    rows: list[Row]

    @property
    def name(self) -> str:
        """Name of the file, without its suffix."""
        return self.source.name.removesuffix(SUFFIX).removesuffix(PLAIN_SUFFIX)

    @property
    def file(self) -> str:
        """Name of the file as a command makes it."""
        return f"{self.name}{PLAIN_SUFFIX}"


class Fields(NamedTuple):
    """The rows of a kind of measurement."""

    kinds: Mapping[str, Kind]
    needed: tuple[str, ...]
    """Fields without which a row is none."""


def list_of(kind: Kind) -> Kind:
    """The kind of lists of such values."""
    return Kind(f"a list, each {kind.right}", lambda value: isinstance(value, list) and all(map(kind.test, value)))


def _is_moment(value: Any) -> bool:
    named = ("time", "places", "correlation", "at_same_distance")
    return isinstance(value, dict) and all(NUMBER.or_none().test(value.get(name, "")) for name in named)


def _numbers(value: Any, count: int) -> bool:
    return NUMBERS.test(value) and len(value) == count


def _lists(value: Any, count: int) -> bool:
    return isinstance(value, list) and all(_numbers(each, count) for each in value)


def _is_scene(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and _lists(value.get("boxes"), 5)
        and _lists(value.get("cylinders"), 3)
        and all(_numbers(value.get(name), count) for name, count in (("bounds", 4), ("start", 2), ("goal", 2)))
    )


def _is_view(value: Any) -> bool:
    return (
        isinstance(value, dict)
        and isinstance(value.get("levels"), str)
        and NUMBER.test(value.get("half_side"))
        and _lists(value.get("movers"), 3)
        and _is_scene(value.get("scene"))
        and all(_numbers(value.get(name), count) for name, count in (("pose", 3), ("scale", 2)))
    )


def _is_path(value: Any) -> bool:
    return _lists(value, 2) and len(value) > 0


def _is_situations(value: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(each, dict) and COUNT.test(each.get("decisions")) and all(
            NUMBERS.test(each.get(name)) and len(each[name]) == len(value[next(iter(value))][name])
            for name in ("leads", "shares")
        )
        for each in value.values()
    )  # fmt: skip


def _is_faults(value: Any) -> bool:
    times = ("began", "found_after")
    return isinstance(value, dict) and all(
        isinstance(each, dict)
        and NUMBER.test(each.get("watched"))
        and all(NUMBER.or_none().test(each.get(name, "")) for name in times)
        for each in value.values()
    )


_EPISODE = ("world", "region", "without", "movers", "speed", "sighted", "start", "goal", "robot", "method", "seed")
KINDS: Mapping[str, Fields] = {
    "moments": Fields({**ROW_KINDS, "t_inevitable": NUMBER.or_none()}, (*_EPISODE, "contact", "t_inevitable")),
    "heatmap": Fields(
        {**ROW_KINDS, "moments": list_of(Kind("a moment", _is_moment)), "view": Kind("a view", _is_view).or_none()},
        (*_EPISODE, "moments", "view"),
    ),
    "courses": Fields(
        {
            **ROW_KINDS,
            "path": Kind("a list of places", _is_path),
            "expert_shares": list_of(NUMBERS).or_none(),
            "period": NUMBER,
            "scene": Kind("a scene", _is_scene),
        },
        (*_EPISODE, "outcome", "path", "expert_shares", "period", "scene"),
    ),
    "lost": Fields({**ROW_KINDS, "faults": Kind("results by fault", _is_faults)}, (*_EPISODE, "faults")),
    "gate": Fields(
        {"policy": TEXT, "kind": TEXT, "seed": COUNT, "situations": Kind("counts by situation", _is_situations)},
        ("policy", "kind", "seed", "situations"),
    ),
}
"""The kinds of measurements there are."""


def is_measurement(source: Path) -> bool:
    """Whether a source of a report is a file of measurements, by its first line."""
    if source.is_dir() or not source.name.endswith((PLAIN_SUFFIX, SUFFIX)):
        return False
    lines = _lines(source)
    return bool(lines) and lines[0].startswith('{"measurement":')


def read_measurement(source: Path) -> Measurement:
    """Read a file of measurements, kept or plain; a torn last line is left out.

    Raises:
        BadArgument: It is none, or a row is not as its kind of measurement has them.
    """
    wrong = f"{source} is not a file of measurements"
    lines = _lines(source)
    head = parse_json(lines[0], wrong, BadArgument) if lines else None
    if not isinstance(head, dict) or head.get("measurement") not in KINDS:
        raise BadArgument(f"{wrong}: its first line names none of {', '.join(KINDS)}")
    made_by, runs = head.get("made_by"), head.get("runs")
    if not (isinstance(made_by, dict) and isinstance(runs, list)):
        raise BadArgument(f"{wrong}: its first line does not say what made it")
    for run in runs:
        check_values(run, RUN_KINDS, f"{wrong}: a run")
    fields = KINDS[head["measurement"]]
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        row = parse_json(line, f"{source}: line {number}", BadArgument)
        check_values(row, fields.kinds, f"{source}: line {number}")
        missing = [name for name in fields.needed if name not in row]
        if missing:
            raise BadArgument(f"{source}: line {number}: {', '.join(missing)} missing")
        rows.append(row)
    return Measurement(head["measurement"], source, made_by, runs, rows)


def keep_measurements(sources: Sequence[Path], out: Path) -> list[Path]:
    """Write files of measurements compressed, over those of the same names; the same rows give the same bytes.

    Args:
        sources: Files of measurements; others are left out.
        out: Directory that exists.

    Returns:
        The files that were written.
    """
    written = []
    for source in filter(is_measurement, sources):
        measurement = read_measurement(source)
        runs = [{**run, "command": told_command(measurement.file, run)} for run in measurement.runs]
        lines = "".join(f"{json.dumps(row, allow_nan=False)}\n" for row in measurement.rows)
        written.append(out / f"{measurement.name}{SUFFIX}")
        text = head_line(measurement.kind, measurement.made_by, runs) + lines
        write_whole(written[-1], lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))
    return written


def _lines(source: Path) -> list[str]:
    if source.name.endswith(SUFFIX):
        return unpacked(source)
    text = read_text(source, BadArgument, MOST_BYTES)
    return text[: text.rfind("\n") + 1].splitlines()


def head_line(kind: str, made_by: Row, runs: Sequence[Row]) -> str:
    """The first line of a file."""
    return json.dumps({"measurement": kind, "made_by": made_by, "runs": list(runs)}, allow_nan=False) + "\n"


def run_of(command: str) -> Row:
    """A run of a command that measures, as the first line notes it."""
    began = datetime.now(UTC).isoformat(timespec="seconds")
    return {"began": began, "command": command, "machine": machine(), **made_with()}


def measure(
    path: Path,
    kind: str,
    configs: Sequence[EpisodeConfig],
    job: RunEpisode,
    *,
    workers: int | None = None,
    command: str = "",
    finish: Callable[[Row], Row] = dict,
    settings: Row | None = None,
) -> tuple[list[Row], list[Crash]]:
    """Measure the episodes that a file does not hold yet; begun again, it goes on where it was.

    Args:
        path: The file, which is made if it is not there.
        kind: Name of the measurement.
        configs: The episodes.
        job: Measures one episode in a worker; must be importable.
        workers: Number of processes; None for one a core.
        command: The command as typed, noted with the machine if there is something to measure.
        finish: Completes a row of ``job``.
        settings: What else decides on the rows; another one cannot go on with the file.

    Returns:
        The rows of these episodes, in their order, and the episodes that could not be run.

    Raises:
        VucaError: The file is another measurement's or was begun by other code, is being written, or cannot be written.
    """
    made_by = provenance(configs)
    drivers = {driver_of(config): config for config in configs}
    hashes = {
        name: bits_of(made_by, name, identity_of(resolve(config.method, config.options)))
        for name, config in drivers.items()
    }
    keys = {key_of(config.row()): hashes[driver_of(config)] for config in configs}
    common = json.loads(json.dumps({**made_by, "settings": settings or {}}))  # a row's bits have its method's settings
    prepare_file(path)
    lock = DirectoryLock(path, "command") if path.exists() else None
    try:
        stored = _begun(path, kind, common)
        known = {(key_of(row), row.get("bits")): row for row in stored.rows}
        todo = [config for config in configs if (key := key_of(config.row()), keys[key]) not in known]
        if todo:
            lines = "".join(f"{json.dumps(row, allow_nan=False)}\n" for row in stored.rows)
            write_whole(path, head_line(kind, common, [*stored.runs, run_of(command)]) + lines)
            before, lock = lock, DirectoryLock(path, "command")  # it is another file of this name now
            if before is not None:
                before.release()
        crashes: list[Crash] = []
        pause, there = pause_of_progress(), len(configs) - len(todo)
        with (
            open(path, "ab", buffering=0) as file,
            tqdm(total=len(configs), initial=there, unit="episode", file=sys.stderr, mininterval=pause) as bar,
        ):
            for result in run_episodes(todo, workers, job) if todo else ():
                if isinstance(result, Crash):
                    crashes.append(result)
                    bar.write(f"crashed: {result.config}\n{result.trace}", file=sys.stderr)
                else:
                    key = key_of(result)
                    known[key, keys[key]] = {**finish(result), "bits": keys[key]}
                    append_row(file, path, known[key, keys[key]], len(known) - 1)
                bar.update()
    finally:
        if lock is not None:
            lock.release()
    return [known[key] for key in keys.items() if key in known], crashes


def _begun(path: Path, kind: str, made_by: Row) -> Measurement:
    """What a file holds already, if it is of the same measurement and of the same code."""
    if not path.exists():
        return Measurement(kind, path, made_by, [], [])
    stored = read_measurement(path)
    if stored.kind != kind:
        raise BadArgument(f"{path} holds another measurement, {shown(stored.kind)}; choose another --out")
    different = [name for name in made_by if stored.made_by.get(name) != made_by[name]]
    if different:
        raise BadArgument(
            f"{path} was begun with other {', '.join(different)}; go on with the same code on the same kind of "
            "machine, or choose another --out"
        )
    return stored
