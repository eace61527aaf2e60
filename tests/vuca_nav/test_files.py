import os
import subprocess
import sys
from pathlib import Path

import pytest

from vuca_nav.errors import BadArgument
from vuca_nav.files import DirectoryLock, prepare_directory, prepare_file, write_whole


@pytest.mark.parametrize(("data", "there"), [("grün\n", b"gr\xc3\xbcn\n"), (b"\x00\xff", b"\x00\xff")])
def test_a_file_is_written_over(tmp_path, data, there):
    path = tmp_path / "file.txt"
    path.write_text("something longer that was there before")
    write_whole(path, data)
    assert path.read_bytes() == there
    assert list(tmp_path.iterdir()) == [path]


def test_who_is_killed_while_writing_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "file.txt"
    path.write_text("old")

    def half(self, data):
        with open(self, "wb") as file:
            file.write(data[:2])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, "new")
    assert path.read_text() == "old"


def test_a_directory_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BadArgument, match="is a file, expected a directory"):
        prepare_directory(tmp_path / "file")
    for path in (tmp_path / "file" / "run", Path("/proc/run")):
        with pytest.raises(BadArgument, match="cannot be written"):
            prepare_directory(path)
    prepare_directory(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_a_link_is_followed_to_a_file_that_is_not_there_yet(tmp_path):
    link, file = tmp_path / "link.png", tmp_path / "pictures" / "file.png"
    link.symlink_to(Path("pictures") / "file.png")
    prepare_file(link)
    assert link.is_symlink()
    assert not file.exists()
    write_whole(link, b"picture")
    assert link.is_symlink()
    assert file.read_bytes() == b"picture"


def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadArgument, match="is a pipe or a device, expected a file"):
        prepare_file(tmp_path / "pipe")  # to open it would wait for a reader
    with pytest.raises(BadArgument, match="is a directory, expected a file"):
        prepare_file(tmp_path)
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(BadArgument, match="cannot be written"):
        prepare_file(tmp_path / "loop")
    with pytest.raises(OSError, match="no regular file"):
        write_whole(tmp_path / "pipe", "text")


def test_a_name_that_is_not_utf_8_can_stand_in_a_text(tmp_path):
    write_whole(tmp_path / "page.md", "of " + os.fsdecode(b"room-\xff.yaml"))
    assert (tmp_path / "page.md").read_text() == "of room-\\udcff.yaml"


def test_a_full_disk_leaves_the_old_file_and_its_name_in_the_error(tmp_path, small_files):
    path = tmp_path / "file.txt"
    path.write_text("old")
    with small_files(100), pytest.raises(OSError, match=r"file\.txt") as raised:
        write_whole(path, "x" * 1000)
    assert raised.value.filename == str(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


LOCK = """
import sys
from pathlib import Path
from vuca_nav.files import DirectoryLock
DirectoryLock(Path(sys.argv[1]), "vuca train")
"""


def test_a_directory_has_one_writer(tmp_path):
    lock = DirectoryLock(tmp_path, "vuca train")
    with pytest.raises(BadArgument, match="is being written by another vuca train"):
        DirectoryLock(tmp_path, "vuca train")
    assert subprocess.run([sys.executable, "-c", LOCK, tmp_path], capture_output=True, check=False).returncode == 1
    lock.release()
    DirectoryLock(tmp_path, "vuca train").release()
    assert list(tmp_path.iterdir()) == []
