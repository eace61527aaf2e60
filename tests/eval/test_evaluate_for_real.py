"""Real episodes, real processes, a real kill."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eval.metrics import TIMING_FIELDS

COMMAND = [sys.executable, "-m", "vuca_nav.cli", "eval", "smoke", "--method", "ours-dh,move_base", "--episodes", "4"]
EPISODES = 4


def rows_of(out: Path) -> list[dict]:
    rows = [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]
    return [{key: value for key, value in row.items() if key not in TIMING_FIELDS} for row in rows]


def run(out: Path, workers: int) -> list[dict]:
    subprocess.run([*COMMAND, "--out", str(out), "--workers", str(workers)], check=True, capture_output=True)
    return rows_of(out)


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_workers_and_kills_change_nothing(tmp_path):
    alone = run(tmp_path / "alone", workers=1)
    assert len(alone) == EPISODES
    assert run(tmp_path / "pair", workers=2) == alone

    killed = tmp_path / "killed"
    process = subprocess.Popen(
        [*COMMAND, "--out", str(killed), "--workers", "2"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    rows = killed / "episodes.jsonl"
    while process.poll() is None and not (rows.exists() and rows.read_bytes().count(b"\n") >= 1):
        time.sleep(0.05)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert 1 <= rows.read_bytes().count(b"\n") < EPISODES
    assert not (killed / "summary.json").exists()
    deadline = time.monotonic() + 10.0
    while any(is_alive(int(pid)) for pid in children):
        assert time.monotonic() < deadline, "workers outlive their killed parent"
        time.sleep(0.05)
    assert run(killed, workers=2) == alone
