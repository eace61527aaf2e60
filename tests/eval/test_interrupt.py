"""An evaluation that is told to end: real processes, an episode that takes for ever."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

SCRIPT = """
import functools, signal, sys
import eval.evaluate
from tests.eval import jobs
from vuca_nav.cli import main

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it is ignored
    eval.evaluate.evaluate = functools.partial(eval.evaluate.evaluate, job=getattr(jobs, sys.argv[2]))
    sys.exit(main(["eval", "smoke", "--seeds", "0:2", "--out", sys.argv[1], "--workers", "2", "--method", sys.argv[3]]))
"""


def is_alive(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)],
    ids=["SIGINT", "SIGTERM"],
)
def test_a_signal_to_the_parent_alone_ends_the_workers_and_keeps_the_rows(number, code, tmp_path):
    script, out = tmp_path / "script.py", tmp_path / "out"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, script, out, "episode_that_waits_on_seed_1", "dwa-dh"],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    rows = out / "episodes.jsonl"
    while process.poll() is None and not (rows.exists() and rows.read_bytes().count(b"\n") >= 4):
        time.sleep(0.05)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert len(children) >= 2
    process.send_signal(number)
    _, told = process.communicate(timeout=60.0)
    assert process.returncode == code, told
    assert f"4 of 8 episodes are in {out}; the same command goes on from there" in told
    assert "Traceback" not in told
    assert rows.read_bytes().count(b"\n") == 4
    deadline = time.monotonic() + 10.0
    while any(is_alive(child) for child in children):
        assert time.monotonic() < deadline, "workers outlive their parent"
        time.sleep(0.05)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="looks for processes in /proc")
def test_killed_with_two_workers_and_two_methods_it_goes_on_to_the_same_rows(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}

    def command(out: Path, job: str) -> list[str]:
        return [sys.executable, str(script), str(out), job, "dwa-dh,ours"]

    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(command(whole, "episode_by_hash"), env=environment, check=True, capture_output=True)
    process = subprocess.Popen(
        command(killed, "episode_that_waits_on_seed_1"), env=environment,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    rows = killed / "episodes.jsonl"
    while process.poll() is None and not (rows.exists() and rows.read_bytes().count(b"\n") >= 8):
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert rows.read_bytes().count(b"\n") == 8  # the first seed of both methods, none of the second
    subprocess.run(command(killed, "episode_by_hash"), env=environment, check=True, capture_output=True)
    for name in ("episodes.jsonl", "summary.json"):
        assert (killed / name).read_bytes() == (whole / name).read_bytes()
