"""The code that made a result, and its machine."""

import hashlib
import os
import platform
import subprocess
from pathlib import Path


def commit() -> str | None:
    """Commit of the checkout that this code runs from; None if it runs from none, or without git.

    A changed tree adds ``-dirty-`` and a hash of the changes, so that two changed trees differ; untracked files are
    ignored. An installed package may lie in the checkout of another project, in a virtual environment for example.
    """
    root = Path(__file__).resolve().parents[1]
    top = _git(root, "rev-parse", "--show-toplevel")
    if top is None or Path(os.fsdecode(top)).resolve() != root:
        return None
    name = _git(root, "describe", "--always", "--dirty", "--abbrev=12")
    if name is None or not name.endswith(b"-dirty"):
        return None if name is None else name.decode()
    changes = _git(root, "diff", "--no-ext-diff", "--no-textconv", "--full-index", "HEAD") or b""
    return f"{name.decode()}-{hashlib.sha256(changes).hexdigest()[:12]}"


def machine() -> dict[str, str | int]:
    """The machine that this process runs on: CPU model, number of its cores, operating system, Python version."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count() or 1,
        "os": platform.platform(),
        "python": platform.python_version(),
    }


def _cpu_model() -> str:
    """CPU model, from /proc on Linux and from Python elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine()


def _git(directory: Path, *arguments: str) -> bytes | None:
    try:
        result = subprocess.run(["git", *arguments], cwd=directory, capture_output=True, check=False)
    except FileNotFoundError:
        return None
    return result.stdout.strip() or None
