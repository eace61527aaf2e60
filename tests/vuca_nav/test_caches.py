import logging
import os
import pwd

import pytest

from vuca_nav.caches import cache_folder, read_sealed, write_sealed


@pytest.fixture(autouse=True)
def own_places(monkeypatch, tmp_path):
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)


def without_home(monkeypatch):
    def unknown(_):
        raise KeyError

    monkeypatch.delenv("HOME")
    monkeypatch.setattr(pwd, "getpwuid", unknown)


def test_the_folder_is_the_users_own_cache(monkeypatch, tmp_path):
    assert cache_folder("things") == tmp_path / "home" / ".cache" / "vuca-nav" / "things"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder("things") == tmp_path / "xdg" / "vuca-nav" / "things"
    assert cache_folder("things", str(tmp_path / "mine")) == tmp_path / "mine" / "vuca-nav" / "things"
    assert (tmp_path / "mine" / "vuca-nav" / "things").is_dir()


def test_without_a_home_or_with_one_that_cannot_be_written_it_is_under_the_temporary_folder(monkeypatch, tmp_path):
    own = tmp_path / "tmp" / f"vuca-nav-{os.getuid()}" / "things"
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    assert cache_folder("things", str(tmp_path / "file")) == own
    without_home(monkeypatch)
    assert cache_folder("things") == own
    assert own.parent.stat().st_mode & 0o777 == 0o700


def test_a_temporary_folder_that_others_can_write_is_not_used(monkeypatch, tmp_path):
    without_home(monkeypatch)
    own = tmp_path / "tmp" / f"vuca-nav-{os.getuid()}"
    own.mkdir()
    own.chmod(0o777)
    assert cache_folder("things") is None
    own.rmdir()
    own.symlink_to(tmp_path)
    assert cache_folder("things") is None


def test_what_is_sealed_is_read_back(tmp_path):
    path = tmp_path / "new" / "entry"
    assert read_sealed(path) is None
    write_sealed(path, b"content")
    assert read_sealed(path) == b"content"
    assert [file.name for file in path.parent.iterdir()] == ["entry"]
    write_sealed(path / "below a file", b"")  # cannot be written: only costs time


@pytest.mark.parametrize(
    "damage", [lambda data: b"", lambda data: data[:-1], lambda data: data[:-3] + b"X" + data[-2:]]
)
def test_a_damaged_file_is_named_once_and_counts_as_not_there(tmp_path, caplog, damage):
    path = tmp_path / "entry"
    write_sealed(path, b"content")
    path.write_bytes(damage(path.read_bytes()))
    with caplog.at_level(logging.WARNING):
        assert read_sealed(path) is None
        assert read_sealed(path) is None
    assert [record.getMessage() for record in caplog.records] == [f"{path} is damaged; it is made again"]
    write_sealed(path, b"content")
    assert read_sealed(path) == b"content"
