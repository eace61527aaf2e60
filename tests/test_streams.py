"""Standard streams that are closed, full or narrow: what is not needed is done without, nothing is lost."""

import errno
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from vuca_nav.cli import main, show

ROOT = Path(__file__).parents[1]


def shell(command: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a shell's command in which ``vuca`` stands for the program."""
    spelled = command.replace("vuca", f"{sys.executable} -m vuca_nav.cli")
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", spelled], cwd=cwd, env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def test_a_run_goes_on_with_its_streams_closed(tmp_path, room):
    result = shell(f"vuca run --world {room} --method dwa-dh --json 2>&- <&-", tmp_path)
    assert result.returncode == 0
    assert json.loads(result.stdout.splitlines()[-1])["outcome"] == "success"


@pytest.mark.parametrize(
    ("command", "code", "told"),
    [
        ("vuca --version >&-", 0, []),
        ("vuca --version > /dev/full", 2, ["vuca --version: cannot write to stdout: No space left on device"]),
        ("vuca nonsense 2> /dev/full", 2, []),
        ("vuca --help | true", 0, []),
    ],
)
def test_streams_that_take_nothing(command, code, told, tmp_path):
    result = shell(command, tmp_path)
    assert (result.returncode, result.stdout, result.stderr.splitlines()) == (code, "", told)


class Full(io.StringIO):
    """A stream onto a full disk."""

    def flush(self) -> None:
        """Fail as the operating system does."""
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_result_that_stdout_does_not_take_is_on_stderr(monkeypatch, capsys):
    monkeypatch.setattr("eval.commands.list_", lambda _: show("an hour's work"))
    monkeypatch.setattr("sys.stdout", Full())
    assert main(["list"]) == 2
    lines = ["an hour's work", "vuca list: cannot write to stdout: No space left on device"]
    assert capsys.readouterr().err.splitlines() == lines


def test_names_that_the_terminal_does_not_know_are_escaped(monkeypatch):
    taken = io.BytesIO()
    monkeypatch.setattr("eval.commands.list_", lambda _: show(f"ä {os.fsdecode(bytes([255]))}"))
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(taken, encoding="ascii"))
    main(["list"])
    assert taken.getvalue() == b"\\xe4 \\udcff\n"


def test_progress_onto_a_full_disk_does_not_stop_the_work(monkeypatch):
    def list_(argv: list[str]) -> int:
        print("progress", file=sys.stderr, flush=True)
        return 0

    monkeypatch.setattr("eval.commands.list_", list_)
    monkeypatch.setattr("sys.stderr", Full())
    assert main(["list", "suites"]) == 0


def test_an_error_of_the_operating_system_is_one_line(monkeypatch, capsys):
    def list_(argv: list[str]) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), "results/summary.json")

    monkeypatch.setattr("eval.commands.list_", list_)
    assert main(["list", "suites"]) == 2
    assert capsys.readouterr().err == "vuca list: results/summary.json: Permission denied\n"
