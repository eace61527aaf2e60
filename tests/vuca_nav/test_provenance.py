import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from vuca_nav.provenance import commit, find_commit, machine, usable_cores


def git(directory, *arguments):
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *arguments]
    subprocess.run(command, cwd=directory, check=True, capture_output=True)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A checkout with the package that asks for its commit."""
    checkout = tmp_path / "checkout"
    package = checkout / "vuca_nav"
    package.mkdir(parents=True)
    (package / "provenance.py").write_text("")
    git(checkout, "init")
    git(checkout, "add", ".")
    git(checkout, "commit", "-m", "first")
    monkeypatch.setattr("vuca_nav.provenance.__file__", str(package / "provenance.py"))
    return package


def test_the_commit_is_ours_not_that_of_a_repository_around_us(package, monkeypatch):
    first = commit()
    assert first is not None
    assert len(first) == 12
    dirty = []
    for change in (b"changed", b"changed again", b"\0 \xff binary", b"\0 \xfe binary", b"changed"):
        (package / "provenance.py").write_bytes(change)
        dirty.append(str(commit()))
    assert all(name.startswith(f"{first}-dirty-") for name in dirty)
    assert len(set(dirty)) == 4
    assert dirty[0] == dirty[-1]
    installed = package.parent / ".venv" / "lib" / "site-packages" / "vuca_nav"
    installed.mkdir(parents=True)
    monkeypatch.setattr("vuca_nav.provenance.__file__", str(installed / "provenance.py"))
    assert commit() is None
    assert "another project" in str(find_commit().reason)


def test_the_commit_is_ours_whatever_git_is_told_by_a_hook(package, tmp_path, monkeypatch):
    ours = commit()
    other = tmp_path / "other"
    other.mkdir()
    git(other, "init")
    git(other, "commit", "--allow-empty", "-m", "of another repository")
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    monkeypatch.setenv("GIT_WORK_TREE", str(other))
    monkeypatch.setenv("GIT_INDEX_FILE", str(other / ".git" / "index"))
    assert commit() == ours is not None


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_checkout_of_another_owner_tells_its_commit(package):
    ours = commit()
    for path in (package.parent, *package.parent.rglob("*")):
        os.chown(path, 65534, 65534)
    assert commit() == ours is not None


def test_what_is_not_known_has_its_reason(package, tmp_path, monkeypatch):
    untracked = package / "copy.py"
    untracked.write_text("")
    monkeypatch.setattr("vuca_nav.provenance.__file__", str(untracked))
    assert "copy.py" in str(find_commit().reason)
    away = tmp_path / "away" / "vuca_nav"
    away.mkdir(parents=True)
    monkeypatch.setattr("vuca_nav.provenance.__file__", str(away / "provenance.py"))
    assert "not a git repository" in str(find_commit().reason)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_commit() == (None, "git does not run: No such file or directory")


def test_cores_are_counted_where_there_is_no_affinity(monkeypatch):
    monkeypatch.delattr("os.sched_getaffinity", raising=False)  # as on macOS
    monkeypatch.setattr("os.cpu_count", lambda: 7)
    assert usable_cores() == 7


def test_a_machine_has_a_name_and_cores():
    told = machine()
    assert str(told["cpu"]).strip()
    assert told["cores"] == os.cpu_count()
    assert "blas" in told["blas"].lower() or "accelerate" in told["blas"].lower()
    assert told["libraries"]["numpy"] == np.__version__
    assert told["libraries"]["numba"] == numba.__version__
    assert told["python"] == ".".join(map(str, sys.version_info[:3]))
