"""Processes beside the simulator: the deployed stack, and an idle loop to compare its timing with."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from vuca_nav.errors import VucaError

PATIENCE = 10.0
"""Time in which a process has to end after SIGTERM [s]; a loaded machine is slow."""
SIMULATED_CLOCK = ("--ros-args", "-p", "use_sim_time:=true")
"""Options by which a node takes its time from the topic clock."""
_DOMAINS = 100
"""Number of ROS domains to choose from: their ports are below those that systems give away."""


class StackEnded(VucaError):
    """The deployed stack has ended by itself."""


def own_domain() -> int:
    """A ROS domain that other processes of this machine are not likely to use."""
    return 1 + os.getpid() % _DOMAINS


class Deployment:
    """A ``vuca deploy`` in a process of its own. Use it as a context manager.

    Args:
        bundle: The bundle that it runs.
        options: Options of the command.
        domain: ROS domain.
        log: File that its messages go to.
    """

    def __init__(self, bundle: Path, options: Sequence[str], domain: int, log: Path):
        self.command = [sys.executable, "-m", "vuca_nav.cli", "deploy", str(bundle), *options]
        self.log = log
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("ab") as file:
            environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
            self._process = subprocess.Popen(
                self.command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, env=environment
            )
        self.pid = self._process.pid

    def __enter__(self) -> "Deployment":
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None):
        self.stop()

    @property
    def exit_code(self) -> int | None:
        """Its exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    def check(self) -> None:
        """See that it runs.

        Raises:
            StackEnded: If it does not.
        """
        if self.exit_code is not None:
            lines = self.log.read_text(errors="replace").strip().splitlines() or ["it said nothing"]
            raise StackEnded(f"vuca deploy has ended with exit code {self.exit_code}: {lines[-1]} ({self.log})")

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, if it still runs."""
        if self.exit_code is None:
            os.kill(self.pid, number)

    def stop(self) -> int:
        """End it by SIGTERM, and by SIGKILL if it does not; its exit code."""
        self.send(signal.SIGCONT)
        self.send(signal.SIGTERM)
        try:
            return self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.send(signal.SIGKILL)
            return self._process.wait()

    def memory(self) -> int:
        """Its resident memory [bytes]; 0 if it has ended."""
        try:
            fields = Path(f"/proc/{self.pid}/statm").read_text().split()
        except OSError:
            return 0
        return int(fields[1]) * os.sysconf("SC_PAGE_SIZE")


class IdleLoop:
    """A loop that does nothing at a rate, in a process of its own: what this machine's scheduler does to any loop.

    Args:
        rate: Its rate [Hz].
    """

    def __init__(self, rate: float):
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_idle, args=(rate, theirs), daemon=True)
        self._process.start()

    def __enter__(self) -> "IdleLoop":
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None):
        self._process.terminate()
        self._process.join()

    def take(self) -> list[float]:
        """Times between its ticks since the last call [s]."""
        self._ours.send(None)
        return self._ours.recv()


def _idle(rate: float, pipe: Connection) -> None:
    periods: list[float] = []
    before = deadline = time.perf_counter()
    while True:
        deadline = max(deadline + 1.0 / rate, time.perf_counter())
        time.sleep(max(deadline - time.perf_counter(), 0.0))
        now = time.perf_counter()
        periods.append(now - before)
        before = now
        if pipe.poll():
            pipe.recv()
            pipe.send(periods)
            periods = []
