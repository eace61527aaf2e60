"""Which code made a result."""

import hashlib
import os
import subprocess
from pathlib import Path


def commit() -> str | None:
    """Of the checkout we run from; None if we run from none, or without git.

    If it was changed since: ``-dirty-`` and a hash of the changes, so that two changed trees are told apart; files that
    git does not know of are not looked at. An installed package may lie in somebody else's checkout, in a virtual
    environment there for example.
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


def _git(directory: Path, *arguments: str) -> bytes | None:
    try:
        result = subprocess.run(["git", *arguments], cwd=directory, capture_output=True, check=False)
    except FileNotFoundError:
        return None
    return result.stdout.strip() or None
