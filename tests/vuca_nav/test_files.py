from pathlib import Path

import pytest

from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, write_whole


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
