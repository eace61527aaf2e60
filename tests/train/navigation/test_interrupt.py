"""Training by several processes of which one dies, or whose parent is told to end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SMALL = "--worlds 8 --horizon 4 --minibatch 32 --epochs 1 --layouts 2 --pairs 4 --hidden 16 --critic 16 --steps 999999"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize(
    ("to_worker", "number", "code", "told"),
    [
        (False, signal.SIGINT, 130, "--resume goes on from the checkpoint in"),
        (False, signal.SIGTERM, 143, "--resume goes on from the checkpoint in"),
        (True, signal.SIGKILL, 2, "vuca train: a worker process died"),
    ],
    ids=["interrupt", "terminate", "killed worker"],
)
def test_no_worker_is_left_and_the_run_can_go_on(to_worker, number, code, told, tmp_path):
    command = [sys.executable, "-m", "vuca_nav.cli", "train", "go-straight", "--out", str(tmp_path), "--workers", "2"]
    with (tmp_path / "told").open("w") as file:
        process = subprocess.Popen(
            [*command, *SMALL.split()], env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
            stdout=subprocess.DEVNULL, stderr=file, start_new_session=True,
        )  # fmt: skip
    checkpoint = tmp_path / "go-straight" / "checkpoint.pt"
    while process.poll() is None and not checkpoint.exists():
        time.sleep(0.1)
    workers = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert len(workers) == 2
    os.kill(int(workers[0]) if to_worker else process.pid, number)
    assert process.wait(timeout=60.0) == code
    text = (tmp_path / "told").read_text()
    assert told in text
    assert "Traceback" not in text
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)
