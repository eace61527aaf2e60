"""Data files: what is no regular file, too large or no text is refused at once."""

import os
import socket

import pytest

from vuca_nav.data_files import parse_json, read_bytes, read_json, read_text, shown
from vuca_nav.errors import BadArgument, BadWeights


def test_a_file_is_read_whole(tmp_path):
    (tmp_path / "a").write_bytes(bytes(range(256)) * 10_000)
    assert read_bytes(tmp_path / "a", 3_000_000, BadArgument) == bytes(range(256)) * 10_000
    with pytest.raises(BadArgument, match="is larger than 1 MiB, which is the most"):
        read_bytes(tmp_path / "a", 2**20, BadArgument)


def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a socket's path must be short
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        for name, message in (
            ("pipe", "pipe is a pipe; the path of a regular file"),
            ("/dev/zero", "/dev/zero is a device"),
            ("socket", "socket "),
            (".", "Is a directory"),
            ("none", "No such file"),
            ("none/below", "No such file"),
            ("a" * 5000, "File name too long"),
            ("nul\0", "'nul.x00' cannot be read: embedded null byte"),
        ):
            with pytest.raises(BadWeights, match=message):
                read_bytes(name, 100, BadWeights)


def test_a_text_is_utf_8_with_or_without_a_mark(tmp_path):
    file = tmp_path / "a"
    file.write_bytes(b"\xef\xbb\xbfr\xc3\xa4um")
    assert read_text(file, BadArgument) == "räum"
    for content, message in (
        (b"a\xff", r"not a text in UTF-8 \(byte 1\)"),
        (b"\xff\xfea\0", r"not a text in UTF-8 \(byte 0\)"),
        (b"ab\0", "not a text: byte 2 is NUL"),
    ):
        file.write_bytes(content)
        with pytest.raises(BadArgument, match=message):
            read_text(file, BadArgument)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100_000, "nested too deeply"),
        ('{"a": 1, "a": 2}', "the key 'a' a second time"),
        ("[NaN]", "NaN is not a number of JSON"),
        ("[-Infinity]", "-Infinity is not a number"),
        ("9" * 5000, "not JSON: "),
        ("", "not JSON: "),
        ("{'a': 1}", "not JSON: "),
    ],
)
def test_what_is_no_json_is_refused(text, message, tmp_path):
    with pytest.raises(BadArgument, match=f"source: .*{message}") as caught:
        parse_json(text, "source", BadArgument)
    assert "\n" not in str(caught.value)
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(BadArgument, match=r"a\.json: "):
        read_json(tmp_path / "a.json", BadArgument)


def test_json_is_read(tmp_path):
    (tmp_path / "a.json").write_text('{"a": [1, 2.5, null, "é"]}')
    assert read_json(tmp_path / "a.json", BadArgument) == {"a": [1, 2.5, None, "é"]}


def test_a_message_shows_a_short_line():
    assert shown("räum 1") == "räum 1"
    assert shown("a\x1b[2J\nb") == "a\\x1b[2J\\nb"
    assert shown("a" * 100) == "a" * 57 + "..."
    assert shown("\ud800") == "\\ud800"
