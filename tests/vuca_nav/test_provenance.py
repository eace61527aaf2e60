import os
import subprocess
import sys

from vuca_nav.provenance import commit, machine


def git(directory, *arguments):
    command = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *arguments]
    subprocess.run(command, cwd=directory, check=True, capture_output=True)


def test_the_commit_is_ours_not_that_of_a_repository_around_us(tmp_path, monkeypatch):
    git(tmp_path, "init")
    package = tmp_path / "vuca_nav"
    package.mkdir()
    (package / "provenance.py").write_text("")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "first")
    monkeypatch.setattr("vuca_nav.provenance.__file__", str(package / "provenance.py"))
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
    installed = tmp_path / ".venv" / "lib" / "site-packages" / "vuca_nav"
    installed.mkdir(parents=True)
    monkeypatch.setattr("vuca_nav.provenance.__file__", str(installed / "provenance.py"))
    assert commit() is None


def test_a_machine_has_a_name_and_cores():
    told = machine()
    assert str(told["cpu"]).strip()
    assert told["cores"] == os.cpu_count()
    assert told["python"] == ".".join(map(str, sys.version_info[:3]))
