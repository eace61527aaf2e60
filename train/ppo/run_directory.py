"""The directory of a training run: what it was begun with, its log, its checkpoint. It survives a kill."""

import io
import json
from collections.abc import Sequence
from pathlib import Path

import torch

from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole
from vuca_nav.provenance import commit

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
CONFIG = "config.json"
NOTES = ("commits", "stage.about")
"""What ``config.json`` tells beside that which a run depends on."""
NOT_KNOWN = "not known"
"""In place of a commit, of a run that began before commits were noted, or away from a checkout."""


def open_run(out: Path, contract: dict, *, resume: bool) -> None:
    """Make a run's directory, or see that the run in it is the same.

    Args:
        out: The directory.
        contract: What a run depends on, as JSON holds it; kept in ``config.json``.
        resume: Go on with what is in ``out``, if anything is.

    Raises:
        BadArgument: If ``out`` holds a run and it shall not be resumed, or one of another contract, or cannot be
            written.
    """
    prepare_directory(out)
    config = out / CONFIG
    if not (out / CHECKPOINT).exists():
        write_whole(config, json.dumps(contract, indent=2) + "\n")
        return
    if not resume:
        raise BadArgument(f"{out} holds a training run; go on with it by --resume, or give another --out")
    try:
        begun = json.loads(config.read_text())
    except (OSError, ValueError) as error:
        raise BadArgument(f"{config} cannot be read: {error}; give another --out") from error
    if not isinstance(begun, dict):
        raise BadArgument(f"{config} is not the configuration of a run, which is a JSON object; give another --out")
    differing = [place for place in _differences(begun, contract) if place not in NOTES]
    if differing:
        raise BadArgument(f"{out} holds a run that differs in {', '.join(differing)}; give another --out")


def note_commit(out: Path) -> None:
    """Note that a run goes on from here at the present commit."""
    config = json.loads((out / CONFIG).read_text())
    begun = read_commits(out) if (out / CHECKPOINT).exists() else []
    now = commit() or NOT_KNOWN
    config["commits"] = begun if begun[-1:] == [now] else [*begun, now]
    write_whole(out / CONFIG, json.dumps(config, indent=2) + "\n")


def read_commits(out: Path) -> list[str]:
    """The commits that a run was at, one after another."""
    commits = json.loads((out / CONFIG).read_text()).get("commits")
    return [str(at) for at in commits] if isinstance(commits, list) and commits else [NOT_KNOWN]


def save_checkpoint(out: Path, state: dict) -> None:
    """Put a run's checkpoint in place of the last one."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_whole(out / CHECKPOINT, buffer.getvalue())


def load_checkpoint(checkpoint: Path, names: Sequence[str]) -> dict:
    """What is in a checkpoint by these names.

    Raises:
        BadArgument: If it cannot be read, or lacks one of them.
    """
    try:
        state = torch.load(checkpoint, weights_only=True)
        return {key: state[key] for key in names}
    except Exception as error:  # torch raises whatever the broken bytes lead to
        raise BadArgument(f"{checkpoint} is not a checkpoint that can be read: {error}") from error


def read_log(log: Path, last: int | None = None, *, counter: str = "iteration") -> list[dict]:
    """A run's log; a last line that was torn off is left out.

    Args:
        log: JSON lines as a run writes them.
        last: Only the rows up to this one. What came after a checkpoint is lost, and will come again.
        counter: The field that numbers them.

    Raises:
        BadArgument: If it cannot be read, or a line is not a row.
    """
    try:
        lines = log.read_text().splitlines()
    except (OSError, ValueError) as error:
        raise BadArgument(f"{log} cannot be read: {error}; put it back, or give another --out") from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
        except ValueError:
            if number == len(lines):
                break
            row = None
        if not isinstance(row, dict) or not isinstance(row.get(counter), int):
            raise BadArgument(f"{log}:{number} is not a row of a log; put it back as it was, or give another --out")
        rows.append(row)
    return rows if last is None else [row for row in rows if row[counter] <= last]


def read_whole_log(log: Path, last: int, *, counter: str = "iteration") -> list[dict]:
    """A run's log up to its checkpoint, with a row for each iteration.

    Args:
        log: JSON lines as a run writes them.
        last: The checkpoint's iteration.
        counter: The field that numbers them from 1.

    Raises:
        BadArgument: If it cannot be read, a line is not a row, or a row is missing.
    """
    rows = read_log(log, last, counter=counter)
    if [row[counter] for row in rows] != list(range(1, last + 1)):
        raise BadArgument(
            f"{log} does not have the rows of {counter} 1 to {last} that its checkpoint comes after; put it back as it "
            "was, or give another --out"
        )
    return rows


def write_log(log: Path, rows: Sequence[dict]) -> None:
    """The log again, with these rows."""
    write_whole(log, "".join(json.dumps(row) + "\n" for row in rows))


def _differences(old: object, new: object, at: str = "") -> list[str]:
    """Paths of what is not the same in two trees of JSON."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = sorted({*old, *new})
        return [d for key in keys for d in _differences(old.get(key), new.get(key), f"{at}.{key}".strip("."))]
    return [] if old == new else [at]
