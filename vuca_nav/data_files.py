"""Data files read with suspicion: regular files only, of bounded size; text in UTF-8; JSON with every key once.

Nothing that is read here can run code, hang, or ask for more memory than a few times its limit. Each reader takes the
class of the errors that it raises, for what is wrong with a scene is not what is wrong with weights.
"""

import errno
import json
import os
import stat
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from vuca_nav.errors import VucaError

MOST_TEXT = 16 * 2**20
"""Greatest size of a text file [bytes]: a scene file of 10,000 obstacles has 2 MB."""
_CHUNK = 2**20
"""Bytes read at a time."""
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def read_bytes(path: str | Path, most: int, wrong: type[VucaError]) -> bytes:
    """Read a regular file as a whole; a pipe or a device is refused without waiting for it.

    Args:
        path: Path of the file.
        most: Greatest size that is taken [bytes].
        wrong: Class of the errors.

    Raises:
        VucaError: Of the class ``wrong``: if there is no such file, it is not a regular one, is too large, or cannot
            be read.
    """
    content = bytearray()
    try:
        file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            mode = os.fstat(file).st_mode
            if stat.S_ISDIR(mode):
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            if not stat.S_ISREG(mode):
                kind = next((name for test, name in _KINDS if test(mode)), "something else")
                raise wrong(f"{path} is {kind}; the path of a regular file would be right")
            while len(content) <= most and (chunk := os.read(file, _CHUNK)):
                content += chunk
        finally:
            os.close(file)
    except OSError as error:
        raise wrong(f"{path} cannot be read: {error.strerror}; the path of a readable file would be right") from error
    except ValueError as error:  # a NUL in the path
        raise wrong(f"{str(path)!r} cannot be read: {error}; the path of a readable file would be right") from error
    if len(content) > most:
        raise wrong(f"{path} is larger than {most / 2**20:g} MiB, which is the most that is read of such a file")
    return bytes(content)


def read_text(path: str | Path, wrong: type[VucaError], most: int = MOST_TEXT) -> str:
    """Read a text file in UTF-8; a byte order mark is left out.

    Args:
        path: Path of the file.
        wrong: Class of the errors.
        most: Greatest size that is taken [bytes].

    Raises:
        VucaError: As by ``read_bytes``, and if the text is not UTF-8 or holds a NUL.
    """
    content = read_bytes(path, most, wrong)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise wrong(f"{path}: not a text in UTF-8 (byte {error.start})") from error
    if "\0" in text:
        raise wrong(f"{path}: not a text: byte {content.index(0)} is NUL")
    return text


def read_json(path: str | Path, wrong: type[VucaError]) -> Any:
    """Read a JSON file; raises as ``read_text`` and ``parse_json`` do."""
    return parse_json(read_text(path, wrong), str(path), wrong)


def parse_json(text: str, source: str, wrong: type[VucaError]) -> Any:
    """Parse JSON of an untrusted source.

    Args:
        text: The JSON text.
        source: Name of the source, which begins each message.
        wrong: Class of the errors.

    Raises:
        VucaError: Of the class ``wrong``: if the text is not JSON, is nested too deeply, gives a key twice, or holds
            NaN or an infinity, which Python would take.
    """
    try:
        return json.loads(text, object_pairs_hook=_once, parse_constant=_refuse)
    except RecursionError:
        raise wrong(f"{source}: not JSON that can be read: nested too deeply") from None
    except ValueError as error:
        raise wrong(f"{source}: not JSON: {error}") from None


def read_xml(path: str | Path, wrong: type[VucaError]) -> ElementTree.Element:
    """Read an XML file that declares no document type, so that no entity expands or names another file.

    Args:
        path: Path of the file.
        wrong: Class of the errors.

    Returns:
        The root element.

    Raises:
        VucaError: As by ``read_text``, and if the text is not XML, or declares a document type.
    """
    text = read_text(path, wrong)
    if "<!DOCTYPE" in text:  # the one place where XML declares entities
        raise wrong(f"{path} declares a document type; a description without one would be right")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise wrong(f"{path} is not XML: {error}") from error


def shown(value: object, most: int = 60) -> str:
    """A text of a file as a message may show it: short, in one line, without control characters."""
    text = str(value)
    text = text if text.isprintable() else ascii(text)[1:-1]
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these pairs; of two equal keys ``json`` silently takes the last."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        again = next(name for k, name in enumerate(names) if name in names[:k])
        raise ValueError(f"the key {shown(again)!r} a second time")
    return content


def _refuse(constant: str) -> None:
    """Raise for NaN and infinities, which are not JSON."""
    raise ValueError(f"{constant} is not a number of JSON")
