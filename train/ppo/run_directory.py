"""The directory of a training run: its settings, its log, its checkpoint. It survives a kill."""

import io
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from vuca_nav.errors import BadArgument
from vuca_nav.files import DirectoryLock, prepare_directory, write_whole
from vuca_nav.provenance import find_commit

CHECKPOINT = "checkpoint.pt"
LOG = "log.jsonl"
CONFIG = "config.json"
NOTES = ("commits", "stage.about")
"""Keys of ``config.json`` that a run does not depend on."""
NOT_KNOWN = "not known"
"""Text in place of a commit, for a run that began before commits were noted, or away from a checkout."""


class RunDirectory:
    """Files of a run; one process writes them, from here to ``release``.

    Args:
        out: The directory; made if it is not there.
        contract: Settings that the run depends on, as JSON; kept in ``config.json``.
        resume: Go on with the run in ``out``, if there is one.

    Raises:
        BadArgument: If ``out`` holds a run and ``resume`` is not set, or a run of another contract, is written by
            another process, or cannot be written.
    """

    def __init__(self, out: Path, contract: dict, *, resume: bool):
        self.path, self.log = out, out / LOG
        self._checkpoint, self._config = out / CHECKPOINT, out / CONFIG
        contract = json.loads(json.dumps(contract))  # as it will be read back
        prepare_directory(out)
        self._lock = DirectoryLock(out, "vuca train")
        try:
            self._open(contract, resume)
        except BaseException:
            self.release()
            raise

    def release(self) -> None:
        """Let other processes write here."""
        self._lock.release()

    def _open(self, contract: dict, resume: bool) -> None:
        """Begin a run, or see that the one that is there can go on."""
        out = self.path
        if not self.begun:
            write_whole(self._config, json.dumps(contract, indent=2) + "\n")
            return
        if not resume:
            raise BadArgument(f"{out} holds a training run; go on with it by --resume, or give another --out")
        try:
            begun = json.loads(self._config.read_text())
        except (OSError, ValueError) as error:
            raise BadArgument(f"{self._config} cannot be read: {error}; give another --out") from error
        if not isinstance(begun, dict):
            raise BadArgument(
                f"{self._config} is not the configuration of a run, which is a JSON object; give another --out"
            )
        differing = [place for place in _differences(begun, contract) if place not in NOTES]
        if differing:
            raise BadArgument(f"{out} holds a run that differs in {', '.join(differing)}; give another --out")

    @property
    def begun(self) -> bool:
        """Whether there is a checkpoint."""
        return self._checkpoint.exists()

    @property
    def commits(self) -> list[str]:
        """Commits that the run was at, one after another."""
        commits = json.loads(self._config.read_text()).get("commits")
        return [str(at) for at in commits] if isinstance(commits, list) and commits else [NOT_KNOWN]

    def note_commit(self) -> None:
        """Note that the run goes on from here at the present commit."""
        config = json.loads(self._config.read_text())
        begun = self.commits if self.begun else []
        at = find_commit()
        now = at.name or NOT_KNOWN
        if at.reason is not None:
            print(f"the commit is not known: {at.reason}", file=sys.stderr)
        config["commits"] = begun if begun[-1:] == [now] else [*begun, now]
        write_whole(self._config, json.dumps(config, indent=2) + "\n")

    def progress(self) -> tuple[int, float]:
        """Iterations that are done, and the time they took [s]; the log has a row for each of them.

        Raises:
            BadArgument: If checkpoint or log are damaged.
        """
        if not self.begun:
            return 0, 0.0
        state = self.load()
        read_whole_log(self.log, state["done"])
        return state["done"], state["elapsed"]

    def save(self, learner: dict, done: int, elapsed: float) -> None:
        """Put a checkpoint in place of the last one.

        Args:
            learner: State of the learner: tensors, numbers and text only.
            done: Number of iterations done.
            elapsed: Time that they took [s].
        """
        buffer = io.BytesIO()
        torch.save({"learner": learner, "done": done, "elapsed": elapsed}, buffer)
        write_whole(self._checkpoint, buffer.getvalue())

    def load(self) -> dict:
        """Read the checkpoint that ``save`` wrote.

        Raises:
            BadArgument: If it cannot be read, or lacks a part.
        """
        try:
            state = torch.load(self._checkpoint, weights_only=True)
            return {key: state[key] for key in ("learner", "done", "elapsed")}
        except Exception as error:  # torch raises whatever the broken bytes lead to
            raise BadArgument(f"{self._checkpoint} is not a checkpoint that can be read: {error}") from error

    def cut_log(self, done: int) -> None:
        """Drop the rows of the log after a checkpoint: their iterations are lost, and will come again."""
        write_log(self.log, read_log(self.log, done) if done else [])


def read_log(log: Path, last: int | None = None) -> list[dict]:
    """Read a run's log; a last line that was torn off is left out.

    Args:
        log: JSON lines as a run writes them.
        last: Last row to read. Rows after a checkpoint are lost, and will come again.

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
        if not isinstance(row, dict) or not isinstance(row.get("iteration"), int):
            raise BadArgument(f"{log}:{number} is not a row of a log; put it back as it was, or give another --out")
        rows.append(row)
    return rows if last is None else [row for row in rows if row["iteration"] <= last]


def read_whole_log(log: Path, last: int) -> list[dict]:
    """Read a run's log up to its checkpoint, with a row for each iteration.

    Args:
        log: JSON lines as a run writes them.
        last: The checkpoint's iteration.

    Raises:
        BadArgument: If it cannot be read, a line is not a row, or a row is missing.
    """
    rows = read_log(log, last)
    if [row["iteration"] for row in rows] != list(range(1, last + 1)):
        raise BadArgument(
            f"{log} does not have the rows of iteration 1 to {last} that its checkpoint comes after; put it back as it "
            "was, or give another --out"
        )
    return rows


def write_log(log: Path, rows: Sequence[dict]) -> None:
    """Write the log again, with these rows."""
    write_whole(log, "".join(json.dumps(row) + "\n" for row in rows))


def _differences(old: object, new: object, at: str = "") -> list[str]:
    """Paths at which two trees of JSON differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = sorted({*old, *new})
        return [d for key in keys for d in _differences(old.get(key), new.get(key), f"{at}.{key}".strip("."))]
    return [] if old == new else [at]
