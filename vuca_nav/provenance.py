"""The code that made a result, and its machine."""

import hashlib
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "mujoco", "dm-control", "torch")
"""Libraries that compute, of which a machine is recorded with those that are installed."""


class Commit(NamedTuple):
    """The commit that this code is at, or why it is not known."""

    name: str | None
    reason: str | None


def commit() -> str | None:
    """Commit of the checkout that this code runs from; None if it is not known, see ``find_commit``."""
    return find_commit().name


def find_commit() -> Commit:
    """Commit of the checkout that this code runs from, or the reason why it is not known.

    A changed tree adds ``-dirty-`` and a hash of the changes, so that two changed trees differ; untracked files are
    ignored. An installed package may lie in the checkout of another project, in a virtual environment for example,
    and git's variables (``GIT_DIR``, as set in a hook) may name another repository: neither is taken for ours.
    """
    root = Path(__file__).resolve().parents[1]
    try:
        top = Path(os.fsdecode(_git(root, "rev-parse", "--show-toplevel")))
        if top.resolve() != root:
            return Commit(None, f"{root} is not the top of a git checkout, but lies in that of another project, {top}")
        _git(root, "ls-files", "--error-unmatch", os.path.relpath(Path(__file__).resolve(), root))
        name = _git(root, "describe", "--always", "--dirty", "--abbrev=12").decode()
        if not name.endswith("-dirty"):
            return Commit(name, None)
        changes = _git(root, "diff", "--no-ext-diff", "--no-textconv", "--full-index", "HEAD")
    except OSError as error:
        return Commit(None, f"git does not run: {error.strerror}")
    except subprocess.CalledProcessError as error:
        lines = error.stderr.decode(errors="replace").strip().splitlines() or [f"exit code {error.returncode}"]
        return Commit(None, f"git in {root}: {lines[0]}")
    return Commit(f"{name}-{hashlib.sha256(changes).hexdigest()[:12]}", None)


def usable_cores() -> int:
    """Number of processor cores that this process may use; macOS tells only how many there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """The machine that this process runs on.

    CPU model, number of its cores, operating system, C library, Python version, NumPy's BLAS, and the versions of the
    libraries that compute.
    """
    import numpy as np  # late: a command that only helps does without

    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count() or 1,
        "os": platform.platform(),
        "libc": " ".join(platform.libc_ver()).strip() or "unknown",
        "python": platform.python_version(),
        "blas": f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip(),
        "libraries": {name: found for name in LIBRARIES if (found := version_of(name)) is not None},
    }


def version_of(package: str) -> str | None:
    """Version of an installed package; None if there is none."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _cpu_model() -> str:
    """CPU model, from /proc on Linux and from Python elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine()


def _git(directory: Path, *arguments: str) -> bytes:
    """Output of git in a checkout, whoever owns it: code of this checkout is running already.

    No variable of git's and no configuration of the user's or the machine's has a say.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment |= {"GIT_CONFIG_NOSYSTEM": "1", "GIT_CONFIG_GLOBAL": os.devnull, "LC_ALL": "C"}
    settings = ("-c", f"safe.directory={directory}", "-c", "core.fsmonitor=false")
    command = ["git", *settings, *arguments]
    return subprocess.run(command, cwd=directory, env=environment, capture_output=True, check=True).stdout.strip()
