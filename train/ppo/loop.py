"""The training loop: checkpoints, log, TensorBoard, progress bar, curves and the page of the weights."""

import contextlib
import copy
import json
import math
import sys
import threading
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from train.ppo.run_directory import RunDirectory, read_log
from vuca_nav.errors import BadArgument

Report = dict[str, Any]
"""A row of the log: numbers, which are also plotted, and other JSON values."""


class Learner(Protocol):
    """Interface of a learner that a loop trains."""

    def restart(self) -> None:
        """Begin new episodes, as at every checkpoint; a function of the iteration alone."""
        ...

    def iterate(self, progress: float) -> Report:
        """Make one iteration, at this share of the training, 0-1."""
        ...

    def state(self) -> dict:
        """State that the next iteration depends on: tensors, numbers and text; borrowed."""
        ...

    def load(self, state: dict) -> None:
        """Restore such a state."""
        ...


AnyLearner = TypeVar("AnyLearner", bound=Learner)


class TrainingLoop(ABC, Generic[AnyLearner]):
    """A run that can be interrupted and resumed.

    Args:
        name: Name of the policy that is trained.
        directory: Directory of checkpoint, log, curves and weights.
    """

    save_every: ClassVar[int] = 1
    """Iterations between checkpoints."""
    unit: ClassVar[str] = "step"
    save_on_interrupt: ClassVar[bool] = False
    """Save the last whole iteration when interrupted from the keyboard: for learners whose state goes on through it."""

    def __init__(self, name: str, directory: RunDirectory):
        self.name, self.directory = name, directory

    @property
    @abstractmethod
    def weights(self) -> Path:
        """File of the weights that the run ends with; its page is beside it."""

    @property
    @abstractmethod
    def steps(self) -> int:
        """Number of steps of the whole training; rounded up to whole iterations."""

    @property
    def steps_per_iteration(self) -> int:
        """Number of steps of one iteration."""
        return 1

    @property
    def iterations(self) -> int:
        """Number of iterations of the whole training."""
        return math.ceil(self.steps / self.steps_per_iteration)

    @abstractmethod
    def start(self) -> None:
        """Make the learner, and ``train`` it, in this process or in workers."""

    @abstractmethod
    def export(self, learner: AnyLearner, done: int, elapsed: float) -> None:
        """Write the weights after so many iterations and seconds."""

    @abstractmethod
    def describe(self, done: int, elapsed: float, rows: list[Report]) -> None:
        """Draw the curves and write the page of the weights.

        Args:
            done: Number of iterations done.
            elapsed: Time that they took [s].
            rows: Rows of the log.
        """

    @abstractmethod
    def shown(self, report: Report) -> dict[str, str]:
        """Numbers of a report that the progress bar shows."""

    def begin(self, learner: AnyLearner) -> None:
        """Change the first weights of a run that begins."""

    def run(self) -> None:
        """Train until all steps are made.

        An interrupted run loses what it did since its last checkpoint.

        Raises:
            BadArgument: If checkpoint or log of a resumed run are damaged.
        """
        try:
            done, elapsed = self.directory.progress()
            if done < self.iterations:
                self.directory.note_commit()
                self.start()
            elif not self.weights.with_suffix(".md").exists():  # killed between the last checkpoint and the page
                self.describe(done, elapsed, read_log(self.directory.log))
        except KeyboardInterrupt:
            if self.directory.begun:
                print(f"\n{self.name}: --resume goes on from the checkpoint in {self.directory.path}", file=sys.stderr)
            raise
        finally:
            self.directory.release()

    def train(self, learner: AnyLearner, *, leads: bool = True) -> None:
        """Run all iterations that are left; one worker's part.

        Args:
            learner: The learner to be trained.
            leads: Whether this is the worker that writes.

        Raises:
            BadArgument: If the checkpoint does not fit the learner, or a file cannot be written.
            FloatingPointError: If the training diverged.
        """
        done, elapsed = 0, 0.0
        if self.directory.begun:
            state = self.directory.load()
            done, elapsed = state["done"], state["elapsed"]
            try:
                learner.load(state["learner"])
            except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
                path = self.directory.path
                raise BadArgument(f"the checkpoint in {path} does not fit the networks of this run: {error}") from error
        else:
            self.begin(learner)
        recorder = _Recorder(self, done) if leads else None
        whole = (copy.deepcopy(learner.state()), done, elapsed) if self.save_on_interrupt and leads else None
        try:
            while done < self.iterations:
                start = time.perf_counter()
                if done % self.save_every == 0:
                    learner.restart()
                report = learner.iterate(done * self.steps_per_iteration / self.steps)
                done, elapsed = done + 1, elapsed + time.perf_counter() - start
                if not all(math.isfinite(value) for value in report.values() if isinstance(value, float)):
                    raise FloatingPointError(f"training diverged at iteration {done}: {report}")
                if recorder is None:
                    continue
                if self.save_on_interrupt:
                    whole = copy.deepcopy(learner.state()), done, elapsed
                recorder.record(done, elapsed, report)
                if done % self.save_every == 0 or done == self.iterations:
                    self.export(learner, done, elapsed)  # the checkpoint last, as it says what is there
                    self.directory.save(learner.state(), done, elapsed)
        except KeyboardInterrupt:
            if whole is not None:
                self.directory.save(*whole)
            raise
        except OSError as error:  # a full disk
            where = error.filename or self.directory.path
            raise BadArgument(f"{where}: {error.strerror}; --resume goes on from the last checkpoint") from error
        finally:
            if recorder is not None:
                recorder.close()
        if leads:
            self.describe(done, elapsed, read_log(self.directory.log))


class _Recorder:
    """Log, TensorBoard and progress bar of a run."""

    def __init__(self, loop: TrainingLoop, done: int):
        loop.directory.cut_log(done)
        self._hook, threading.excepthook = threading.excepthook, _all_but_errors_of_the_disk
        self._loop, self._size = loop, loop.steps_per_iteration
        self._log = loop.directory.log.open("a", buffering=1)
        self._writer = SummaryWriter(str(loop.directory.path / "tensorboard"), purge_step=done * self._size)
        self._bar = tqdm(
            total=loop.iterations * self._size, initial=done * self._size, unit=loop.unit,
            unit_scale=self._size > 1, desc=loop.name,
        )  # fmt: skip

    def record(self, done: int, elapsed: float, report: Report) -> None:
        steps = done * self._size
        self._log.write(json.dumps({"iteration": done, "steps": steps, "seconds": round(elapsed, 2), **report}) + "\n")
        for key, value in report.items():
            if isinstance(value, float):
                self._writer.add_scalar(key, value, steps)
        self._bar.set_postfix(self._loop.shown(report), refresh=False)
        self._bar.update(self._size)

    def close(self) -> None:
        for part in (self._log, self._writer, self._bar):
            with contextlib.suppress(OSError):  # rows are on disk already; after a full disk the error is being raised
                part.close()
        threading.excepthook = self._hook


def _all_but_errors_of_the_disk(failed: threading.ExceptHookArgs) -> None:
    """Print what ended a thread, but for TensorBoard's complaint about a full disk, which the log reports."""
    if failed.exc_type is None or not issubclass(failed.exc_type, OSError):
        threading.__excepthook__(failed)
